"""Bodies: a point mass, a rigid body on a frame, and a rigid body that moves freely."""

from __future__ import annotations

from .. import lang as gt
from .attitude import UnitQuaternion
from .frames import Frame, PointFrame, World


class PointMass(gt.Model):
    """A point mass m [kg] under gravity."""

    m = gt.parameter(unit="kg", min=0.0, description="mass")
    frame = gt.port(PointFrame)
    world = gt.outer(World)

    def equations(self):
        r, v = self.frame.r, gt.der(self.frame.r)
        yield self.frame.f == self.m * (gt.der(r, 2) - self.world.g)
        yield gt.energy(stored=self.m * (gt.dot(v, v) / 2 - gt.dot(self.world.g, r)))


class RigidBody(gt.Model):
    """Mass m [kg], centre of mass c [m] and inertia tensor I [kg m2] under gravity, fixed to a frame.

    c and I are given in frame coordinates, I about the centre of mass; its off-diagonal entries are the negative
    products of inertia, as in pinocchio and MuJoCo. Newton and Euler for the frame's origin. I must be symmetric and
    positive semidefinite; that no principal moment exceeds the sum of the others is not asked for: planar models leave
    moments 0 that no motion needs, identified ones scatter, and the equations are passive all the same.
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
        yield gt.energy(stored=self.stored_energy())

    def inertial_wrench(self):
        """Force [N] and torque about the frame's origin [N.m] that move the body, world coordinates."""
        R, w = self.frame.R, self.frame.w
        turn = gt.der(w)
        arm = R @ self.c
        force = self.m * (gt.der(self.frame.r, 2) + gt.cross(turn, arm) + gt.cross(w, gt.cross(w, arm)) - self.world.g)
        own_w, own_turn = w @ R, turn @ R
        torque = R @ (self.I @ own_turn + gt.cross(own_w, self.I @ own_w))
        return force, torque + gt.cross(arm, force)

    def stored_energy(self):
        """Kinetic energy and potential energy of weight [J]."""
        R, w = self.frame.R, self.frame.w
        arm, own_w = R @ self.c, w @ R
        v = gt.der(self.frame.r) + gt.cross(w, arm)
        weight = gt.dot(self.world.g, self.frame.r + arm)
        return self.m * (gt.dot(v, v) / 2 - weight) + gt.dot(own_w, self.I @ own_w) / 2


class FreeBody(RigidBody):
    """A rigid body with six degrees of freedom of its own: position frame.r and orientation by `attitude`.

    It is a root: it says how its frame is oriented. Whatever hangs on it by rods or spherical joints leaves it so.
    """

    attitude = gt.part(UnitQuaternion)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.attitude.rotation() == self.frame.R
        yield self.attitude.angular_velocity() == self.frame.w
        yield from super().equations()
