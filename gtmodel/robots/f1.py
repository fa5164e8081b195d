"""The F1 Gantry-Tau: three carts and three rotary axes move the plate in six degrees of freedom; also with ball
screws that drive the axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import quaternion_matrix, quaternion_of
from ..mechanics import BallScrew, MidpointRod, RigidPlate, RotationalTanhFriction, Shaft, TorqueMotor
from . import f1_geometry, links
from .cart import PointCart, behind_and_ahead, cart_friction
from .entries import printed
from .f1_geometry import F1FiveDof, F1Rotation, TiltingPlate, TurningPlate


class RotaryAxis(gt.Model):
    """A driven rotary axis with friction; the motor's inertia includes that of the parts it turns."""

    shaft = gt.port(Shaft)
    motor = gt.part(TorqueMotor)
    friction = gt.part(RotationalTanhFriction)

    def equations(self):
        yield gt.connect(self.shaft, self.motor.shaft)
        yield gt.connect(self.shaft, self.friction.shaft)


class F1(gt.Model):
    """Gantry-Tau with rotating joint plates on carts 2 and 3: axes q (6), plate pose T [m] and e, motors tau (6).

    q[0:3] are the carts [m], q[3:6] the rotary axes q4, q5, q6 [rad]; tau[0:3] are cart forces [N], tau[3:6] torques
    [N.m]. Dressler 2012, eqs. (4.16)-(4.24) and (4.34): the closure equation of link (i, j) is
    |T + R B_ij - A_ij(q)| = L_ij; the rows of A, B and L are in the order 1, 2a, 2b, 3a, 3b, 3c. The quaternions u are
    raw: their lengths scale the vectors they rotate. The plate's R = R(e), e of length 1, scalar first. z is vertical,
    along the guideways, and v points upwards: the plate hangs below the carts. Branch `below` of link 1 selects the
    root of arm 1, whose inverse kinematics is in closed form. Forward kinematics and arms 2 and 3 of the inverse are
    Newton blocks that continue from the home pose. If an arm has several inverse solutions, the result is the one on
    the straight line from home, or the one near a guess. e and -e are the same attitude and give the same result.
    Forward kinematics may end in another assembly mode than that of a commanded pose, with status OK.

    Change of the axes when the plate moves down from home by 0.1 m; the carts move along z:

    >>> robot = gt.robots.f1_gantry_tau()
    >>> ik = robot.causal(known=["T", "e"], targets="q")
    >>> q, status = ik([robot.home, robot.home - [0.0, 0.0, 0.1]], [robot.home_e] * 2)
    >>> print((q[1] - q[0]).round(3) + 0.0)
    [-0.101 -0.101 -0.101  0.     0.     0.   ]
    """

    A0 = gt.parameter(shape=(3, 3), unit="m", description="reference points of the carts at q = 0")
    v = gt.parameter(shape=(3, 3), unit="1", kind="direction", description="cart motion per q, not normalised")
    L = gt.parameter(shape=6, unit="m", positive=True, description="link lengths")
    A = gt.parameter(shape=(6, 3), unit="m", description="cart joints in the frames of their joint plates")
    B = gt.parameter(shape=(6, 3), unit="m", description="plate joints from T, plate coordinates")
    u1_2 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of S_2, scalar first")
    u1_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 1S_3, scalar first")
    u2_3 = gt.parameter(shape=4, unit="1", kind="direction", description="raw quaternion of 2S_3 in 1S_3, scalar first")
    r3 = gt.parameter(shape=3, unit="m", description="origin of 2S_3 in 1S_3")
    m_p = gt.parameter(unit="kg", positive=True, description="plate mass, joints and payload included")
    c_p = gt.parameter([0.0, 0.0, 0.0], unit="m", description="plate's centre of mass from T, plate coordinates")
    I_p = gt.parameter(
        shape=(3, 3),
        unit="kg.m2",
        kind="semidefinite",
        description="plate's inertia about its centre of mass, plate axes",
    )
    m_c = gt.parameter(shape=3, unit="kg", positive=True, description="cart masses, joint plates included")
    m_a = gt.parameter(np.zeros(6), unit="kg", min=0.0, description="link masses")
    J = gt.parameter(shape=3, unit="kg.m2", positive=True, description="inertias of the rotary axes about themselves")
    coulomb = gt.parameter([0.0, 0.0, 0.0], unit="N", min=0.0, description="Coulomb friction of each cart")
    viscous = gt.parameter([0.0, 0.0, 0.0], unit="kg/s", min=0.0, description="viscous friction of each cart")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="friction smoothing")
    home = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a reachable T")
    home_e = gt.parameter(
        [1.0, 0.0, 0.0, 0.0], unit="1", kind="unit", description="plate quaternion at home, with q4 = q5 = q6 = 0"
    )
    q = gt.variable(6, start=lambda self: _home_q(self), description="carts q1..q3 [m], rotary axes q4..q6 [rad]")
    T = gt.variable(3, unit="m", start=home, prefer=1, description="tool centre point, origin of the plate frame")
    e = gt.variable(4, unit="1", start=home_e, prefer=-2, description="plate quaternion, scalar first")
    R = gt.variable((3, 3), unit="1", prefer=-4, description="rotation from plate to world coordinates")
    tau = gt.input(6, nominal=100.0, description="motors: forces of the carts [N], torques of the rotary axes [N.m]")
    cart = gt.parts(
        3,
        PointCart,
        A=A0,
        v=v,
        m=m_c,
        friction=cart_friction,
    )
    axis = gt.parts(3, RotaryAxis, motor=lambda self: [dict(J=self.J[i]) for i in range(3)])
    turning = gt.part(TurningPlate, u=u1_2, A=lambda self: self.A[1:3])
    tilting = gt.part(TiltingPlate, u1=u1_3, u2=u2_3, r=r3, A=lambda self: self.A[3:6])
    link = gt.parts(6, MidpointRod, L=L, m=m_a)
    plate = gt.part(RigidPlate, m=m_p, c=c_p, I=I_p, B=B)

    def equations(self):
        yield gt.connect(self.cart[1].point, self.turning.mount)
        yield gt.connect(self.cart[2].point, self.tilting.mount)
        joints = [self.cart[0].point, *self.turning.point, *self.tilting.point]
        for k, (link, joint) in enumerate(zip(self.link, joints, strict=True)):
            yield gt.connect(link.a, joint)
            yield gt.connect(link.b, self.plate.point[k])
        shafts = [self.turning.shaft, *self.tilting.shaft]
        for i in range(3):
            yield self.q[i] == self.cart[i].flange.s
            yield self.tau[i] == self.cart[i].motor.force
            yield gt.connect(self.axis[i].shaft, shafts[i])
            yield self.q[3 + i] == shafts[i].phi
            yield self.tau[3 + i] == self.axis[i].motor.torque
        yield self.plate.frame.r == self.T
        yield self.e == self.plate.attitude.e
        yield self.plate.frame.R == self.R
        yield gt.branch("below", gt.dot(self.link[0].a.r - self.link[0].b.r, self.v[0]))


LINK_ENDS = [f"link[{k}].{end}.r" for k in range(6) for end in "ab"]


def link_guideways(robot: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return for each link its cart's reference point (6, 3) [m] and motion per q (6, 3), its length (6,) [m], and its
    plate joint (6, 3) [m] in plate coordinates."""
    rows = [arm for arm, links in enumerate(links.ROWS) for _ in links]
    A0, v, L, B = (np.array(getattr(robot, name), float) for name in ("A0", "v", "L", "B"))
    return A0[rows], v[rows], L, B


def _home_q(robot: Any) -> Any:
    """Return q at the home pose: carts above the plate from the first link of each arm, rotary axes at 0."""
    R = quaternion_matrix(robot.home_e)
    R12, R13, R23 = (quaternion_matrix(u) for u in (robot.u1_2, robot.u1_3, robot.u2_3))
    joints = [robot.A0[0], robot.A0[1] + R12 @ robot.A[1], robot.A0[2] + R13 @ (robot.r3 + R23 @ robot.A[3])]
    carts = [
        behind_and_ahead(robot.home + R @ robot.B[k] - joints[i], robot.v[i], robot.L[k])[1]
        for i, k in enumerate((0, 1, 3))
    ]
    return gt.vector([*carts, 0.0, 0.0, 0.0])


# No masses of the F1 are printed. EXAMPLE OF OURS, similar to the identified L1 (Dressler 2012, Table 6.3).
EXAMPLE = dict(
    m_p=12.0,
    I_p=np.diag([0.25, 0.25, 0.3]),
    m_c=np.array([15.0, 25.0, 40.0]),
    m_a=np.full(6, 1.5),
    J=np.array([0.5, 0.8, 0.4]),
    coulomb=np.array([130.0, 150.0, 200.0]),
    viscous=np.array([100.0, 200.0, 300.0]),
)
HOME = (-0.2, 2.3, 0.0)  # about the middle of the workspace, q = (0.72, 0.26, 0.21) m and small angles


def _geometry(name: str, parallel: bool) -> dict[str, Any]:
    """Return the geometry of a printed F1, or the parallel one near it, as parameters of F1 in metres."""
    if name != "f1":
        raise gt.ModelError(f"there is no F1 robot '{name}'; there is f1")
    geometry = f1_geometry.of_table(printed("gantry_tau.toml")[name])
    return f1_geometry.parallel(geometry) if parallel else geometry


def f1_gantry_tau(name: str = "f1", parallel: bool = False, **modifiers: Any) -> F1:
    """Return the F1 (Dressler 2012, Table 5.5) with raw quaternions; masses, inertias, friction: an example of ours.

    Repaired: the fourth component of 1u_2, printed as +0.7467, is -0.7467 here. As printed, the link clusters are
    151 mm away from parallel instead of 8 mm. `v` is printed only as 0.99, along z.

    Args:
        parallel: use a geometry of ours near the printed one, whose clusters are exact parallelograms if q4 = -q5.
        modifiers: any parameter of F1.

    Raises ModelError for an unknown name.

    Link lengths [m], printed and of the parallel geometry:

    >>> print(gt.robots.f1_gantry_tau().L.round(4))
    [1.9226 1.5019 1.5043 1.502  1.5012 1.5052]
    >>> print(gt.robots.f1_gantry_tau(parallel=True).L.round(4))
    [1.9226 1.5031 1.5031 1.5028 1.5028 1.5028]
    """
    geometry = _geometry(name, parallel)
    home_e = quaternion_of(f1_geometry.home_rotation(geometry)[0], positive="largest")
    return F1(**{**EXAMPLE, **geometry, "home": np.array(HOME), "home_e": home_e, **modifiers})


def f1_five_dof(name: str = "f1", parallel: bool = False, **modifiers: Any) -> F1FiveDof:
    """Return the closed-form kinematics of the F1 with q4 = -q5.

    Arguments as for `f1_gantry_tau`; modifiers: any parameter of F1FiveDof. From axes to position and back:

    >>> robot = gt.robots.f1_five_dof(parallel=True)
    >>> T, status = robot.causal(known="q", targets="T")([0.72, 0.26, 0.21, 0.1, 0.0])
    >>> q, status = robot.causal(known=["T", "angles"], targets="q")(T, [0.1, 0.0])
    >>> print(T.round(3), q.round(6))
    [-0.212  2.28  -0.016] [0.72 0.26 0.21 0.1  0.  ]
    """
    return F1FiveDof(**{**f1_geometry.five_dof(_geometry(name, parallel)), "home": np.array(HOME), **modifiers})


def f1_rotation(name: str = "f1", parallel: bool = False) -> F1Rotation:
    """Return the model of the rotary axes of the 5-DOF F1; arguments as for `f1_gantry_tau`.

    Angles to orientation and back:

    >>> five, rotation = gt.robots.f1_five_dof(), gt.robots.f1_rotation()
    >>> R, status = five.causal(known=["T", "angles"], targets="R")([0.2, -0.1])
    >>> angles, status = rotation.causal(known="R", targets="angles")(R)
    >>> print(angles.round(6))
    [ 0.2 -0.1]
    """
    geometry = _geometry(name, parallel)
    five = f1_geometry.five_dof(geometry)
    values = {k: five[k] for k in ("u1_3", "u2_3", "e_c")}
    return F1Rotation(**values, home_R=f1_geometry.home_rotation(geometry)[0])


class F1BallScrews(F1):
    """An F1 with all actuator coordinates in metres: s (6) [m], the carts q1..q3 and the travels of three ball screws.

    The screws turn q4, q5, q6. Dressler 2012, section 5.4, prints neither their equations nor their dimensions: those
    of BallScrew are an EXAMPLE OF OURS. The motors stay on the rotary axes, as in F1.

    `f1_ball_screws` builds it from the catalogue. Rotary axes [degrees] for 4 mm of the first screw, with two levers:

    >>> known = ([0.7, 0.26, 0.2, 0.004, 0.0, 0.0],)
    >>> for robot in gt.robots.f1_ball_screws(), gt.robots.f1_ball_screws(screw=dict(b=0.2)):
    ...     q, status = robot.causal(known="s", targets="q")(*known)
    ...     print(np.degrees(q[3:]).round(2) + 0.0)
    [2.49 0.   0.  ]
    [1.48 0.   0.  ]
    """

    s = gt.variable(6, unit="m", description="carts q1..q3, travels of the ball screws of q4..q6")
    screw = gt.parts(3, BallScrew)

    def equations(self):
        yield from super().equations()
        shafts = [self.turning.shaft, *self.tilting.shaft]
        for i, (screw, shaft) in enumerate(zip(self.screw, shafts, strict=True)):
            yield gt.connect(screw.shaft, shaft)
            yield self.s[i] == self.cart[i].flange.s
            yield self.s[3 + i] == screw.flange.s


def f1_ball_screws(name: str = "f1", parallel: bool = False, **modifiers: Any) -> F1BallScrews:
    """Return the F1 with ball screws; arguments as for `f1_gantry_tau`, modifiers of F1BallScrews.

    The dimensions of the screws are an example of ours (see BallScrew). Raises ModelError for an unknown name.

    Carts and travels of the screws [m] for the home pose:

    >>> robot = gt.robots.f1_ball_screws()
    >>> s, status = robot.causal(known=["T", "e"], targets="s")(robot.home, robot.home_e)
    >>> print(s.round(3))
    [ 0.719  0.262  0.208  0.    -0.005 -0.001]
    """
    robot = f1_gantry_tau(name, parallel)._modifiers
    return F1BallScrews(**{**robot, **modifiers})
