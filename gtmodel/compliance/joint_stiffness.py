"""Joint stiffness from static load tests, linear in the compliances c = 1/K (Cvitanic 2021), including the effects of
the moving load and a gravity compensator; selection of tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..calibrate import exchange
from ..calibrate.pose_information import PoseInformation, made
from ..inference import Identifiability, Observability, Verdict, identifiability, linear_fit, noise_size, nonlinear_fit
from ..results.estimate import Estimate
from .static_tests import StaticTests


def complementary_stiffness(J: ArrayLike, wrench: ArrayLike) -> np.ndarray:
    """Return K_c (n, k, k) [N.m/rad] of eq. (2) (Cvitanic 2021): d(J'F)_i / dq_j for a wrench (n, 6) fixed in space.

    J (n, 6, k): geometric Jacobian of an arm with revolute joints, at the point where the wrench acts. K_c is not
    symmetric if a moment acts, because a constant moment has no potential. Raises ValueError for wrong shapes.

    >>> J = gt.compliance.arm_poses(gt.robots.kr500(), [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1]]).J
    >>> K_c = gt.compliance.complementary_stiffness(J, [[0, 0, -4000.0, 0, 0, 0]])
    >>> K_c.shape, np.allclose(K_c[0], K_c[0].T)  # a force alone: symmetric
    ((1, 6, 6), True)
    """
    J, F = np.asarray(J, float), np.asarray(wrench, float)
    if J.ndim != 3 or J.shape[1] != 6 or F.shape != (len(J), 6):
        raise ValueError(f"J and wrench have the shapes {J.shape} and {F.shape}; expected (n, 6, k) and (n, 6)")
    v, w = np.moveaxis(J[:, :3], 1, 2), np.moveaxis(J[:, 3:], 1, 2)  # (n, k, 3)
    k = J.shape[2]
    K = np.empty((len(J), k, k))
    for i in range(k):
        for j in range(k):
            # joints before i rotate the axis and arm of i; joints after it move only the tool
            linear = np.cross(w[:, min(i, j)], v[:, max(i, j)])
            angular = np.cross(w[:, j], w[:, i]) if j < i else np.zeros_like(linear)
            K[:, i, j] = np.sum(linear * F[:, :3] + angular * F[:, 3:], axis=1)
    return K


@dataclass(frozen=True)
class Compensator:
    """A gas or coil spring between the base and a lever of joint 2, with both hinges in the plane of the arm.

    `base` [m] and `lever` [m]: distances of its hinges from the axis of joint 2; `angle` [rad]: q2 at which the lever
    points away from the base hinge and the spring is longest. Its force is rate [N/m] times (length - rest) [m] along
    the spring, and pulls the hinges together if positive.

    >>> spring = gt.compliance.Compensator(base=0.3, lever=0.25, rate=8e5, rest=0.2)
    >>> spring.length([0.0, np.pi / 2]).round(3)  # m
    array([0.55 , 0.391])
    """

    base: float
    lever: float
    rate: float
    rest: float
    angle: float = 0.0

    def length(self, q2: ArrayLike) -> np.ndarray:
        """Return the length of the spring [m] at q2 [rad]."""
        turn = np.asarray(q2, float) - self.angle
        return np.sqrt(self.base**2 + self.lever**2 + 2 * self.base * self.lever * np.cos(turn))

    def torque(self, q2: ArrayLike) -> np.ndarray:
        """Return the torque on joint 2 [N.m], positive along q2: minus the derivative of the spring's energy."""
        turn, s = np.asarray(q2, float) - self.angle, self.length(q2)
        return self.rate * (s - self.rest) * self.base * self.lever * np.sin(turn) / s

    def stiffness(self, q2: ArrayLike) -> np.ndarray:
        """Return d torque / d q2 [N.m/rad], the spring's contribution to K_c at joint 2.

        The torque itself acts with and without the load and cancels in the difference.
        """
        turn, s = np.asarray(q2, float) - self.angle, self.length(q2)
        arm = self.base * self.lever
        by_turn = -arm * np.sin(turn) / s  # d length / d q2
        pull = self.rate * (s - self.rest) / s
        return self.rate * self.rest / s**2 * by_turn * arm * np.sin(turn) + pull * arm * np.cos(turn)

    def added(self, K_c: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return K_c (n, k, k) plus the spring's contribution at joints q (n, k)."""
        stiffness = np.array(K_c, float)
        stiffness[:, 1, 1] += self.stiffness(np.asarray(q, float)[:, 1])
        return stiffness


ARM = 3  # joints before the wrist centre
# for a load of half a ton, K_c is about 0.5 % of K_q: each round gains two digits
STILL, ROUNDS = 1e-13, 50
UNIT = "rad/(N.m)"


@dataclass(frozen=True, eq=False)
class StiffnessFit:
    """Joint compliances with confidence, how well the tests determine each, and whether the residuals are noise.

    `estimate`: compliance[0], compliance[1], ... [rad/(N.m)]. `identifiability`: how well the tests determine each.
    `adequacy`: the chi-squared test of the residuals. `jacobian` (rows, k): Jacobian of the measured rows in the
    compliances; `assumed`: the covariance used as weight, in blocks or whole.
    """

    method: str
    estimate: Estimate
    identifiability: Identifiability
    adequacy: Verdict
    jacobian: np.ndarray
    assumed: np.ndarray

    @property
    def compliance(self) -> np.ndarray:
        """Compliances (k,) [rad/(N.m)]."""
        return self.estimate.values[[name.startswith("compliance[") for name in self.estimate.names]]

    @property
    def stiffness(self) -> np.ndarray:
        """K = 1/c [N.m/rad]; negative if noise made the compliance negative."""
        return 1 / self.compliance

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of "stiffness[0]" [N.m/rad], "compliance[0]" [rad/(N.m)] or another name.

        The interval of a stiffness has the inverted ends of that of the compliance, without linearisation: the upper
        end is infinite if the compliance may be zero, and both ends are NaN if the whole interval of the compliance is
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
    """Fit joint compliances to all six rows of the displacement: dX = J diag(J'F) c, or eq. (2) if the tests have K_c.

    Rows are whitened with the tests' covariance. `rotation_weight` w gives rotations w times the weight that their
    noise justifies (the thesis scales rotations by 10); without model error it only widens the intervals. Intervals are
    those for the stated noise, and the chi-squared test is that for w = 1. Raises ValueError for compliances that the
    tests do not determine. Source: Cvitanic 2021, eqs. (2), (3), (6).

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
        raise ValueError("every displacement is zero; expected the pose with the load less the pose without")
    y, torque, before = tests.displacement.reshape(-1), tests.torque, None
    for _ in range(ROUNDS):
        A = (tests.J * torque[:, None, :]).reshape(6 * n, k)
        e = linear_fit(A, y, names_of(range(k)), covariance=covariance, units=[UNIT] * k)
        converged = before is not None and np.abs(e.values - before).max() <= STILL * np.abs(e.values).max()
        if tests.K_c is None or converged:
            break
        before, torque = e.values, loaded_torque(tests, e.values)
    return stiffness_fit("complete pose", e, A, covariance, n)  # pyrefly: ignore[unbound-name]


def decoupled(tests: StaticTests, *, moment: bool = True) -> StiffnessFit:
    """Fit the arm's compliances to the linear motion of the wrist centre, then the wrist's to that of the tool.

    The arm's torque is (J'F)_123, which includes the moment of the force about the wrist centre. With `moment=False` it
    is J_wrist' f, as in the text of the thesis (Cvitanic 2021); this biases the arm and stiffens the wrist. Intervals
    of the wrist include the error of the arm. Raises ValueError for tests with K_c if `moment` is False, and for
    compliances that the tests do not determine.

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
    # one test has three rows for three compliances of the arm: no residuals are left, nor for the wrist
    if len(tests.J) < 2:
        raise ValueError(f"found {len(tests.J)} test; expected at least 2 for six joints, in different poses or loads")
    if tests.K_c is not None and not moment:
        raise ValueError("moment=False cannot be combined with the complementary stiffness; leave K_c out")
    torque, before = tests.torque, None
    for _ in range(ROUNDS):
        fit = _decoupled(tests, torque, moment)
        c = fit.compliance
        converged = before is not None and np.abs(c - before).max() <= STILL * np.abs(c).max()
        if tests.K_c is None or converged:
            break
        before, torque = c, loaded_torque(tests, c)
    return fit  # pyrefly: ignore[unbound-name]


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
    # the arm's error enters every row of the second fit
    gain = arm.covariance @ _whitened_transpose(A_w, S_w)
    shared = _rows(S_tw) @ gain.T @ A_a.T
    S_b = _rows(tests.covariance[:, :3, :3]) - shared - shared.T + A_a @ arm.covariance @ A_a.T
    y_b = tests.displacement[:, :3].reshape(-1) - A_a @ arm.values
    wrist = linear_fit(A_b, y_b, names_of(range(ARM, k)), covariance=S_b, units=[UNIT] * (k - ARM))
    wrist_gain = wrist.covariance @ np.linalg.solve(S_b, A_b).T
    cross = (gain @ _rows(S_tw).T - arm.covariance @ A_a.T) @ wrist_gain.T
    estimate = Estimate(
        (*arm.names, *wrist.names), np.concatenate([arm.values, wrist.values]),
        np.block([[arm.covariance, cross], [cross.T, wrist.covariance]]),
        arm.degrees_of_freedom + wrist.degrees_of_freedom,
        _pooled(arm, wrist), True, np.concatenate([arm.residuals, wrist.residuals]),
        (), units=arm.units + wrist.units,
    )  # fmt: skip
    whole = np.block([[A_w, np.zeros((3 * n, k - ARM))], [A_a, A_b]])
    zero = np.zeros((3 * n, 3 * n))
    noise = np.block([[_rows(S_w), zero], [zero, _rows(tests.covariance[:, :3, :3])]])
    return stiffness_fit("decoupled", estimate, whole, noise, n)


def loaded_torque(tests: StaticTests, c: np.ndarray) -> np.ndarray:
    """Torques (n, k) that deflect compliances c in the displaced pose: tau + K_c (K_q - K_c)^-1 tau."""
    if tests.K_c is None:
        return tests.torque
    matrix = np.eye(len(c)) - c[:, None] * tests.K_c
    dq = np.linalg.solve(matrix, (c * tests.torque)[:, :, None])[:, :, 0]
    return tests.torque + np.einsum("nij,nj->ni", tests.K_c, dq)


def predicted(tests: StaticTests, c: np.ndarray) -> np.ndarray:
    """Displacement of the tool (n, 6) [m, rad] for joint compliances c (k,), eqs. (2), (3).

    Raises ValueError if there is no stable equilibrium (K_q - K_c is not positive definite).
    """
    if tests.K_c is not None:
        c = np.asarray(c, float)
        root = np.sqrt(np.maximum(c, 0.0))
        scaled = root[:, None] * (tests.K_c + np.swapaxes(tests.K_c, 1, 2)) / 2 * root
        over = np.flatnonzero(np.linalg.eigvalsh(scaled)[:, -1] >= 1)
        if len(over):
            raise ValueError(f"test {over[0] + 1}: the load exceeds what the joints can carry, K_q - K_c is not "
                             "positive definite; check the units of wrench and stiffness")  # fmt: skip
    return np.einsum("nik,nk->ni", tests.J, c * loaded_torque(tests, np.asarray(c, float)))


def without_noise(tests: StaticTests, c: np.ndarray) -> StaticTests:
    """The tests with displacements predicted from c, also at the wrist centre if it was measured."""
    wrist = np.einsum("nik,nk->ni", tests.J_wrist, c * loaded_torque(tests, c))
    return replace(
        tests,
        displacement=predicted(tests, c),
        wrist_displacement=None if tests.wrist_displacement is None else wrist,
    )


def stiffness_fit(method: str, e: Estimate, A: np.ndarray, covariance: np.ndarray, poses: int) -> StiffnessFit:
    """Assemble a StiffnessFit: identifiability with each unknown in units of itself, and the test of the residuals."""
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
    """Block-diagonal matrix (n b, n b) from blocks (n, b, b)."""
    n, b, _ = blocks.shape
    whole = np.zeros((n, b, n, b))
    whole[np.arange(n), :, np.arange(n)] = blocks
    return whole.reshape(n * b, n * b)


def _whitened_transpose(A: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """A' S^-1 (k, rows) for S of independent blocks."""
    n, b, _ = blocks.shape
    return np.linalg.solve(blocks, A.reshape(n, b, -1)).reshape(A.shape).T


Array = np.ndarray
RATE = "rate"
JOINT = 1  # the spring is on joint 2


def with_compensator(tests: StaticTests, spring: Compensator, q: Array) -> StiffnessFit:
    """Fit complete poses with the rate of the spring on joint 2 as an unknown, in `estimate` as "rate" [N/m].

    `spring` gives the other dimensions and the start value of the rate. q (n, k) [rad]: joints of each test. The
    spring's torque acts with and without the load; only its change as joint 2 moves is observed. This is K_c = rate *
    d(torque per rate)/dq2, a few per cent of K_q (Cvitanic 2021, eq. (2)), so that the interval is wide. Raises
    ValueError for unknowns that the tests do not determine.

    >>> from gtmodel.compliance import Compensator, arm_poses, complementary_stiffness, synthetic_tests
    >>> q = np.deg2rad(gt.robots.kr500_tables()["static_stiffness"]["poses_deg"])
    >>> wrench = np.tile([[2000.0, 0, 0, 0, 0, 0], [0, 500.0, -4000, 0, 0, 0]], (5, 1))
    >>> poses = arm_poses(gt.robots.kr500(), q, [0.1, 0.05, 0.4])
    >>> K_c = complementary_stiffness(poses.J, wrench)
    >>> spring = Compensator(base=0.3, lever=0.25, rate=8e5, rest=0.2)
    >>> loaded = poses.tests(wrench, sigma=[2e-5] * 3 + [1e-4] * 3, K_c=spring.added(K_c, q))
    >>> tests = synthetic_tests(loaded, [1e-6] * 6, None).with_(K_c=K_c)
    >>> start = Compensator(base=0.3, lever=0.25, rate=5e5, rest=0.2)
    >>> gt.compliance.with_compensator(tests, start, q).estimate.values[6].round(3) == 8e5  # N/m
    np.True_
    """
    n, _, k = tests.J.shape
    y = tests.displacement.reshape(-1)
    K_c = np.zeros((n, k, k)) if tests.K_c is None else tests.K_c
    slope = spring.stiffness(np.asarray(q, float)[:, JOINT]) / spring.rate  # K_c of the spring per rate
    tau = tests.torque

    def residuals(x: Array) -> tuple[Array, Array]:
        c, rate = x[:k], x[k]
        K = K_c.copy()
        K[:, JOINT, JOINT] += rate * slope
        inverse = np.linalg.inv(np.eye(k) - c[:, None] * K)
        dq = np.einsum("nij,nj->ni", inverse, c * tau)
        loaded = tau + np.einsum("nij,nj->ni", K, dq)
        by_c = inverse * loaded[:, None, :]
        by_rate = inverse[:, :, JOINT] * (c[JOINT] * slope * dq[:, JOINT])[:, None]
        J = np.concatenate([tests.J @ by_c, (tests.J @ by_rate[:, :, None])], axis=2)
        return np.einsum("nik,nk->ni", tests.J, dq).reshape(-1) - y, J.reshape(6 * n, k + 1)

    first = complete_pose(replace(tests, K_c=spring.added(K_c, np.asarray(q, float))))
    start = np.concatenate([first.compliance, [spring.rate]])
    fit = nonlinear_fit(
        residuals, start, [*names_of(range(k)), RATE], scale=np.abs(start), covariance=tests.covariance,
        units=[UNIT] * k + ["N/m"],
    )  # fmt: skip
    if fit.estimate is None:
        raise ValueError(f"joint stiffness with the compensator's rate: {fit.message}")
    return stiffness_fit("complete pose, compensator", fit.estimate, residuals(fit.x)[1], tests.covariance, n)


@dataclass(frozen=True, eq=False)
class LoadTestSelection:
    """Selected tests, ascending, with the observability indices of their Jacobian and of all candidates."""

    chosen: tuple[int, ...]
    indices: Observability
    of_all: Observability


def information(tests: StaticTests, expected: ArrayLike) -> PoseInformation:
    """Return the information of each test on the compliances, in units of `expected` (k,) [rad/(N.m)].

    Its rows are those of the complete pose, whitened by their noise, for the pose selection in `calibrate`. The
    displacements are not used.
    """
    sizes = np.asarray(expected, float)
    rows = np.linalg.solve(np.linalg.cholesky(tests.covariance), tests.J * tests.torque[:, None, :]) * sizes
    return made([f"compliance[{j}]" for j in range(len(sizes))], sizes, rows, np.zeros((0, len(sizes))))


def select(tests: StaticTests, count: int, expected: ArrayLike, *, seed: int = 0) -> LoadTestSelection:
    """Select `count` of the candidate tests by exchange, for the largest determinant of their information.

    expected (k,) [rad/(N.m)]: approximate compliances. Each candidate is used at most once; list it repeatedly to
    allow repetition. The same seed gives the same tests. Raises ValueError if `count` exceeds the candidates, or if the
    candidates leave a compliance undetermined.

    >>> q = np.deg2rad(gt.robots.kr500_tables()["static_stiffness"]["poses_deg"])
    >>> wrench = np.tile([[2000.0, 0, 0, 0, 0, 0], [0, 500.0, -4000, 0, 0, 0]], (5, 1))
    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), q, tool=[0.1, 0.05, 0.4])
    >>> planned = poses.tests(wrench, sigma=[2e-5] * 3 + [1e-4] * 3)
    >>> chosen = gt.compliance.select(planned, 5, expected=[1e-6] * 6)
    >>> len(chosen.chosen), chosen.indices.rank
    (5, 6)
    """
    n, _, k = tests.J.shape
    if not 1 <= count <= n:
        raise ValueError(f"found a count of {count}; expected 1 to {n}, the number of candidates")
    info = information(tests, expected)
    if info.rank < k:
        raise ValueError(f"the tests determine {info.rank} of {k} compliances; add poses, or loads in other directions")
    chosen = exchange(info, count, "D", repeats=1, seed=seed).indices
    return LoadTestSelection(
        tuple(int(i) for i in chosen), info.identifiability(chosen).indices, info.identifiability().indices
    )
