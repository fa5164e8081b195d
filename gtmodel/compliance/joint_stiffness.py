"""Joint stiffness from static load tests, linear in the compliances c = 1/K (Cvitanic 2021, eqs. (2)-(7))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..inference import Identifiability, Verdict, identifiability, linear_fit, noise_size
from ..results.estimate import Estimate
from .static_tests import StaticTests

ARM = 3  # joints before the wrist centre
# K_c is half a per cent of K_q for half a ton: each round gains two digits
STILL, ROUNDS = 1e-13, 50
UNIT = "rad/(N.m)"


@dataclass(frozen=True, eq=False)
class StiffnessFit:
    """Joint compliances as an Estimate, how well the tests determine each, and whether the residuals are noise.

    `estimate`: compliance[0], compliance[1], ... [rad/(N.m)]. `identifiability`: how well the tests determine each.
    `adequacy`: the chi-squared test of the residuals. `jacobian` (rows, k): Jacobian of the measured rows in the
    compliances; `assumed`: the covariance by which they were weighted, as blocks or whole.
    """

    method: str
    estimate: Estimate
    identifiability: Identifiability
    adequacy: Verdict
    jacobian: np.ndarray
    assumed: np.ndarray

    @property
    def compliance(self) -> np.ndarray:
        """(k,) [rad/(N.m)]."""
        return self.estimate.values[[name.startswith("compliance[") for name in self.estimate.names]]

    @property
    def stiffness(self) -> np.ndarray:
        """K = 1/c [N.m/rad]; negative where noise made the compliance so."""
        return 1 / self.compliance

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "stiffness[0]" [N.m/rad], "compliance[0]" [rad/(N.m)] or another estimated name.

        That of a stiffness has the ends of that of the compliance, inverted, without linearisation: the upper end is
        infinite where the compliance may be zero, and both are NaN where the whole interval of the compliance is
        negative. Joints are counted from 0. Raises ArgumentError for a name that was not estimated.
        """
        if name not in stiffness_names(range(len(self.compliance))):
            return self.estimate.interval(name, level)
        low, high = self.estimate.interval(name.replace("stiffness", "compliance"), level)
        if high <= 0:
            return np.nan, np.nan
        return 1 / high, 1 / low if low > 0 else np.inf


def names_of(joints: Sequence[int]) -> list[str]:
    return [f"compliance[{j}]" for j in joints]


def stiffness_names(joints: Sequence[int]) -> list[str]:
    return [f"stiffness[{j}]" for j in joints]


def complete_pose(tests: StaticTests, *, rotation_weight: float = 1.0) -> StiffnessFit:
    """Joint compliances from all six rows of the displacement: dX = J diag(J'F) c, or eq. (2) where the tests have K_c.

    Rows are whitened by the tests' covariance. `rotation_weight` w counts rotations w times as much as their noise
    justifies, as the thesis scales its rotations by 10: without model error it only widens the intervals, which are
    those of the stated noise; the chi-squared test is that of w = 1. Raises ValueError for compliances that the tests
    do not determine. Source: Cvitanic 2021, eqs. (2), (3), (6).

    >>> q = np.deg2rad(gt.robots.kr500_tables()["static_stiffness"]["poses_deg"])
    >>> wrench = np.tile([[2000.0, 0, 0, 0, 0, 0], [0, 500.0, -4000, 0, 0, 0]], (5, 1))
    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), q, tool=[0.1, 0.05, 0.4])
    >>> planned = poses.tests(wrench, sigma=[2e-5] * 3 + [1e-4] * 3)
    >>> tests = gt.compliance.synthetic_tests(planned, 1e-6 / np.array([4, 3, 3, 2, 0.2, 0.2]), rng=None)
    >>> (gt.compliance.complete_pose(tests).stiffness / 1e6).round(3)  # MN.m/rad
    array([4. , 3. , 3. , 2. , 0.2, 0.2])
    """
    fit = _complete(tests, tests.covariance)
    if rotation_weight == 1.0:
        return fit
    scale = np.repeat([1.0, 1 / rotation_weight], 3)
    weighted = _complete(tests, tests.covariance * np.outer(scale, scale))
    gain = weighted.estimate.covariance @ _whitened_transpose(weighted.jacobian, weighted.assumed)
    spread = gain @ _rows(tests.covariance) @ gain.T
    estimate = replace(weighted.estimate, covariance=(spread + spread.T) / 2)
    return replace(weighted, estimate=estimate, identifiability=fit.identifiability, adequacy=fit.adequacy)


def _complete(tests: StaticTests, covariance: np.ndarray) -> StiffnessFit:
    n, _, k = tests.J.shape
    if not np.any(tests.displacement):
        raise ValueError("every displacement is zero; expected what moved under the load, with it less without")
    y, torque, before = tests.displacement.reshape(-1), tests.torque, None
    for _ in range(ROUNDS):
        A = (tests.J * torque[:, None, :]).reshape(6 * n, k)
        e = linear_fit(A, y, names_of(range(k)), covariance=covariance, units=[UNIT] * k)
        still = before is not None and np.abs(e.values - before).max() <= STILL * np.abs(e.values).max()
        if tests.K_c is None or still:
            break
        before, torque = e.values, loaded_torque(tests, e.values)
    return stiffness_fit("complete pose", e, A, covariance, n)  # pyright: ignore[reportPossiblyUnboundVariable]


def decoupled(tests: StaticTests, *, moment: bool = True) -> StiffnessFit:
    """Joint compliances of the arm from the linear motion of the wrist centre, then of the wrist from that of the tool.

    The arm's torque is (J'F)_123, the moment of the force about the wrist centre included; with `moment=False` it is
    J_wrist' f, as the text of the thesis (Cvitanic 2021) has it, which biases the arm and stiffens the wrist. Intervals
    of the wrist hold the error of the arm. Raises ValueError for tests with K_c without the moment, and for what the
    tests do not determine.

    >>> q = np.deg2rad(gt.robots.kr500_tables()["static_stiffness"]["poses_deg"])
    >>> wrench = np.tile([[2000.0, 0, 0, 0, 0, 0], [0, 500.0, -4000, 0, 0, 0]], (5, 1))
    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), q, tool=[0.1, 0.05, 0.4])
    >>> planned = poses.tests(wrench, sigma=[2e-5] * 3 + [1e-4] * 3)
    >>> c = 1e-6 / np.array([4, 3, 3, 2, 0.2, 0.2])  # rad/(N.m)
    >>> tests = gt.compliance.synthetic_tests(planned, c, np.random.default_rng(1))
    >>> without = gt.compliance.decoupled(tests, moment=False)
    >>> gt.compliance.decoupled(tests).adequacy.passed, without.adequacy.passed
    (True, False)
    """
    # one test has three rows for three compliances of the arm: no residual is left, and none of the wrist's either
    if len(tests.J) < 2:
        raise ValueError(f"found {len(tests.J)} test; expected at least 2 for six joints, in different poses or loads")
    if tests.K_c is not None and not moment:
        raise ValueError("without the moment about the wrist there is no complementary stiffness; leave K_c out")
    torque, before = tests.torque, None
    for _ in range(ROUNDS):
        fit = _decoupled(tests, torque, moment)
        c = fit.compliance
        still = before is not None and np.abs(c - before).max() <= STILL * np.abs(c).max()
        if tests.K_c is None or still:
            break
        before, torque = c, loaded_torque(tests, c)
    return fit  # pyright: ignore[reportPossiblyUnboundVariable]


def _decoupled(tests: StaticTests, torque: np.ndarray, moment: bool) -> StiffnessFit:
    n, _, k = tests.J.shape
    arm_torque = torque[:, :ARM]
    if not moment:
        arm_torque = np.einsum("nik,ni->nk", tests.J_wrist[:, :, :ARM], tests.wrench[:, :3])
    y_w, S_w, S_tw = tests.wrist()
    A_w = (tests.J_wrist[:, :, :ARM] * arm_torque[:, None, :]).reshape(3 * n, ARM)
    arm = linear_fit(A_w, y_w.reshape(-1), names_of(range(ARM)), covariance=S_w, units=[UNIT] * ARM)
    A_t = (tests.J[:, :3] * torque[:, None, :]).reshape(3 * n, k)
    A_a, A_b = A_t[:, :ARM], A_t[:, ARM:]
    # the arm's error is in every row of the second fit
    gain = arm.covariance @ _whitened_transpose(A_w, S_w)
    shared = _rows(S_tw) @ gain.T @ A_a.T
    S_b = _rows(tests.covariance[:, :3, :3]) - shared - shared.T + A_a @ arm.covariance @ A_a.T
    y_b = tests.displacement[:, :3].reshape(-1) - A_a @ arm.values
    wrist = linear_fit(A_b, y_b, names_of(range(ARM, k)), covariance=S_b, units=[UNIT] * (k - ARM))
    back = wrist.covariance @ np.linalg.solve(S_b, A_b).T
    cross = (gain @ _rows(S_tw).T - arm.covariance @ A_a.T) @ back.T
    both = Estimate(
        (*arm.names, *wrist.names), np.concatenate([arm.values, wrist.values]),
        np.block([[arm.covariance, cross], [cross.T, wrist.covariance]]),
        arm.degrees_of_freedom + wrist.degrees_of_freedom,
        _pooled(arm, wrist), True, np.concatenate([arm.residuals, wrist.residuals]),
        (), units=arm.units + wrist.units,
    )  # fmt: skip
    whole = np.block([[A_w, np.zeros((3 * n, k - ARM))], [A_a, A_b]])
    zero = np.zeros((3 * n, 3 * n))
    noise = np.block([[_rows(S_w), zero], [zero, _rows(tests.covariance[:, :3, :3])]])
    return stiffness_fit("decoupled", both, whole, noise, n)


def loaded_torque(tests: StaticTests, c: np.ndarray) -> np.ndarray:
    """Torques (n, k) by which compliances c turn the joints once these have moved: tau + K_c (K_q - K_c)^-1 tau."""
    if tests.K_c is None:
        return tests.torque
    left = np.eye(len(c)) - c[:, None] * tests.K_c
    dq = np.linalg.solve(left, (c * tests.torque)[:, :, None])[:, :, 0]
    return tests.torque + np.einsum("nij,nj->ni", tests.K_c, dq)


def predicted(tests: StaticTests, c: np.ndarray) -> np.ndarray:
    """Displacement of the tool (n, 6) [m, rad] by joint compliances c (k,), eqs. (2), (3).

    Raises ValueError where K_q - K_c holds no equilibrium: the load is beyond what the joints carry.
    """
    if tests.K_c is not None:
        c = np.asarray(c, float)
        root = np.sqrt(np.maximum(c, 0.0))
        scaled = root[:, None] * (tests.K_c + np.swapaxes(tests.K_c, 1, 2)) / 2 * root
        over = np.flatnonzero(np.linalg.eigvalsh(scaled)[:, -1] >= 1)
        if len(over):
            raise ValueError(f"test {over[0] + 1}: load and gravity soften the joints to nothing, K_q - K_c is not "
                             "positive definite; look at the units of wrench and stiffness")  # fmt: skip
    return np.einsum("nik,nk->ni", tests.J, c * loaded_torque(tests, np.asarray(c, float)))


def without_noise(tests: StaticTests, c: np.ndarray) -> StaticTests:
    """The tests with the displacements that c predicts, at the wrist centre too where it was measured."""
    wrist = np.einsum("nik,nk->ni", tests.J_wrist, c * loaded_torque(tests, c))
    return replace(
        tests,
        displacement=predicted(tests, c),
        wrist_displacement=None if tests.wrist_displacement is None else wrist,
    )


def stiffness_fit(method: str, e: Estimate, A: np.ndarray, covariance: np.ndarray, poses: int) -> StiffnessFit:
    """How well the rows determine each unknown, in units of itself, and whether the residuals are noise."""
    # in whitened rows, each compliance in units of itself
    blocks = covariance if covariance.ndim == 3 else covariance[None]
    L = np.linalg.cholesky(blocks)
    rows = np.linalg.solve(L, A.reshape(len(blocks), -1, A.shape[1])).reshape(A.shape)
    determined = identifiability(rows, e.names, scale=np.abs(e.values), poses=poses)
    return StiffnessFit(method, e, determined, noise_size(e), A, covariance)


def _pooled(*estimates: Estimate) -> float:
    degrees_of_freedom = sum(e.degrees_of_freedom for e in estimates)
    chi2 = sum(float(e.residuals @ e.residuals) for e in estimates)
    return float(np.sqrt(chi2 / degrees_of_freedom)) if degrees_of_freedom else 1.0


def _rows(blocks: np.ndarray) -> np.ndarray:
    """Block-diagonal (n b, n b) of (n, b, b)."""
    n, b, _ = blocks.shape
    whole = np.zeros((n, b, n, b))
    whole[np.arange(n), :, np.arange(n)] = blocks
    return whole.reshape(n * b, n * b)


def _whitened_transpose(A: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """A' S^-1 (k, rows) for S of independent blocks."""
    n, b, _ = blocks.shape
    return np.linalg.solve(blocks, A.reshape(n, b, -1)).reshape(A.shape).T
