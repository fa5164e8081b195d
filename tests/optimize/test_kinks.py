"""Functions with kinks in equations and at instants: optima in closed form, or one sentence."""

from __future__ import annotations

import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.optimize import Mesh, solve

MESH = Mesh(10)


class Table(gt.Optimization):
    """x' = u from 0 for 2 s; y is tabulated over x."""

    final_time = 2.0
    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable()
    u = gt.input(min=-1.0, max=1.0)

    def equations(self):
        yield der(self.x) == self.u
        yield self.y == gt.interpolate(self.x, [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 4.0, 9.0])

    def objective(self):
        return -self.y.at(2.0)


def test_a_table_at_the_end():
    """Its second derivative is zero wherever there is one."""
    assert solve(Table(), MESH).objective == pytest.approx(-4.0, rel=1e-6)


def test_an_input_that_acts_on_one_side_only():
    """max(u, -0.2) cannot be solved for u everywhere: the rates are used as they stand. From 0.7 to 0.7 - 0.4."""

    class OneSided(Table):
        def equations(self):
            yield der(self.x) == gt.maximum(self.u, -0.2)
            yield self.y == self.x + 0.7

        def objective(self):
            return self.y.at(2.0)

    s = solve(OneSided(), MESH)
    assert s.problem.formulation == "explicit"
    assert s.objective == pytest.approx(0.3, rel=1e-6)


def test_one_relation_is_no_list():
    class Returned(Table):
        def constraints(self):
            return self.x <= 0.2

    with pytest.raises(ModelError, match="returned one Relation; expected 'yield'"):
        solve(Returned(), MESH)
