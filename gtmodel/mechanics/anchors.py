"""What stands still: the world's frame, fixed points and locked flanges."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, Frame, PointFrame, Shaft


class Ground(gt.Model):
    """The world frame: origin, axes of the world, no motion. It is the root of everything fixed to it; Fixed places
    frames elsewhere.

    The top of a tower of 2 m:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> tower = bench.part("tower", gt.mechanics.FixedTranslation(d=[0.0, 0.0, 2.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(ground.frame, tower.a), gt.connect(tower.b, load.frame))
    >>> r, R, status = bench.causal(known=["load.force", "load.torque"], targets=["load.frame.r", "load.frame.R"])()
    >>> print(r, np.array_equal(R, np.eye(3)))
    [0. 0. 2.] True
    """

    frame = gt.port(Frame)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.frame.r == np.zeros(3)
        yield np.eye(3) == self.frame.R
        yield self.frame.w == np.zeros(3)


class Anchor(gt.Model):
    """A point r [m] fixed in the world, for rods and spring-dampers.

    A mass of 3 kg at rest 1.2 m below the anchor: the spring is stretched by 0.2 m and pulls with 200 N, the load adds
    the rest of the balance, 29.43 N of weight less 200 N.

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor(r=[0.0, 0.0, 2.0]))
    >>> spring = bench.part("spring", gt.mechanics.SpringDamper(k=1000.0, length0=1.0))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, spring.a), gt.connect([spring.b, mass.frame], [mass.frame, load.frame]))
    >>> hold = bench.causal(known="mass.frame.r", targets=["spring.pull", "load.force"])
    >>> rest = np.zeros(3)
    >>> pull, force, status = hold([0.0, 0.0, 0.8], rest, rest)
    >>> print(round(pull, 6), force.round(6))
    200.0 [   0.      0.   -170.57]
    """

    r = gt.parameter([0.0, 0.0, 0.0], unit="m", description="position in the world frame")
    point = gt.port(PointFrame)

    def equations(self):
        yield self.point.r == self.r


class FixedFlange(gt.Model):
    """A flange that is held at s [m].

    A motor holds a spring at s = 0.02 m against a fixed flange at 0; its force is positive along s.

    >>> bench = gt.Builder("bench")
    >>> wall = bench.part("wall", gt.mechanics.FixedFlange(s=0.0))
    >>> spring = bench.part("spring", gt.mechanics.FlangeSpringDamper(k=1000.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(wall.flange, spring.a), gt.connect(spring.b, motor.flange))
    >>> hold = bench.causal(known="motor.flange.s", targets="motor.force")
    >>> force, status = hold(0.02, 0.0)  # position and velocity
    >>> print(round(force, 6))
    20.0
    """

    s = gt.parameter(0.0, unit="m", description="coordinate")
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.s == self.s


class FixedShaft(gt.Model):
    """A shaft that is held at the angle phi [rad].

    The motor that holds a torsional spring turned by 0.1 rad against a fixed shaft:

    >>> bench = gt.Builder("bench")
    >>> wall = bench.part("wall", gt.mechanics.FixedShaft(phi=0.0))
    >>> spring = bench.part("spring", gt.mechanics.ShaftSpringDamper(k=50.0))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(wall.shaft, spring.a), gt.connect(spring.b, motor.shaft))
    >>> hold = bench.causal(known="motor.shaft.phi", targets="motor.torque")
    >>> torque, status = hold(0.1, 0.0, 0.0)  # angle, velocity, acceleration
    >>> print(round(torque, 6))
    5.0
    """

    phi = gt.parameter(0.0, unit="rad", description="angle")
    shaft = gt.port(Shaft)

    def equations(self):
        yield self.shaft.phi == self.phi
