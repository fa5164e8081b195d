"""Areas and boundaries: order of convergence, closed forms, scipy's hull, holes, edges, touching cells."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gtmodel.kinematics.workspace import region
from gtmodel.kinematics.workspace.volume import Region

LOOPS = 1e-12  # the same polygons, summed in another order
BISECTED = 1e-9  # of the crossings


def found(inside, h: float, half: float = 1.5) -> Region:
    u = np.arange(-half, half + h / 2, h)
    v = np.arange(-half - 0.3, half + h / 2, h)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    return region(inside, u, v, inside(uv.reshape(-1, 2)).reshape(uv.shape[:2]))


def disc(radius: float = 1.0, centre: tuple[float, float] = (0.07, -0.11)):
    return lambda p: ((p - centre) ** 2).sum(axis=1) < radius**2


def test_disc_converges_with_the_second_order() -> None:
    errors = [abs(found(disc(), h).area - np.pi) for h in (0.2, 0.1, 0.05, 0.025)]
    order = np.polyfit(np.log([0.2, 0.1, 0.05, 0.025]), np.log(errors), 1)[0]
    assert 1.7 < order < 2.4 and errors[-1] < 1e-3


def test_boundary_lies_on_the_circle_and_runs_round_it() -> None:
    r = found(disc(), 0.1)
    (loop,) = r.loops
    np.testing.assert_allclose(np.linalg.norm(loop - (0.07, -0.11), axis=1), 1.0, atol=BISECTED)
    assert r.area_within_loops == pytest.approx(r.area, rel=LOOPS) and r.area > 0
    assert r.area == pytest.approx(ConvexHull(loop).volume, rel=1e-9)
    np.testing.assert_allclose(r.extent, 2.0, atol=0.02)
    assert not r.on_edge


def test_a_hole_runs_the_other_way_and_is_taken_off() -> None:
    r = found(lambda p: disc()(p) & ~disc(0.4)(p), 0.02)
    assert len(r.loops) == 2 and r.area == pytest.approx(np.pi * (1 - 0.16), abs=2e-3)
    assert r.area_within_loops == pytest.approx(r.area, rel=LOOPS)


def test_what_leaves_the_grid_is_cut_and_says_so() -> None:
    r = found(lambda p: p[:, 0] > 0.123, 0.1)
    assert r.on_edge and r.area == pytest.approx((1.5 - 0.123) * 3.3, abs=1e-6)
    assert r.area_within_loops == pytest.approx(r.area, rel=LOOPS)


@pytest.mark.parametrize("joined", [True, False])
def test_two_opposite_corners(joined: bool) -> None:
    """One cell with two regions, or one that passes between them: its middle decides."""

    def inside(p: np.ndarray) -> np.ndarray:
        if joined:
            return np.abs(p[:, 0] - p[:, 1]) < 0.5
        return np.abs(p[:, 0] + p[:, 1] - 1.0) > 0.5

    u = np.array([0.0, 1.0])
    mask = inside(np.array([[0.0, 0], [0, 1], [1, 0], [1, 1]])).reshape(2, 2)
    np.testing.assert_array_equal(mask, np.eye(2))
    r = region(inside, u, u, mask)
    assert r.area == pytest.approx(0.75 if joined else 0.25, abs=BISECTED)
    assert len(r.loops) == (1 if joined else 2)
    assert r.area_within_loops == pytest.approx(r.area, rel=LOOPS)


def test_nothing_inside() -> None:
    r = found(lambda p: np.zeros(len(p), dtype=bool), 0.5)
    assert r.area == 0.0 and r.loops == () and not r.on_edge and np.all(r.extent == 0) and np.isnan(r.low).all()
