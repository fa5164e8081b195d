"""The Gantry-Tau with its three parallel-link clusters simplified to one link each; also on measured guideways."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import quaternion_matrix
from ..mechanics import ForceMotor, Guideway, MeasuredGuideway, MidpointRod, PointFrame, PointMass, TanhFriction
from .cart import cart_friction


class Arm(gt.Model):
    """One arm: a driven cart on a guideway and a link from the cart to the plate.

    Branch `ahead`: the plate is ahead of the cart along the guideway, dot(d, v) > 0.
    """

    A = gt.parameter(shape=3, unit="m", description="cart joint at q = 0")
    v = gt.parameter(shape=3, unit="1", kind="direction", description="guideway direction, not normalised")
    m_c = gt.parameter(unit="kg", min=0.0, description="cart mass")
    tip = gt.port(PointFrame)
    guideway = gt.part(Guideway, A=A, v=v)
    cart = gt.part(PointMass, m=m_c)
    rod = gt.part(MidpointRod)
    friction = gt.part(TanhFriction)
    motor = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.guideway.frame, self.cart.frame)
        yield gt.connect(self.guideway.frame, self.rod.a)
        yield gt.connect(self.rod.b, self.tip)
        yield gt.connect(self.motor.flange, self.guideway.flange)
        yield gt.connect(self.friction.flange, self.guideway.flange)
        yield gt.branch("ahead", gt.dot(self.rod.b.r - self.rod.a.r, self.v))


class GantryTau(gt.Model):
    """Three-link Gantry-Tau: carts q [m], tool centre point T [m], motor forces tau [N], positive along +v.

    Dressler 2012, eqs. (6.3)-(6.8), from components. Branch `plate_ahead`: the plate is ahead of the plane through the
    three cart joints, along the guideways; `arm[i].ahead` is the same for one cart.

    A custom machine with three guideways along x and links of 2 m: carts [m] and motor forces [N] at rest for a pose of
    the plate. A positive force pushes its cart along +v.

    >>> robot = gt.robots.GantryTau(
    ...     A=[[0.0, 0.0, 1.4], [0.0, -1.3, 1.4], [0.0, 0.0, 0.0]],
    ...     v=[[1.0, 0.0, 0.0]] * 3,
    ...     L=[2.0, 2.0, 2.0],
    ...     m_p=9.0,
    ...     m_c=[14.0, 14.0, 38.0],
    ...     home=[1.4, -0.5, 0.8],
    ... )
    >>> q, tau, status = robot.causal(known="T", targets=["q", "tau"])(robot.home, np.zeros(3), np.zeros(3))
    >>> print(q.round(3), tau.round(2))
    [-0.441 -0.332 -0.364] [-115.16    1.85  113.31]
    """

    A = gt.parameter(shape=(3, 3), unit="m", description="cart joints at q = 0, one row per arm")
    v = gt.parameter(shape=(3, 3), unit="1", kind="direction", description="guideway directions, one row per arm")
    L = gt.parameter(shape=3, unit="m", positive=True, description="link lengths")
    m_p = gt.parameter(unit="kg", positive=True, description="plate mass, joints and payload included")
    m_c = gt.parameter(shape=3, unit="kg", positive=True, description="cart masses, joints included")
    m_a = gt.parameter([0.0, 0.0, 0.0], unit="kg", min=0.0, description="masses of the link clusters")
    coulomb = gt.parameter([0.0, 0.0, 0.0], unit="N", min=0.0, description="Coulomb friction of each cart")
    viscous = gt.parameter([0.0, 0.0, 0.0], unit="kg/s", min=0.0, description="viscous friction of each cart")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="friction smoothing")
    home = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a reachable TCP position")
    q = gt.variable(3, unit="m", description="cart coordinates along their guideways")
    T = gt.variable(3, unit="m", start=home, prefer=1, description="tool centre point")
    tau = gt.input(3, unit="N", nominal=100.0, description="motor forces")
    arm = gt.parts(
        3,
        Arm,
        A=A,
        v=v,
        m_c=m_c,
        rod=lambda self: [dict(L=self.L[i], m=self.m_a[i]) for i in range(3)],
        friction=cart_friction,
    )
    plate = gt.part(PointMass, m=m_p)

    def equations(self):
        for i, arm in enumerate(self.arm):
            yield gt.connect(arm.tip, self.plate.frame)
            yield self.q[i] == arm.guideway.flange.s
            yield self.tau[i] == arm.motor.force
        yield self.T == self.plate.frame.r
        p = [arm.rod.a.r for arm in self.arm]
        normal = gt.cross(p[1] - p[0], p[2] - p[0])
        yield gt.branch("plate_ahead", gt.dot(self.T - p[0], normal) * gt.dot(normal, self.v[0]))


# arms on straight pieces in models 1 to 5; models 1 and 2 have three links, models 3 to 5 six
D1_MODELS = {1: (), 2: (0, 1, 2), 3: (), 4: (0, 1, 2), 5: (1,)}


LEAST = 0.5  # least travel along the guideway per travel of the cart; 1/LEAST is the greatest


class OnPoints(NamedTuple):
    """The robot, and the names of its measured guideways, such as "link[1].guideway"."""

    robot: Any
    guideways: list[str]


def on_measured_points(robot: Any, at: np.ndarray, points: Mapping[int, np.ndarray], u: np.ndarray) -> OnPoints:
    """Return the robot with some arms on straight pieces through measured cart points, eq. (5.7), the others unchanged.

    robot: GantryTau, one guideway per arm, or SixLink, one per link. `at` (n,) [m]: increasing cart coordinates.
    `points`: arm from 0 -> (n, 3) [m] in the recording's frame. `u` (4): orientation of that frame in the robot's, a
    quaternion, scalar first. The frame's origin is fitted to A + q v of each guideway, because the reflector is not at
    the joint. A calibration adjusts t and u of the named guideways, u as a unit quaternion.

    Raises ModelError for an unknown arm, points of the wrong shape, and points that do not move along v as q does.
    """
    A, v = np.array(robot.A, float), np.array(robot.v, float)
    stands_on = getattr(robot, "stands_on", tuple(range(len(A))))
    for arm, rows in points.items():
        if arm not in stands_on:
            raise gt.ModelError(f"there are cart points of arm {arm + 1}; the robot has {max(stands_on) + 1} arms")
        if np.shape(rows) != (len(at), 3):
            raise gt.ModelError(f"cart points of arm {arm + 1} have the shape {np.shape(rows)}; expected "
                                f"{(len(at), 3)}, one point per coordinate")  # fmt: skip
    R = quaternion_matrix(u)
    parts: list[Any] = []
    for k, arm in enumerate(stands_on):
        if arm in points:
            t = np.mean(A[k] + at[:, None] * v[k] - points[arm] @ R.T, axis=0)
            parts.append(MeasuredGuideway(at=at, points=points[arm], t=t, u=u))
            along = _along(np.asarray(at, float), np.asarray(points[arm]) @ R.T, v[k])
            if not LEAST <= along <= 1 / LEAST:
                raise gt.ModelError(f"cart points of arm {arm + 1} move {along:.3g} m along its guideway per metre of "
                                    "the cart; expected about 1: check their unit, their order and u")  # fmt: skip
        else:
            parts.append(Guideway)
    part = "link" if hasattr(robot, "stands_on") else "arm"
    names = [f"{part}[{k}].guideway" for k, arm in enumerate(stands_on) if arm in points]
    return OnPoints(robot.with_(**{part: [dict(guideway=g) for g in parts]}), names)


def _along(at: np.ndarray, points: np.ndarray, v: np.ndarray) -> float:
    """Return the slope along v of points (n, 3) [m] over at (n,) [m], in multiples of v; NaN if `at` is constant."""
    s = at - np.mean(at)
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(s @ (points @ v) / (s @ s) / (v @ v))
