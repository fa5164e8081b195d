"""Design of the learning law of one axis: estimate, shift, and Q as close to 1 as monotone convergence on a set of
models allows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ...results import ArgumentError
from .axis import AxisPlant
from .course import Floor, Rate, floor, rate
from .estimators import ToolEstimate, complementary_estimate, kalman_estimate, kinematic, measured
from .kalman import ExtendedKalman, most_likely_filter
from .law import LearningLaw, Peak, butterworth, frequencies, frequency_bound, input_window
from .lifted import Array, identity, shifted, symmetric, weighted, zero_phase
from .norm_optimal import bounded_limit, bounded_update, model_inverse_law, norm_optimal_law
from .options import LearningDesign, LearningRobot
from .references import CONTRACTION, LENGTH, SAMPLE_TIME
from .robot import ModelledRobot

GRID, FINE = 501, 5001  # frequencies of the design, and of its check
SHIFT_GRID = 200  # frequencies below the cutoff
LEAST_AT_REST = 0.5  # least static gain of Q: below it even a constant error remains
STEEPNESS = 8  # of the low pass, as for the square of a fourth-order Butterworth filter


@dataclass(frozen=True, eq=False)
class RobustFilter:
    """A zero-phase filter Q with its design data.

    taps: (m + 1,) for the lags 0 to m, symmetric. frequency: (k,) [Hz]; at these, response: of the realised Q (k,), and
    rest: the largest |1 - L T| over the models (k,). bound: sup |Q| |1 - L T| of the realised Q over frequencies and
    models. cutoff: [Hz].
    """

    taps: np.ndarray
    frequency: np.ndarray
    response: np.ndarray
    rest: np.ndarray
    bound: Peak
    cutoff: float


def robust_filter(
    rests: Any,
    frequency: Any,
    cutoff: float,
    *,
    contraction: float = CONTRACTION,
    length: int = LENGTH,
    sample_time: float = SAMPLE_TIME,
) -> RobustFilter:
    """Design a finite Q close to min(low pass, contraction / max |1 - L T|), and check the bound of the result.

    Args:
        rests: |1 - L T| of each model (models, k). frequency: (k,) from 0 to half the sampling rate [Hz].
        cutoff: of the low pass [Hz]. contraction: the bound to achieve, below 1.
        length: lags on either side, in samples.

    A linear program maximises Q below these limits, with more weight on low frequencies. Raises ArgumentError if the
    realised filter does not keep the bound below 1, if its static gain is below 0.5, or if numbers are out of range.

    >>> learning = gt.control.learning
    >>> f = learning.frequencies(0.004, 2001)
    >>> loop = learning.flexible_axis(11.5, 0.05).responses(f)["tool"]
    >>> Q = learning.robust_filter([abs(1 - 0.9 * np.exp(2j * np.pi * f * 0.04) * loop)], f, cutoff=30.0)
    >>> Q.bound.value < 0.94, float(Q.response[0]) > 0.99
    (True, True)
    """
    f, worst = np.asarray(frequency, float), np.max(np.atleast_2d(np.abs(np.asarray(rests))), axis=0)
    if not 0 < contraction < 1:
        raise ArgumentError(f"expected a contraction between 0 and 1; found {contraction:g}", "contraction")
    if not 0 < cutoff < 0.5 / sample_time:
        raise ArgumentError(f"expected a cutoff above 0 and below {0.5 / sample_time:g} Hz; found {cutoff:g}", "cutoff")
    if worst.shape != f.shape or not np.all(np.isfinite(worst)):
        raise ArgumentError(f"expected finite numbers at {len(f)} frequencies; found {worst.shape}", "rests")
    grid = np.linspace(0.0, 0.5 / sample_time, GRID)
    # the limit at a frequency of the program uses the largest value around it
    coarse = np.interp(grid, f, scipy.ndimage.maximum_filter1d(worst, max(1, 2 * (len(f) // GRID) + 1)))
    limit = np.minimum(1 / (1 + (grid / cutoff) ** STEEPNESS), contraction / np.maximum(coarse, contraction))
    rows = _cosines(grid, length, sample_time)
    weights = 1 / (1 + grid / 5.0)
    solved = scipy.optimize.linprog(
        -(weights @ rows), A_ub=np.vstack([rows, -rows]), b_ub=np.concatenate([limit, np.zeros(GRID)]),
        bounds=(None, None), method="highs",
    )  # fmt: skip
    if solved.status != 0:
        raise ArgumentError(f"no filter of {length} lags keeps the limits; use more lags", "length")
    taps = np.asarray(solved.x)
    response = _cosines(f, length, sample_time) @ taps
    bound = frequency_bound(response, worst, f)
    if bound.value >= 1:
        raise ArgumentError(
            f"|Q| |1 - L T| reaches {bound.value:.3g} at {bound.frequency:.3g} Hz for one of the models, so learning "
            "would diverge; use more lags, a lower cutoff or another shift",
            "cutoff",
        )
    if response[0] < LEAST_AT_REST:
        raise ArgumentError(
            f"with {length} lags the static gain of Q is {response[0]:.2g}, which hardly learns; use more lags or a "
            "smaller set of models, or set the shift to the delay of the controlled plant",
            "length",
        )
    return RobustFilter(taps, f, response, worst, bound, cutoff)


def rests_of(
    estimates: ToolEstimate, plants: Sequence[AxisPlant], gain: float, shift: int, frequency: np.ndarray
) -> np.ndarray:
    """Return |1 - gain q^shift (F_u + F_y T)| of each plant (plants, k), at frequencies (k,) [Hz].

    >>> learning = gt.control.learning
    >>> f = learning.frequencies(0.004, 11)
    >>> learning.rests_of(learning.measured(300), [learning.flexible_axis(11.5, 0.05)], 0.9, 10, f).shape
    (1, 11)
    """
    z = np.exp(2j * np.pi * frequency * plants[0].sample_time)
    return np.array([*_rests([estimates.response(p, frequency) for p in plants], gain, z**shift)])


def _rests(responses: Sequence[Array], gain: float, advance: Array) -> Iterator[Array]:
    """|1 - gain q^shift T| for each response T; advance: q^shift at the frequencies."""
    return (np.abs(1 - gain * advance * T) for T in responses)


def best_shift(
    estimates: ToolEstimate, plants: Sequence[AxisPlant], gain: float, cutoff: float, shifts: Iterable[int] = range(25)
) -> int:
    """Return the shift with the least mean square of |1 - L T| below the cutoff [Hz], for the worst model at each
    frequency.

    It is about the lag of the controlled plant, of motor loop and tool.

    >>> learning = gt.control.learning
    >>> learning.best_shift(learning.kinematic(300), [learning.flexible_axis(11.5, 0.05)], gain=0.9, cutoff=10.0)
    10
    """
    f = np.linspace(0.0, cutoff, SHIFT_GRID)
    z, responses = np.exp(2j * np.pi * f * plants[0].sample_time), [estimates.response(p, f) for p in plants]
    squares = {n: float(np.mean(_worst(_rests(responses, gain, z**n)) ** 2)) for n in shifts}
    return min(squares, key=squares.__getitem__)


def _cosines(frequency: np.ndarray, length: int, sample_time: float) -> np.ndarray:
    """Responses (k, length + 1) of unit taps."""
    rows = 2 * np.cos(2 * np.pi * np.outer(frequency * sample_time, np.arange(length + 1)))
    rows[:, 0] = 1.0
    return rows


SHIFT_BELOW = 6.0  # Hz: the shift is chosen for slow motion, which causes nearly all of the error
ACTIVE = 1 - 1e-6  # of a bound on the input: within the solvers' tolerance
CASE_1_SHIFT = 5  # samples, Dressler 2012, section 7.4


@dataclass(frozen=True, eq=False)
class AxisLearning:
    """Learning of one axis. estimate, law; shift of L in samples; frequency (k,) [Hz] with response of Q and rest, the
    largest |1 - L T| of the models (k,); bound of their product; rate on the nominal model; seen: map from input to
    estimate.
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
        """Return u (N,) for the next run, within the bounds of the design."""
        d = self.design
        return bounded_update(self.seen, u, error, d.change, d.effort, **self.bounds) if self.bounds else (
            self.law.update(u, error)
        )  # fmt: skip

    @property
    def bounds(self) -> dict[str, float]:
        """Bounds on the input as keywords of `bounded_update`; empty if there are none."""
        d = self.design
        bounds = {} if d.largest is None else {"largest": d.largest}
        return bounds if d.largest_speed is None else {**bounds, "largest_step": d.largest_speed * self.sample_time}

    def floor(self, first_error: Array, corrected: slice, runs: int, repeats: Any = None) -> Floor:
        """Predict the remaining error, with bounds; arguments as in `gtmodel.control.learning.floor`."""
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
    """Design the law of an axis for runs of `size` samples, from the model of the robot.

    Args:
        axis: index, from 0. ramp: samples of lead-in and of lead-out.
        first: signals (N,) by name of runs without input; case 2B estimates the noise of its filter from the first.
        noise: of the accelerometer [m/s2].

    Raises ArgumentError if the law would diverge on one of the models, before any run.

    >>> learning = gt.control.learning
    >>> axis = learning.design_axis(learning.LearningRobot(), 0, learning.LearningDesign(), 825, ramp=100)
    >>> round(axis.rate.sigma, 2), axis.shift
    (0.59, 5)
    """
    nominal, plants, Ts = robot.plant(axis), design.models(robot, axis), robot.sample_time
    if design.case != "1" and "tool" not in nominal.signals:
        raise ArgumentError("the robot's model has no tool, like the printed actuators: use case 1", "design.case")
    kalman = None
    if design.case == "1":
        estimate = kinematic(size)
    elif design.case == "2A":
        estimate = complementary_estimate(size, design.slow_cutoff[min(axis, len(design.slow_cutoff) - 1)], Ts)
    elif design.case == "2B":
        if not first:
            raise ArgumentError("case 2B needs a first run to estimate the noise of its filter", "first")
        kalman = most_likely_filter(robot.tool(axis), first[0]["motor"], first[0]["acceleration"], noise)
        estimate = kalman_estimate(size, kalman)
    else:
        estimate = measured(size)
    seen, f = estimate.seen(nominal.maps(size)), frequencies(Ts, design.grid(robot, axis))
    # also the true tool, because an estimate that trusts its model hardly shows deviations of the tool
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
        filter = robust_filter(
            worst, f, design.low_pass, contraction=design.contraction, length=design.lags, sample_time=Ts
        )  # fmt: skip
        Q, response, bound = symmetric(filter.taps, size), filter.response, filter.bound
    window = weighted(input_window(size, ramp)) if design.ramps else identity(size)
    law = LearningLaw(window @ Q, L)
    convergence = rate(law, seen)
    if bound.value >= 1:
        raise ArgumentError(
            f"the law diverges in long runs: |Q| |1 - L T| reaches {bound.value:.3g} at {bound.frequency:.3g} Hz; "
            "lower the cutoff of Q, or set the shift to the delay of the controlled plant",
            "law",
        )
    return AxisLearning(estimate, law, shift, f, response, worst, bound, convergence, seen, kalman, design, Ts)


def _worst(rests: Iterable[Array]) -> Array:
    """The largest value at each frequency, one model at a time to save memory."""
    worst: Array | None = None
    for rest in rests:
        worst = rest if worst is None else np.maximum(worst, rest)
    assert worst is not None
    return worst


def zero_phase_response(cutoff: float, sample_time: float, frequency: Array) -> Array:
    """Return |Qb|^2 (k,) of a Butterworth filter run forward and backward, at frequencies (k,) in Hz."""
    from scipy.signal import sosfreqz

    return np.abs(sosfreqz(butterworth(cutoff, sample_time), frequency, fs=1 / sample_time)[1]) ** 2
