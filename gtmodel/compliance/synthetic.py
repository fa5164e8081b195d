"""Synthetic static tests, to see what identification gives back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .joint_stiffness import ARM, without_noise
from .static_tests import StaticTests


def synthetic_tests(
    tests: StaticTests,
    compliance: ArrayLike,
    rng: np.random.Generator | None,
    *,
    tilt: ArrayLike | None = None,
    origins: ArrayLike | None = None,
    point: ArrayLike | None = None,
) -> StaticTests:
    """The tests with displacements by joint compliances (k,) [rad/(N.m)], and noise of their covariances from `rng`.

    Without noise where `rng` is None. `tilt` (k,) [rad/(N.m)]: compliance of each bearing about both directions across
    its axis, at `origins` (n, k, 3) with the tool at `point` (n, 3) [m]; the model of the identification lacks it.
    Raises ValueError for a tilt without these.

    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1]])
    >>> planned = poses.tests([[0, 0, -4000.0, 0, 0, 0]], sigma=[2e-5] * 3 + [1e-4] * 3)
    >>> tests = gt.compliance.synthetic_tests(planned, [1e-6] * 6, rng=None)
    >>> np.allclose(tests.displacement[0], poses.J[0] @ (1e-6 * planned.torque[0]))
    True
    """
    made = without_noise(tests, np.asarray(compliance, float))
    moved, wrist = made.displacement.copy(), made.wrist_displacement
    wrist = None if wrist is None else wrist.copy()
    if tilt is not None:
        if origins is None or point is None:
            raise ValueError("tilt needs the origins of the joints and the tool's point; give both")
        by_tilt, wrist_by_tilt = _tilted(tests, *(np.asarray(x, float) for x in (tilt, origins, point)))
        moved += by_tilt
        wrist = None if wrist is None else wrist + wrist_by_tilt
    if rng is not None:
        moved += _noise(tests.covariance, rng)
        if wrist is not None and tests.wrist_covariance is not None:
            wrist += _noise(tests.wrist_covariance, rng)
    return replace(made, displacement=moved, wrist_displacement=wrist)


def _tilted(t: StaticTests, tilt: np.ndarray, origins: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n, 6) of the tool and (n, 3) of the wrist centre."""
    arms = point[:, None, :] - origins  # (n, k, 3)
    axes = np.moveaxis(t.J[:, 3:], 1, 2)
    moments = t.wrench[:, None, 3:] + np.cross(arms, t.wrench[:, None, :3])
    across = moments - np.sum(moments * axes, axis=2, keepdims=True) * axes
    turns = tilt[:, None] * across
    # the target at the wrist centre stands on the arm, before the bearings of the wrist
    at_wrist = np.cross(turns, arms + t.lever[:, None, :])[:, :ARM]
    return np.concatenate([np.cross(turns, arms).sum(axis=1), turns.sum(axis=1)], axis=1), at_wrist.sum(axis=1)


def _noise(covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    L = np.linalg.cholesky(covariance)
    return np.einsum("nij,nj->ni", L, rng.standard_normal(covariance.shape[:2]))
