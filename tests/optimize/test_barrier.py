"""Barrier strategies: each alone, both in turn, and when a try that gets nowhere makes room for the next."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, der
from gtmodel.optimize import Mesh, SolverOptions, Transcription, solve, transcribe
from gtmodel.optimize.watch import RUNAWAY, WEIGHT, Patience

ENOUGH = 600  # iterations: more than either strategy takes on what it solves, and a try given up before it


class SwingUp(gt.Optimization):
    """A pendulum from hanging to standing in least time, with a torque that cannot lift it at once."""

    final_time = gt.free(2.0, min=0.1, unit="s")
    most = gt.parameter(1.0)
    x = gt.variable(start=0.0)
    v = gt.variable(start=0.0)
    u = gt.input()

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u - 9.81 * gt.sin(self.x) - 0.1 * self.v

    def objective(self):
        return self.final_time

    def constraints(self):
        yield gt.between(-self.most, self.u, self.most)
        yield self.x.at(0.0) == 0
        yield self.v.at(0.0) == 0
        yield self.x.at(self.final_time) == np.pi
        yield self.v.at(self.final_time) == 0


def swing_up(most: float, elements: int, **options):
    return solve(
        SwingUp(most=most), Mesh(elements, 2), throw=False,
        solver=SolverOptions(**{"max_iterations": ENOUGH, "formulation": "explicit", **options}),
    )  # fmt: skip


@pytest.fixture(scope="module")
def drawn():
    """Torques and meshes with the outcome of each strategy alone."""
    rng = np.random.default_rng(1515)
    cases = [(round(float(rng.uniform(2.8, 4.6)), 2), int(rng.integers(8, 16))) for _ in range(13)][7:]
    return {c: {b: swing_up(*c, barrier=b, max_iterations=300) for b in ("adaptive", "monotone")} for c in cases}


def test_either_strategy_solves_what_the_other_does_not(drawn):
    only = [[b for b, s in found.items() if s.status.converged] for found in drawn.values()]
    assert ["adaptive"] in only and ["monotone"] in only


def test_auto_solves_what_either_solves_and_says_which(drawn):
    told = 0
    for case, found in drawn.items():
        auto = swing_up(*case)
        if found["adaptive"].status.converged:
            # the first try is the whole solve: not a digit differs
            assert auto.objective == found["adaptive"].objective and auto.iterations == found["adaptive"].iterations
            assert "barrier strategy" not in auto.message
        elif found["monotone"].status.converged:
            assert auto.status.converged, auto.message
            assert auto.objective == pytest.approx(found["monotone"].objective, rel=1e-9)
            assert "monotone barrier strategy, after the adaptive one failed" in auto.message
            assert found["monotone"].iterations < auto.iterations <= ENOUGH  # those of both tries
            told += 1
        else:
            assert auto.status.converged or "barrier strategy" in auto.message
    assert told > 0


@pytest.mark.parametrize("most", [1, 40, 90, 200])
def test_both_tries_share_one_limit_of_iterations(most):
    s = swing_up(1.0, 10, max_iterations=most)  # too weak: both fail, the first after some 70
    assert not s.status.converged and s.iterations <= most
    seen = []
    solve(SwingUp(most=1.0), Mesh(10, 2), solver=SolverOptions(max_iterations=most), throw=False,
          progress=lambda n, f, v: bool(seen.append(n)))  # fmt: skip
    assert seen.count(0) == 1  # counted on, not anew


def test_a_limit_of_iterations_is_no_failure_to_be_tried_again():
    s = swing_up(5.0, 10, max_iterations=5)
    assert s.status is SolveStatus.ITERATION_LIMIT and s.iterations == 5 and "monotone" not in s.message


def test_a_stop_during_the_second_try_stops():
    def stop(n, f, v):
        return n >= 75  # the first of the too weak pendulum ends before

    first = swing_up(1.0, 10, barrier="adaptive")
    assert first.iterations < 75
    s = solve(SwingUp(most=1.0), Mesh(10, 2), solver=SolverOptions(max_iterations=300, formulation="explicit"),
              throw=False, progress=stop)  # fmt: skip
    assert s.status is SolveStatus.INTERRUPTED and s.iterations == 75 and np.all(np.isfinite(s.trajectory["x"]))


def test_a_warm_start_that_fails_is_tried_cold():
    t: Transcription = transcribe(SwingUp(most=5.0), Mesh(10, 2))
    first = t.solve()
    again = t.solve(start=first)
    assert again.status.converged and again.iterations < first.iterations and "barrier strategy" not in again.message


def test_patience_gives_up_what_gets_nowhere():
    lost = swing_up(1.5, 10, barrier="adaptive", formulation="auto")  # too weak
    assert lost.status is SolveStatus.INFEASIBLE
    for patience in (10, 30):
        s = swing_up(1.5, 10, barrier="adaptive", patience=patience, formulation="auto")
        assert s.status is SolveStatus.FAILED and s.iterations < lost.iterations
        assert f"no progress in {patience} iterations" in s.message


class TestPatience:
    def test_it_waits_as_long_as_something_falls(self):
        p = Patience()
        assert [p(1.0, 0.5**k) for k in range(10)] == [0] * 10
        assert [p(1.0 - 0.1 * k, 1.0) for k in range(5, 9)] == [0] * 4

    def test_one_for_the_other_is_progress(self):
        p = Patience()
        assert [p(f, v) for f, v in [(1.0, 1.0), (2.0, 0.1), (0.5, 3.0), (1.5, 0.5)]] == [0] * 4

    def test_worse_in_both_is_none_and_neither_is_what_is_no_number(self):
        p = Patience()
        assert [p(f, v) for f, v in [(1.0, 1.0), (1.0, 1.0), (2.0, 5.0), (np.nan, 2.0), (0.0, np.inf)]] == [
            0,
            1,
            2,
            3,
            4,
        ]
        assert p(0.5, 1.0) == 0

    def test_multipliers_that_run_away_are_no_progress_and_weigh_more(self):
        p = Patience(RUNAWAY)
        assert [p(1.0, 0.5**k, m) for k, m in enumerate([1.0, 1e9, 1e11, 1e14, 1.0])] == [0, 0, WEIGHT, 2 * WEIGHT, 0]
        # beside the objective; and a point that keeps its rows is not lost
        assert p(1e6, 0.01, 1e14) == 0 and p(1.0, 1e-9, 1e14) == 0

    def test_points_that_keep_their_rows_are_not_lost(self):
        p = Patience()
        assert [p(1.0, 1e-9) for _ in range(5)] == [0] * 5


@pytest.mark.parametrize(
    "options", [{"barrier": "adaptiv"}, {"patience": 0}, {"patience": 2.5}, {"barrier": "monotone", "solver": "fatrop"}]
)
def test_wrong_options(options):
    with pytest.raises(ModelError, match=r"barrier|patience"):
        SolverOptions(**options)
