"""How the orientation of a free body is written: quaternion or angles."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from .rotation import quaternion_matrix, quaternion_velocity, rotation_about

Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Attitude(gt.Model):
    """Base: coordinates of an orientation. Subclasses declare them and define rotation and angular velocity.

    Coordinates of one's own, roll, pitch and yaw, for the attitude of a free body:

    >>> from gtmodel.mechanics.rotation import rotation_about
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
    >>> R[:2, 0].round(3)  # where x of the body points
    array([0.866, 0.5  ])
    """

    def rotation(self) -> Any:
        """Rotation (3, 3) from body to world coordinates."""
        raise gt.ModelError("an Attitude must define rotation(); use UnitQuaternion, AnyQuaternion or ZYZAngles")

    def angular_velocity(self) -> Any:
        """Angular velocity (3,) [rad/s], world coordinates."""
        raise gt.ModelError("an Attitude must define angular_velocity()")


class UnitQuaternion(Attitude):
    """Quaternion e (4), scalar first; e.e = 1 is an ordinary equation. No orientation is singular.

    A FreeBody takes it unless another `attitude` is given. A rotation about z by 73.7 degrees: e[0] = 0.8 follows from
    the other three, on the side of its start value 1.

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
    """Quaternion e (4), scalar first, of any length but zero, with no equation of its own: for causalities in which
    e is known.

    The length of e has no effect on the rotation: here 60 degrees about z, with |e| = 2.

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

    Singular where the second is 0 or pi.

    With the second angle alone the body turns about y, and its z axis moves towards x:

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
