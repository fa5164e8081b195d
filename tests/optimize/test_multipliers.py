"""Multipliers by name: whole words, vectors, and what two elements share, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve

NUMBERS = 1e-6  # exact for these quadratic problems but for the solver's tolerance


class Ten(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    x2 = gt.variable(start=0.0, fixed=True)
    u = gt.input()
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u
        yield der(self.x2) == self.x

    def objective(self):
        return gt.integral(self.u**2 + self.x**2)

    def constraints(self):
        yield self.u + self.x <= 10
        for k in range(2, 12):
            yield self.x.at(0.05 * k) * self.x.at(0.0) <= 0.9 + k


def test_whole_words():
    s = solve(Ten(), Mesh(4), solver=SolverOptions(formulation="explicit", prefer=("x", "x2")))
    assert np.shape(s.multiplier("constraint 1")) == (4, 3)
    assert np.shape(s.multiplier("constraint 10")) == ()
    for name in ("constraint", "constr", "continuity of y"):
        with pytest.raises(KeyError, match=f"rows begin with '{name}'"):
            s.multiplier(name)


def test_entries_of_a_vector():
    """x = a t to x(1) = (1, 3) costs a'a: a row raised by e asks for a smaller x by e, so -2 a."""

    class Two(gt.Optimization):
        x = gt.variable(2, start=[0.0, 0.0], fixed=True, nominal=[1.0, 10.0])
        u = gt.input(2)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return gt.integral(self.u[0] ** 2 + self.u[1] ** 2)

        def constraints(self):
            yield self.x.at(1.0) + 0.0 * self.u.at(0.3) == [1.0, 3.0] + 1e-9 * self.x.at(0.3)

    s = solve(Two(), Mesh(3))
    assert s.multiplier("constraint 1") == pytest.approx([-2.0, -6.0], rel=NUMBERS)
    assert s.multiplier("constraint 1[1]") == pytest.approx(-6.0, rel=NUMBERS)
    costate = s.multiplier("continuity of x")
    assert isinstance(costate, np.ndarray) and costate.shape == (3, 2)
    assert costate == pytest.approx(np.tile([-2.0, -6.0], (3, 1)), rel=NUMBERS)


def test_rows_of_a_torn_block_have_names_and_sizes_of_their_own():
    """The torn equations and the whole system ("dae") have one and the same multiplier for one equation."""

    class Torn(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True)
        z = gt.variable(start=0.5, nominal=3.0)
        y = gt.variable(start=0.5, nominal=0.1)
        u = gt.input(min=-1, max=1)
        final_time = 2.0

        def equations(self):
            yield der(self.x) == -self.z + self.u
            yield self.z + 0.3 * gt.sin(self.z + self.y) == self.x * 0.5
            yield 100 * self.y + 0.2 * gt.cos(self.z * self.y) == self.x * 0.7

        def objective(self):
            return gt.integral(self.x**2 + 0.1 * self.u**2)

    torn, dae = (solve(Torn(), Mesh(4), solver=SolverOptions(formulation=f)) for f in ("torn", "dae"))
    blocks = [n for n in torn.multiplier_names if n.startswith("block of")]
    names = [n for n in dae.multiplier_names if "equation 2" in n or "equation 3" in n]
    assert len(blocks) == len(names) == 2
    for block, name in zip(blocks, names, strict=True):
        assert torn.multiplier(block) == pytest.approx(dae.multiplier(name), rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("scale", [1.0, 50.0])
def test_the_bound_of_a_state_at_the_ends_of_elements(scale):
    """Where x rests at its bound 0.5, (x - 1)^2 presses with 1 at each instant: also where two elements meet."""

    class Held(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True, max=0.5, nominal=scale)
        u = gt.input()
        final_time = 2.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return gt.integral((self.x - 1) ** 2 + 0.1 * self.u**2)

    mesh = Mesh(10)
    found = solve(Held(), mesh).bound_multiplier("x") / (mesh.table.weights * 0.2)
    assert found[6:] == pytest.approx(1.0, abs=1e-4)


def test_the_bound_of_a_continuous_control():
    """(u - 2)^2 with u <= 1 over 2 s: all bounds together press with 4, each edge by its hat function."""

    class Hat(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        u = gt.input(max=1.0)
        final_time = 2.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return gt.integral((self.u - 2) ** 2)

    found = solve(Hat(), Mesh(5, control="linear")).bound_multiplier("u")
    assert found[:, 0] == pytest.approx([0.4, 0, 0, 0, 0], abs=1e-6)
    assert found[:, 1] == pytest.approx([0.8, 0.8, 0.8, 0.8, 0.4], abs=1e-6)
