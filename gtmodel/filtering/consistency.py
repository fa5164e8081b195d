"""Whether a filter may be believed: its innovations, and over many runs its errors, against exact bands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..inference.chance import chi_squared_bound, chi_squared_chance, chi_squared_ends, chi_squared_share
from ..inference.residuals import autocorrelation, portmanteau
from ..results.estimate import half_width
from ..results.refusal import ArgumentError
from .faults import Suspect, noise_in_doubt
from .filtered import Filtered
from .system import System

LEVEL = 0.999  # of all bands, two-sided: one alarm of a thousand right filters
LAGS = 20
LEAST = 5  # instants by lag that the sum of squared autocorrelations needs to be chi-squared


class Band(NamedTuple):
    """Between which values the mean of `count` independent chi-squared numbers with `numbers` degrees of freedom lies
    with the probability `level`."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high


def chi_squared_band(count: int, numbers: float, level: float = LEVEL) -> Band:
    """The exact two-sided band of a mean of `count` independent chi-squared numbers with `numbers` degrees of freedom.

    Raises ArgumentError for less than one of either, and for a level that is no probability.

    >>> low, high = gt.filtering.chi_squared_band(100, 18)  # errors of 18 states over 100 runs
    >>> round(low, 2), round(high, 2)
    (16.09, 20.04)
    """
    if count < 1 or numbers <= 0:
        raise ArgumentError(f"expected at least one number; found {count} of {numbers:g} degrees of freedom", "count")
    if not 0 < level < 1:
        raise ArgumentError(f"expected a probability between 0 and 1; found {level}", "level")
    return _scaled_band(count * numbers, 2 * count * numbers, count, level)


@dataclass(frozen=True)
class SensorConsistency:
    """Innovations of one sensor: their mean square over what the filter expects (1 where it is right), its band, the
    largest mean of a component in its deviations and the largest that is expected, the largest autocorrelation of a
    component and at which lag, and whether all of them look white."""

    ratio: float
    band: Band
    mean: float
    mean_limit: float
    correlation: float
    lag: int
    white: bool


@dataclass(frozen=True)
class Consistency:
    """What the innovations of a log say of its filter.

    nis: mean normalised innovation squared of an instant; numbers: how many numbers of the readings it is made of on
    the average; expected: its mean, that number but for gates and weights of outliers, which make it smaller; band: of
    nis, exact for a linear filter with true noise. sensors: each by itself. message: the verdict
    in a sentence, with what to do. doubtful: where nis lies outside or innovations are coloured, the deviations and
    noise that alone explain that best, the likeliest first; several where the log cannot tell them apart, none of a run
    that cannot be made again (of interacting models, particles).
    """

    nis: float
    numbers: float
    band: Band
    sensors: dict[str, SensorConsistency]
    message: str
    expected: float
    doubtful: tuple[Suspect, ...] = ()

    @property
    def consistent(self) -> bool:
        """Whether nis lies in its band and the innovations of all sensors look white and have no mean."""
        return self.nis in self.band and all(s.white and abs(s.mean) <= s.mean_limit for s in self.sensors.values())


def consistency(run: Filtered, *, skip: float = 0.0, level: float = LEVEL, blame: bool = True) -> Consistency:
    """Innovations of a filtered log against what the filter expects of them.

    The sum of the normalised innovations squared of all instants and runs is chi-squared with as many degrees of
    freedom as numbers were read, for a linear filter whose noise is true; so its mean has an exact band. Each component
    must be white besides, by Ljung and Box's test over 20 lags, and have a mean of zero; both at the same level over
    all components of a sensor. What a gate leaves out and what weights of outliers cut is missing from the squares: the
    band is then that of a scaled chi-squared number with the mean and the variance that are left.

    skip: instants within this time of the first are left out [s]. Raises ArgumentError where nothing is left.
    blame: whether the noise at fault is looked for, which takes some ten runs for each of them.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> initial = gt.filtering.InitialState({}, {"x": 1.0})
    >>> drawn = gt.filtering.draw(system, initial, 0.1 * np.arange(2000), seed=1)
    >>> right = gt.filtering.ErrorState(system).run(drawn.log, initial)
    >>> gt.filtering.consistency(right).consistent
    True
    >>> doubtful = gt.filtering.ErrorState(system.with_(deviations={"tape": 0.1})).run(drawn.log, initial)
    >>> print(gt.filtering.consistency(doubtful).message)
    innovations are 16.4 times too small for tape: tape.deviation 0.09... times as large explains that best; see ...
    """
    kept = run.time >= run.time[0] + skip if len(run.time) else np.zeros(0, bool)
    total = int(run.count[kept].sum())
    if total == 0:
        raise ArgumentError("there are no innovations to judge", "run" if not len(run.time) else "skip")
    instants = int(np.count_nonzero(run.count[kept]))
    numbers = total / instants
    band = chi_squared_band(instants, numbers, level)
    nis = float(run.nis[kept].sum()) / instants
    white = {name: values[kept] for name, values in run.innovations.items() if np.isfinite(values[kept]).any()}
    left = {name: _left(run.system, name, values) for name, values in white.items()}
    mean = total - sum(n * (k - one.mean) for n, k, one in left.values())
    expected = mean / instants
    if mean < total:
        spread = 2 * total - sum(n * (2 * k - one.variance) for n, k, one in left.values())
        band = _scaled_band(mean, spread, instants, level)
    sensors = {name: _of_sensor(values, left[name][1:], level) for name, values in white.items()}
    right = nis in band and all(s.white for s in sensors.values())
    doubtful = () if right or nis == 0.0 or not blame else noise_in_doubt(run)
    message = _verdict(nis, expected, band, sensors, doubtful)
    return Consistency(nis, numbers, band, sensors, message, expected, doubtful)


class _Squares(NamedTuple):
    """Mean and variance of a normalised innovation squared, and of the square of one of its components."""

    mean: float
    variance: float
    own_mean: float
    own_variance: float


def _squares(size: int, gate: float | None, cut: float) -> _Squares:
    """Of right readings of this many numbers: none beyond the gate's quantile, those beyond the square `cut` there."""
    within = 1.0 if gate is None else gate
    most = np.inf if gate is None else float(chi_squared_bound(1 - gate, size))
    edge = min(cut, most)
    beyond = max(0.0, within - float(chi_squared_share(edge, size))) if cut < most else 0.0
    k = size
    first = (k * chi_squared_share(edge, k + 2) + (edge * beyond if beyond else 0.0)) / within
    second = (k * (k + 2) * chi_squared_share(edge, k + 4) + (edge**2 * beyond if beyond else 0.0)) / within
    own = float(first) / k
    return _Squares(float(first), float(second - first**2), own, float(3 * second / (k * (k + 2)) - own**2))


def _left(system: System, name: str, white: np.ndarray) -> tuple[int, int, _Squares]:
    """How many readings a sensor gave, of how many numbers, and what gates and weights leave of their squares."""
    used = np.isfinite(white)
    readings = int(used.any(axis=2).sum())
    size = max(1, round(used.sum() / readings))
    sensor = system.sensors[name]
    cut = float(system.huber_limits(name)[0][size]) ** 2 if sensor.outliers else np.inf
    return readings, size, _squares(size, sensor.gate, cut)


def _scaled_band(mean: float, variance: float, count: int, level: float) -> Band:
    """Of the mean of `count` numbers whose sum has this mean and variance, as a chi-squared number that is scaled."""
    ends = chi_squared_ends(level, 2 * mean**2 / variance)
    return Band(*(float(end) * variance / (2 * mean) / count for end in ends))


def _of_sensor(white: np.ndarray, left: tuple[int, _Squares], level: float) -> SensorConsistency:
    """Of normalised innovations (K, m, size), NaN where nothing was used, and what is left of their squares."""
    used = np.isfinite(white)
    per_component = used.sum(axis=(0, 1))
    ratio = float(np.nansum(white**2) / used.sum())
    # components of one instant are correlated: the band is that of the one with most to say, widened to all of them
    size = white.shape[2]
    numbers, each = int(per_component.max()), 1 - (1 - level) / size
    band = chi_squared_band(numbers, 1.0, each)
    if left[1].mean < left[0]:
        band = _scaled_band(numbers * left[1].own_mean, numbers * left[1].own_variance, numbers, each)
        ratio, band = ratio / left[1].own_mean, Band(*(end / left[1].own_mean for end in band))
    worst, most, at = 1.0, 0.0, 1
    for c in range(size):
        statistic, summed = 0.0, 0
        for m in range(white.shape[1]):
            r = white[used[:, m, c], m, c]
            lags = min(LAGS, len(r) // LEAST)
            if lags < 1 or np.ptp(r) == 0:
                continue
            correlation = autocorrelation(r, lags)[1:]
            statistic, summed = statistic + portmanteau(correlation, len(r)), summed + lags
            k = int(np.argmax(np.abs(correlation)))
            if abs(correlation[k]) > abs(most):
                most, at = float(correlation[k]), k + 1
        if summed:
            worst = min(worst, float(chi_squared_chance(statistic, summed)))
    means = np.nansum(white, axis=(0, 1)) / np.sqrt(np.maximum(per_component, 1))
    mean = float(means[np.argmax(np.abs(means))])
    limit = half_width(1 - (1 - level) / size)
    return SensorConsistency(ratio, band, mean, limit, most, at, worst >= (1 - level) / size)


def _verdict(
    nis: float,
    expected: float,
    band: Band,
    sensors: dict[str, SensorConsistency],
    doubtful: tuple[Suspect, ...],
) -> str:
    low = [name for name, s in sensors.items() if s.ratio < s.band.low]
    high = [name for name, s in sensors.items() if s.ratio > s.band.high]
    coloured = {name: s for name, s in sensors.items() if not s.white}
    shifted = {name: s for name, s in sensors.items() if abs(s.mean) > s.mean_limit}
    if nis in band and not coloured and not shifted:
        within = f"{nis:.4g} within {band.low:.4g} to {band.high:.4g}"
        return f"innovations agree with the filter: {within}, white and without a mean"
    said = []
    if nis == 0.0:
        said.append(
            "innovations are all zero, which no noise is: the readings do not change, or were made from the model"
        )
    elif nis < band.low:
        said.append(
            f"innovations are {_times(expected / nis)} too small for {_listed(low or list(sensors))}: "
            f"{_blamed(doubtful) or 'deviations or the noise of the process are too large'}; see `tune`"
        )
    elif nis > band.high:
        said.append(
            f"innovations are {_times(nis / expected)} too large for {_listed(high or list(sensors))}: "
            f"{_blamed(doubtful) or 'deviations or the noise of the process are too small'}, or the model is wrong; "
            "see `tune` and `find_faults`"
        )
    if shifted:
        name, s = max(shifted.items(), key=lambda item: abs(item[1].mean))
        said.append(
            f"innovations of {name} have a mean, {s.mean:.3g} of its deviations where {s.mean_limit:.2g} is the most: "
            "an offset is left out; see `find_faults`"
        )
    if coloured:
        name, s = max(coloured.items(), key=lambda item: abs(item[1].correlation))
        said.append(
            f"innovations of {name} are coloured (correlation {s.correlation:.2f} at lag {s.lag}): the filter leaves "
            "something unsaid, as an offset, a delay or wrong noise of the process"
            + (f": {_blamed(doubtful)}" if doubtful and nis in band else "")
        )
    return "; ".join(said)


def _blamed(doubtful: tuple[Suspect, ...]) -> str:
    """Which noise explains it, in words; empty where none does."""
    if not doubtful:
        return ""
    each = [f"{s.name} {float(s.value[0]):.2g} times as large" for s in doubtful]
    if len(each) == 1:
        return f"{each[0]} explains that best"
    return f"{' or '.join(each)} explain that alike, which this log cannot tell apart"


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 1.1 else f"{100 * (ratio - 1):.2g} %"


def _listed(names: list[str]) -> str:
    return ", ".join(names)


@dataclass(frozen=True, eq=False)
class JudgedErrors:
    """Errors of many runs against the filter's own covariance.

    time: instants that were judged (T,) [s]. nees: mean normalised estimation error squared over the runs (T,); band:
    of each, exact. coverage: state component -> share of the runs and judged instants... within two-sided 95 %, (T,) ;
    coverage_band: share at one instant. consistency: of the innovations of all runs.
    """

    time: np.ndarray
    nees: np.ndarray
    band: Band
    coverage: dict[str, np.ndarray]
    coverage_band: Band
    consistency: Consistency
    runs: int

    @property
    def consistent(self) -> bool:
        """Whether errors at all judged instants and the innovations lie in their bands."""
        return (
            bool(np.all((self.nees >= self.band.low) & (self.nees <= self.band.high))) and self.consistency.consistent
        )

    @property
    def onset(self) -> float | None:
        """The first judged instant [s] at which the errors leave their band; None where none does."""
        outside = (self.nees < self.band.low) | (self.nees > self.band.high)
        return float(self.time[np.argmax(outside)]) if outside.any() else None


def judged(run: Filtered, instants: int = 10, *, level: float = LEVEL, skip: float = 0.0) -> JudgedErrors:
    """Errors of independent runs whose truth is known, at evenly spread instants.

    Runs at one instant are independent, so the mean of their errors has an exact band; instants of one run are not.
    With several instants each has the level 1 - (1 - level) / instants, so that all of them together have `level`.
    Raises ArgumentError where the truth was not given, or for a single run.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> initial = gt.filtering.InitialState({}, {"x": 1.0})
    >>> drawn = gt.filtering.draw(system, initial, 0.1 * np.arange(50), seed=1, runs=100)
    >>> runs = gt.filtering.ErrorState(system).run(drawn.log, initial, truth=drawn.truth)
    >>> gt.filtering.judged(runs).consistent
    True
    """
    if run.nees is None or run.errors is None:
        raise ArgumentError("the truth was not given to the run, so there are no errors", "run")
    if run.runs < 2:
        raise ArgumentError("expected at least 2 independent runs; found 1", "run")
    from scipy.stats import binom

    first = int(np.searchsorted(run.time, run.time[0] + skip))
    at = np.unique(np.linspace(first, len(run.time) - 1, min(instants, len(run.time) - first)).round().astype(int))
    each = 1 - (1 - level) / len(at)
    within = np.abs(run.errors[at]) <= half_width(0.95) * run.deviations[at]
    names = run.system.space.labels
    ends = binom.ppf([(1 - each) / 2 / len(names), 1 - (1 - each) / 2 / len(names)], run.runs, 0.95) / run.runs
    return JudgedErrors(
        run.time[at], run.nees[at].mean(axis=1), chi_squared_band(run.runs, run.dimension, each),
        {name: within[:, :, n].mean(axis=1) for n, name in enumerate(names)}, Band(float(ends[0]), float(ends[1])),
        consistency(run, skip=skip, level=level), run.runs,
    )  # fmt: skip
