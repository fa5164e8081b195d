"""Mechanical connectors, and the world with its gravity.

All connectors have the same sign convention: the flow of a port (force, torque) acts on the component that owns the
port. The flows of connected ports sum to zero, and flow times velocity is the power into the component.

Joint coordinates are preferred as states to those of connectors. The values of `prefer` are 0 for angles and travels,
-1 for w, -2 for quaternions, -3 for positions and -4 for rotation matrices.
"""

from __future__ import annotations

from typing import ClassVar

from .. import lang as gt


class PointFrame(gt.Connector):
    """A point: its position r [m] and the force f [N] that acts on the component there, both in world coordinates.

    A custom component with a point, a buoy that lifts the connected body with a constant force along z:

    >>> class Buoy(gt.Model):
    ...     lift = gt.parameter(unit="N")
    ...     point = gt.port(gt.mechanics.PointFrame)
    ...
    ...     def equations(self):
    ...         yield self.point.f == gt.vector([0.0, 0.0, -self.lift])
    ...
    >>> bench = gt.Builder("bench")
    >>> buoy = bench.part("buoy", Buoy(lift=50.0))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=4.0))
    >>> bench.add(gt.connect(buoy.point, mass.frame))
    >>> acceleration, status = bench.causal(targets="der(mass.frame.r,2)")()
    >>> acceleration.round(6)
    array([0.  , 0.  , 2.69])
    """

    r = gt.potential(3, unit="m", prefer=-3, description="position in the world frame")
    f = gt.flow(3, unit="N", description="force on the component")


class Frame(gt.Connector):
    """A frame fixed to a rigid body; all vectors in world coordinates.

    R (3, 3) rotates frame coordinates to world coordinates (its columns are the frame's axes), and w is the angular
    velocity, der(R) = w x R. The force f acts on the component at the frame's origin, and the torque t is about it.

    An arm of 0.5 m along x with a load of 10 N downwards at its end. The flows f and t at its mount act on the arm and
    hold it up.

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> arm = bench.part("arm", gt.mechanics.FixedTranslation(d=[0.5, 0.0, 0.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(ground.frame, arm.a), gt.connect(arm.b, load.frame))
    >>> f = bench.causal(known=["load.force", "load.torque"], targets=["arm.a.f", "arm.a.t"])
    >>> force, torque, status = f([0.0, 0.0, -10.0], np.zeros(3))
    >>> print(force + 0.0, torque + 0.0)
    [ 0.  0. 10.] [ 0. -5.  0.]
    """

    overdetermined: ClassVar[str] = (
        "the orientation R of a Frame has nine numbers for three degrees of freedom, so a closed loop of frames "
        "without a joint is overdetermined; remove a connection, or put a joint of gt.mechanics into the loop, or "
        "close it with rods or spherical joints, which transmit no orientation"
    )
    r = gt.potential(3, unit="m", prefer=-3, description="origin in the world frame")
    R = gt.potential(
        (3, 3), unit="1", prefer=-4, kind="rotation", description="rotation from frame to world coordinates"
    )
    w = gt.potential(3, unit="rad/s", prefer=-1, description="angular velocity, world coordinates")
    f = gt.flow(3, unit="N", description="force on the component, world coordinates")
    t = gt.flow(3, unit="N.m", description="torque on the component about the origin, world coordinates")


class Flange(gt.Connector):
    """A translational flange: coordinate s [m], and the force f [N] on the component in the direction of positive s.

    A custom component that pulls the connected flange towards positive s; the flow at its own flange is the reaction:

    >>> class Pull(gt.Model):
    ...     force = gt.parameter(unit="N", description="force on the connected flange, along positive s")
    ...     flange = gt.port(gt.mechanics.Flange)
    ...
    ...     def equations(self):
    ...         yield self.flange.f == -self.force
    ...
    >>> bench = gt.Builder("bench")
    >>> mass = bench.part("mass", gt.mechanics.Mass(m=4.0))
    >>> pull = bench.part("pull", Pull(force=20.0))
    >>> bench.add(gt.connect(mass.flange, pull.flange))
    >>> acceleration, status = bench.causal(targets="der(mass.flange.s,2)")()
    >>> print(acceleration)
    5.0
    """

    s = gt.potential(unit="m", description="coordinate along the axis")
    f = gt.flow(unit="N", description="force on the component")


class Shaft(gt.Connector):
    """A rotational flange: angle phi [rad], and the torque t [N.m] on the component in the direction of positive phi.

    A custom component with a shaft, an eccentric weight that hangs down at phi = 0 and needs a positive torque at a
    positive angle:

    >>> class Eccentric(gt.Model):
    ...     moment = gt.parameter(unit="N.m", description="weight times distance from the axis")
    ...     shaft = gt.port(gt.mechanics.Shaft)
    ...
    ...     def equations(self):
    ...         yield self.shaft.t == self.moment * gt.sin(self.shaft.phi)
    ...
    >>> bench = gt.Builder("bench")
    >>> eccentric = bench.part("eccentric", Eccentric(moment=3.0))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(eccentric.shaft, motor.shaft))
    >>> torque, status = bench.causal(known="motor.shaft.phi", targets="motor.torque")(np.pi / 6, 0.0, 0.0)
    >>> print(round(torque, 6))
    1.5
    """

    phi = gt.potential(unit="rad", description="angle about the axis")
    t = gt.flow(unit="N.m", description="torque on the component")


class World(gt.Model):
    """The gravitational acceleration g [m/s2] in world coordinates; the default points along -z.

    As a part of a model it sets the gravity of all bodies in the model; a model without it has the default.

    >>> bench = gt.Builder("on_the_moon")
    >>> world = bench.part("world", gt.mechanics.World(g=[0.0, 0.0, -1.62]))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> acceleration, status = bench.causal(targets="der(mass.frame.r,2)")()
    >>> acceleration
    array([ 0.  ,  0.  , -1.62])
    """

    g = gt.parameter([0.0, 0.0, -9.81], unit="m/s2", description="gravitational acceleration")
