"""Bodies: point mass, rigid body on a frame, free rigid body with a quaternion or angles, and end-effector plate."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from ..geometry.expressions import quaternion_velocity as quaternion_velocity
from ..geometry.quaternions import quaternion_matrix as quaternion_matrix
from ..geometry.rotations import rotation_about as rotation_about
from .frames import Frame, PointFrame, World

Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Attitude(gt.Model):
    """Base class for coordinates of an orientation. Subclasses declare them and define rotation and angular velocity.

    A free body with its own attitude coordinates, roll, pitch and yaw:

    >>> from gtmodel.mechanics.bodies import rotation_about
    >>> class RollPitchYaw(gt.mechanics.Attitude):
    ...     angles = gt.variable(3, unit="rad", start=np.zeros(3), description="about x, y and z of the world, in turn")
    ...
    ...     def rotations(self):
    ...         return [rotation_about(np.eye(3)[k], self.angles[k]) for k in range(3)]
    ...
    ...     def rotation(self):
    ...         about_x, about_y, about_z = self.rotations()
    ...         return about_z @ about_y @ about_x
    ...
    ...     def angular_velocity(self):
    ...         (x, y, z), rate, (_, about_y, about_z) = np.eye(3), gt.der(self.angles), self.rotations()
    ...         return rate[0] * (about_z @ (about_y @ x)) + rate[1] * (about_z @ y) + rate[2] * z
    ...
    >>> body = gt.mechanics.FreeBody(m=2.0, I=np.eye(3), attitude=RollPitchYaw)
    >>> R, status = body.causal(targets="frame.R", prefer="attitude.angles")([0.0, 0.0, np.pi / 6])
    >>> R[:2, 0].round(3)  # direction of the body's x axis
    array([0.866, 0.5  ])
    """

    def rotation(self) -> Any:
        """Return the rotation (3, 3) from body to world coordinates."""
        raise gt.ModelError("an Attitude must define rotation(); use UnitQuaternion, AnyQuaternion or ZYZAngles")

    def angular_velocity(self) -> Any:
        """Return the angular velocity (3,) [rad/s] in world coordinates."""
        raise gt.ModelError("an Attitude must define angular_velocity()")


class UnitQuaternion(Attitude):
    """Quaternion e (4), scalar first, with the equation e.e = 1. No orientation is singular.

    It is the default `attitude` of a FreeBody. A rotation about z by 73.7 degrees: e[0] = 0.8 follows from the other
    three elements, with the sign of its start value 1.

    >>> body = gt.mechanics.FreeBody(m=2.0, I=np.eye(3), attitude=gt.mechanics.UnitQuaternion)
    >>> turn = body.causal(targets="frame.R", prefer=["frame.r", "attitude.e[1]", "attitude.e[2]", "attitude.e[3]"])
    >>> print([x.name for x in turn.inputs])
    ['attitude.e[1]', 'attitude.e[2]', 'attitude.e[3]']
    >>> R, status = turn(0.0, 0.0, 0.6)
    >>> R.round(3)
    array([[ 0.28, -0.96,  0.  ],
           [ 0.96,  0.28,  0.  ],
           [ 0.  ,  0.  ,  1.  ]])
    """

    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-2, description="quaternion, scalar first")

    def equations(self):
        yield gt.dot(self.e, self.e) == 1.0

    def rotation(self):
        return quaternion_matrix(self.e)

    def angular_velocity(self):
        return quaternion_velocity(self.e)


class AnyQuaternion(Attitude):
    """Quaternion e (4), scalar first, of any nonzero length, without a norm equation: for causalities with known e.

    The length of e has no effect on the rotation, here 60 degrees about z with |e| = 2.

    >>> bench = gt.Builder("bench")
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, I=np.eye(3), attitude=gt.mechanics.AnyQuaternion))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(body.frame, load.frame))
    >>> pose = bench.causal(known=["body.frame.r", "body.attitude.e"], targets="body.frame.R")
    >>> R, status = pose([np.sqrt(3.0), 0.0, 0.0, 1.0])
    >>> R.round(3)
    array([[ 0.5  , -0.866,  0.   ],
           [ 0.866,  0.5  ,  0.   ],
           [ 0.   ,  0.   ,  1.   ]])
    """

    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-2, description="quaternion, scalar first")

    def rotation(self):
        return quaternion_matrix(self.e) / gt.dot(self.e, self.e)

    def angular_velocity(self):
        return quaternion_velocity(self.e) / gt.dot(self.e, self.e)


class ZYZAngles(Attitude):
    """Angles (3) about z, the new y and the new z (Dressler 2012, section 4.4).

    Singular if the second angle is 0 or pi.

    The second angle alone turns the body about y, and its z axis towards x:

    >>> body = gt.mechanics.FreeBody(m=2.0, I=np.eye(3), attitude=gt.mechanics.ZYZAngles)
    >>> R, status = body.causal(targets="frame.R", prefer=["frame.r", "attitude.angles"])([0.0, np.pi / 6, 0.0])
    >>> R[:, 2].round(3)
    array([0.5  , 0.   , 0.866])
    """

    angles = gt.variable(3, unit="rad", start=[0.0, 1.0, 0.0], description="angles about z, y, z")

    def rotation(self):
        about_z, about_y, about_new_z = self._rotations()
        return about_z @ about_y @ about_new_z

    def angular_velocity(self):
        about_z, about_y, _ = self._rotations()
        rate = gt.der(self.angles)
        return rate[0] * Z + rate[1] * (about_z @ Y) + rate[2] * (about_z @ (about_y @ Z))

    def _rotations(self):
        return [rotation_about(n, self.angles[k]) for k, n in enumerate((Z, Y, Z))]


class PointMass(gt.Model):
    """A point mass m [kg] under gravity; frame.f = m (acceleration - g) is the force that other components exert [N].

    The load that holds up 3 kg and accelerates it by 1 m/s2 along x:

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
    """Rigid body under gravity: mass m [kg], centre of mass c [m] and inertia tensor I [kg m2], fixed to a frame.

    c and I are in frame coordinates, I about the centre of mass; its off-diagonal entries are the negative products of
    inertia, as in pinocchio and MuJoCo. The equations are Newton's and Euler's about the frame's origin. I must be
    symmetric and positive semidefinite. A principal moment may exceed the sum of the others, because planar models omit
    moments that have no effect and identified values scatter; the model remains passive.

    A body of 2 kg held level, with its centre of mass at 0.25 m along x from an axis along y. By the right-hand rule, a
    negative torque lifts it.

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
        """Return the force [N] and the torque about the frame's origin [N.m] that move the body, world coordinates."""
        R, w = self.frame.R, self.frame.w
        turn = gt.der(w)
        arm = R @ self.c
        force = self.m * (gt.der(self.frame.r, 2) + gt.cross(turn, arm) + gt.cross(w, gt.cross(w, arm)) - self.world.g)
        body_w, body_turn = w @ R, turn @ R
        torque = R @ (self.I @ body_turn + gt.cross(body_w, self.I @ body_w))
        return force, torque + gt.cross(arm, force)

    def energies(self):
        """Return the kinetic energy and the potential energy of gravity [J]."""
        R, w = self.frame.R, self.frame.w
        arm, body_w = R @ self.c, w @ R
        v = gt.der(self.frame.r) + gt.cross(w, arm)
        kinetic = self.m / 2 * gt.dot(v, v) + gt.dot(body_w, self.I @ body_w) / 2
        return kinetic, -self.m * gt.dot(self.world.g, self.frame.r + arm)


class LinkBody(gt.Model):
    """A rigid body on a frame with ten parameters in which its forces are linear, for identification.

    Mass m [kg], first moments mc = m c [kg m], and the entries J = (xx, xy, xz, yy, yz, zz) [kg m2] of the inertia
    tensor about the frame's origin, frame axes; off-diagonal entries are the negative products of inertia, as in URDF.
    It is under gravity and equals RigidBody with J = I + m (c.c 1 - c c'). Any values are accepted, because identified
    ones scatter.

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
        body_w, body_turn, inertia = w @ R, turn @ R, self.inertia()
        yield self.frame.f == self.m * pull + gt.cross(turn, arm) + gt.cross(w, gt.cross(w, arm))
        yield self.frame.t == R @ (inertia @ body_turn + gt.cross(body_w, inertia @ body_w)) + gt.cross(arm, pull)
        v = gt.der(self.frame.r)
        weight = gt.dot(self.world.g, self.m * self.frame.r + arm)
        kinetic = self.m * gt.dot(v, v) / 2 + gt.dot(v, gt.cross(w, arm)) + gt.dot(body_w, inertia @ body_w) / 2
        yield gt.energy(stored=kinetic)
        yield gt.energy(stored=-weight)

    def inertia(self):
        """Return the inertia (3, 3) about the frame's origin, frame axes [kg m2]."""
        xx, xy, xz, yy, yz, zz = (self.J[k] for k in range(6))
        return gt.vector([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class FreeBody(RigidBody):
    """A free rigid body with six degrees of freedom: position frame.r [m] and an orientation given by `attitude`.

    It defines the orientation of its frame. Rods and spherical joints may be connected to it, because they do not
    transmit orientation.

    Accelerations of frame.r and w of a body that falls and tumbles:

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


class RigidPlate(FreeBody):
    """A free rigid body with spherical joints for six links at the points B (6, 3) [m], plate coordinates.

    B is measured from the frame's origin, usually the tool centre point. A wrist or a tool may be connected to the
    frame. For another number of joints n, a subclass declares B = gt.parameter(shape=(n, 3), unit="m") and
    point = gt.ports(n, PointFrame).

    Position of the second joint of a plate at (0, 0, 1) m, rotated about z by the quaternion (0.8, 0, 0, 0.6):

    >>> B = 0.3 * np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0, 0], [-1, -1, 0], [0, -1, 0]])
    >>> plate = gt.mechanics.RigidPlate(m=12.0, I=np.diag([0.25, 0.25, 0.3]), B=B)
    >>> f = plate.causal(targets="point[1].r", prefer=["frame.r", "attitude.e[1]", "attitude.e[2]", "attitude.e[3]"])
    >>> r, status = f([0.0, 0.0, 1.0], 0.0, 0.0, 0.6)
    >>> r.round(6)
    array([-0.204,  0.372,  1.   ])
    """

    B = gt.parameter(shape=(6, 3), unit="m", description="joint centres, one row each, plate coordinates")
    point = gt.ports(6, PointFrame)

    def equations(self):
        for k, point in enumerate(self.point):
            yield point.r == self.frame.r + self.frame.R @ self.B[k]
        yield from super().equations()

    def inertial_wrench(self):
        force, torque = super().inertial_wrench()
        for k, point in enumerate(self.point):
            force = force - point.f
            torque = torque - gt.cross(self.frame.R @ self.B[k], point.f)
        return force, torque
