"""Synthetic pictures: areas against polygons clipped by hand, and what light and noise make of them."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.vision import rendering

EXACT = 1e-12  # areas are sums of products of coordinates


def clipped(polygon: np.ndarray, column: int, row: int) -> float:
    """Area of a polygon within one pixel, by Sutherland and Hodgman: an independent way to each share."""
    p = [tuple(x) for x in polygon]
    for axis, sign, bound in ((0, 1, column - 0.5), (0, -1, column + 0.5), (1, 1, row - 0.5), (1, -1, row + 0.5)):
        kept = []
        for a, b in zip(p, p[1:] + p[:1], strict=True):
            inside_a, inside_b = sign * (a[axis] - bound) >= 0, sign * (b[axis] - bound) >= 0
            if inside_a:
                kept.append(a)
            if inside_a != inside_b:
                t = (bound - a[axis]) / (b[axis] - a[axis])
                kept.append((a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])))
        p = kept
        if not p:
            return 0.0
    x, y = np.array(p).T
    return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2


def test_coverage_is_the_clipped_area_of_every_pixel():
    rng = np.random.default_rng(1)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
    polygon = np.column_stack([6 + 5 * np.cos(angles), 5 + 4 * np.sin(angles)])
    got = rendering.coverage([polygon], (13, 11))
    expected = [[clipped(polygon, i, j) for i in range(13)] for j in range(11)]
    np.testing.assert_allclose(got, expected, atol=EXACT)


def test_what_leaves_the_picture_counts_only_where_it_is_inside():
    square = np.array([[-3.2, -3.2], [1.3, -3.2], [1.3, 1.9], [-3.2, 1.9]])
    got = rendering.coverage([square[::-1]], (4, 3))
    expected = [[clipped(square, i, j) for i in range(4)] for j in range(3)]
    np.testing.assert_allclose(got, expected, atol=EXACT)
    assert rendering.coverage([square + 50], (4, 3)).max() == 0


def test_an_outline_that_is_not_finite_is_refused():
    with pytest.raises(gt.results.ArgumentError) as refused:
        rendering.coverage([np.array([[0.0, 0.0], [1.0, np.nan], [1.0, 1.0]])], (4, 4))
    assert refused.value.argument == "outlines"


def test_the_same_seed_gives_the_same_bytes_and_noise_has_its_size():
    layer = rendering.Layer([np.array([[2.0, 2.0, 1.0], [9.0, 2.0, 1.0], [9.0, 8.0, 1.0]])], 30.0)

    def draw(seed: int, noise: float) -> np.ndarray:
        exposure = rendering.Exposure(seed=seed, noise=noise)
        return rendering.rendered([layer], lambda p: p[:, :2], (200, 200), exposure)

    assert np.array_equal(draw(3, 2.0), draw(3, 2.0))
    assert not np.array_equal(draw(3, 2.0), draw(4, 2.0))
    difference = draw(3, 2.0).astype(float) - draw(3, 0.0)
    assert difference.std() == pytest.approx(2.0, rel=0.05)  # 40,000 pixels; rounding adds 1/24 of a variance of 4


def test_a_shape_behind_the_camera_is_refused():
    layer = rendering.Layer([np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 1.0, 1.0]])], 30.0)

    def pinhole(p):
        return np.where(p[:, 2:] > 0, p[:, :2] / p[:, 2:], np.nan)

    with pytest.raises(gt.results.ArgumentError) as refused:
        rendering.rendered([layer], pinhole, (20, 20))
    assert refused.value.argument == "layers"
