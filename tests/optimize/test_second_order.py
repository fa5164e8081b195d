"""A stationary point is called solved without more words only where it is a minimum.

int u^2 - k x^2 dt of x' = u from 0 to 0 within 1 s has a conjugate point at k = pi^2: beyond it x = 0 satisfies every
first-order condition, and is no minimum.
"""

from __future__ import annotations

import math

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve
from gtmodel.results import Trajectory

GUESS = Trajectory([0.0, 0.5, 1.0], {"x": [0.0, 0.3, 0.0], "y": [0.0, 0.0, 0.0]}, {"x": "1", "y": "1"})


class Pair(gt.Optimization):
    """Two of them; the guess lets IPOPT step in x, and stay where it is in y."""

    k = gt.parameter(1.0)
    x = gt.variable(start=0.0, fixed=True, min=-5, max=5)
    y = gt.variable(start=0.0, fixed=True, min=-5, max=5)
    u = gt.input(min=-50, max=50)
    v = gt.input(min=-50, max=50)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u
        yield der(self.y) == self.v

    def constraints(self):
        yield self.x.at(self.final_time) == 0
        yield self.y.at(self.final_time) == 0

    def objective(self):
        return gt.integral(self.u**2 - self.x**2 + self.v**2 - self.k * self.y**2)


@pytest.mark.parametrize("k", [0.0, 4.0, 0.9 * math.pi**2, 1.2 * math.pi**2, 15.0, 30.0])
def test_a_saddle_is_said_to_satisfy_first_order_conditions_only(k: float) -> None:
    found = solve(Pair(k=k), Mesh(10, 3), guess=GUESS, throw=False)
    assert found.status.ok, found.message
    saddle = abs(found.objective) < 1e-6 and k > math.pi**2
    assert ("first-order" in found.message) == saddle, (found.objective, found.message)
    assert saddle or k < math.pi**2


@pytest.mark.parametrize("hessian", ["lbfgs"])
def test_without_second_derivatives_nothing_is_said_of_them(hessian: str) -> None:
    options = SolverOptions(hessian=hessian)  # type: ignore[arg-type]
    found = solve(Pair(k=1.0), Mesh(6, 2), guess=GUESS, solver=options, throw=False)
    assert found.status.ok and "first-order" in found.message


def test_a_start_at_the_answer_shows_nothing() -> None:
    """IPOPT takes no step there, and so never looks at the Hessian."""
    flat = Trajectory([0.0, 1.0], {n: [0.0, 0.0] for n in "xyuv"}, dict.fromkeys("xyuv", "1"))
    found = solve(Pair(k=30.0), Mesh(6, 2), guess=flat, throw=False)
    assert not found.status.ok or "first-order" in found.message, found.message
