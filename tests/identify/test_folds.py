"""Rows left out in turn: what refits by hand give, one row at a time too."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gtmodel.identify import Fitting, leave_out_in_turn
from gtmodel.lang import ModelError
from gtmodel.results import ArgumentError
from tests.identify.test_between_recordings import recorded, solve


@pytest.fixture(scope="module")
def fitted():
    return solve(recorded(95.0, 1), recorded(95.0, 2), fitting=Fitting(folds=5))


def by_hand(rows, begin: int, end: int) -> np.ndarray:
    kept = np.r_[0:begin, end : len(rows)]
    x = np.linalg.lstsq(rows.Y[kept, 0], rows.effort[kept, 0] - rows.y0[kept, 0], rcond=None)[0]
    return rows.effort[begin:end, 0] - rows.Y[begin:end, 0] @ x - rows.y0[begin:end, 0]


def test_each_stretch_is_predicted_by_a_refit_by_hand(fitted) -> None:
    rows, n = fitted.fit.rows, len(fitted.fit.rows)
    ends = np.round(np.linspace(0, n, 6)).astype(int)
    errors = np.concatenate([by_hand(rows, a, b) for a, b in itertools.pairwise(ends)])
    left = leave_out_in_turn(fitted.fit, 5)
    assert left.errors[:, 0] == pytest.approx(errors, abs=1e-9)
    assert fitted.left_out_in_turn == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)
    assert fitted.noise[0] < fitted.left_out_in_turn[0] < 1.3 * fitted.noise[0]
    assert "cross-validation error of tau" in str(fitted)


def test_one_row_out_is_what_leverages_say(fitted) -> None:
    rows = fitted.fit.rows
    A = rows.Y[:, 0]
    leverage = np.einsum("ij,ij->i", A, A @ np.linalg.inv(A.T @ A))
    errors = leave_out_in_turn(fitted.fit, len(rows)).errors[:, 0]
    assert errors == pytest.approx(fitted.fit.residuals[:, 0] / (1 - leverage), rel=1e-8)


def test_wrong_numbers_of_stretches(fitted) -> None:
    with pytest.raises(ModelError, match="no more than rows"):
        leave_out_in_turn(fitted.fit, len(fitted.fit.rows) + 1)
    with pytest.raises(ArgumentError) as error:
        solve(recorded(95.0, 1), fitting=Fitting(folds=10**6))
    assert error.value.argument == "fitting.folds"
