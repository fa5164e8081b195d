"""Which tests to make: poses and loads that determine the compliances best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..calibrate import exchange
from ..calibrate.pose_information import PoseInformation, made
from ..inference import Observability
from .static_tests import StaticTests


@dataclass(frozen=True, eq=False)
class LoadTestSelection:
    """Chosen tests, ascending, with the observability indices of their Jacobian and those of all candidates."""

    chosen: tuple[int, ...]
    indices: Observability
    of_all: Observability


def information(tests: StaticTests, expected: ArrayLike) -> PoseInformation:
    """What each test contributes to the compliances, in units of those `expected` (k,) [rad/(N.m)].

    Its rows are those of the complete pose, whitened by their noise, for everything in `calibrate` that chooses poses.
    The displacements are not looked at.
    """
    sizes = np.asarray(expected, float)
    rows = np.linalg.solve(np.linalg.cholesky(tests.covariance), tests.J * tests.torque[:, None, :]) * sizes
    return made([f"compliance[{j}]" for j in range(len(sizes))], sizes, rows, np.zeros((0, len(sizes))))


def select(tests: StaticTests, count: int, expected: ArrayLike, *, seed: int = 0) -> LoadTestSelection:
    """`count` of the candidate tests, by exchange for the largest determinant of their information.

    expected (k,) [rad/(N.m)]: compliances of about the right size. Each candidate counts once: repeat it among the
    candidates to allow repetition. The same seed gives the same tests. Raises ValueError for a count beyond the
    candidates, or candidates that leave a compliance undetermined.

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
    gained = information(tests, expected)
    if gained.rank < k:
        raise ValueError(
            f"the tests determine {gained.rank} of {k} compliances; take more poses or loads in other directions"
        )
    chosen = exchange(gained, count, "D", repeats=1, seed=seed).indices
    return LoadTestSelection(
        tuple(int(i) for i in chosen), gained.identifiability(chosen).indices, gained.identifiability().indices
    )
