"""The KUKA KR 500-3 (R2830), an arm with six revolute joints, and its printed oscillators (Cvitanic 2021, Table 16)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import lang as gt
from ..mechanics import Fixed, FixedTranslation, Frame, FrameLoad, Ground, Revolute, TorqueMotor
from .entries import printed

FLANGE = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # Ry(90 deg)
WRIST = 3  # index of the first axis through the wrist centre


class ArmAxis(gt.Model):
    """One massless revolute axis at o from the previous frame; both frames are parallel at angle 0."""

    o = gt.parameter(shape=3, unit="m", description="origin of the axis, coordinates of the previous frame")
    axis = gt.parameter(shape=3, unit="1", kind="direction", description="direction of the axis")
    before = gt.port(Frame)
    after = gt.port(Frame)
    reach = gt.part(FixedTranslation, d=o)
    joint = gt.part(Revolute, axis=axis)
    motor = gt.part(TorqueMotor)

    def equations(self):
        yield gt.connect(self.before, self.reach.a)
        yield gt.connect(self.reach.b, self.joint.a)
        yield gt.connect(self.joint.b, self.after)
        yield gt.connect(self.joint.shaft, self.motor.shaft)


class SphericalWristArm(gt.Model):
    """Six revolute axes with a spherical wrist: angles q (6) [rad] as the controller shows them.

    T [m] and R are origin and orientation of the flange (its z axis points outwards), v [m/s] and w [rad/s] its linear
    and angular velocity, W [m] the wrist centre and v_W its velocity. The flange carries `load.force` [N] and
    `load.torque` [N.m], world coordinates. `tau` [N.m] are the motor torques that hold this load, tau = -J'F, with F
    the load at the flange (compliant joints deflect under +J'F). Links are massless: no masses are printed. `known="q"`
    with targets v and w gives the geometric Jacobian through der(q). `kinematics.postures` returns all branches of
    the inverse.

    Motor torques [N.m] that hold 100 N downwards at the flange of a KR 500-3 with its forearm level:

    >>> robot = gt.robots.kr500()
    >>> f = robot.causal(known=["q", "load.force", "load.torque"], targets=["T", "tau"])
    >>> q, rest = np.radians([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]), np.zeros(6)
    >>> T, tau, status = f(q, rest, rest, [0.0, 0.0, -100.0], np.zeros(3))
    >>> print(T.round(3), tau.round(1) + 0.0)
    [1.815 0.    2.29 ] [   0.  -131.5 -131.5    0.   -29.     0. ]
    """

    origins = gt.parameter(shape=(6, 3), unit="m", description="axis origins, each in the previous frame, at q = 0")
    axes = gt.parameter(shape=(6, 3), unit="1", kind="direction", description="axis directions at q = 0")
    R_flange = gt.parameter(
        FLANGE, unit="1", kind="rotation", description="rotation from flange to the last axis' frame"
    )
    q = gt.variable(6, unit="rad", start=np.zeros(6), prefer=1, description="joint angles")
    tau = gt.variable(6, unit="N.m", nominal=1000.0, description="torques of the motors on their joints")
    T = gt.variable(3, unit="m", description="origin of the flange")
    R = gt.variable((3, 3), unit="1", prefer=-4, description="rotation from flange to world coordinates")
    v = gt.variable(3, unit="m/s", description="velocity of T")
    w = gt.variable(3, unit="rad/s", prefer=-1, description="angular velocity of the flange, world coordinates")
    W = gt.variable(3, unit="m", description="wrist centre")
    v_W = gt.variable(3, unit="m/s", description="velocity of the wrist centre")
    ground = gt.part(Ground)
    link = gt.parts(6, ArmAxis, o=origins, axis=axes)
    flange = gt.part(Fixed, R=R_flange)
    load = gt.part(FrameLoad)

    @property
    def joint_limits(self) -> np.ndarray | None:
        """Joint limits (6, 2), lower and upper [rad]; None if they are unknown."""
        return None

    def equations(self):
        before = self.ground.frame
        for i, link in enumerate(self.link):
            yield gt.connect(before, link.before)
            yield self.q[i] == link.joint.shaft.phi
            yield self.tau[i] == link.motor.torque
            before = link.after
        yield gt.connect(before, self.flange.a)
        yield gt.connect(self.flange.b, self.load.frame)
        end, wrist = self.load.frame, self.link[WRIST].joint.a
        yield self.T == end.r
        yield self.R == end.R
        yield self.v == gt.der(end.r)
        yield self.w == end.w
        yield self.W == wrist.r
        yield self.v_W == gt.der(wrist.r)


class KR500(SphericalWristArm):
    """The KR 500-3 with its joint limits, for any calibrated geometry."""

    @property
    def joint_limits(self) -> np.ndarray:
        return kr500_limits()


def kr500(**modifiers: Any) -> KR500:
    """Return the KR 500-3 with its printed geometry. modifiers: any parameter of SphericalWristArm.

    Raises ModelError for an unknown parameter.

    Flange and wrist centre [m] of the outstretched arm, all angles 0:

    >>> robot = gt.robots.kr500()
    >>> T, W, status = robot.causal(known="q", targets=["T", "W"])(np.zeros(6))
    >>> print(T.round(3), W.round(3))
    [3.115 0.    0.99 ] [2.825 0.    0.99 ]
    """
    geometry = kr500_tables()["geometry"]
    values = {"origins": np.array(geometry["joint_origins_m"], float), "axes": np.array(geometry["joint_axes"], float)}
    return KR500(**{**values, **modifiers})


def kr500_limits() -> np.ndarray:
    """Return the joint limits (6, 2) of the KR 500-3, lower and upper [rad], from its data sheet.

    In degrees, as on the data sheet:

    >>> np.degrees(gt.robots.kr500_limits()).round()
    array([[-185.,  185.],
           [-130.,   20.],
           [-100.,  144.],
           [-350.,  350.],
           [-120.,  120.],
           [-350.,  350.]])
    """
    return np.deg2rad(np.array(kr500_tables()["geometry"]["limits_deg"], float))


def kr500_tables() -> dict[str, Any]:
    """Return the printed figures of the KR 500-3 (Cvitanic 2021) as nested tables; each key ends with its unit.

    The damping c_z of the milling tests is missing in print. The tables are shared: do not modify them.

    >>> tables = gt.robots.kr500_tables()
    >>> print(*sorted(tables))
    appendix_a closed_loop cutting fusion geometry milling_tests static_stiffness
    >>> print(tables["geometry"]["limits_deg"][0])
    [-185, 185]
    """
    return printed("kr500.toml")


NOTE = (
    "Table 16 has nine distinct rows, which are values of a regression and not its training data; its c_z repeats m_z, "
    "so zeta_z is taken as the mean of zeta_x and zeta_y"
)


@dataclass(frozen=True, eq=False)
class Table16Oscillators:
    """Distinct rows: poses (n, 4) in m and rad, m [kg], c [N.s/m], k [N/m] (n, 3); `tests`: numbers of each row."""

    poses: np.ndarray
    m: np.ndarray
    c: np.ndarray
    k: np.ndarray
    tests: tuple[tuple[int, ...], ...]
    note: str = NOTE
    name: str = "table_16"

    @property
    def fn(self) -> np.ndarray:
        """Natural frequencies (n, 3) [Hz]."""
        return np.sqrt(self.k / self.m) / (2 * np.pi)

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios (n, 3)."""
        return self.c / (2 * np.sqrt(self.k * self.m))


def table_16() -> Table16Oscillators:
    """Return each pose of Table 16 once, with c_z from zeta_z = (zeta_x + zeta_y) / 2."""
    table = kr500_tables()["milling_tests"]
    poses = np.column_stack([np.array(table["tcp_mm"]) / 1e3, np.deg2rad(table["angle_A_deg"])])
    m, c, k = np.array(table["m_kg"]), np.array(table["c_N_s_m"]), 1e6 * np.array(table["k_MN_m"])
    zeta = c / (2 * np.sqrt(k * m))
    c[:, 2] = zeta[:, :2].mean(axis=1) * 2 * np.sqrt(k[:, 2] * m[:, 2])
    rows: dict[tuple[float, ...], list[int]] = {}
    for test, row in enumerate(np.hstack([m, k]).tolist(), 1):
        rows.setdefault(tuple(row), []).append(test)
    first = [tests[0] - 1 for tests in rows.values()]
    return Table16Oscillators(poses[first], m[first], c[first], k[first], tuple(map(tuple, rows.values())))
