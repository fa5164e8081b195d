"""The F1 with q4 = -q5: link clusters stay parallelograms, orientation and position part, everything is closed form."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import product, quaternion_matrix
from ..geometry.rotations import rotation_about
from .joint_plates import X, Y


class F1FiveDof(gt.Model):
    """Implicit 5-DOF kinematics of the F1 (Dressler 2012, eqs. (4.25), (4.26)): axes q (5), T [m], R and angles (2).

    q is q1, q2, q3 [m], q4 (= -q5) and q6 [rad]; angles is (q4, q6): the plate's turns about its own y and z, which no
    position changes. Each cluster is one link: rows of A, B and L are the means over the links of an arm, A in the
    frames of the joint plates as in F1. R = R(u1_3) Ry(q5) R(u2_3) Rx(q6) R(e_c), each divided by the squared length
    of its quaternion, so that R is a rotation; e is a unit quaternion of it. Exact where clusters are parallelograms
    (`f1_geometry.parallel`). On the printed set it is a start value for the 6-DOF Newton: up to 15 mm and 4 degrees off
    for angles of 17 degrees (eq. (4.32)) where q4 = -q5, up to 12 cm where these differ by 30 degrees. Branches as for
    three links: `arm_below[i]`, the plate joint below cart i, and `plate_below`, the plate below the plane through the
    three virtual cart joints.

    Known q4 and q6, the carts follow in closed form; q is q1, q2, q3 [m], q4, q6 [rad]:

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

    Known R (3, 3), a rotation; angles (q4, q6) [rad] follow by two arc tangents. `twist` [1] is 0 for an R that
    q4 = -q5 reaches, and otherwise measures how far R is from that: of the unit vector along the axis of q6, the y
    component in 1S_3, which q4 cannot change, minus that of the given R.

    The plate turned from its home by 0.1 rad about the world's z, which q4 = -q5 and q6 cannot do:

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
    twist = gt.variable(unit="1", description="how far R is out of reach")

    def equations(self):
        R13, R23, C = (quaternion_matrix(u) / gt.dot(u, u) for u in (self.u1_3, self.u2_3, self.e_c))
        axis = _column(R23)  # of q6, in 1S_3 at q4 = 0
        M = (_transposed(R13) @ self.R) @ _transposed(C)
        now = _column(M)
        # Ry(-q4) takes axis to now: angles in the plane of z and x
        yield self.angles[0] == gt.atan2(axis[0] * now[2] - axis[2] * now[0], axis[0] * now[0] + axis[2] * now[2])
        inner = _transposed(R23) @ (_transposed(rotation_about(Y, -self.angles[0])) @ M)
        yield self.angles[1] == gt.atan2(inner[2, 1] - inner[1, 2], inner[1, 1] + inner[2, 2])
        yield self.twist == axis[1] - now[1]


def _transposed(M):
    return gt.vector([[M[j, i] for j in range(3)] for i in range(3)])


def _column(M):
    return gt.vector([M[i, 0] for i in range(3)])
