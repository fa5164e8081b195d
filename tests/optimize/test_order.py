"""Orders of convergence of both schemes, measured on problems with known solutions."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve

# The observed order between 16 and 32 elements: the next term of the error expansion is a few per cent of the first.
ASYMPTOTIC = 0.12
TIGHT = SolverOptions(tolerance=1e-12)  # errors down to 1e-11 are to be seen


class Decay(gt.Optimization):
    """x' = -2 t x^2, x(0) = 1: x = 1 / (1 + t^2), int x = atan t. Nonlinear, time-dependent, nothing to choose."""

    rate = gt.parameter(1.0, unit="1/s")
    x = gt.variable(start=1.0, fixed=True)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == -2 * self.rate * self.time * self.x**2

    def objective(self):
        return gt.integral(self.x)


class Regulator(gt.Optimization):
    """x' = u, int x^2 + u^2: x = cosh(tf - t) / cosh tf, cost tanh tf."""

    x = gt.variable(start=1.0, fixed=True)
    u = gt.input()
    final_time = 2.0

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return gt.integral(self.x**2 + self.u**2)


@cache
def configured(cls):
    return cls()


@cache
def errors(cls, scheme: str, points: int, elements: int) -> dict[str, float]:
    """Largest error of the state at the mesh edges and at all collocation points, and of the cost."""
    exact = {
        Decay: (lambda t: 1 / (1 + t**2), np.arctan(2.0)),
        Regulator: (lambda t: np.cosh(2 - t) / np.cosh(2), np.tanh(2.0)),
    }
    x, cost = exact[cls]
    solution = solve(configured(cls), Mesh(elements, points, scheme), solver=TIGHT)
    edges = solution.sample(np.linspace(0.0, 1.0, elements + 1))
    inner = solution.trajectory
    return {
        "edges": float(np.max(np.abs(edges["x"] - x(edges.time)))),
        "points": float(np.max(np.abs(inner["x"] - x(inner.time)))),
        "cost": abs(solution.objective - cost),
    }


def order(cls, scheme, points, what) -> float:
    return float(np.log2(errors(cls, scheme, points, 16)[what] / errors(cls, scheme, points, 32)[what]))


@pytest.mark.parametrize("scheme, points", [(s, k) for s in ("radau", "gauss") for k in (1, 2, 3)])
class TestOrder:
    def expected(self, scheme, points):
        return 2 * points - (1 if scheme == "radau" else 0)

    def test_states_at_the_mesh_edges(self, scheme, points):
        expected = self.expected(scheme, points)
        assert order(Decay, scheme, points, "edges") == pytest.approx(expected, abs=ASYMPTOTIC)
        assert order(Regulator, scheme, points, "edges") == pytest.approx(expected, abs=ASYMPTOTIC)

    def test_states_at_the_collocation_points(self, scheme, points):
        # stage order: one more than the points, but not above the order at the edges
        expected = min(points + 1, self.expected(scheme, points))
        assert order(Decay, scheme, points, "points") == pytest.approx(expected, abs=ASYMPTOTIC)

    def test_cost(self, scheme, points):
        assert order(Regulator, scheme, points, "cost") == pytest.approx(self.expected(scheme, points), abs=ASYMPTOTIC)


@pytest.mark.parametrize("scheme, control, expected", [("radau", "polynomial", 3), ("radau", "constant", 2)])
def test_constant_control_costs_an_order(scheme, control, expected):
    """Two points: the best input that is constant per element is first order, its cost second."""
    costs = [solve(configured(Regulator), Mesh(n, 2, scheme, control), solver=TIGHT).objective for n in (16, 32)]
    first, second = np.abs(np.array(costs) - np.tanh(2.0))
    assert np.log2(first / second) == pytest.approx(expected, abs=ASYMPTOTIC)


def test_unequal_elements_of_a_clustered_mesh_are_as_exact():
    """Lengths enter everywhere: halving all elements of an uneven mesh gains the same order."""
    lengths = (1.0, 0.3, 0.3, 2.0, 0.7, 1.1, 0.5, 1.4) * 2
    halved = tuple(np.repeat(lengths, 2))
    found = [
        abs(solve(configured(Regulator), Mesh(len(n), 2, lengths=n), solver=TIGHT).objective - np.tanh(2.0))
        for n in (lengths, halved)
    ]
    assert np.log2(found[0] / found[1]) == pytest.approx(3, abs=ASYMPTOTIC)
