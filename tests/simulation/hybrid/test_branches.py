"""Branches of an event by precedence, and ends of a run, against what paper says."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt


class Branches(gt.Model):
    """x = t. Comparisons: two that come true together, one alone, one that another branch brings about."""

    x = gt.variable(start=0.0, fixed=True)
    n = gt.discrete(0.0)
    steps = gt.discrete(0.0)
    first = gt.parameter(0.5)

    def equations(self):
        yield gt.der(self.x) == 1.0
        yield (
            gt.when(self.x >= self.first, self.n == 1.0)
            .elsewhen(2.0 * self.x >= 1.0, self.n == gt.pre(self.n) + 10.0)
            .elsewhen(self.x >= 0.75, self.n == gt.pre(self.n) + 100.0)
        )
        yield gt.when(self.steps >= 1.0, self.steps == gt.pre(self.steps) + 2.0).elsewhen(
            self.x >= 0.25, self.steps == 1.0
        )


def test_of_branches_at_one_instant_the_first_acts_and_the_others_have_had_their_moment() -> None:
    run = gt.simulate(Branches(), 1.0)
    assert [(round(e.time, 9), dict(e.discrete)) for e in run.events] == [
        (0.25, {"steps": (0.0, 3.0)}),  # the second branch acts, and what follows from it is the first one's moment
        (0.5, {"n": (0.0, 1.0)}),
        (0.75, {"n": (1.0, 101.0)}),
    ]


def test_a_branch_acts_on_its_own_where_those_before_it_hold_already_or_come_later() -> None:
    before = gt.simulate(Branches(first=0.1), 1.0).events
    assert [(round(e.time, 9), e.discrete.get("n")) for e in before if "n" in e.discrete] == [
        (0.1, (0.0, 1.0)), (0.5, (1.0, 11.0)), (0.75, (11.0, 111.0)),
    ]  # fmt: skip
    later = gt.simulate(Branches(first=0.9), 1.0).events
    assert [(round(e.time, 9), e.discrete.get("n")) for e in later if "n" in e.discrete] == [
        (0.5, (0.0, 10.0)), (0.75, (10.0, 110.0)), (0.9, (110.0, 1.0)),
    ]  # fmt: skip


def test_samples_have_precedence_as_conditions_do() -> None:
    class Clocks(gt.Model):
        x = gt.variable(start=0.0, fixed=True)
        fast = gt.discrete(0.0)
        slow = gt.discrete(0.0)

        def equations(self):
            yield gt.der(self.x) == 0.0
            yield gt.when(gt.sample(0.3), self.slow == gt.pre(self.slow) + 1.0).elsewhen(
                gt.sample(0.1), self.fast == gt.pre(self.fast) + 1.0
            )

    end = gt.simulate(Clocks(), 0.95).trajectory
    assert (end["slow"][-1], end["fast"][-1]) == (4.0, 6.0)  # 0 to 0.9: ten instants, of which four are slow


class Stone(gt.Model):
    h = gt.variable(unit="m", start=5.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    n = gt.discrete(0.0)
    failed = False

    def equations(self):
        yield gt.der(self.h) == self.v
        yield gt.der(self.v) == -10.0
        yield gt.when(self.h <= 0.0, gt.terminate("it is down", failed=self.failed), self.n == 1.0)


class Forbidden(Stone):
    failed = True


def test_a_run_ends_where_its_model_says() -> None:
    run = gt.simulate(Stone(), 3.0)
    assert run.status is gt.SolveStatus.SOLVED and "it is down" in run.message
    assert run.trajectory.time[-1] == pytest.approx(1.0, abs=1e-9)
    assert run.trajectory["n"][-1] == 1.0 and len(run.events) == 1
    bad = gt.simulate(Forbidden(), 3.0, throw=False)
    assert bad.status is gt.SolveStatus.FAILED and "it is down" in bad.message
    with pytest.raises(gt.NotSimulated):
        gt.simulate(Forbidden(), 3.0)


def test_phases_keep_the_precedence() -> None:
    class Throw(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        slope = gt.discrete(1.0)
        gain = gt.free(1.0, min=0.1, max=5.0)
        final_time = 2.0

        def equations(self):
            yield gt.der(self.x) == self.slope * self.gain
            yield gt.when(self.x >= 1.0, self.slope == 2.0).elsewhen(self.x >= 1.0, self.slope == 50.0)

        def objective(self):
            return (self.x.at(self.final_time) - 2.0) ** 2

        def constraints(self):
            return ()

    solved = gt.solve_phases(gt.phases_of_events(Throw(), ["event 1"]), gt.Mesh(2))
    # 1 / g until the event, then twice as fast: 1 + 2 g (2 - 1 / g) = 2
    assert solved["phase 1"].free["gain"] == pytest.approx(0.75, rel=1e-6)


def test_an_end_is_no_phase() -> None:
    class Ends(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        u = gt.input()

        def equations(self):
            yield gt.der(self.x) == self.u
            yield gt.when(self.x >= 0.5, gt.terminate("there"))

        def objective(self):
            return gt.integral(self.u**2)

    with pytest.raises(gt.ModelError, match="ends the motion"):
        gt.phases_of_events(Ends(), ["event 1"])
    with pytest.raises(gt.ModelError, match="sentence"):
        gt.terminate("")
    assert np.isfinite(gt.simulate(Stone(), 0.5).trajectory["h"][-1])
