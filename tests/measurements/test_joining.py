"""Joins of two recordings, against a search by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel.results import ArgumentError

RowJoin = gt.measurements.RowJoin
TIMES = st.lists(st.integers(0, 60), min_size=2, max_size=12, unique=True).map(sorted)


def recording(times: Any, **values: Any) -> gt.Trajectory:
    return gt.Trajectory(np.asarray(times, float), {n: np.asarray(v, float) for n, v in values.items()})


@given(TIMES, TIMES)
def test_the_nearest_row_is_that_of_a_search_over_all_rows(mine: list[int], theirs: list[int]) -> None:
    x = np.arange(len(theirs)) + 0.5
    rows = gt.measurements.joined(recording(mine, f=mine), recording(theirs, x=x), RowJoin("nearest", tolerance=100.0))
    for t, value in zip(mine, rows["x"], strict=True):
        assert abs(theirs[int(value)] - t) == min(abs(s - t) for s in theirs)


def test_rows_by_number_or_order_and_by_interpolation() -> None:
    first = recording([0, 1, 2], f=[5, 6, 7], number=[3, 1, 2])
    other = recording([0, 2, 4, 6], x=[10, 20, 30, 40], number=[1, 2, 3, 4])
    joined = gt.measurements.joined
    assert joined(first, other, RowJoin("number", number="number"))["x"].tolist() == [30, 10, 20]
    assert joined(first, recording([0, 5, 9], x=[1, 2, 3]), RowJoin("order"))["x"].tolist() == [1, 2, 3]
    assert joined(first, other.select("x"), RowJoin("interpolated"))["x"].tolist() == [10, 15, 20]


@pytest.mark.parametrize(
    ("match", "tolerance", "other", "argument"),
    [
        ("nearest", None, recording([0, 1], x=[1, 2]), "tolerance"),
        ("nearest", 0.5, recording([0, 1], x=[1, 2]), ""),
        ("interpolated", None, recording([0, 1], x=[1, 2]), ""),
        ("order", None, recording([0, 1], x=[1, 2]), ""),
        ("number", None, recording([0, 1], number=[1, 1]), ""),
        ("number", None, recording([0, 1], number=[1, 2]), ""),
        ("number", None, recording([0, 1, 2], number=[1, 2, 3]), "number"),
        ("any", None, recording([0, 1], x=[1, 2]), "match"),
    ],
)
def test_a_row_without_one_partner_is_an_error(match: Any, tolerance: Any, other: Any, argument: str) -> None:
    first = recording([0, 1, 2], number=[1, 2, 3])
    with pytest.raises(ArgumentError if argument else gt.measurements.LogError) as caught:
        gt.measurements.joined(first, other, RowJoin(match, tolerance, None if argument == "number" else "number"))
    assert getattr(caught.value, "argument", "") == argument
