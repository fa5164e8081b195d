"""What was refused and is right: a free time that nobody bounds, and a fixed start without a value, which is 0."""

from __future__ import annotations

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, solve, solve_phases
from gtmodel.results import SolveStatus

SOLVER = 1e-5  # IPOPT's tolerance on the scaled problem, at bang-bang controls
MESH = Mesh(20, 2)


class Fastest(gt.Optimization):
    """One metre from rest to rest with unit acceleration: 2 s."""

    far = gt.parameter(1.0)
    x = gt.variable(fixed=True)
    v = gt.variable(fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    final_time = gt.free(1.0)

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u

    def objective(self):
        return self.final_time - self.start_time

    def constraints(self):
        yield self.x.at(self.final_time) == self.far
        yield self.v.at(self.final_time) == 0.0


class FromBefore(Fastest):
    start_time = gt.free(-1.0)
    final_time = 3.0


class BothEnds(Fastest):
    start_time = gt.free(-1.0)

    def constraints(self):
        yield from super().constraints()
        yield self.start_time == -0.3


class Zero(Fastest):
    final_time = gt.free(1.0, min=0.0)


@pytest.mark.parametrize("far", [1.0, 1e-2, 1e4])
@pytest.mark.parametrize("make", [Fastest, FromBefore, BothEnds, Zero])
def test_the_optimum_needs_no_bound(make, far):
    s = solve(make(far=far), MESH)
    length = s.trajectory.time[-1] - s.trajectory.time[0]
    assert length == pytest.approx(2.0 * far**0.5, rel=SOLVER)
    assert [s.trajectory[n][0] for n in ("x", "v")] == [0.0, 0.0]


@pytest.mark.parametrize("make", [Fastest, FromBefore, Zero])
def test_a_horizon_that_shrinks_to_nothing_is_told(make):
    bare = type("Bare", (make,), {"constraints": lambda self: ()})
    s = solve(bare(), MESH, throw=False)
    assert s.status is SolveStatus.FAILED and "the horizon has shrunk" in s.message


def test_so_does_a_phase():
    class Wait(Fastest):
        def constraints(self):
            yield self.u == 0.0

    class Go(Fastest):
        x = gt.variable()
        v = gt.variable()
        start_time = gt.free(1.0)
        final_time = gt.free(2.0)

    s = solve_phases(gt.Phases({"wait": Wait(), "go": Go()}), MESH, throw=False)
    assert s.status is SolveStatus.FAILED and "phase 'wait': the horizon has shrunk" in s.message


def test_a_bound_of_ones_own_is_a_solution():
    s = solve(type("Own", (Fastest,), {"final_time": gt.free(1.0, min=1e-3), "constraints": lambda self: ()})(), MESH)
    assert s.status.ok and s.final_time == pytest.approx(1e-3)


def test_a_start_fixed_without_a_value_is_zero_in_a_simulation_too():
    class Fall(gt.Model):
        x = gt.variable(shape=(2,), fixed=True)
        v = gt.variable(start=1.0)

        def equations(self):
            yield der(self.x[0]) == 1.0 - self.x[1]
            yield der(self.x[1]) == self.v
            yield self.v == 2.0 - self.x[0]

    run = gt.simulate(Fall(), 0.1)
    assert run.trajectory["x"][0].tolist() == [0.0, 0.0]
