"""Distances against brute force: many points on the segments, and least squares that know no geometry."""

import numpy as np
from hypothesis import given, settings, strategies as st
from scipy.optimize import lsq_linear

from gtmodel.kinematics.workspace.clearance import between_segments, segment_to_box

NUMBERS = st.floats(-2, 2).map(lambda x: round(x, 2))  # rounded: parallel and touching segments are drawn too
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)
CLOSE = 1e-6  # of the interior method of bounded least squares, at distances of 1


def row(p):
    return np.asarray(p, dtype=float)[None]


@settings(max_examples=60, deadline=None)
@given(POINTS, POINTS, POINTS, POINTS)
def test_segments(p1, p2, r1, r2) -> None:
    # bounded least squares in both shares; a minimiser by differences stops up to 2 % above it
    fits = [lsq_linear(np.column_stack([p2 - p1, r1 - r2]), r1 - p1, (0, 1), m) for m in ("bvls", "trf")]
    found = between_segments(row(p1), row(p2), row(r1), row(r2))[0]
    assert abs(found**2 - min(2 * fit.cost for fit in fits)) < CLOSE
    assert (
        found == between_segments(row(p2), row(p1), row(r1), row(r2))[0]
        or abs(found - between_segments(row(p2), row(p1), row(r1), row(r2))[0]) < 1e-7
    )


@settings(max_examples=100, deadline=None)
@given(POINTS, POINTS, POINTS, POINTS)
def test_segment_and_box(p1, p2, c1, c2) -> None:
    low, high = np.minimum(c1, c2), np.maximum(c1, c2)
    t = np.linspace(0, 1, 2001)[:, None]
    points = p1 + t * (p2 - p1)
    brute = np.linalg.norm(points - np.clip(points, low, high), axis=1).min()
    found = segment_to_box(row(p1), row(p2), low, high)[0]
    # never more than at any point of the segment, and the points are at most 3.5e-3 apart
    assert found <= brute + 1e-12 and brute - found < 2e-3


def test_nan_harms_no_other_row() -> None:
    p = np.array([[0.0, 0, 2], [np.nan, 0, 0], [0, 0, 3]])
    q = p + np.array([1.0, 0, 0])
    low, high = -np.ones(3), np.ones(3)
    found = segment_to_box(p, q, low, high)
    np.testing.assert_allclose(found[[0, 2]], [1.0, 2.0])
    assert np.isnan(found[1])
    found = between_segments(p, q, 0 * q, 0 * q + np.array([1.0, 0, 0]))
    np.testing.assert_allclose(found[[0, 2]], [2.0, 3.0])
    assert np.isnan(found[1])
