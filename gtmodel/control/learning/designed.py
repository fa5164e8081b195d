"""The law of one axis from its options: estimate, shift, Q, and what is known of its convergence beforehand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...results import ArgumentError
from .contraction import Peak, frequencies, frequency_bound
from .course import Floor, Rate, floor, rate
from .design import best_shift, rests_of, robust_filter
from .estimators import ToolEstimate, complementary_estimate, kalman_estimate, kinematic, measured
from .kalman import ExtendedKalman, most_likely_filter
from .law import LearningLaw, butterworth, input_window
from .lifted import Array, identity, shifted, symmetric, weighted, zero_phase
from .modelled import ModelledRobot
from .norm_optimal import bounded_limit, bounded_update, model_inverse_law, norm_optimal_law
from .options import LearningDesign, LearningRobot

SHIFT_BELOW = 6.0  # Hz: the shift is that of slow motion, where nearly all of the error is
ACTIVE = 1 - 1e-6  # of a bound on the input: as near as the solvers end
CASE_1_SHIFT = 5  # samples, Dressler 2012, section 7.4


@dataclass(frozen=True, eq=False)
class AxisLearning:
    """How one axis learns. estimate, law; shift of L in samples; frequency (k,) [Hz] with response of Q and rest, the
    largest |1 - L T| of the models (k,); bound of both; rate on the nominal model; seen: from input to estimate.
    """

    estimate: ToolEstimate
    law: LearningLaw
    shift: int
    frequency: Array
    response: Array
    rest: Array
    bound: Peak
    rate: Rate
    seen: Any
    kalman: ExtendedKalman | None
    design: LearningDesign
    sample_time: float

    def next_input(self, u: Array, error: Array) -> Array:
        """u (N,) for the next run, within the bounds of the design."""
        d = self.design
        return bounded_update(self.seen, u, error, d.change, d.effort, **self.bounds) if self.bounds else (
            self.law.update(u, error)
        )  # fmt: skip

    @property
    def bounds(self) -> dict[str, float]:
        """On the input, as `bounded_update` takes them; empty without any."""
        d = self.design
        given = {} if d.largest is None else {"largest": d.largest}
        return given if d.largest_speed is None else {**given, "largest_step": d.largest_speed * self.sample_time}

    def floor(self, first_error: Array, corrected: slice, runs: int, repeats: Any = None) -> Floor:
        """What it will leave by the model, within its bounds; arguments as of `gtmodel.control.learning.floor`."""
        if not self.bounds:
            return floor(self.law, self.seen, first_error, corrected, runs, repeats)
        end = bounded_limit(self.seen, first_error, self.design.effort, **self.bounds)
        at_bound = [np.abs(end).max() > ACTIVE * self.bounds.get("largest", np.inf)]
        at_bound.append(np.abs(np.diff(end, prepend=0.0)).max() > ACTIVE * self.bounds.get("largest_step", np.inf))
        return floor(
            self.law, self.seen, first_error, corrected, runs, repeats, update=self.next_input, end=end,
            clipped=any(at_bound),
        )  # fmt: skip


def design_axis(
    robot: LearningRobot | ModelledRobot, axis: int, design: LearningDesign, size: int, ramp: int,
    first: Sequence[Mapping[str, Array]] = (), noise: float = 0.07,
) -> AxisLearning:  # fmt: skip
    """The law of an axis for runs of `size` samples, designed on the robot as it is known.

    Args:
        axis: which one, from 0. ramp: samples of lead-in and of lead-out.
        first: signals (N,) by name of runs without input; case 2B takes the noise of its filter from them.
        noise: of the accelerometer [m/s2].

    Raises ArgumentError where the law would diverge on one of the models, before anything is run.

    >>> learning = gt.control.learning
    >>> axis = learning.design_axis(learning.LearningRobot(), 0, learning.LearningDesign(), 825, ramp=100)
    >>> round(axis.rate.sigma, 2), axis.shift
    (0.59, 5)
    """
    nominal, plants, Ts = robot.plant(axis), design.models(robot, axis), robot.sample_time
    if design.case != "1" and "tool" not in nominal.signals:
        raise ArgumentError(
            "the robot's model has no tool, as that of the printed actuators: case 1 is theirs", "design.case"
        )
    kalman = None
    if design.case == "1":
        estimate = kinematic(size)
    elif design.case == "2A":
        estimate = complementary_estimate(size, design.slow_cutoff[min(axis, len(design.slow_cutoff) - 1)], Ts)
    elif design.case == "2B":
        if not first:
            raise ArgumentError("case 2B takes the noise of its filter from a first run; give one", "first")
        kalman = most_likely_filter(robot.tool(axis), first[0]["motor"], first[0]["acceleration"], noise)
        estimate = kalman_estimate(size, kalman)
    else:
        estimate = measured(size)
    seen, f = estimate.seen(nominal.maps(size)), frequencies(Ts, design.grid(robot, axis))
    # of the tool besides: an estimate that trusts its model hardly sees that the tool differs
    whole = kinematic(size) if design.case == "1" else measured(size)
    if design.law == "norm_optimal":
        law = norm_optimal_law(seen, size, design.change, design.effort)
        T = estimate.response(nominal, f)
        square = np.abs(T) ** 2
        response = (square + design.change) / (square + design.change + design.effort)
        inverse = np.conj(T) / (square + design.change)
        worst, shift = _worst(np.abs(1 - inverse * estimate.response(p, f)) for p in plants), 0
        bound = frequency_bound(response, worst, f)
        if bound.value > 1 + 1e-9:
            raise ArgumentError(
                f"|Q| |1 - L T| reaches {bound.value:.3g} at {bound.frequency:.3g} Hz for one of the models; raise "
                "change or effort",
                "design.effort",
            )
        return AxisLearning(
            estimate, law, shift, f, response, worst, bound, rate(law, seen), seen, kalman, design, Ts
        )  # fmt: skip
    shift = design.shift
    if shift is None:
        shift = CASE_1_SHIFT if design.case == "1" else best_shift(whole, plants, design.gain, SHIFT_BELOW)
    if design.law == "shift":
        L = shifted(size, design.gain, shift)
        worst = _worst(
            rests_of(e, [p], design.gain, shift, f)[0] for e in dict.fromkeys((estimate, whole)) for p in plants
        )
    else:
        L = model_inverse_law(seen, size, design.change).L
        T = estimate.response(nominal, f)
        inverse = np.conj(T) / (np.abs(T) ** 2 + design.change)
        worst = _worst(np.abs(1 - inverse * e.response(p, f)) for p in plants for e in (estimate, whole))
        shift = 0
    if design.case == "1":
        Q = zero_phase(butterworth(design.low_pass, Ts), size)
        response = zero_phase_response(design.low_pass, Ts, f)
        bound = frequency_bound(response, worst, f)
    else:
        made = robust_filter(
            worst, f, design.low_pass, contraction=design.contraction, length=design.lags, sample_time=Ts
        )  # fmt: skip
        Q, response, bound = symmetric(made.taps, size), made.response, made.bound
    window = weighted(input_window(size, ramp)) if design.ramps else identity(size)
    law = LearningLaw(window @ Q, L)
    said = rate(law, seen)
    if bound.value >= 1:
        raise ArgumentError(
            f"the law diverges in long runs: |Q| |1 - L T| reaches {bound.value:.3g} at {bound.frequency:.3g} Hz; "
            "lower the cutoff of Q, or let the shift be the delay of what is controlled",
            "law",
        )
    return AxisLearning(estimate, law, shift, f, response, worst, bound, said, seen, kalman, design, Ts)


def _worst(rests: Iterable[Array]) -> Array:
    """The largest at each frequency, one model at a time: dense sets of many frequencies are long."""
    made: Array | None = None
    for rest in rests:
        made = rest if made is None else np.maximum(made, rest)
    assert made is not None
    return made


def zero_phase_response(cutoff: float, sample_time: float, frequency: Array) -> Array:
    """|Qb|^2 (k,) of the Butterworth filter, forward and backward, at frequencies (k,) in Hz."""
    from scipy.signal import sosfreqz

    return np.abs(sosfreqz(butterworth(cutoff, sample_time), frequency, fs=1 / sample_time)[1]) ** 2
