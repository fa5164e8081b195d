"""Scaling from a trajectory: what it holds takes the place of nominals. Optima in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, Trajectory, der
from gtmodel.optimize import Mesh, SolverOptions, refine, solve, transcribe
from tests.optimize.problems import StirredTank, StirredTankUnscaled

MESH = Mesh(10)
SOLVER = 1e-6  # relative
FAR, FAST = 1e12, 1e7


class Long(gt.Optimization):
    """1e12 m in least time at 1e7 m/s at most; no nominal is declared."""

    final_time = gt.free(1e3, min=1.0)
    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-FAST, max=FAST)

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x.at(self.final_time) == FAR


def rough(**values) -> Trajectory:
    """Three points of a guess that is right to a factor."""
    time = np.array([0.0, 1e5, 2e5])
    return Trajectory(time, {"x": np.array([0.0, 0.5, 1.0]) * FAR, "u": np.full(3, FAST), **values})


def test_what_does_not_converge_without():
    few = SolverOptions(max_iterations=100)
    assert not solve(Long(), MESH, solver=few, throw=False).status.ok
    s = solve(Long(), MESH, scaling=rough(), solver=few)
    assert s.final_time == pytest.approx(FAR / FAST, rel=SOLVER)
    again = transcribe(Long(), MESH, scaling=rough(), solver=few).solve()
    assert (again.objective, again.iterations) == (s.objective, s.iterations)


def test_the_sizes_are_the_largest_magnitudes():
    problem = solve(Long(), MESH, scaling=rough(), solver=SolverOptions(max_iterations=100)).problem
    assert problem.x_scale.tolist() == [FAR] and problem.u_scale.tolist() == [FAST]
    assert problem.P_scale.tolist() == [2e5]


def test_multipliers_stay_in_si_units():
    """One metre more takes 1 / 1e7 s more."""
    s = solve(Long(), MESH, scaling=rough())
    costate = np.asarray(s.multiplier("continuity of x"))
    assert np.abs(costate) == pytest.approx(np.full_like(costate, 1 / FAST), rel=SOLVER)


def test_a_solution_scales_its_constants_too():
    first = solve(Long(), MESH, scaling=rough())
    again = solve(Long(), MESH, scaling=first)
    assert again.problem.P_scale == pytest.approx([FAR / FAST], rel=SOLVER)
    assert again.objective == pytest.approx(first.objective, rel=SOLVER)


def test_the_optimum_of_a_tank_does_not_depend_on_it():
    plain = solve(StirredTank(), MESH)
    scaled = solve(StirredTankUnscaled(), MESH, scaling=plain)
    assert scaled.objective == pytest.approx(plain.objective, rel=SOLVER)
    assert refine(StirredTankUnscaled(), MESH, tolerance=1e-2, scaling=plain).reached


def test_vectors_and_signs():
    class Pair(gt.Optimization):
        x = gt.variable(shape=(2,), start=[0.0, 0.0], fixed=True)
        back = gt.variable()
        u = gt.input(shape=(2,))

        def equations(self):
            yield der(self.x) == self.u
            yield self.back == -self.u[1]

        def objective(self):
            return gt.integral(gt.dot(self.u, self.u))

        def constraints(self):
            yield self.x.at(1.0) == [1.0, 5.0]

    values = {"x": np.array([[0.0, 0.0], [3.0, -7.0]]), "back": np.array([0.0, -11.0])}
    problem = solve(Pair(), Mesh(3), scaling=Trajectory(np.array([0.0, 1.0]), values)).problem
    assert problem.x_scale.tolist() == [3.0, 7.0]
    assert problem.u_scale.tolist() == [1.0, 11.0]


def test_what_is_no_trajectory():
    with pytest.raises(ModelError, match=r"scaling must be a gt\.Trajectory or an earlier solution; found 3"):
        solve(Long(), MESH, scaling=3)  # type: ignore[arg-type]
