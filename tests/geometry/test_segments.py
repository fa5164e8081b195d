"""Distances of segments and boxes against dense sampling and cases known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import lsq_linear

from gtmodel.geometry.distances import bounding_capsule, segment_to_box, segment_to_segment

DENSE = np.linspace(0.0, 1.0, 401)
# two samples of a segment of length L are L / 400 apart: a sampled distance exceeds the true one by at most half of it
# for each segment
SAMPLED = 1 / 400


def sampled(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a + DENSE[:, None] * (b - a)


def drawn(kind: str, rng: np.random.Generator) -> np.ndarray:
    a, b, c, d = rng.normal(size=(4, 3))
    if kind == "parallel":
        d = c + rng.normal() * (b - a)
    if kind == "nearly parallel":
        d = c + rng.normal() * (b - a) + 1e-7 * rng.normal(size=3)
    if kind in ("point", "points"):
        d = c
    if kind == "points":
        b = a
    if kind == "crossing":
        c = a + 0.4 * (b - a)
        d = c + rng.normal(size=3)
    return np.array([a, b, c, d])


@pytest.mark.parametrize("kind", ["any", "parallel", "nearly parallel", "point", "points", "crossing"])
def test_segments_against_samples(kind) -> None:
    rng = np.random.default_rng(7)
    for _ in range(12):
        a, b, c, d = drawn(kind, rng)
        distance, first, second = segment_to_segment(a, b, c, d)
        p, q = sampled(a, b), sampled(c, d)
        brute = float(np.min(np.linalg.norm(p[:, None] - q[None], axis=2)))
        length = np.linalg.norm(b - a) + np.linalg.norm(d - c)
        assert brute - SAMPLED * length <= distance[0] <= brute + 1e-9
        assert np.linalg.norm(first - second) == pytest.approx(distance[0], abs=1e-15)
        for x, u, v in ((first[0], a, b), (second[0], c, d)):  # the points lie on their segments
            assert np.linalg.norm(x - u) + np.linalg.norm(x - v) == pytest.approx(np.linalg.norm(u - v), abs=1e-12)


def test_segments_and_a_box_against_samples() -> None:
    rng = np.random.default_rng(8)
    half = np.array([0.5, 0.3, 0.8])
    a, b = rng.normal(size=(2, 60, 3)) * 1.2
    b[:20, 0] = a[:20, 0]  # parallel to a face
    b[20:25] = a[20:25]  # points
    a[25], b[25] = [-3.0, 0.0, 0.0], [3.0, 0.1, 0.0]  # through the box
    distance, on_segment, on_box = segment_to_box(a, b, half)
    for k in range(len(a)):
        p = sampled(a[k], b[k])
        brute = float(np.min(np.linalg.norm(np.maximum(np.abs(p) - half, 0.0), axis=1)))
        assert brute - SAMPLED * np.linalg.norm(b[k] - a[k]) <= distance[k] <= brute + 1e-12
    np.testing.assert_allclose(np.linalg.norm(on_segment - on_box, axis=1), distance, atol=1e-12)
    assert distance[25] == 0.0 and np.all(np.abs(on_box) <= half)


NUMBERS = st.floats(-2, 2).map(lambda x: round(x, 2))  # rounded: parallel and touching segments are drawn too
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)
CLOSE = 1e-6  # of the interior method of bounded least squares, at distances of 1


@settings(max_examples=40, deadline=None)
@given(POINTS, POINTS, POINTS, POINTS)
def test_segments_against_least_squares_that_know_no_geometry(p1, p2, r1, r2) -> None:
    # bounded least squares in both shares; a minimiser by differences stops up to 2 % above it
    fits = [lsq_linear(np.column_stack([p2 - p1, r1 - r2]), r1 - p1, (0, 1), m) for m in ("bvls", "trf")]
    found = segment_to_segment(p1, p2, r1, r2)[0][0]
    assert abs(found**2 - min(2 * fit.cost for fit in fits)) < CLOSE
    assert found == pytest.approx(segment_to_segment(r1, r2, p2, p1)[0][0], abs=1e-7)


@settings(max_examples=60, deadline=None)
@given(POINTS, POINTS, POINTS)
def test_a_segment_and_a_box_that_may_be_flat(p1, p2, size) -> None:
    points = p1 + np.linspace(0, 1, 2001)[:, None] * (p2 - p1)
    brute = np.linalg.norm(np.maximum(np.abs(points) - np.abs(size), 0.0), axis=1).min()
    found = segment_to_box(p1, p2, np.abs(size))[0][0]
    # never more than at any point of the segment, and the points are at most 3.5e-3 apart
    assert found <= brute + 1e-12 and brute - found < 2e-3


def test_nan_harms_no_other_row() -> None:
    p = np.array([[0.0, 0, 2], [np.nan, 0, 0], [0, 0, 3]])
    q, zero = p + np.array([1.0, 0, 0]), np.zeros((3, 3))
    np.testing.assert_array_equal(segment_to_box(p, q, np.ones(3))[0], [1.0, np.nan, 2.0])
    np.testing.assert_array_equal(segment_to_segment(p, q, zero, zero + np.eye(3)[0])[0], [2.0, np.nan, 3.0])


def test_distances_known_by_hand() -> None:
    assert segment_to_segment([0, 0, 0], [1, 0, 0], [2, 1, 0], [5, 1, 0])[0][0] == pytest.approx(np.sqrt(2))
    assert segment_to_box([2, 2, 0], [2, 0, 0], [1, 1, 1])[0][0] == pytest.approx(1.0)
    assert segment_to_box([2, 0, 0], [0, 2, 0], [0.5, 0.5, 0.5])[0][0] == pytest.approx(np.sqrt(0.5))  # an edge


def test_the_capsule_of_a_box_holds_its_corners() -> None:
    for size in ([0.1, 0.5, 0.2], [0.3, 0.3, 0.3], [0.0, 0.0, 1.0]):
        half, axis, radius = bounding_capsule(size)
        end = half * np.eye(3)[axis]
        corners = np.array(np.meshgrid(*([-x / 2, x / 2] for x in size))).reshape(3, -1).T
        distance = segment_to_segment(np.tile(-end, (8, 1)), np.tile(end, (8, 1)), corners, corners)[0]
        assert np.max(distance) <= radius + 1e-15
