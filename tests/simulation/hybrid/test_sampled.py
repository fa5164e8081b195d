"""Sampled blocks around linear plants, against matrices; blocks among each other; bytes."""

from __future__ import annotations

from fractions import Fraction

import control
import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.simulation.hybrid.clock import Due, SampleClock, exact

TOLERANCE = 1e-9

A = np.array([[0.0, 1.0], [-40.0, -1.2]])
B = np.array([0.0, 25.0])
KP, KD, KI = 3.0, 0.4, 2.0


class PID(gt.SampledBlock):
    x = gt.input()
    v = gt.input()
    integral = gt.discrete(0.0)
    u = gt.output()

    def step(self, inputs, state):
        integral = state.integral + self.period * (1.0 - inputs.x)
        return {"u": KP * (1.0 - inputs.x) - KD * inputs.v + KI * integral, "integral": integral}


class Swinging(gt.Model):
    x = gt.variable(start=0.3, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    period = gt.parameter(0.02, unit="s")
    delay = gt.parameter(0.0, unit="s")
    law = gt.part(PID, period=period, delay=delay)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == A[1, 0] * self.x + A[1, 1] * self.v + B[1] * self.law.u
        yield self.law.x == self.x
        yield self.law.v == self.v


def held(t: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(A t), and what a held input adds."""
    m = scipy.linalg.expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * t)
    return m[:2, :2], m[:2, 2]


def by_matrices(period: float, delay: float, count: int) -> np.ndarray:
    """States at the samples: the output of sample k is there from k period + delay on."""
    whole, part = divmod(round(delay / period * 1000), 1000)
    first = part / 1000 * period
    f1, g1 = held(first)
    f2, g2 = held(period - first)
    x, integral, outputs, states = np.array([0.3, 0.0]), 0.0, [0.0] * (whole + 1), []
    for _ in range(count):
        states.append(x)
        integral += period * (1.0 - x[0])
        outputs.append(KP * (1.0 - x[0]) - KD * x[1] + KI * integral)
        old, new = outputs[-2 - whole], outputs[-1 - whole]
        x = f2 @ (f1 @ x + g1 * old) + g2 * new
    return np.array(states)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0, 1.6, 2.0])
def test_a_linear_plant_under_a_sampled_law(share: float) -> None:
    period = 0.02
    run = gt.simulate(Swinging(delay=share * period), 3.0, start={"x": 0.3, "v": 0.0})
    expected = by_matrices(period, share * period, len(run.samples["law"]))
    samples = run.samples["law"]
    assert len(samples) == 151
    assert np.max(np.abs(samples["x"] - expected[:, 0])) < TOLERANCE
    assert np.max(np.abs(samples["v"] - expected[:, 1])) < 10 * TOLERANCE


def test_without_delay_it_is_what_control_makes_of_it() -> None:
    period = 0.02
    plant = control.c2d(control.ss(A, B[:, None], np.eye(2), 0), period)
    f, g = np.asarray(plant.A), np.asarray(plant.B)[:, 0]
    # the companion matrix of (x, v, integral), with the set point's share apart
    k = np.array([-KP - KI * period, -KD])
    m = np.block([[f + np.outer(g, k), (g * KI)[:, None]], [np.array([[-period, 0.0, 1.0]])]])
    constant = np.concatenate([g * (KP + KI * period), [period]])
    state = np.array([0.3, 0.0, 0.0])
    run = gt.simulate(Swinging(), 2.0)
    for x, v in zip(run.samples["law"]["x"], run.samples["law"]["v"], strict=True):
        assert abs(x - state[0]) < TOLERANCE
        assert abs(v - state[1]) < 10 * TOLERANCE
        state = m @ state + constant


class Doubling(gt.SampledBlock):
    x = gt.input()
    y = gt.output()

    def step(self, inputs, state):
        return {"y": 2.0 * inputs.x}


class Chain(gt.Model):
    """The second block doubles what the first one gives, declared in the other order."""

    late = gt.parameter(0.0, unit="s")
    t = gt.variable(start=0.0, fixed=True)
    second = gt.part(Doubling, period=0.1)
    first = gt.part(Doubling, period=0.2, delay=late)

    def equations(self):
        yield gt.der(self.t) == 1.0
        yield self.first.x == self.t
        yield self.second.x == self.first.y


def test_blocks_that_sample_together_go_in_the_order_of_their_data() -> None:
    second = gt.simulate(Chain(), 1.05).samples["second"]
    assert second["y"] == pytest.approx(4 * 0.2 * np.floor(np.arange(11) / 2 + 1e-9), abs=1e-12)
    late = gt.simulate(Chain(late=0.2), 1.05).samples["second"]
    # a delayed output arrives after those who sample at that instant have read
    assert late["y"][:6] == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.8], abs=1e-12)


def test_a_thousand_periods_that_no_float_can_hold_meet_exactly() -> None:
    assert exact(0.1) == Fraction(1, 10)
    clock = SampleClock()
    clock.add(exact(0.1) * 3000, Due("block", 0))
    clock.add(exact(0.3) * 1000, Due("block", 1))
    assert [d.number for d in clock.take()[1]] == [0, 1]
    assert clock.next is None


def test_the_same_run_gives_the_same_bytes() -> None:
    runs = [gt.simulate(Swinging(delay=0.007), 0.5) for _ in range(2)]
    assert runs[0].trajectory == runs[1].trajectory
    assert runs[0].samples["law"] == runs[1].samples["law"]


def test_parameters_of_a_sweep_reach_the_blocks() -> None:
    run = gt.simulate(Swinging(), 0.5, parameters={"period": 0.05})
    assert len(run.samples["law"]) == 11
    same = gt.simulate(Swinging(period=0.05), 0.5)
    assert np.max(np.abs(run.trajectory["x"] - same.trajectory["x"])) < TOLERANCE


def test_a_sampled_block_on_its_own_clock_begins_at_its_offset() -> None:
    class Late(gt.Model):
        t = gt.variable(start=0.0, fixed=True)
        law = gt.part(Doubling, period=0.3, offset=0.1)

        def equations(self):
            yield gt.der(self.t) == 1.0
            yield self.law.x == self.t

    run = gt.simulate(Late(), 1.0)
    assert run.samples["law"].time == pytest.approx([0.1, 0.4, 0.7, 1.0])
    begun = gt.simulate(Late(), 1.0, start_time=0.5)
    assert begun.samples["law"].time == pytest.approx([0.7, 1.0])


class Runaway(gt.SampledBlock):
    x = gt.input()
    u = gt.output()

    def step(self, inputs, state):
        return {"u": np.log(0.9 - inputs.x)}  # not defined from x = 0.9 on


def test_a_law_that_gives_no_number_ends_the_run_and_keeps_what_there_is() -> None:
    class Loop(gt.Model):
        x = gt.variable(start=0.0, fixed=True)
        law = gt.part(Runaway, period=0.25)
        late = gt.variable()

        def equations(self):
            yield gt.der(self.x) == 2.0
            yield self.law.x == self.x
            yield self.late == self.law.u

    with np.errstate(all="ignore"):
        run = gt.simulate(Loop(), 2.0, throw=False)
    assert run.status is gt.SolveStatus.FAILED
    assert "step() of Runaway gives 'u' = nan at 0.5 s: not finite" in run.message
    assert run.trajectory.time[-1] == pytest.approx(0.5)
    assert len(run.samples["law"]) == 2
