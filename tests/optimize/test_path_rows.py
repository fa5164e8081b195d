"""Path constraints that are rows: they hold at the start too, as bounds do, and in the size of what they bound."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve, transcribe

MESH = Mesh(5)
NANO = 1e-9


class High(gt.Optimization):
    """As high as it may be at the start; then it pays to fall."""

    p = gt.parameter(1.0)
    x = gt.variable(start=0.5)
    u = gt.input(min=-50.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return -self.x.at(0.0) + 0.1 * gt.integral(self.x**2)

    def constraints(self) -> Iterable[Any]:
        yield self.x <= self.p


class Cubed(High):
    y = gt.variable(max=8.0)

    def equations(self):
        yield der(self.x) == self.u
        yield self.y == self.x**3

    def constraints(self):
        return ()


class ByFree(High):
    k = gt.free(1.0, min=1.0, max=1.0)

    def constraints(self):
        yield self.x <= self.k


class TestAtTheStart:
    def test_a_row_and_a_bound_give_one_optimum(self):
        bound = solve(High(), MESH)
        for row in (transcribe(High(), MESH).solve(), solve(ByFree(), MESH)):
            assert row.objective == pytest.approx(bound.objective, abs=1e-7)
            assert row.trajectory["x"][0] == pytest.approx(1.0, abs=1e-6)

    def test_other_values_of_the_parameter(self):
        t = transcribe(High(), MESH)
        assert t.solve({"p": 2.0}).objective == pytest.approx(solve(High(p=2.0), MESH).objective, abs=1e-7)

    @pytest.mark.parametrize("form", ["explicit", "inverse", "dae"])
    def test_bound_of_an_eliminated_variable(self, form):
        s = solve(Cubed(), MESH, solver=SolverOptions(formulation=form))
        assert s.trajectory["x"][0] == pytest.approx(2.0, abs=1e-4)

    def test_the_row_has_a_multiplier_of_its_own(self):
        """The cost falls by nearly 1 per unit that the row at the start is raised; the path rows are slack."""
        s = transcribe(High(), MESH).solve()
        assert s.multiplier("at the start: constraint 1") == pytest.approx(1.0, abs=0.05)
        assert np.shape(s.multiplier("constraint 1")) == (5, 3)

    def test_a_fixed_start_that_breaks_it(self):
        class Fixed(High):
            x = gt.variable(start=1.5, fixed=True)
            y = gt.variable(max=2.0)

            def equations(self):
                yield der(self.x) == self.u
                yield self.y == self.x**2

            def constraints(self):
                return ()

        with pytest.raises(gt.ModelError, match=r"fixed start values violate 'bounds of y' by 0\.25"):
            solve(Fixed(), MESH)

    def test_an_equation_along_the_path_with_a_fixed_start(self):
        class Line(High):
            x = gt.variable(start=0.0, fixed=True)

            def constraints(self):
                yield self.x == self.p * self.time

        for s in (solve(Line(), MESH), transcribe(Line(), MESH).solve()):
            assert s.trajectory["x"][-1] == pytest.approx(1.0, abs=1e-6)


class Tiny(gt.Optimization):
    x = gt.variable(start=0.0, fixed=True, nominal=NANO)
    q = gt.variable(max=0.4 * NANO, nominal=NANO)
    u = gt.input(nominal=NANO, min=-10 * NANO, max=10 * NANO)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u
        yield self.q == self.u + 0.5 * self.x

    def objective(self):
        return -self.x.at(1.0) / NANO


class TinyRow(Tiny):
    q = gt.variable()

    def constraints(self):
        yield self.u + 0.5 * self.x <= 0.4 * NANO


class TestSize:
    # x' = 0.4e-9 - x / 2
    END = 0.8 * (1 - np.exp(-0.5))

    @pytest.mark.parametrize("cls", [Tiny, TinyRow])
    @pytest.mark.parametrize("form", ["auto", "explicit", "dae"])
    def test_nano(self, cls, form):
        s = solve(cls(), Mesh(6), solver=SolverOptions(formulation=form))
        assert s.trajectory["x"][-1] / NANO == pytest.approx(self.END, abs=1e-6)
        assert s.checks["constraint_violation"].passed

    def test_multipliers_are_in_si_units(self):
        """Sum over the points of the multipliers: what the cost falls by when the bound is raised everywhere."""
        tall = type("Tall", (Tiny,), {"q": gt.variable(max=0.5 * NANO, nominal=NANO)})
        a, b = solve(Tiny(), Mesh(6)), solve(tall(), Mesh(6))
        slope = (b.objective - a.objective) / (0.1 * NANO)
        assert -np.sum(a.multiplier("bounds of q")) == pytest.approx(slope, rel=1e-4)


def test_fatrop_takes_the_row_at_the_start():
    class Two(gt.Optimization):
        x = gt.variable(start=0.5)
        v = gt.variable(start=0.5)
        u = gt.input()
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.v
            yield der(self.v) == self.u

        def objective(self):
            return gt.integral((self.x - 9) ** 2 + self.u**2)

        def constraints(self):
            yield self.x**2 <= 4 + 100 * self.time

    a, b = solve(Two(), MESH), solve(Two(), MESH, solver=SolverOptions(solver="fatrop"))
    assert b.objective == pytest.approx(a.objective, rel=1e-6)
    assert b.trajectory["x"][0] == pytest.approx(2.0, abs=1e-6)
    name = "at the start: constraint 1"
    assert b.multiplier(name) == pytest.approx(a.multiplier(name), rel=1e-3) and a.multiplier(name) > 0.1


@pytest.mark.parametrize("cls", [High, Cubed])
def test_gauss_edges(cls):
    """A row holds at the end too, where no Gauss point lies: it pays to climb over the bound there."""

    class Up(cls):
        u = gt.input(min=-50.0, max=50.0)

        def objective(self):
            return -self.x.at(1.0) + 0.01 * gt.integral(self.x**2 + self.u**2)

    top = 1.0 if cls is High else 2.0
    s = transcribe(Up(), Mesh(5, 2, "gauss")).solve()
    assert s.trajectory["x"][-1] <= top + 1e-6
    name = "constraint 1" if cls is High else "bounds of y"
    assert np.shape(s.multiplier(f"at the edge: {name}")) == (5,)
    assert np.shape(s.multiplier(name)) == (5, 2)
    if cls is High:
        assert s.objective == pytest.approx(solve(Up(), Mesh(5, 2, "gauss")).objective, abs=1e-6)
