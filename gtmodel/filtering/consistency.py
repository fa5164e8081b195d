"""Consistency of a filter: its innovations, and its errors over many runs, against exact bands."""

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

LEVEL = 0.999  # of all bands, two-sided: one false alarm in a thousand correct filters
LAGS = 20
LEAST = 5  # instants per lag: with fewer the sum of squared autocorrelations is not chi-squared


class Band(NamedTuple):
    """Interval that holds a mean of independent chi-squared numbers with a given probability."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high


def chi_squared_band(count: int, numbers: float, level: float = LEVEL) -> Band:
    """Return the exact two-sided band of a mean of `count` independent chi-squared numbers with `numbers` degrees of
    freedom each.

    Raises ArgumentError if `count` is below 1, if `numbers` is not positive, or if `level` is not between 0 and 1.

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
    """Innovations of one sensor.

    ratio, band: mean square over its expected value (1 for a correct filter), and its band. mean, mean_limit: largest
    mean of a component in its standard deviations, and its limit. correlation, lag: largest autocorrelation of a
    component, and its lag. white: whether all components pass the whiteness test.
    """

    ratio: float
    band: Band
    mean: float
    mean_limit: float
    correlation: float
    lag: int
    white: bool


@dataclass(frozen=True)
class Consistency:
    """Innovation test of a filtered log.

    nis: mean normalised innovation squared per instant. numbers: average count of measured numbers per instant.
    expected: expected nis; equal to `numbers`, or less with gates or outlier weights. band: of nis, exact for a linear
    filter with true noise. sensors: the same per sensor. message: the verdict in a sentence, with what to do.
    doubtful: if nis is outside its band or the innovations are coloured, the sensor deviations and process noise that
    alone explain this best, the likeliest first; several if the log cannot distinguish them, empty for a run that
    cannot be repeated (interacting models, particles).
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
        """Whether nis is in its band and the innovations of all sensors are white with zero mean."""
        return self.nis in self.band and all(s.white and abs(s.mean) <= s.mean_limit for s in self.sensors.values())


def consistency(run: Filtered, *, skip: float = 0.0, level: float = LEVEL, blame: bool = True) -> Consistency:
    """Test the innovations of a filtered log against their expected statistics.

    For a linear filter with true noise, the sum of the normalised innovations squared of all instants and runs is
    chi-squared with as many degrees of freedom as numbers were read; so its mean has an exact band. Each component must
    also be white, by the Ljung-Box test over 20 lags, and have zero mean; both tests have the same level over all
    components of a sensor. Gates and outlier weights reduce the squares: the band is then that of a scaled chi-squared
    number with the remaining mean and variance.

    skip: leave out instants within this time of the first one [s]. Raises ArgumentError if no instant is left.
    blame: whether to search for the noise at fault; this takes about ten runs per candidate.

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
    innovations are 16.4 times too small for tape: tape.deviation 0.09... times as large explains this best; see ...
    """
    rows = run.time >= run.time[0] + skip if len(run.time) else np.zeros(0, bool)
    total = int(run.count[rows].sum())
    if total == 0:
        raise ArgumentError("there are no innovations to test", "run" if not len(run.time) else "skip")
    instants = int(np.count_nonzero(run.count[rows]))
    numbers = total / instants
    band = chi_squared_band(instants, numbers, level)
    nis = float(run.nis[rows].sum()) / instants
    white = {name: values[rows] for name, values in run.innovations.items() if np.isfinite(values[rows]).any()}
    remaining = {name: _left(run.system, name, values) for name, values in white.items()}
    mean = total - sum(n * (k - s.mean) for n, k, s in remaining.values())
    expected = mean / instants
    if mean < total:
        spread = 2 * total - sum(n * (2 * k - s.variance) for n, k, s in remaining.values())
        band = _scaled_band(mean, spread, instants, level)
    sensors = {name: _of_sensor(values, remaining[name][1:], level) for name, values in white.items()}
    good = nis in band and all(s.white for s in sensors.values())
    doubtful = () if good or nis == 0.0 or not blame else noise_in_doubt(run)
    message = _verdict(nis, expected, band, sensors, doubtful)
    return Consistency(nis, numbers, band, sensors, message, expected, doubtful)


class _Squares(NamedTuple):
    """Mean and variance of a normalised innovation squared, and of the square of one of its components."""

    mean: float
    variance: float
    own_mean: float
    own_variance: float


def _squares(size: int, gate: float | None, cut: float) -> _Squares:
    """For readings of `size` numbers from the true model: the gate rejects, and squares above `cut` are cut to it."""
    within = 1.0 if gate is None else gate
    most = np.inf if gate is None else float(chi_squared_bound(1 - gate, size))
    edge = min(cut, most)
    beyond = max(0.0, within - float(chi_squared_share(edge, size))) if cut < most else 0.0
    k = size
    first = (k * chi_squared_share(edge, k + 2) + (edge * beyond if beyond else 0.0)) / within
    second = (k * (k + 2) * chi_squared_share(edge, k + 4) + (edge**2 * beyond if beyond else 0.0)) / within
    each_mean = float(first) / k
    return _Squares(float(first), float(second - first**2), each_mean, float(3 * second / (k * (k + 2)) - each_mean**2))


def _left(system: System, name: str, white: np.ndarray) -> tuple[int, int, _Squares]:
    """Number of readings of a sensor, their size, and the statistics of their squares after gate and weights."""
    used = np.isfinite(white)
    readings = int(used.any(axis=2).sum())
    size = max(1, round(used.sum() / readings))
    sensor = system.sensors[name]
    cut = float(system.huber_limits(name)[0][size]) ** 2 if sensor.outliers else np.inf
    return readings, size, _squares(size, sensor.gate, cut)


def _scaled_band(mean: float, variance: float, count: int, level: float) -> Band:
    """Band of the mean of `count` numbers whose sum, a scaled chi-squared number, has this mean and variance."""
    ends = chi_squared_ends(level, 2 * mean**2 / variance)
    return Band(*(float(end) * variance / (2 * mean) / count for end in ends))


def _of_sensor(white: np.ndarray, remaining: tuple[int, _Squares], level: float) -> SensorConsistency:
    """Test normalised innovations (K, m, size), NaN if not used; `remaining`: their size and statistics of squares."""
    used = np.isfinite(white)
    per_component = used.sum(axis=(0, 1))
    ratio = float(np.nansum(white**2) / used.sum())
    # components of one instant are correlated: the band is that of the one with most readings, widened for all of them
    size = white.shape[2]
    numbers, each = int(per_component.max()), 1 - (1 - level) / size
    band = chi_squared_band(numbers, 1.0, each)
    if remaining[1].mean < remaining[0]:
        band = _scaled_band(numbers * remaining[1].own_mean, numbers * remaining[1].own_variance, numbers, each)
        ratio, band = ratio / remaining[1].own_mean, Band(*(end / remaining[1].own_mean for end in band))
    worst, most, lag = 1.0, 0.0, 1
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
                most, lag = float(correlation[k]), k + 1
        if summed:
            worst = min(worst, float(chi_squared_chance(statistic, summed)))
    means = np.nansum(white, axis=(0, 1)) / np.sqrt(np.maximum(per_component, 1))
    mean = float(means[np.argmax(np.abs(means))])
    limit = half_width(1 - (1 - level) / size)
    return SensorConsistency(ratio, band, mean, limit, most, lag, worst >= (1 - level) / size)


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
        return f"innovations agree with the filter: {within}, white, with zero mean"
    sentences = []
    if nis == 0.0:
        sentences.append(
            "all innovations are zero, so they hold no noise: the readings do not change, or the model computed them"
        )
    elif nis < band.low:
        sentences.append(
            f"innovations are {_times(expected / nis)} too small for {', '.join(low or list(sensors))}: "
            f"{_blamed(doubtful) or 'sensor deviations or process noise are too large'}; see `tune`"
        )
    elif nis > band.high:
        sentences.append(
            f"innovations are {_times(nis / expected)} too large for {', '.join(high or list(sensors))}: "
            f"{_blamed(doubtful) or 'sensor deviations or process noise are too small'}, or the model is wrong; "
            "see `tune` and `find_faults`"
        )
    if shifted:
        name, s = max(shifted.items(), key=lambda item: abs(item[1].mean))
        sentences.append(
            f"innovations of {name} have a mean of {s.mean:.3g} standard deviations, above the limit of "
            f"{s.mean_limit:.2g}: the model lacks an offset; see `find_faults`"
        )
    if coloured:
        name, s = max(coloured.items(), key=lambda item: abs(item[1].correlation))
        sentences.append(
            f"innovations of {name} are coloured (correlation {s.correlation:.2f} at lag {s.lag}): the filter lacks "
            "something, such as an offset, a delay or the right process noise"
            + (f": {_blamed(doubtful)}" if doubtful and nis in band else "")
        )
    return "; ".join(sentences)


def _blamed(doubtful: tuple[Suspect, ...]) -> str:
    """The noise that explains the innovations, in words; empty if there is none."""
    if not doubtful:
        return ""
    candidates = [f"{s.name} {float(s.value[0]):.2g} times as large" for s in doubtful]
    if len(candidates) == 1:
        return f"{candidates[0]} explains this best"
    return f"{' or '.join(candidates)} explain this equally well; this log cannot distinguish them"


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 1.1 else f"{100 * (ratio - 1):.2g} %"


@dataclass(frozen=True, eq=False)
class JudgedErrors:
    """Errors of many runs against the filter's own covariance.

    time: judged instants (T,) [s]. nees: normalised estimation error squared, mean over the runs (T,); band: exact band
    at each instant. coverage: state component -> share of the runs inside their two-sided 95 % interval (T,);
    coverage_band: band of this share at one instant. consistency: of the innovations of all runs.
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
        """Whether the errors at all tested instants and the innovations are in their bands."""
        return (
            bool(np.all((self.nees >= self.band.low) & (self.nees <= self.band.high))) and self.consistency.consistent
        )

    @property
    def onset(self) -> float | None:
        """First tested instant [s] at which the errors are outside their band; None if they always stay inside."""
        outside = (self.nees < self.band.low) | (self.nees > self.band.high)
        return float(self.time[np.argmax(outside)]) if outside.any() else None


def judged(run: Filtered, instants: int = 10, *, level: float = LEVEL, skip: float = 0.0) -> JudgedErrors:
    """Test the errors of independent runs with known truth, at evenly spaced instants.

    Runs are independent at one instant, so the mean of their squared errors has an exact band; instants of one run are
    not independent. Each instant has the level 1 - (1 - level) / instants, so that all of them together have `level`.
    Raises ArgumentError if the truth was not given, or for a single run.

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
        raise ArgumentError("the run has no truth and so no errors; pass truth= to `run`", "run")
    if run.runs < 2:
        raise ArgumentError("expected at least 2 independent runs; found 1", "run")
    from scipy.stats import binom

    first = int(np.searchsorted(run.time, run.time[0] + skip))
    rows = np.unique(np.linspace(first, len(run.time) - 1, min(instants, len(run.time) - first)).round().astype(int))
    single = 1 - (1 - level) / len(rows)
    within = np.abs(run.errors[rows]) <= half_width(0.95) * run.deviations[rows]
    names = run.system.space.labels
    ends = binom.ppf([(1 - single) / 2 / len(names), 1 - (1 - single) / 2 / len(names)], run.runs, 0.95) / run.runs
    return JudgedErrors(
        run.time[rows], run.nees[rows].mean(axis=1), chi_squared_band(run.runs, run.dimension, single),
        {name: within[:, :, n].mean(axis=1) for n, name in enumerate(names)}, Band(float(ends[0]), float(ends[1])),
        consistency(run, skip=skip, level=level), run.runs,
    )  # fmt: skip
