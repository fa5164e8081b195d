"""Offset and drift between two clocks, with intervals, from a signal in both recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...inference.chance import chi_squared_chance, f_test
from ...inference.covariance import automatic_lag, newey_west, white
from ...inference.residuals import SMALL_P, Verdict, autocorrelation, portmanteau
from ...results.estimate import Estimate
from ...results.interpolation import smooth
from ...results.refusal import ArgumentError
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from ...results.work import Progress, silent
from ..log import LogError
from .common_curve import OVERLAP, PROBES, CurveFit, Freed, Series, Warp, coarse_offset, fit_curve, shown

FEWEST = 20  # rows of each recording
COARSEST = 16  # knot intervals of the first curve
ROWS_A_KNOT = 2.5  # least rows of both recordings per knot, so that the residuals can be tested
LAGS = 20
NEARLY_ALL = 0.9  # the fit begins with knots that explain this share of what the closest knots explain
TINY_P = 1e-6  # smallest p-value that PROBES simulations can support
MOST_DRIFT = 0.05  # relative rate: the worst clocks, resonators without a crystal, are off by 1 or 2 %
RELATED = 0.5  # share of the variance that the common curve must explain; below it the signals are unrelated


@dataclass(frozen=True, eq=False)
class Alignment:
    """Offset and drift of another clock relative to a reference clock, with their uncertainty.

    `warp(t)` converts times of the other clock to the reference clock; `bring(trajectory)` converts a recording.
    `estimate`: "offset" [s], to be added to the other times at the middle of that recording; "drift" [1], if estimated;
    "scale" and "shift" of each signal. `explained`: share of the variance that the common curve explains where the
    recordings overlap; the smaller share of both signals, except that a reference with white residuals does not count.
    `noise` (signals, 2): standard deviations of reference and other signal, in their units. `tests`: whiteness test of
    the residuals of each recording; if one fails, `coloured` is true and the intervals are those of Newey and West.
    `resolved`: whether a finer curve would not fit significantly better. `residuals`: name -> times on the reference
    clock and residuals of the other recording, in `unit` if all signals share one.
    """

    warp: Warp
    estimate: Estimate
    explained: float
    noise: Array
    tests: Mapping[str, Verdict]
    coloured: bool
    resolved: bool
    spacing: float
    residuals: Mapping[str, tuple[Array, Array]]
    unit: str
    notes: tuple[str, ...]

    @property
    def offset(self) -> float:
        """Offset [s] to be added to the times of the other clock, at the middle of its recording."""
        return self.warp.offset

    @property
    def drift(self) -> float:
        """Relative rate [1] by which the reference clock runs faster."""
        return self.warp.drift

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of an entry of `estimate`. Raises ArgumentError for an unknown name."""
        return self.estimate.interval(name, level)

    def bring(self, trajectory: Trajectory) -> Trajectory:
        """Return a recording of the other clock with times of the reference clock."""
        return Trajectory(
            self.warp(trajectory.time), {n: trajectory[n] for n in trajectory.names},
            {n: trajectory.unit(n) for n in trajectory.names}, title=trajectory.title,
            provenance=trajectory.provenance, synthetic=trajectory.synthetic,
        )  # fmt: skip

    @property
    def message(self) -> str:
        low, high = self.interval("offset")
        places = max(0, 2 - int(np.floor(np.log10(max(high - low, 1e-12)))))  # show the width of the interval
        text = f"add {self.offset:.{places}f} s ({low:.{places}f} to {high:.{places}f}) to the times of the other clock"
        if "drift" in self.estimate.names:
            half = 0.5 * float(np.diff(self.interval("drift"))[0])
            text += f", which runs {-1e6 * self.drift:.3g} ppm fast (+- {1e6 * half:.2g})"
        return text


def align(
    reference: Trajectory,
    other: Trajectory,
    signals: Mapping[str, str] | Sequence[str] | str | None = None,
    *,
    drift: bool = True,
    scale: bool = True,
    shift: bool = True,
    within: tuple[float, float] | None = None,
    progress: Progress = silent,
) -> Alignment:
    """Estimate offset and drift between the clocks of two recordings, from signals that both contain.

    Args:
        reference, other: recordings; their rows may be uneven and have gaps.
        signals: names in the reference -> names in the other; a name or names if they agree; None for all common names.
            Components of vectors are used separately. Units must agree.
        drift: whether the clocks may differ in rate.
        scale, shift: whether the other signal may be scale times the reference signal plus shift.
        within: range of the offset [s]; None for all offsets at which half of the shorter recording overlaps.

    Correlation gives a coarse offset. Then one cubic spline is fitted to both recordings, together with offset, drift,
    scale, shift and the noise level of each. Knots are refined until a finer curve is not significantly better. The
    residuals are tested for whiteness against white noise passed through the same fit. Intervals are those for white
    noise if the test passes, otherwise those of Newey and West. Raises LogError if the signals agree at no offset or
    equally well at two, ArgumentError for wrong names or units.

    >>> t = np.linspace(0.0, 20.0, 1001)
    >>> wave = lambda t: np.sin(t + 0.2 * t**2)
    >>> rng = np.random.default_rng(0)
    >>> robot = gt.Trajectory(t, {"q": wave(t) + 0.01 * rng.normal(size=t.size)}, {"q": "rad"})
    >>> tracker = gt.Trajectory(t[:900] + 100.0, {"q": wave(t[:900] + 0.7) + 0.01 * rng.normal(size=900)}, {"q": "rad"})
    >>> alignment = gt.measurements.align(robot, tracker)
    >>> round(alignment.offset, 3), abs(alignment.drift) < 1e-4
    (-99.3, True)
    """
    pairs = _pairs(reference, other, signals)
    reference, other = smooth(reference.select(list(pairs))), smooth(other.select(list(pairs.values())))
    series = _series(reference, other, pairs)
    low, high = within or _widest(series)
    if not low <= high:
        raise ArgumentError(f"the range of the offset is {low:g} to {high:g} s; the lower bound comes first", "within")
    progress("correlating", 0.1)
    start = coarse_offset(series, low, high)
    middle = 0.5 * float(series[0].other_time[0] + series[0].other_time[-1])
    warp = _with_scales(series, Warp(middle, start, 0.0, np.ones(len(series)), np.zeros(len(series))), scale, shift)
    fit, resolved = _fine_enough(series, warp, Freed(drift, scale, shift), progress)
    if not low - 0.5 * (high - low) <= fit.warp.offset <= high + 0.5 * (high - low):
        raise LogError(f"the estimated offset, {fit.warp.offset:.6g} s, has left the range {low:g} to {high:g} s")
    units = {reference.unit(n) for n in dict(_pairs(reference, other, signals))}
    unit = units.pop() if len(units) == 1 else ""
    if abs(fit.warp.drift) > MOST_DRIFT:
        raise LogError(
            f"the estimated rates of the clocks differ by {100 * abs(fit.warp.drift):.2g} %; expected at most "
            f"{100 * MOST_DRIFT:g} %; use signals of the same motion, and check the units of both times"
        )
    return _judged(series, fit, resolved, unit, drift, scale, shift)


def _pairs(
    reference: Trajectory, other: Trajectory, signals: Mapping[str, str] | Sequence[str] | str | None
) -> dict[str, str]:
    if isinstance(signals, Mapping):
        return dict(signals)
    if signals is None:
        signals = [n for n in reference.names if n in other.names]
    return {n: n for n in ([signals] if isinstance(signals, str) else signals)}


def _series(
    reference: Trajectory, other: Trajectory, signals: Mapping[str, str] | Sequence[str] | str | None
) -> list[Series]:
    pairs = _pairs(reference, other, signals)
    if not pairs:
        raise ArgumentError("the recordings have no signal in common; name pairs of them", "signals")
    series = []
    for first, second in pairs.items():
        a, b = np.asarray(reference[first]), np.asarray(other[second])
        units = reference.unit(first), other.unit(second)
        if units[0] != units[1]:
            raise ArgumentError(
                f"'{first}' is in {units[0]} and '{second}' in {units[1]}; expected one unit", "signals"
            )
        if a.shape[1:] != b.shape[1:]:
            raise ArgumentError(
                f"'{first}' has {a[0].size} components and '{second}' {b[0].size}; expected equal numbers", "signals"
            )
        for which, rows in (("reference", a), ("other recording", b)):
            if len(rows) < FEWEST:
                raise LogError(f"the {which} has {len(rows)} rows of '{first}'; expected at least {FEWEST}")
        a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
        for k in range(a.shape[1]):
            name = first if a.shape[1] == 1 else f"{first}[{k}]"
            if np.ptp(a[:, k]) == 0.0 or np.ptp(b[:, k]) == 0.0:
                if a.shape[1] > 1:
                    continue
                raise LogError(f"'{name}' does not vary; use a signal that moves in both recordings")
            series.append(Series(name, reference.time, a[:, k], other.time, b[:, k]))
    if not series:
        raise LogError(f"'{next(iter(pairs))}' does not vary; use a signal that moves in both recordings")
    return series


def _widest(series: Sequence[Series]) -> tuple[float, float]:
    s = series[0]
    half = 0.5 * min(np.ptp(s.reference_time), np.ptp(s.other_time))
    return (
        float(s.reference_time[0] - s.other_time[-1] + half), float(s.reference_time[-1] - s.other_time[0] - half)
    )  # fmt: skip


def _with_scales(series: Sequence[Series], warp: Warp, scale: bool, shift: bool) -> Warp:
    """Fit scales and shifts at the coarse offset with straight lines."""
    scales, shifts = warp.scale.copy(), warp.shift.copy()
    for k, s in enumerate(series):
        u = warp(s.other_time)
        inside = (u >= s.reference_time[0]) & (u <= s.reference_time[-1])
        x, y = np.interp(u[inside], s.reference_time, s.reference), s.other[inside]
        if scale and shift:
            scales[k], shifts[k] = np.polyfit(x, y, 1)
        elif scale:
            scales[k] = float(x @ y / (x @ x))
        elif shift:
            shifts[k] = float(np.mean(y - x))
    return Warp(warp.at, warp.offset, warp.drift, scales, shifts)


def _fine_enough(series: Sequence[Series], warp: Warp, freed: Freed, progress: Progress) -> tuple[CurveFit, bool]:
    """Return the coarsest fit that two halvings of the knot spacing do not improve significantly, else the finest."""
    s = series[0]
    length = max(s.reference_time[-1], warp(s.other_time)[-1]) - min(s.reference_time[0], warp(s.other_time)[0])
    closest = ROWS_A_KNOT * length / (len(s.reference) + len(s.other))
    spacings = [length / COARSEST]
    while spacings[-1] / 2 >= closest:
        spacings.append(spacings[-1] / 2)
    fits = list[CurveFit]()
    noise = None
    # with a curve too coarse to show the motion, the fit would run away from the coarse offset
    shares = [min(shown(series, warp, spacing)) for spacing in spacings]
    if max(shares) > RELATED:
        spacings = spacings[next(k for k, share in enumerate(shares) if share >= NEARLY_ALL * max(shares)) :]
    for k, spacing in enumerate(spacings):
        progress("fitting a common curve", 0.2 + 0.7 * k / len(spacings))
        fits.append(fit_curve(series, warp, spacing, freed, noise))
        warp, noise = fits[-1].warp, fits[-1].noise
        if len(fits) >= 3 and all(_chance(a, fits[-1]) for a in fits[-3:-1]):
            return fits[-3], True
    if len(fits) >= 2 and _chance(fits[-2], fits[-1]):
        return fits[-2], True
    return fits[-1], False


def _chance(coarse: CurveFit, fine: CurveFit) -> bool:
    """Return whether the finer curve is not significantly better: an F test with the noise levels of the finer fit."""
    more = fine.curve - coarse.curve
    if more <= 0 or fine.degrees_of_freedom <= 0:
        return True
    unit = np.ones(len(coarse.residuals))
    for k, pair in enumerate(coarse.parts):
        for which, part in enumerate(pair):
            unit[part] = coarse.noise[k, which] / fine.noise[k, which]
    before = float(np.sum((coarse.residuals * unit) ** 2))
    return f_test(before, fine.sum_of_squares, more, fine.degrees_of_freedom)[1] >= SMALL_P


def _judged(
    series: Sequence[Series], fit: CurveFit, resolved: bool, unit: str, drift: bool, scale: bool, shift: bool
) -> Alignment:
    tests, residuals, explained = dict[str, Verdict](), dict[str, tuple[Array, Array]](), list[float]()
    for k, (s, pair) in enumerate(zip(series, fit.parts, strict=True)):
        suffix = "" if len(series) == 1 else f" of {s.name}"
        for which, part in zip(("reference", "other"), pair, strict=True):
            tests[f"{which} signal{suffix}"] = _whiteness(fit.residuals[part], fit.simulated[part])
        residuals[s.name] = fit.times[pair[1]], fit.noise[k, 1] * fit.residuals[pair[1]]
        shares = _explained(s, fit, k)
        if tests[f"reference signal{suffix}"].passed:
            shares.pop(" of the reference", None)  # its residuals are noise
        explained += shares.values()
        for whose, share in shares.items():
            if share < RELATED:
                raise LogError(
                    f"the common curve explains {100 * max(share, 0.0):.0f} % of '{s.name}'{whose} at the best offset, "
                    f"{fit.warp.offset:.6g} s; expected more than half, so use signals of the same motion"
                )
    coloured = not all(v.passed for v in tests.values())
    n, k = fit.border.shape
    if coloured:
        order = np.argsort(fit.times, kind="stable")
        lags = _lags(fit)
        covariance = newey_west(fit.border[order], fit.residuals[order], lags=lags)
        covariance *= (n - k) / fit.degrees_of_freedom  # accounts for the coefficients of the curve
    else:
        covariance = white(fit.border, fit.sum_of_squares / fit.degrees_of_freedom, scale=_norms(fit.border))
    names, values, units = ["offset"], [fit.warp.offset], ["s"]
    if drift:
        names, values, units = [*names, "drift"], [*values, fit.warp.drift], [*units, "1"]
    for j, s in enumerate(series):
        if scale:
            names, values, units = [*names, f"scale of {s.name}"], [*values, float(fit.warp.scale[j])], [*units, "1"]
        if shift:
            names, values, units = [*names, f"shift of {s.name}"], [*values, float(fit.warp.shift[j])], [*units, ""]
    notes = []
    if coloured:
        worst = min(tests, key=lambda name: tests[name].p)
        notes.append(f"{worst}: {tests[worst].message}; the intervals allow for this (Newey and West)")
    if not resolved:
        notes.append(
            "the signals contain more than the sampling resolves: components faster than "
            f"{1e3 * fit.spacing:.3g} ms count as noise"
        )
    estimate = Estimate(
        tuple(names), np.array(values), covariance, float(fit.degrees_of_freedom), 1.0, False, fit.residuals, (),
        units=tuple(units), notes=tuple(notes),
    )  # fmt: skip
    return Alignment(
        fit.warp,
        estimate,
        min(explained),
        fit.noise,
        tests,
        coloured,
        resolved,
        fit.spacing,
        residuals,
        unit,
        tuple(notes),
    )


def _explained(s: Series, fit: CurveFit, k: int) -> dict[str, float]:
    """Return the explained shares of the variance of both recordings of series k, keyed by a suffix for messages. Only
    the overlap counts: elsewhere the curve follows a single recording. Raises LogError if the overlap is too short."""
    u = fit.warp(s.other_time)
    low, high = max(s.reference_time[0], u[0]), min(s.reference_time[-1], u[-1])
    if high - low < OVERLAP * min(np.ptp(s.reference_time), np.ptp(u)) * 0.9:
        raise LogError(
            f"the recordings of '{s.name}' overlap for {high - low:.3g} s at the best offset, {fit.warp.offset:.6g} s, "
            "which is less than half of the shorter one; use signals of the same motion"
        )
    shares = {}
    for whose, which, time, values in (("", 1, u, s.other), (" of the reference", 0, s.reference_time, s.reference)):
        overlap = (time >= low) & (time <= high)
        residuals = fit.noise[k, which] * fit.residuals[fit.parts[k][which]]
        shares[whose] = 1.0 - float(np.var(residuals[overlap]) / max(np.var(values[overlap]), np.finfo(float).tiny))
    return shares


def _norms(J: Array) -> Array:
    return 1.0 / np.linalg.norm(J, axis=0)


def _lags(fit: CurveFit) -> int:
    """Return the Newey-West bandwidth in rows of both recordings together, from the bandwidth of each."""
    longest = 1.0
    total = len(fit.times) / max(np.ptp(fit.times), np.finfo(float).tiny)
    for pair in fit.parts:
        for part in pair:
            step = np.ptp(fit.times[part]) / max(part.stop - part.start - 1, 1)
            longest = max(longest, automatic_lag(fit.residuals[part]) * step * total)
    return min(int(np.ceil(longest)), len(fit.times) // 4)


def _whiteness(r: Array, simulated: Array) -> Verdict:
    """Ljung-Box test whose null distribution comes from white noise passed through the same fit."""
    lags = min(LAGS, len(r) // 5)
    c = autocorrelation(r, lags)[1:]
    Q = portmanteau(c, len(r))
    chance = np.array([portmanteau(autocorrelation(column, lags)[1:], len(r)) for column in simulated.T])
    mean, variance = float(chance.mean()), float(chance.var(ddof=1))
    p = float(chi_squared_chance(Q * 2 * mean / variance, 2 * mean**2 / variance))
    k = int(np.argmax(np.abs(c)))
    text = "residuals look white" if p >= SMALL_P else f"residuals are coloured (correlation {c[k]:.2f} at lag {k + 1})"
    p_text = f"= {p:.2g}" if p >= TINY_P else f"below {TINY_P:g}"
    return Verdict(Q, p, p >= SMALL_P, f"{text}, p {p_text} from {PROBES} simulations of white noise")
