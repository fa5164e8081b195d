"""All solutions of planar and spatial mechanisms by declared branches, against intersections of circles and spheres."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

import gtmodel as gt
from problems.models import mechanisms

ROUND_OFF = 1e-11  # some hundred operations on numbers of order one; Newton's method ends at 1e-12
CLOSED = {"explicit", "linear", "quadratic", "sphere pencil", "angle"}


@cache
def model(name):
    return getattr(mechanisms, name)()


def both(A, a, B, b):
    """The two intersections of circles in the plane: left and right of the line from A to B."""
    d = np.linalg.norm(B - A)
    along = (d**2 + a**2 - b**2) / (2 * d)
    e = (B - A) / d
    across = np.sqrt(a**2 - along**2) * np.array([-e[1], e[0]])
    return A + along * e + across, A + along * e - across


def test_delta_has_two_forward_solutions_in_closed_form():
    found = []
    q = np.array([0.3, 0.4, 0.2])
    for side in (1, -1):
        f = model("Delta").causal("q", "T", branches={"below": side})
        assert {b.kind for b in f.plan.blocks} <= CLOSED
        assert f.casadi.n_instructions() < 250  # Newton's method took 3,463
        T, status = f(q)
        assert status == gt.Status.OK
        found.append(T)
    turns = [
        np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])
        for t in 2 * np.pi / 3 * np.arange(3)
    ]
    elbows = [R @ [0.15 + 0.3 * np.cos(a), 0.0, -0.3 * np.sin(a)] for R, a in zip(turns, q, strict=True)]
    for T in found:
        assert np.allclose([np.linalg.norm(T - e) for e in elbows], 0.8, atol=ROUND_OFF)
    assert found[0][2] < elbows[0][2] < found[1][2]
    _, status = model("Delta").causal("q", "T")([-3.0, 0.3, 0.3])
    assert status in (gt.Status.OK, gt.Status.OUT_OF_RANGE)


@pytest.mark.parametrize("sides", list(product((1, -1), repeat=3)))
def test_delta_has_eight_inverse_solutions_in_closed_form(sides):
    f = model("Delta").causal("T", "q", branches={f"knee_{k}": s for k, s in enumerate(sides)})
    assert {b.kind for b in f.plan.blocks} <= CLOSED
    assert f.casadi.n_instructions() < 250  # Newton's method took 1,793
    T = np.array([0.1, -0.05, -0.7])
    q, status = f(T)
    assert status == gt.Status.OK
    for k, side in enumerate(sides):
        # in the plane of the arm: x outwards, y up; the rod's end is off the plane
        x, off, z = np.array(mechanisms.TURNS[k]).T @ T
        solutions = both(np.array([0.15, 0.0]), 0.3, np.array([x, z]), np.sqrt(0.64 - off**2))
        elbow = max(solutions, key=lambda p: side * p[0])
        assert np.allclose([0.15 + 0.3 * np.cos(q[k]), -0.3 * np.sin(q[k])], elbow, atol=ROUND_OFF)


def test_five_bar_has_two_forward_solutions_in_closed_form():
    q = np.array([2.2, 0.9])
    elbows = [np.array([0.4 * k + 0.4 * np.cos(a), 0.4 * np.sin(a)]) for k, a in enumerate(q)]
    for side, x in zip((1, -1), both(elbows[0], 0.5, elbows[1], 0.5), strict=True):
        f = model("FiveBar").causal("q", "x", branches={"above": side})
        assert {b.kind for b in f.plan.blocks} <= CLOSED
        found, status = f(q)
        assert status == gt.Status.OK
        assert np.allclose(found, x, atol=ROUND_OFF)


@pytest.mark.parametrize("sides", list(product((1, -1), repeat=2)))
def test_five_bar_has_four_inverse_solutions_in_closed_form(sides):
    f = model("FiveBar").causal("x", "q", branches={f"knee_{k}": s for k, s in enumerate(sides)})
    assert {b.kind for b in f.plan.blocks} <= CLOSED
    x = np.array([0.2, 0.55])
    q, status = f(x)
    assert status == gt.Status.OK
    for k, side in enumerate(sides):
        base = np.array([0.4 * k, 0.0])
        outside = side > 0 if k == 0 else side < 0
        elbow = both(base, 0.4, x, 0.5)[0 if outside else 1]
        assert np.allclose(base + 0.4 * np.array([np.cos(q[k]), np.sin(q[k])]), elbow, atol=ROUND_OFF)


RNG = np.random.default_rng(44)
X, ANGLE = RNG.uniform([0.3, 0.15], [0.5, 0.35], (1000, 2)), RNG.uniform(-0.4, 0.6, 1000)


@pytest.mark.parametrize("sides", list(product((1, -1), repeat=3)))
def test_three_arms_with_a_planar_platform_have_eight_inverse_solutions_in_closed_form(sides):
    m = model("ThreeArms")
    f = m.causal(["x", "angle"], "q", branches={f"elbow_{k}": s for k, s in enumerate(sides)})
    assert {b.kind for b in f.plan.blocks} <= CLOSED
    q, status = f(X, ANGLE)
    R = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
    corners = X[:, None] + np.einsum("ijn,kj->nki", R, m.B) - m.A  # from the motors (1000, 3, 2)
    d = np.linalg.norm(corners, axis=2)
    ok = status == gt.Status.OK
    assert np.array_equal(ok, np.all((d > 0.05) & (d < 0.65), axis=1))
    # by the law of cosines in the triangle of arm, rod and the line from the motor to the corner
    bend = np.arccos((d[ok] ** 2 + 0.3**2 - 0.35**2) / (2 * 0.3 * d[ok]))
    expected = np.arctan2(corners[ok, :, 1], corners[ok, :, 0]) + np.array(sides) * bend
    assert np.allclose(np.exp(1j * q[ok]), np.exp(1j * expected), atol=1e-9)  # near a stretched leg bend is less exact
