"""A guess of the F1's axes, or of anything else, leads its inverse to that solution, near folds too."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt

HOME_Q = np.array([0.72, 0.26, 0.21, 0.0, 0.0, 0.0])
RANGE = np.array([0.3, 0.3, 0.3, 0.8, 0.8, 0.8])  # m, rad: beyond folds of the arms
SAME = 1e-6  # m, rad


@pytest.fixture(scope="module")
def poses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes and poses that belong to them."""
    q = HOME_Q + RANGE * np.random.default_rng(1).uniform(-1, 1, (700, 6))
    T, e, status = gt.robots.f1_gantry_tau().causal("q", ["T", "e"])(q)
    ok = status == gt.Status.OK
    return q[ok], T[ok], e[ok]


def test_by_the_axes(poses: tuple[np.ndarray, np.ndarray, np.ndarray]):
    q, T, e = poses
    inverse = gt.robots.f1_gantry_tau().causal(["T", "e"], "q")
    plain, _ = inverse(T, e)
    hard = ~(np.abs(plain - q).max(axis=1) < SAME)  # the way from home leads to another solution, or to none
    assert hard.sum() > 20
    q, T, e = q[hard], T[hard], e[hard]
    found, status = inverse(T, e, guess={"q": q})
    assert np.all(status == gt.Status.OK) and np.abs(found - q).max() < SAME
    near = q + 1e-4 * np.random.default_rng(2).standard_normal(q.shape)  # the last sample of a controller
    found, status = inverse(T, e, guess={"q": near})
    right = np.abs(found - q).max(axis=1) < SAME
    assert right.sum() >= len(q) - 2  # a fold may lie between
    one, status = inverse(T[0], e[0], guess={"q": q[0]})
    assert status is gt.Status.OK and np.abs(one - q[0]).max() < SAME


@pytest.mark.parametrize(
    "names", [("q[3]", "q[4]", "q[5]"), ("q", "tau"), tuple(f"link[{k}].a.r" for k in range(1, 6))]
)
def test_by_other_names(names: tuple[str, ...], poses: tuple[np.ndarray, np.ndarray, np.ndarray]):
    robot = gt.robots.f1_gantry_tau()
    q, T, e = (a[:40] for a in poses)
    inverse = robot.causal(["T", "e"], "q")
    seen = [n for n in names if n != "tau"]
    *values, status = robot.causal("q", seen)(q)
    assert np.all(status == gt.Status.OK)
    guess = dict(zip(seen, values, strict=True)) | ({"tau": np.zeros(6)} if "tau" in names else {})
    found, status = inverse(T, e, guess=guess)
    assert np.all(status == gt.Status.OK) and np.abs(found - q).max() < SAME


def test_a_guess_that_is_no_number_goes_the_ordinary_way(poses: tuple[np.ndarray, np.ndarray, np.ndarray]):
    q, T, e = (a[:5] for a in poses)
    inverse = gt.robots.f1_gantry_tau().causal(["T", "e"], "q")
    spoilt = q.copy()
    spoilt[2, 3] = np.nan
    plain, _ = inverse(T[2:3], e[2:3])
    found, _ = inverse(T, e, guess={"q": spoilt})
    np.testing.assert_allclose(found[2:3], plain, atol=1e-12)
    for tells_nothing in ({"tau": np.zeros(6)}, {"T": T + 1.0}):
        np.testing.assert_allclose(inverse(T, e, guess=tells_nothing)[0], inverse(T, e)[0], atol=1e-12)
