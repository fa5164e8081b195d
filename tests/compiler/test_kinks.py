"""sign(), absolute values and minima of unknowns: their derivatives hide them, the compiler does not overlook them."""

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.rewriting import is_nonsmooth


class Sign(gt.Model):
    u = gt.input()
    x = gt.variable(start=2.0)

    def equations(self):
        yield self.x + gt.sign(self.x) == self.u


class Square(Sign):
    def equations(self):
        yield self.x**2 + gt.sign(self.x) == self.u


class Behind(Sign):
    v = gt.variable()

    def equations(self):
        yield self.x + gt.sign(self.v) == self.u
        yield self.v == 2 * self.x


class Disguised(Sign):
    v = gt.variable()

    def equations(self):
        yield self.x - self.u + gt.sign(self.v) == 0
        yield self.v == 3 * gt.absolute(self.x) - self.x


class Smaller(Sign):
    def equations(self):
        yield self.x + gt.minimum(self.x, 1 + 0 * self.u) == self.u


@pytest.mark.parametrize(
    ("model", "u", "x"),
    [(Sign, 3.0, 2.0), (Square, 3.0, np.sqrt(2)), (Behind, 3.0, 2.0), (Disguised, 3.0, 2.0), (Smaller, 3.0, 2.0)],
)
def test_an_unknown_inside_is_solved_for(model, u, x):
    found, status = model().causal(known="u", targets="x")(u)
    assert status is gt.Status.OK
    assert found == pytest.approx(x, abs=1e-12)


@pytest.mark.parametrize("u", [0.5, -0.9])
def test_where_the_jump_leaves_no_solution_there_is_a_status(u):
    x, status = Sign().causal(known="u", targets="x")(u)
    assert status is not gt.Status.OK
    assert np.isnan(x)


def test_known_values_inside_cost_nothing():
    f = Disguised().causal(known="x", targets="u")
    assert {b.kind for b in f.plan.blocks} == {"explicit"}
    assert f(-2.0) == (-1.0, gt.Status.OK)


def test_models_without_them_are_told_at_once():
    assert is_nonsmooth(flat_of(Sign()))
    assert not is_nonsmooth(flat_of(gt.robots.gantry_tau("l1_tape")))
