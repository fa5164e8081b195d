"""Parameters of an F1 from its printed table, its rotating joint plates, and closed-form kinematics for q4 = -q5."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import product, quaternion_matrix, quaternion_of
from ..geometry.rotations import rotation_about, shortest_rotation
from ..mechanics import PointFrame, Shaft
from . import links

X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


class TurningPlate(gt.Model):
    """Joints of arm 2 of the F1 (Dressler 2012, eqs. (4.17), (4.21), (4.22)): two points that turn about y of S_2.

    point_j = mount + R(u) Ry(angle) A_j, in world coordinates. u is the calibrated quaternion, scalar first: its length
    is not 1 and scales A_j by |u|^2, so it must not be normalised. The angle [rad] is that of `shaft`, right-handed
    about the second column of R(u). The plate is massless; an inertia may be connected to the shaft.
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

    point_j = mount + R(u1) Ry(angle_1) (r + R(u2) Rx(angle_2) A_j). The angles [rad] are those of shaft[0] and
    shaft[1]; the quaternions are raw, as in TurningPlate.
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


class F1FiveDof(gt.Model):
    """Implicit 5-DOF kinematics of the F1 (Dressler 2012, eqs. (4.25), (4.26)): axes q (5), T [m], R and angles (2).

    q is q1, q2, q3 [m], q4 (= -q5) and q6 [rad]. angles is (q4, q6): rotations of the plate about its own y and z,
    independent of its position. Each cluster is one link: the rows of A, B and L are means over the links of an arm,
    with A in the frames of the joint plates as in F1. R = R(u1_3) Ry(q5) R(u2_3) Rx(q6) R(e_c), each factor divided by
    the squared length of its quaternion, so that R is a rotation; e is its unit quaternion. The model is exact if the
    clusters are parallelograms (`f1_geometry.parallel`). On the printed geometry it gives start values for the 6-DOF
    Newton iteration: up to 15 mm and 4 degrees off at angles of 17 degrees (eq. (4.32)) if q4 = -q5, and up to 12 cm if
    q4 and -q5 differ by 30 degrees. Branches as for three links: `arm_below[i]`, the plate joint is below cart i;
    `plate_below`, the plate is below the plane through the three virtual cart joints.

    The carts follow in closed form from T, q4 and q6; q is q1, q2, q3 [m], q4, q6 [rad]:

    >>> robot = gt.robots.f1_five_dof()
    >>> q, status = robot.causal(known=["T", "angles"], targets="q")(robot.home, [0.1, -0.05])
    >>> print(q.round(3))
    [ 0.744  0.278  0.229  0.1   -0.05 ]
    """

    A0 = gt.parameter(shape=(3, 3), unit="m", description="reference points of the carts at q = 0")
    v = gt.parameter(shape=(3, 3), unit="1", kind="direction", description="their motion per q, not normalised")
    L = gt.parameter(shape=3, unit="m", positive=True, description="link lengths, means of the clusters")
    A = gt.parameter(shape=(3, 3), unit="m", description="cart joints in their joint plates, means of the clusters")
    B = gt.parameter(
        shape=(3, 3), unit="m", description="plate joints from T, plate coordinates, means of the clusters"
    )
    u1_2 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of S_2, scalar first")
    u1_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 1S_3, scalar first")
    u2_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 2S_3 in 1S_3, scalar first")
    r3 = gt.parameter(shape=3, unit="m", description="origin of 2S_3 in 1S_3")
    e_c = gt.parameter(
        shape=4, unit="1", kind="direction", description="quaternion from plate to turned 2S_3, scalar first"
    )
    home = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a reachable T with q4 = q6 = 0")
    q = gt.variable(5, description="carts q1, q2, q3 [m], rotary axes q4 = -q5 and q6 [rad]")
    T = gt.variable(3, unit="m", start=home, prefer=1, description="tool centre point, origin of the plate frame")
    R = gt.variable((3, 3), unit="1", prefer=-4, description="rotation from plate to world coordinates")
    e = gt.variable(4, unit="1", prefer=-4, description="unit quaternion of R, scalar first")
    angles = gt.variable(2, unit="rad", start=[0.0, 0.0], prefer=1, description="q4 and q6")
    base = gt.variable((3, 3), unit="m", prefer=-4, description="cart joint less plate joint at q_i = 0, eq. (4.1)")

    def equations(self):
        q4, q6 = self.angles
        R12, R13, R23 = (quaternion_matrix(u) for u in (self.u1_2, self.u1_3, self.u2_3))
        turn, outer, inner = rotation_about(Y, q4), rotation_about(Y, -q4), rotation_about(X, q6)
        scale = gt.dot(self.u1_3, self.u1_3) * gt.dot(self.u2_3, self.u2_3) * gt.dot(self.e_c, self.e_c)
        yield self.R == (((R13 @ outer) @ R23) @ inner) @ (quaternion_matrix(self.e_c) / scale)
        about_y = gt.vector([gt.cos(q4 / 2), 0.0, -gt.sin(q4 / 2), 0.0])
        about_x = gt.vector([gt.cos(q6 / 2), gt.sin(q6 / 2), 0.0, 0.0])
        e = product(product(product(product(self.u1_3, about_y), self.u2_3), about_x), self.e_c)
        yield self.e == e / gt.sqrt(scale)
        joints = [self.A[0], R12 @ (turn @ self.A[1]), R13 @ (outer @ (self.r3 + R23 @ (inner @ self.A[2])))]
        for i in range(3):
            yield self.base[i] == self.A0[i] + joints[i] - self.R @ self.B[i]
            d = self.T - self.base[i] - self.q[i] * self.v[i]
            yield gt.dot(d, d) == self.L[i] ** 2
            yield gt.branch(f"arm_below[{i}]", -gt.dot(d, self.v[i]))
        yield self.q[3] == q4
        yield self.q[4] == q6
        p = [self.base[i] + self.q[i] * self.v[i] for i in range(3)]
        normal = gt.cross(p[1] - p[0], p[2] - p[0])
        yield gt.branch("plate_below", -gt.dot(self.T - p[0], normal) * gt.dot(normal, self.v[0]))


class F1Rotation(gt.Model):
    """Rotary axes of the 5-DOF F1 from the plate's orientation (Dressler 2012, f_ik,rot of eq. (4.25)).

    For a known rotation R (3, 3), two arc tangents give the angles (q4, q6) [rad]. `twist` [1] is 0 if q4 = -q5 and q6
    can reach R. Otherwise it measures the distance: the y component, in 1S_3, of the unit vector along the axis of q6,
    which q4 cannot change, minus the same component for R.

    The plate rotated from its home by 0.1 rad about the world's z, which q4 = -q5 and q6 cannot reach:

    >>> rotation = gt.robots.f1_rotation()
    >>> c, s = np.cos(0.1), np.sin(0.1)
    >>> R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation.home_R
    >>> angles, twist, status = rotation.causal(known="R", targets=["angles", "twist"])(R)
    >>> print(angles.round(3), round(twist, 3))
    [-0.001  0.001] 0.1
    """

    u1_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 1S_3, scalar first")
    u2_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 2S_3 in 1S_3, scalar first")
    e_c = gt.parameter(
        shape=4, unit="1", kind="direction", description="quaternion from plate to turned 2S_3, scalar first"
    )
    home_R = gt.parameter(np.eye(3), unit="1", kind="rotation", description="the plate's R at q4 = q6 = 0")
    R = gt.variable((3, 3), unit="1", start=home_R, description="rotation from plate to world coordinates")
    angles = gt.variable(2, unit="rad", start=[0.0, 0.0], description="q4 and q6")
    twist = gt.variable(unit="1", description="how far R is from the reachable rotations")

    def equations(self):
        R13, R23, C = (quaternion_matrix(u) / gt.dot(u, u) for u in (self.u1_3, self.u2_3, self.e_c))
        axis = _column(R23)  # of q6, in 1S_3 at q4 = 0
        M = (_transposed(R13) @ self.R) @ _transposed(C)
        turned = _column(M)  # by Ry(-q4); the angle is taken in the plane of z and x
        yield self.angles[0] == gt.atan2(
            axis[0] * turned[2] - axis[2] * turned[0], axis[0] * turned[0] + axis[2] * turned[2]
        )
        inner = _transposed(R23) @ (_transposed(rotation_about(Y, -self.angles[0])) @ M)
        yield self.angles[1] == gt.atan2(inner[2, 1] - inner[1, 2], inner[1, 1] + inner[2, 2])
        yield self.twist == axis[1] - turned[1]


def _transposed(M):
    return gt.vector([[M[j, i] for j in range(3)] for i in range(3)])


def _column(M):
    return gt.vector([M[i, 0] for i in range(3)])


Array = np.ndarray
Table = dict[str, Any]
QUATERNIONS = ("u1_2", "u1_3", "u2_3")


def of_table(table: Table) -> Table:
    """Return A0, v, L, A, B, u1_2, u1_3, u2_3 (raw) and r3 in metres from a table in millimetres."""
    v = np.array(table["v"], dtype=float)
    lengths = {n: np.array(table[key], dtype=float) / 1e3 for n, key in
               (("A0", "A0_mm"), ("L", "L_mm"), ("A", "A_bj_mm"), ("B", "B0_mm"), ("r3", "r3_mm"))}  # fmt: skip
    raw = {name: np.array(table[name], dtype=float) for name in QUATERNIONS}
    return {**lengths, **raw, "v": np.tile(v, (3, 1)) if v.ndim == 1 else v}


def home_rotation(f1: Table) -> tuple[Array, float]:
    """Return the plate's R (3, 3) at q4 = q5 = q6 = 0 that makes clusters closest to parallel, and the misfit [m]."""
    R12, R13, R23 = _rotations(f1, raw=True)
    turned = np.vstack([f1["A"][:1], f1["A"][1:3] @ R12.T, f1["A"][3:] @ (R13 @ R23).T])
    return links.orientation(turned, f1["B"])


def home(f1: Table) -> Array:
    """Return a T [m] that most machines reach: 0.7 link lengths below the virtual cart joints at q = 0."""
    R12, R13, R23 = _rotations(f1, raw=True)
    R, _ = home_rotation(f1)
    joints = [f1["A"][0], R12 @ f1["A"][1:3].mean(axis=0), R13 @ (f1["r3"] + R23 @ f1["A"][3:].mean(axis=0))]
    plate = [f1["B"][rows].mean(axis=0) for rows in links.ROWS]
    base = np.array([a + x - R @ b for a, x, b in zip(f1["A0"], joints, plate, strict=True)])
    v = f1["v"].mean(axis=0)
    return base.mean(axis=0) - 0.7 * f1["L"].mean() * v / np.linalg.norm(v)


def five_dof(f1: Table) -> Table:
    """Return the parameters of F1FiveDof without `home`: means over the clusters, and e_c from the fit at home."""
    _, R13, R23 = _rotations(f1)
    e_c = quaternion_of((R13 @ R23).T @ home_rotation(f1)[0], positive="largest")
    means = {k: np.array([f1[k][rows].mean(axis=0) for rows in links.ROWS]) for k in ("A", "B", "L")}
    return {**{k: f1[k] for k in ("A0", "v", "r3", *QUATERNIONS)}, **means, "e_c": e_c}


def parallel(f1: Table) -> Table:
    """Return a modified geometry (ours) near `f1` whose clusters are exact parallelograms whenever q4 = -q5.

    The links of a cluster get equal lengths, the axis of q4 becomes antiparallel to that of q5, the links of arm 2 are
    spread along the axis of q6, and the plate joints of a cluster copy its cart joints. Means over clusters are kept.
    """
    R12, R13, R23 = _rotations(f1)
    C = (R13 @ R23).T @ home_rotation(f1)[0]
    s12, s13, s23 = (float(f1[name] @ f1[name]) for name in QUATERNIONS)
    R12 = shortest_rotation(R12[:, 1], -R13[:, 1]) @ R12
    spread = np.linalg.norm(f1["A"][2] - f1["A"][1]) * np.array([[-0.5], [0.5]])
    A, B, L = (f1[k].copy() for k in "ABL")
    A[1:3] = A[1:3].mean(axis=0) + spread * (R12.T @ R13 @ R23[:, 0])
    B[1:3] = B[1:3].mean(axis=0) + s12 * spread * C[0]
    B[3:] = B[3:].mean(axis=0) + s13 * s23 * links.centred(A[3:]) @ C
    for rows in links.ROWS:
        L[rows] = L[rows].mean()
    return {**f1, "A": A, "B": B, "L": L, "u1_2": np.sqrt(s12) * quaternion_of(R12, positive="largest")}


def _rotations(f1: Table, raw: bool = False) -> list[Array]:
    us = [f1[name] for name in QUATERNIONS]
    return [np.array(quaternion_matrix(u), dtype=float) / (1.0 if raw else u @ u) for u in us]
