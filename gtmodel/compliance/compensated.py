"""Joint stiffness and the rate of a gravity compensator on joint 2 from the same static tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..inference import nonlinear_fit
from .complementary import Compensator
from .joint_stiffness import UNIT, StiffnessFit, complete_pose, names_of, stiffness_fit
from .static_tests import StaticTests

Array = np.ndarray
RATE = "rate"
JOINT = 1  # the spring is on joint 2


def with_compensator(tests: StaticTests, spring: Compensator, q: Array) -> StiffnessFit:
    """Complete poses with the rate of the spring on joint 2 among the unknowns, in `estimate` as "rate" [N/m].

    `spring` gives the other dimensions, and the rate where the iteration starts. q (n, k) [rad]: joints of each test.
    The spring's torque is there with and without the load; only its change as joint 2 moves is seen. That is K_c = rate
    * d(torque per rate)/dq2 beside K_q (Cvitanic 2021, eq. (2)), some per cent of it, so expect a wide interval. Raises
    ValueError for what the tests do not determine.

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
        left = np.linalg.inv(np.eye(k) - c[:, None] * K)
        dq = np.einsum("nij,nj->ni", left, c * tau)
        loaded = tau + np.einsum("nij,nj->ni", K, dq)
        by_c = left * loaded[:, None, :]
        by_rate = left[:, :, JOINT] * (c[JOINT] * slope * dq[:, JOINT])[:, None]
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
