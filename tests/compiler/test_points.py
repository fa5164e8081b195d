"""Least-norm steps towards consistent points: dense and sparse matrices give the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from gtmodel.compiler.consistency.points import _least_norm

ROUND_OFF = 1e-9  # of the step: normal equations square the condition, here below 1e3


def drawn(seed: int, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    J = np.where(rng.random((rows, columns)) < 4 / columns, rng.standard_normal((rows, columns)), 0.0)
    return J + np.eye(rows, columns), 0.1 + rng.random(columns), rng.standard_normal(rows)


def test_weights_choose_a_solution_and_not_whether_there_is_one():
    """One equation twice, so that the normal equations are singular, beside an unknown of a tiny weight."""
    J, reach = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([1.0, 1e-11])
    assert _least_norm(J, reach, np.ones(3)) == pytest.approx([-1.0, -1.0], rel=ROUND_OFF)


@pytest.mark.parametrize("rows, columns", [(3, 5), (40, 45), (150, 160)])
@pytest.mark.parametrize("case", ["regular", "held", "dependent"])
def test_dense_and_sparse_steps_are_the_least_norm_solution(rows, columns, case):
    J, reach, r = drawn(rows, rows, columns)
    if case == "held":  # what has no reach stays; its own equation is left out
        reach[[0, 2]] = 0.0
        J[0] = 0.0
        J[0, 0] = 1.0
    if case == "dependent":
        J[1], r[1] = 2.0 * J[0], 2.0 * r[0]
    rows_left = np.flatnonzero(np.abs(J * reach).sum(axis=1))
    by_svd = reach * (np.linalg.pinv((J * reach)[rows_left], rcond=1e-10) @ -r[rows_left])
    for given in (J, csc_matrix(J)):
        step = _least_norm(given, reach, r)
        assert np.max(np.abs(step - by_svd)) <= ROUND_OFF * np.max(np.abs(by_svd))
        assert np.all(step[reach == 0] == 0)
