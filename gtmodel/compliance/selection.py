"""Which tests to make: poses and loads that tell the compliances best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..inference import Observability, observability
from .static_tests import StaticTests

# weight of what is told already before any test is chosen, of the mean information of one candidate
START = 1e-9


@dataclass(frozen=True, eq=False)
class Selection:
    """Chosen tests in the order of choice, the indices of their slopes, and those of all candidates."""

    chosen: tuple[int, ...]
    indices: Observability
    of_all: Observability


def select(tests: StaticTests, count: int, expected: ArrayLike) -> Selection:
    """`count` of the candidate tests, one after the other the one that raises the determinant of the information most.

    `expected` (k,): compliances [rad/(N.m)] in whose units the slopes are taken. Displacements are not looked at. Each
    candidate counts once: repeat it among the candidates to allow repetition. Raises ValueError for a count beyond the
    candidates, or candidates that leave a compliance undetermined.
    """
    n, _, k = tests.J.shape
    if not 1 <= count <= n:
        raise ValueError(f"found a count of {count}; expected 1 to {n}, the number of candidates")
    L = np.linalg.cholesky(tests.covariance)
    rows = np.linalg.solve(L, tests.J * tests.torque[:, None, :]) * np.asarray(expected, float)
    information = np.swapaxes(rows, 1, 2) @ rows
    M = START * np.trace(information.mean(axis=0)) / k * np.eye(k)
    left, chosen = list(range(n)), []
    for _ in range(count):
        gains = np.linalg.slogdet(M + information[left])[1]
        best = left[int(np.argmax(np.round(gains, 9)))]
        chosen.append(best)
        left.remove(best)
        M = M + information[best]
    return Selection(tuple(chosen), _indices(rows[chosen], k), _indices(rows, k))


def _indices(rows: np.ndarray, k: int) -> Observability:
    s = np.linalg.svd(rows.reshape(-1, k), compute_uv=False)
    rank = int(np.count_nonzero(s > 1e-9 * s[0]))
    if rank < k:
        raise ValueError(f"the tests tell {rank} of {k} compliances; take more poses or loads in other directions")
    return observability(s, rank, len(rows), "columns in units of the expected compliances, rows of their noise")
