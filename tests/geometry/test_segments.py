"""Distances of segments and boxes against dense sampling and cases known by hand."""

from __future__ import annotations

import numpy as np
import pytest

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
