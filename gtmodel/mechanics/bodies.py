"""Bodies: a point mass, a rigid body on a frame, and a rigid body that moves freely."""

from __future__ import annotations

from .. import lang as gt
from .attitude import UnitQuaternion
from .frames import Frame, PointFrame, World


class PointMass(gt.Model):
    """A point mass m [kg] under gravity: frame.f = m (acceleration - g) is the force that others exert on it [N].

    The load that holds 3 kg up and accelerates it by 1 m/s2 along x:

    >>> bench = gt.Builder("bench")
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(mass.frame, load.frame))
    >>> inverse = bench.causal(known="mass.frame.r", targets="load.force")
    >>> force, status = inverse(np.zeros(3), np.zeros(3), [1.0, 0.0, 0.0])
    >>> force.round(6)
    array([ 3.  ,  0.  , 29.43])
    """

    m = gt.parameter(unit="kg", min=0.0, description="mass")
    frame = gt.port(PointFrame)
    world = gt.outer(World)

    def equations(self):
        r, v = self.frame.r, gt.der(self.frame.r)
        yield self.frame.f == self.m * (gt.der(r, 2) - self.world.g)
        yield gt.energy(stored=self.m / 2 * gt.dot(v, v))
        yield gt.energy(stored=-self.m * gt.dot(self.world.g, r))


class RigidBody(gt.Model):
    """Mass m [kg], centre of mass c [m] and inertia tensor I [kg m2] under gravity, fixed to a frame.

    c and I are given in frame coordinates, I about the centre of mass; its off-diagonal entries are the negative
    products of inertia, as in pinocchio and MuJoCo. Newton and Euler for the frame's origin. I must be symmetric and
    positive semidefinite; a principal moment may exceed the sum of the others: planar models leave moments 0
    that no motion needs, identified ones scatter, and the equations are passive all the same.

    A body of 2 kg whose centre of mass is 0.25 m from an axis along y, held level: by the right-hand rule a negative
    torque lifts what stands out along x.

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> joint = bench.part("joint", gt.mechanics.Revolute(axis=[0.0, 1.0, 0.0]))
    >>> body = bench.part("body", gt.mechanics.RigidBody(m=2.0, c=[0.25, 0.0, 0.0], I=0.01 * np.eye(3)))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, joint.b, joint.shaft], [joint.a, body.frame, motor.shaft]))
    >>> inverse = bench.causal(known="joint.shaft.phi", targets="motor.torque")
    >>> torque, status = inverse(0.0, 0.0, 0.0)  # angle, velocity, acceleration
    >>> print(round(torque, 6))
    -4.905
    """

    m = gt.parameter(unit="kg", min=0.0, description="mass")
    c = gt.parameter([0.0, 0.0, 0.0], unit="m", description="centre of mass, frame coordinates")
    I = gt.parameter(
        shape=(3, 3), unit="kg.m2", kind="semidefinite", description="inertia about the centre of mass, frame axes"
    )
    frame = gt.port(Frame)
    world = gt.outer(World)

    def equations(self):
        force, torque = self.inertial_wrench()
        yield self.frame.f == force
        yield self.frame.t == torque
        for stored in self.energies():
            yield gt.energy(stored=stored)

    def inertial_wrench(self):
        """Force [N] and torque about the frame's origin [N.m] that move the body, world coordinates."""
        R, w = self.frame.R, self.frame.w
        turn = gt.der(w)
        arm = R @ self.c
        force = self.m * (gt.der(self.frame.r, 2) + gt.cross(turn, arm) + gt.cross(w, gt.cross(w, arm)) - self.world.g)
        own_w, own_turn = w @ R, turn @ R
        torque = R @ (self.I @ own_turn + gt.cross(own_w, self.I @ own_w))
        return force, torque + gt.cross(arm, force)

    def energies(self):
        """Kinetic energy, and potential energy of weight [J]."""
        R, w = self.frame.R, self.frame.w
        arm, own_w = R @ self.c, w @ R
        v = gt.der(self.frame.r) + gt.cross(w, arm)
        moving = self.m / 2 * gt.dot(v, v) + gt.dot(own_w, self.I @ own_w) / 2
        return moving, -self.m * gt.dot(self.world.g, self.frame.r + arm)


class LinkBody(gt.Model):
    """A rigid body on a frame by the ten numbers in which its forces are linear, for identification.

    Mass m [kg], first moments mc = m c [kg m] and inertia J = (xx, xy, xz, yy, yz, zz) [kg m2] about the frame's
    origin, frame axes, entries of the tensor: its off-diagonal entries are the negative products of inertia, as in
    URDF. Under gravity, as RigidBody with J = I + m (c.c 1 - c c'). Any numbers are taken: identified ones scatter.

    The body of RigidBody's example, 2 kg at 0.25 m from the axis:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> joint = bench.part("joint", gt.mechanics.Revolute(axis=[0.0, 1.0, 0.0]))
    >>> body = bench.part("body", gt.mechanics.LinkBody(m=2.0, mc=[0.5, 0.0, 0.0], J=[0.01, 0, 0, 0.135, 0, 0.135]))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, joint.b, joint.shaft], [joint.a, body.frame, motor.shaft]))
    >>> inverse = bench.causal(known="joint.shaft.phi", targets="motor.torque")
    >>> torque, status = inverse(0.0, 0.0, 0.0)
    >>> print(round(torque, 6))
    -4.905
    """

    m = gt.parameter(unit="kg", description="mass")
    mc = gt.parameter([0.0, 0.0, 0.0], unit="kg.m", description="mass times centre of mass, frame coordinates")
    J = gt.parameter(
        shape=6, unit="kg.m2", description="xx, xy, xz, yy, yz, zz of the inertia about the frame's origin"
    )
    frame = gt.port(Frame)
    world = gt.outer(World)

    def equations(self):
        R, w = self.frame.R, self.frame.w
        turn = gt.der(w)
        pull = gt.der(self.frame.r, 2) - self.world.g
        arm = R @ self.mc
        own_w, own_turn, inertia = w @ R, turn @ R, self.inertia()
        yield self.frame.f == self.m * pull + gt.cross(turn, arm) + gt.cross(w, gt.cross(w, arm))
        yield self.frame.t == R @ (inertia @ own_turn + gt.cross(own_w, inertia @ own_w)) + gt.cross(arm, pull)
        v = gt.der(self.frame.r)
        weight = gt.dot(self.world.g, self.m * self.frame.r + arm)
        moving = self.m * gt.dot(v, v) / 2 + gt.dot(v, gt.cross(w, arm)) + gt.dot(own_w, inertia @ own_w) / 2
        yield gt.energy(stored=moving)
        yield gt.energy(stored=-weight)

    def inertia(self):
        """Inertia (3, 3) about the frame's origin, frame axes [kg m2]."""
        xx, xy, xz, yy, yz, zz = (self.J[k] for k in range(6))
        return gt.vector([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class FreeBody(RigidBody):
    """A rigid body with six degrees of freedom of its own: position frame.r [m] and orientation by `attitude`.

    It defines the orientation of its frame. Rods and spherical joints may hang on it, since they pass no orientation
    on.

    It falls, and turning about no principal axis it tumbles: accelerations of frame.r and of w.

    >>> body = gt.mechanics.FreeBody(m=2.0, I=np.diag([0.1, 0.2, 0.25]))
    >>> fall = body.causal(targets=["der(frame.r,2)", "der(frame.w)"], prefer=["frame.r", "frame.w"])
    >>> a, turn, status = fall([1.0, 1.0, 0.0], 0.0, 0.0, 0.0)  # w, three of e
    >>> print(a + 0.0, turn.round(6) + 0.0)
    [ 0.    0.   -9.81] [ 0.   0.  -0.4]
    """

    attitude = gt.part(UnitQuaternion)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.attitude.rotation() == self.frame.R
        yield self.attitude.angular_velocity() == self.frame.w
        yield from super().equations()
