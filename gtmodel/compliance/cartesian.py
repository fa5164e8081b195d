"""A serial arm with joint springs: poses and Jacobians, stiffness at the tool from joint compliances, and the vertical
plane of the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.chains import postures
from ..geometry.rotations import rotation_about, within_pi
from ..kinematics import chain_of
from ..kinematics.section import SectionPlane
from ..lang import Model
from ..results import ArgumentError, Status
from ..view.space import RobotScene
from .options import ArmSprings, Load
from .sprung_links import ComplianceAtPoses
from .static_tests import StaticTests, at_tool


@dataclass(frozen=True, eq=False)
class ArmPoses:
    """n poses of an arm with k joints, in world coordinates.

    q (n, k) [rad]; tool centre point T (n, 3) [m] and its geometric Jacobian J (n, 6, k), linear rows [m] before
    angular ones; wrist centre W (n, 3) [m] with J_wrist (n, 3, k); origins of the joints (n, k, 3) [m]; rotation R (n,
    3, 3) of the flange.
    """

    q: np.ndarray
    T: np.ndarray
    J: np.ndarray
    W: np.ndarray
    J_wrist: np.ndarray
    origins: np.ndarray
    R: np.ndarray

    def tests(
        self,
        wrenches: ArrayLike,
        *,
        sigma: ArrayLike,
        wrist_sigma: float | None = None,
        K_c: np.ndarray | None = None,
    ) -> StaticTests:
        """Return planned tests at these poses under wrenches (n, 6) [N, N.m] at T, with zero displacements.

        sigma (6,): standard deviations of the displacement [m, rad]; wrist_sigma [m]: if the wrist centre has a
        separate target. Raises ValueError for wrong shapes.
        """
        n = len(self.q)
        wrenches = np.asarray(wrenches, float)
        return StaticTests(
            self.J,
            self.J_wrist,
            wrenches,
            np.zeros((n, 6)),
            np.tile(np.diag(np.broadcast_to(np.asarray(sigma, float), (6,)) ** 2), (n, 1, 1)),
            self.W - self.T,
            None if wrist_sigma is None else np.zeros((n, 3)),
            None if wrist_sigma is None else np.tile(wrist_sigma**2 * np.eye(3), (n, 1, 1)),
            K_c,
        )


def arm_poses(model: Any, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> ArmPoses:
    """Return tool centre point, Jacobians and wrist centre of a serial arm at joint angles q (n, k) [rad].

    model: an arm with angles q, variables T, R, v, w, W, v_W and parts link, such as `robots.SphericalWristArm`. tool
    (3,) [m]: tool centre point in flange coordinates. Raises ValueError for a pose at which the model cannot be
    evaluated.

    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), np.deg2rad([[0, -90, 90, 0, -60, 0]]), tool=[0.1, 0, 0.4])
    >>> poses.T.round(3), poses.J.shape
    (array([[1.957, 0.   , 2.838]]), (1, 6, 6))
    """
    q = np.atleast_2d(np.asarray(q, float))
    n, k = q.shape
    names = [f"link[{i}].joint.a.r" for i in range(k)]
    unit = np.tile(np.eye(k), (n, 1))
    # one call: its rows are the unit rates at each pose
    solution = model.causal(known="q", targets=["T", "R", "W", *names, "v", "w", "v_W"])(np.repeat(q, k, axis=0), unit)
    *fixed, v, w, v_W, moving = solution
    T, R, W, *origins = (np.asarray(x)[::k] for x in fixed)
    status = moving.reshape(n, k).max(axis=1)
    if np.any(status != Status.OK):
        bad = int(np.argmax(status != Status.OK))
        raise ValueError(f"pose {bad} cannot be evaluated: {Status(int(status[bad])).message}")
    columns = [np.swapaxes(x.reshape(n, k, 3), 1, 2) for x in (v, w, v_W)]
    arm = R @ np.asarray(tool, float)
    J = at_tool(np.concatenate(columns[:2], axis=1), arm)
    return ArmPoses(q, T + arm, J, W, columns[2], np.stack(origins, axis=1), R)


# beyond this condition number of J its inverse keeps fewer than four digits
SINGULAR = 1e-4 / np.finfo(float).eps


def cartesian_stiffness(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """Return K_x = J^-T K_q J^-1 (n, 6, 6), eq. (7) (Cvitanic 2021): N/m, N/rad, N.m/rad in one matrix.

    J (n, 6, 6) or (6, 6); compliance (6,) [rad/(N.m)] of the joints. NaN if J is singular or not finite. The function
    inverts J rather than the compliance at the tool, whose condition number is the square. Raises ValueError for wrong
    shapes and for compliances that are not positive.

    >>> J = gt.compliance.arm_poses(gt.robots.kr500(), [0.3, -0.9, 2.0, 0.2, -1.1, -0.1]).J
    >>> c = np.full(6, 1e-6)
    >>> K = gt.compliance.cartesian_stiffness(J, c)
    >>> np.allclose(K[0] @ (J[0] * c) @ J[0].T, np.eye(6))
    True
    """
    J, c = np.asarray(J, float), np.asarray(compliance, float)
    if J.ndim not in (2, 3) or J.shape[-1] != J.shape[-2] or c.shape != J.shape[-1:]:
        raise ValueError(f"found J {J.shape} and compliances {c.shape}; expected (n, 6, 6) and (6,)")
    if not np.all((c > 0) & np.isfinite(c)):
        raise ValueError(f"the compliances are {c.tolist()} rad/(N.m); expected positive numbers")
    many = J.reshape(-1, *J.shape[-2:])
    stiffness = np.full(many.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(many).all(axis=(1, 2)))
    regular = finite[np.linalg.cond(many[finite]) < SINGULAR]
    inverse = np.linalg.inv(many[regular])
    stiffness[regular] = np.swapaxes(inverse, 1, 2) @ (inverse / c[:, None])
    return stiffness.reshape(J.shape)


def translational_compliance(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """Return C_tt (n, 3, 3) [m/N]: displacement of the tool per force at the tool; finite also at singular poses.

    J (n, 6, k), linear rows first; compliance (k,) [rad/(N.m)] of the joints.

    >>> J = np.zeros((1, 6, 1))
    >>> J[0, :, 0] = [0, 2.0, 0, 0, 0, 1]  # one joint about z, the tool 2 m away along x
    >>> gt.compliance.translational_compliance(J, [1e-6])[0, 1, 1]  # m/N
    np.float64(4e-06)
    """
    v = np.asarray(J, float)[:, :3]
    return (v * np.asarray(compliance, float)) @ np.swapaxes(v, 1, 2)


def softest_and_stiffest(C: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the stiffness along the principal directions of C_tt (n, 3, 3) [m/N].

    Returns (n, 3) [N/m], softest first, and the directions (n, 3, 3) as rows; both are NaN if C is. Singular values of
    K_x would mix units and be unbounded near singular poses.

    >>> stiffness, directions = gt.compliance.softest_and_stiffest(np.diag([1e-6, 2e-6, 4e-6])[None])
    >>> stiffness
    array([[ 250000.,  500000., 1000000.]])
    >>> directions[0, 0]
    array([0., 0., 1.])
    """
    C = np.asarray(C, float)
    finite = np.asarray(np.isfinite(C).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], C, 0.0))
    with np.errstate(divide="ignore"):
        stiffness = np.where(values > 0, 1 / values, np.inf)
    stiffness[~finite], vectors[~finite] = np.nan, np.nan
    return stiffness[:, ::-1], np.swapaxes(vectors, 1, 2)[:, ::-1]


Array = np.ndarray
OUTSIDE = "beyond the joints' limits"


class SprungArm:
    """A serial arm of six joints that turn, with named postures, and joint springs. Raises ArgumentError."""

    def __init__(self, model: Model, arm: ArmSprings, load: Load, pose: Sequence[float] | None) -> None:
        self.load = load
        if len(arm.joint) != 6:
            raise ArgumentError(f"has {len(arm.joint)} numbers; expected 6, one per joint", "springs.joint")
        self.compliance = 1 / np.asarray(arm.joint)
        self.tool = np.asarray(arm.tool)
        q = np.array([arm.pose])
        self.chain = chain_of(model, named=True)
        if abs(self.chain.axes[0, 2]) < 1 or self.chain.axes[1, 2]:
            raise ArgumentError("expected an arm such as kr500, with axis 1 vertical and axis 2 horizontal", "robot")
        flange, R = self.chain.pose(q)
        self.R = R[0]
        self.limits = getattr(model, "joint_limits", None)
        self.home = flange[0] + self.R @ self.tool if pose is None else np.asarray(pose, float)
        branches = postures(self.chain, flange, self.R).q[0]
        self.branch = int(np.nanargmin(np.abs(within_pi(branches - q[0])).sum(axis=1)))
        across = rotation_about(self.chain.axes[0], q[0, 0]) @ np.cross(self.chain.axes[1], [0.0, 0.0, 1.0])
        if self.home @ across < 0:  # axis 2 may point to either side; the section begins at axis 1 and holds the pose
            across = -across
        normal = np.cross(across, [0.0, 0.0, 1.0])
        self.section = SectionPlane((self.home @ normal) * normal, across, np.array([0.0, 0.0, 1.0]), normal)
        self.marks = np.zeros((0, 2))

    @property
    def window(self) -> tuple[Array, Array]:
        reach, height = self.chain.size + float(np.linalg.norm(self.tool)), self.chain.points[1, 2]
        return np.array([0.0, height - reach]), np.array([reach, height + reach])

    @property
    def assumptions(self) -> list[str]:
        endless = ["the joint limits of this robot are not known: poses beyond them count as reachable"]
        return [
            "joints are compliant only about their axes, and motors hold their position; links and bearings are rigid",
            "the tool keeps the orientation of arm.pose_deg, and the arm keeps its branch",
            *(endless if self.limits is None else []),
        ]

    def scenes(self, title: str) -> dict[str, Callable[[], RobotScene]]:
        """No views: an arm's springs are in its joints, without the masses of its links."""
        return {}

    def __call__(self, T: Array) -> ComplianceAtPoses:
        T = np.atleast_2d(np.asarray(T, float))
        n = len(T)
        branches = postures(self.chain, T - self.R @ self.tool, np.tile(self.R, (n, 1, 1)))
        q, status = branches.q[:, self.branch], branches.status[:, self.branch]
        reason = ["" if code == Status.OK else Status(int(code)).message for code in status]
        if self.limits is not None:
            low, high = self.limits.T
            turned = q + 2 * np.pi * np.ceil((low - q - 1e-9) / (2 * np.pi))
            out = np.any(turned > high + 1e-9, axis=1)
            reason = [r or (OUTSIDE if o else "") for r, o in zip(reason, out, strict=True)]
        good = np.array([not r for r in reason])
        C, moved, work = np.full((n, 6, 6), np.nan), np.full((n, 6), np.nan), np.full((n, 6), np.nan)
        load = np.array([*self.load.force, *self.load.moment])
        if good.any():
            J = at_tool(self.chain.jacobian(q[good]), np.tile(self.R @ self.tool, (int(good.sum()), 1)))
            C[good] = (J * self.compliance) @ np.swapaxes(J, 1, 2)
            torque = np.einsum("nij,i->nj", J, load)
            turned = self.compliance * torque
            moved[good] = np.einsum("nij,nj->ni", J, turned)
            work[good] = torque * turned / 2
        shares = None
        if np.any(load):
            shares = {f"joint_{k + 1}": w for k, w in enumerate((work / work.sum(axis=1, keepdims=True)).T)}
        return ComplianceAtPoses(C, moved, reason, shares=shares)
