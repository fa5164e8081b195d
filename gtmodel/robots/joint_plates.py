"""Plates on a cart that carry spherical joints and turn: about one axis, or about two (F1 and T2)."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import quaternion_matrix
from ..geometry.rotations import rotation_about
from ..mechanics import PointFrame, Shaft

X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


class TurningPlate(gt.Model):
    """Joints of arm 2 of the F1 (Dressler 2012, eqs. (4.17), (4.21), (4.22)): two points that turn about y of S_2.

    point_j = mount + R(u) Ry(angle) A_j, all in world coordinates. u is a quaternion, scalar first, as calibrated: its
    length is not one and scales A_j by |u|^2; it must not be normalised. The angle [rad] is that of `shaft`, by the
    right-hand rule about the second column of R(u). Massless: an inertia may hang on the shaft.
    """

    u = gt.parameter(shape=4, unit="1", kind="direction", description="quaternion of S_2, scalar first, raw")
    A = gt.parameter(shape=(2, 3), unit="m", description="ball joints, coordinates of the turned S_2")
    mount = gt.port(PointFrame)
    shaft = gt.port(Shaft)
    point = gt.ports(2, PointFrame)

    def equations(self):
        R = quaternion_matrix(self.u)
        turn = rotation_about(Y, self.shaft.phi)
        force, torque = self.mount.f, self.shaft.t
        for k, point in enumerate(self.point):
            arm = turn @ self.A[k]
            yield point.r == self.mount.r + R @ arm
            force = force + point.f
            torque = torque + gt.dot(R @ gt.cross(Y, arm), point.f)
        yield force == np.zeros(3)
        yield torque == 0


class TiltingPlate(gt.Model):
    """Joints of arm 3 of the F1 (Dressler 2012, eqs. (4.18), (4.23), (4.24)): three points that turn about two axes.

    point_j = mount + R(u1) Ry(angle_1) (r + R(u2) Rx(angle_2) A_j). Angles [rad] are those of shaft[0] and shaft[1],
    quaternions raw as for TurningPlate.
    """

    u1 = gt.parameter(shape=4, unit="1", kind="direction", description="quaternion of 1S_3, scalar first, raw")
    u2 = gt.parameter(shape=4, unit="1", kind="direction", description="quaternion of 2S_3 in 1S_3, scalar first, raw")
    r = gt.parameter(shape=3, unit="m", description="origin of 2S_3 in 1S_3")
    A = gt.parameter(shape=(3, 3), unit="m", description="ball joints, coordinates of the turned 2S_3")
    mount = gt.port(PointFrame)
    shaft = gt.ports(2, Shaft)
    point = gt.ports(3, PointFrame)

    def equations(self):
        R1, R2 = quaternion_matrix(self.u1), quaternion_matrix(self.u2)
        outer, inner = rotation_about(Y, self.shaft[0].phi), rotation_about(X, self.shaft[1].phi)
        force, torques = self.mount.f, [s.t for s in self.shaft]
        for k, point in enumerate(self.point):
            inside = inner @ self.A[k]
            arm = outer @ (self.r + R2 @ inside)
            yield point.r == self.mount.r + R1 @ arm
            force = force + point.f
            torques[0] = torques[0] + gt.dot(R1 @ gt.cross(Y, arm), point.f)
            torques[1] = torques[1] + gt.dot(R1 @ (outer @ (R2 @ gt.cross(X, inside))), point.f)
        yield force == np.zeros(3)
        for torque in torques:
            yield torque == 0
