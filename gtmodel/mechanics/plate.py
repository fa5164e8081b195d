"""The end-effector plate: a free rigid body with joints at several points."""

from __future__ import annotations

from .. import lang as gt
from .bodies import FreeBody
from .frames import PointFrame


class RigidPlate(FreeBody):
    """A free rigid body with spherical joints at the points B (6, 3) [m], plate coordinates: six links pull there.

    Its frame is the plate's own; frame.r is the tool centre point where B is given from there, and a wrist or a tool
    may hang on it. For another number of joints n a subclass declares B = gt.parameter(shape=(n, 3), unit="m") and
    point = gt.ports(n, PointFrame).

    Its second joint, where the plate is at (0, 0, 1) m and turned about z by the quaternion (0.8, 0, 0, 0.6):

    >>> B = 0.3 * np.array([[1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0, 0], [-1, -1, 0], [0, -1, 0]])
    >>> plate = gt.mechanics.RigidPlate(m=12.0, I=np.diag([0.25, 0.25, 0.3]), B=B)
    >>> f = plate.causal(targets="point[1].r", prefer=["frame.r", "attitude.e[1]", "attitude.e[2]", "attitude.e[3]"])
    >>> r, status = f([0.0, 0.0, 1.0], 0.0, 0.0, 0.6)
    >>> r.round(6)
    array([-0.204,  0.372,  1.   ])
    """

    B = gt.parameter(shape=(6, 3), unit="m", description="joint centres, plate coordinates, one row each")
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
