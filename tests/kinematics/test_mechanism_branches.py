"""All solutions of planar and spatial mechanisms by declared branches, against intersections of circles and spheres."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

import gtmodel as gt
from problems.models import mechanisms
from tests.support.mechanisms import RodFiveBar

ROUND_OFF = 1e-11  # some hundred operations on numbers of order one; Newton's method ends at 1e-12
CLOSED = {"explicit", "linear", "quadratic", "sphere pencil"}


@cache
def model(name):
    return (RodFiveBar if name == "RodFiveBar" else getattr(mechanisms, name))()


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


def test_five_bar_has_two_forward_solutions_in_closed_form():
    q = np.array([2.2, 0.9])
    elbows = [np.array([0.4 * k + 0.4 * np.cos(a), 0.4 * np.sin(a)]) for k, a in enumerate(q)]
    for side, T in zip((1, -1), both(elbows[0], 0.5, elbows[1], 0.5), strict=True):
        f = model("RodFiveBar").causal("q", "T", branches={"above": side})
        assert {b.kind for b in f.plan.blocks} <= CLOSED
        found, status = f(q)
        assert status == gt.Status.OK
        assert np.allclose(found, [*T, 0.0], atol=ROUND_OFF)


@pytest.mark.parametrize("sides", list(product((1, -1), repeat=2)))
def test_five_bar_has_four_inverse_solutions(sides):
    f = model("RodFiveBar").causal(["T[0]", "T[1]"], "q", branches={f"elbow_{k}": s for k, s in enumerate(sides)})
    T = np.array([0.2, 0.55])
    q, status = f(*T)
    assert status == gt.Status.OK
    for k, side in enumerate(sides):
        base = np.array([0.4 * k, 0.0])
        elbow = both(base, 0.4, T, 0.5)[0 if side > 0 else 1]
        assert np.allclose(base + 0.4 * np.array([np.cos(q[k]), np.sin(q[k])]), elbow, atol=ROUND_OFF)


def mirrored(k):
    """The angle of arm k with its elbow on the right, at the start pose."""
    base, corner = np.array(mechanisms.ThreeArms().A[k][:2]), np.array([0.4, 0.25])
    corner = corner + np.array(mechanisms.ThreeArms().B[k][:2])
    elbow = both(base, 0.3, corner, 0.35)[1] - base
    return float(np.arctan2(elbow[1], elbow[0]))


@pytest.mark.parametrize("sides", list(product((1, -1), repeat=3)))
def test_three_arms_with_a_planar_platform_have_eight_inverse_solutions(sides):
    # each solution from a start on its side: from another side's home Newton's method may not come so far
    start = [[1.65, -2.63, -0.43][k] if side > 0 else mirrored(k) for k, side in enumerate(sides)]
    m = mechanisms.ThreeArms(q={"start": start})
    f = m.causal(["x[0]", "x[1]", "angle"], "q", branches={f"elbow_{k}": s for k, s in enumerate(sides)})
    x, angle = np.array([0.41, 0.26]), 0.15
    q, status = f(*x, angle)
    assert status == gt.Status.OK
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for k, side in enumerate(sides):
        base, corner = np.array(m.A[k][:2]), x + R @ np.array(m.B[k][:2])
        elbow = both(base, 0.3, corner, 0.35)[0 if side > 0 else 1]
        assert np.allclose(base + 0.3 * np.array([np.cos(q[k]), np.sin(q[k])]), elbow, atol=ROUND_OFF)
