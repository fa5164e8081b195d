"""Numbers far below one: what is small has its own size, and what is missed is said. Optima in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus, der
from gtmodel.optimize import Mesh, NotSolved, Phases, estimate, solve, solve_phases

MESH = Mesh(4)
SOLVER = 1e-6  # relative: IPOPT's 1e-8 on unknowns of order one, and what bounds give way by


def two(unit: float, objective=None, rows=lambda m: []):
    """x' = u, y' = w from 0, with int u^2 + 4 w^2 as the cost."""

    class Two(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True, nominal=unit)
        y = gt.variable(start=0.0, fixed=True, nominal=unit)
        u = gt.input(nominal=unit)
        w = gt.input(nominal=unit)

        def equations(self):
            yield der(self.x) == self.u
            yield der(self.y) == self.w

        def objective(self):
            return gt.integral(self.u**2 + 4 * self.w**2) if objective is None else objective(self)

        def constraints(self):
            return rows(self)

    return Two()


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9])
def test_a_row_at_the_end(unit):
    """x + y = c at the end: x = 0.8 c, and the cost grows by its slope -1.6 c per unit by which the row is raised."""
    s = solve(two(unit, rows=lambda m: [m.x.at(1.0) + m.y.at(1.0) == unit]), MESH)
    assert s.trajectory["x"][-1] == pytest.approx(0.8 * unit, rel=SOLVER)
    assert s.objective == pytest.approx(0.8 * unit**2, rel=SOLVER)
    assert s.multiplier("constraint 1") == pytest.approx(-1.6 * unit, rel=SOLVER)


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6])
def test_an_integral_that_is_bounded(unit):
    s = solve(two(unit, lambda m: -m.x.at(1.0) / unit, lambda m: [gt.integral(m.u**2 + m.w**2) <= unit**2]), MESH)
    assert s.trajectory["x"][-1] == pytest.approx(unit, rel=SOLVER)


def test_a_link_of_phases():
    """Free phases that must meet x + y = 1e-9 where the second one begins: half the way in each."""
    first = two(1e-9)
    links = {"second": lambda before, after: [before.x + before.y == 1e-9]}
    s = solve_phases(Phases({"first": first, "second": two(1e-9)}, links=links,
                            free={"second": ["x", "y"]}), MESH)  # fmt: skip
    assert s["first"].trajectory["x"][-1] == pytest.approx(0.8e-9, rel=SOLVER)
    assert s.link_multipliers[next(n for n in s.link_multipliers if n.startswith("link"))] == pytest.approx(
        -1.6e-9, rel=SOLVER
    )


class Gain(gt.Optimization):
    """x' = 1e9 k + u: as much as the bounds allow."""

    k = gt.free(1e-9, min=0.0, max=5e-9)
    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1e-9, max=1e-9)

    def equations(self):
        yield der(self.x) == 1e9 * (self.k + self.u)

    def objective(self):
        return -self.x.at(1.0)


@pytest.mark.parametrize("formulation", ["inverse", "explicit"])
def test_small_bounds_without_a_nominal(formulation):
    s = solve(Gain(), MESH, solver=gt.SolverOptions(formulation=formulation))
    assert s.objective == pytest.approx(-6.0, rel=SOLVER)
    assert s.free["k"] == pytest.approx(5e-9, rel=SOLVER)
    assert s.bound_multiplier("u").sum() == pytest.approx(1e9, rel=1e-4)  # cost per unit of the bound


@pytest.mark.parametrize("bounds", [{"min": 1e-9}, {"min": 1e-10, "max": 1e-7}])
def test_a_short_free_time(bounds):
    class Short(gt.Optimization):
        final_time = gt.free(1e-8, **bounds)
        x = gt.variable(start=0.0, fixed=True, nominal=1e-8)
        u = gt.input(min=-1.0, max=1.0)

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return self.final_time

        def constraints(self):
            yield self.x.at(self.final_time) == 1e-8

    assert solve(Short(), MESH).final_time == pytest.approx(1e-8, rel=SOLVER)


class OneSided(Gain):
    k = gt.free(0.0, min=-1e-9)

    def equations(self):
        yield der(self.x) == 1e9 * self.k + 0.0 * self.u

    def objective(self):
        return self.x.at(1.0)


def test_bounds_that_give_way_too_far_are_no_solution():
    """IPOPT relaxes k >= -1e-9 by 1e-8: x would end at -11 beside a k that gives -1."""
    with pytest.raises(NotSolved, match=r"violates the constraints by [\d.]+ of their size.*a nominal") as caught:
        solve(OneSided(), MESH)
    solution = caught.value.solution
    assert solution.status is SolveStatus.FAILED
    assert not solution.checks["constraint_violation"].passed


def test_what_is_large_may_be_missed_by_as_much_more():
    """Rows of order 1e9 hold to their own digits."""

    class Large(Gain):
        k = gt.free(1.0, min=0.0, max=2.0)
        u = gt.input(min=-1.0, max=1.0)

        def objective(self):
            return (self.x.at(1.0) / 1e9 - 3.0) ** 2

    s = solve(Large(), MESH)
    assert s.objective == pytest.approx(0.0, abs=SOLVER) and s.checks["constraint_violation"].passed
    assert s.free["k"] + np.mean(s.trajectory["u"]) == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("bounds", [{"min": 0.0}, {"min": 0.0, "max": 1e-8}, {}])
def test_a_small_constant_is_estimated(bounds):
    """Synthetic data, exact but for a ripple: k and its deviation are those in units of 1e-9."""
    t = np.linspace(0.1, 2.0, 20)
    data = 2 * np.exp(-0.7 * t) + 0.01 * np.sin(40 * t)

    def decay(unit: float, **own):
        class Decay(gt.Optimization):
            k = gt.free(unit, **own)
            final_time = 2.0
            x = gt.variable(start=unit, nominal=unit)

            def equations(self):
                yield der(self.x) == -self.k / unit * self.x

            def objective(self):
                return gt.misfit(self.x, t, unit * data)

        return estimate(solve(Decay(), MESH))

    large, small = decay(1.0), decay(1e-9, **bounds)
    assert small.names == large.names == ("k", "x at the start") and not small.held
    assert small.values == pytest.approx(1e-9 * large.values, rel=1e-5)
    assert small.std == pytest.approx(1e-9 * large.std, rel=1e-4)
