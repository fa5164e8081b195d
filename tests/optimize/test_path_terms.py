"""Quantities along a path multiplied out: the same numbers, and few operations that depend on the speed."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from gtmodel.optimize.path import collected
from tests.bench.bench_path import symbolic
from tests.bench.rivals.l1_by_hand import Motion

ROUND_OFF = 1e-12  # relative to the largest row: sums in another order


def rebuilt(expression: ca.SX, variables: ca.SX, given: ca.SX) -> tuple[ca.Function, ca.Function, ca.Function]:
    """The expression as it stands and by its terms, and what of these depends on the variables."""
    rows, symbols, coefficients = collected(expression, variables)
    of = ca.Function("of", [variables, symbols], [rows], {"cse": True})
    return (
        ca.Function("whole", [variables, given], [expression]),
        ca.Function("terms", [variables, given], [of(variables, coefficients)]),
        of,
    )


def assert_equal_values(whole: ca.Function, terms: ca.Function, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(20):
        at = rng.uniform(0.2, 1.5, whole.numel_in(0)), rng.uniform(0.2, 1.5, whole.numel_in(1))
        a, b = np.asarray(whole(*at)).reshape(-1), np.asarray(terms(*at)).reshape(-1)
        assert a == pytest.approx(b, rel=ROUND_OFF, abs=ROUND_OFF * (1 + np.max(np.abs(a))))


def test_every_kind_of_operation():
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    v, a = x[0], x[1]
    column = ca.vertcat(
        (p[0] * v + p[1]) ** 2 - a * ca.sin(p[2]), -(2 * (v - p[0])) * a, v / p[0] - p[1] / (1 + v**2),
        ca.tanh(p[0] * v + a) * p[1] * v + ca.sqrt(1 + v * v), ca.fmax(v * p[0], a) + ca.if_else(v > p[1], a, v),
        (1 + v + a + p[0]) ** 5 / (p[1] + v + a), p[0] * p[1], 3.0, v, v - v, ca.atan2(a * p[1], v), 1 / p[0] + 1 / v,
    )  # fmt: skip
    whole, terms, _ = rebuilt(column, x, p)
    assert_equal_values(whole, terms)


def test_nothing_at_all():
    rows, symbols, coefficients = collected(ca.SX(0, 1), ca.SX.sym("x"))
    assert rows.numel() == symbols.numel() == coefficients.numel() == 0


def test_inverse_dynamics_become_few_products():
    quantities = symbolic(Motion(0.0).robot)
    x, place = ca.SX.sym("x", 3), ca.SX.sym("place", 9)
    v, b, a = ca.vertsplit(x)
    home, slope, curvature = ca.vertsplit(place, [0, 3, 6, 9])
    written = quantities(home, slope * v, curvature * b + slope * a)
    whole, terms, of = rebuilt(written, x, place)
    rng = np.random.default_rng(1)
    for _ in range(20):
        pose = np.array([0.4, -0.9, 0.3]) + rng.uniform(-0.1, 0.1, 3)
        at = rng.uniform(-1, 1, 3), np.concatenate([pose, rng.uniform(-1, 1, 6)])
        p, q = np.asarray(whole(*at)).reshape(-1), np.asarray(terms(*at)).reshape(-1)
        assert p == pytest.approx(q, rel=0, abs=ROUND_OFF * (1 + np.max(np.abs(p))))
    # mass, speeds, Coulomb and viscous friction, weight: five terms for each of three motors, three hyperbolic tangents
    assert of.n_instructions() < whole.n_instructions() / 2
