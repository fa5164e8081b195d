"""How the orientation of a free body is written: quaternion or angles."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from .rotation import quaternion_matrix, quaternion_velocity, rotation_about

Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Attitude(gt.Model):
    """Base: coordinates of an orientation. Subclasses declare them and say rotation and angular velocity."""

    def rotation(self) -> Any:
        """Rotation (3, 3) from body to world coordinates."""
        raise gt.ModelError("an Attitude must define rotation(); use UnitQuaternion, AnyQuaternion or ZYZAngles")

    def angular_velocity(self) -> Any:
        """Angular velocity (3,) [rad/s], world coordinates."""
        raise gt.ModelError("an Attitude must define angular_velocity()")


class UnitQuaternion(Attitude):
    """Quaternion e (4), scalar first; e.e = 1 is an ordinary equation. No orientation is singular."""

    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-2, description="quaternion, scalar first")

    def equations(self):
        yield gt.dot(self.e, self.e) == 1.0

    def rotation(self):
        return quaternion_matrix(self.e)

    def angular_velocity(self):
        return quaternion_velocity(self.e)


class AnyQuaternion(Attitude):
    """Quaternion e (4), scalar first, of any length but zero, with no equation of its own: for causalities in which
    e is known."""

    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-2, description="quaternion, scalar first")

    def rotation(self):
        return quaternion_matrix(self.e) / gt.dot(self.e, self.e)

    def angular_velocity(self):
        return quaternion_velocity(self.e) / gt.dot(self.e, self.e)


class ZYZAngles(Attitude):
    """Angles (3) about z, the new y and the new z (Dressler 2012, section 4.4).

    Singular where the second is 0 or pi.
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
