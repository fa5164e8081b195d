"""Offset and drift between two clocks by a signal that both recordings show, with intervals."""

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
COARSEST = 16  # knots of the first curve
ROWS_A_KNOT = 2.5  # of both recordings together: fewer, and nothing is left to judge the fit by
LAGS = 20
NEARLY_ALL = 0.9  # of what the closest knots show: with these the fit begins
TINY_P = 1e-6  # what a fit to so few simulations can say
MOST_DRIFT = 0.05  # of rate: the worst clocks of loggers, resonators without a crystal, are off by 1 or 2 %
RELATED = 0.5  # of the variance that the common curve must explain: else they are no two views of one signal


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where another clock stands against a reference, and how well that is known.

    `warp(t)` gives the reference's times of times t on the other's clock; `bring(trajectory)` does so for a whole
    recording. `estimate`: "offset" [s], what the other's times want added in the middle of its recording, "drift" [1]
    where it is free, and "scale" and "shift" of each signal. `explained`: the share of the variance that the curve
    explains where both have rows, of the other signal, or of the reference where that is less and not white. `noise`
    (signals, 2): standard deviations of reference and other, in their units. `tests`: whether the residuals of each
    recording are white, by name; `coloured` where one is not, the intervals are then those of Newey and West.
    `resolved`: whether a finer curve would fit no better than chance. `residuals`: name -> times on the reference's
    clock and residuals of the other recording, in `unit` where all signals have one.
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
        """[s] to be added to the other's times, in the middle of its recording."""
        return self.warp.offset

    @property
    def drift(self) -> float:
        """[1] by which the reference's clock runs faster."""
        return self.warp.drift

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of a name of `estimate`. Raises ArgumentError for another one."""
        return self.estimate.interval(name, level)

    def bring(self, trajectory: Trajectory) -> Trajectory:
        """A recording of the other clock with the times of the reference."""
        return Trajectory(
            self.warp(trajectory.time), {n: trajectory[n] for n in trajectory.names},
            {n: trajectory.unit(n) for n in trajectory.names}, title=trajectory.title,
            provenance=trajectory.provenance, synthetic=trajectory.synthetic,
        )  # fmt: skip

    @property
    def message(self) -> str:
        low, high = self.interval("offset")
        text = f"the other clock wants {self.offset:.6g} s added ({low:.6g} to {high:.6g})"
        if "drift" in self.estimate.names:
            half = 0.5 * float(np.diff(self.interval("drift"))[0])
            text += f" and runs {-1e6 * self.drift:.3g} ppm fast (+- {1e6 * half:.2g})"
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
    """Where the clock of one recording stands against that of another, by signals that both show.

    Args:
        reference, other: recordings; their rows may be uneven and have gaps.
        signals: names in the reference -> names in the other; a name or names where both have the same; None for all
            that both have. Components of vectors are taken one by one. Their units must agree.
        drift: whether the clocks may differ in rate.
        scale, shift: whether the other signal may be scale times the reference's plus shift.
        within: the range of the offset [s]; None for all at which half of the shorter recording overlaps.

    A coarse offset by correlation, then one cubic spline through both recordings, with offset, drift, scale and shift
    estimated along, and the noise of each. Knots are set closer until a finer curve explains no more than chance. The
    residuals are tested for whiteness against white noise sent through the same fit; the interval is that of white
    noise where they pass and Newey and West's where they do not. Raises LogError where the signals do not agree at any
    offset, or at two alike, ArgumentError for names and units.

    >>> t = np.linspace(0.0, 20.0, 1001)
    >>> wave = lambda t: np.sin(t + 0.2 * t**2)
    >>> rng = np.random.default_rng(0)
    >>> robot = gt.Trajectory(t, {"q": wave(t) + 0.01 * rng.normal(size=t.size)}, {"q": "rad"})
    >>> tracker = gt.Trajectory(t[:900] + 100.0, {"q": wave(t[:900] + 0.7) + 0.01 * rng.normal(size=900)}, {"q": "rad"})
    >>> found = gt.measurements.align(robot, tracker)
    >>> round(found.offset, 3), abs(found.drift) < 1e-4
    (-99.3, True)
    """
    pairs = _pairs(reference, other, signals)
    reference, other = smooth(reference.select(list(pairs))), smooth(other.select(list(pairs.values())))
    series = _series(reference, other, pairs)
    low, high = within or _widest(series)
    if not low <= high:
        raise ArgumentError(f"the offset may be from {low:g} to {high:g} s; expected the smaller one first", "within")
    progress("correlating", 0.1)
    start = coarse_offset(series, low, high)
    at = 0.5 * float(series[0].other_time[0] + series[0].other_time[-1])
    warp = _with_scales(series, Warp(at, start, 0.0, np.ones(len(series)), np.zeros(len(series))), scale, shift)
    fit, resolved = _fine_enough(series, warp, Freed(drift, scale, shift), progress)
    if not low - 0.5 * (high - low) <= fit.warp.offset <= high + 0.5 * (high - low):
        raise LogError(f"the estimated offset, {fit.warp.offset:.6g} s, has left the range {low:g} to {high:g} s")
    units = {reference.unit(n) for n in dict(_pairs(reference, other, signals))}
    unit = units.pop() if len(units) == 1 else ""
    if abs(fit.warp.drift) > MOST_DRIFT:
        raise LogError(
            f"the clocks would differ in rate by {100 * abs(fit.warp.drift):.2g} %, which clocks do not; expected at "
            f"most {100 * MOST_DRIFT:g} %, so take signals that show the same motion, and check the units of both times"
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
                f"'{first}' has {a[0].size} components and '{second}' {b[0].size}; expected as many", "signals"
            )
        for which, rows in (("reference", a), ("other recording", b)):
            if len(rows) < FEWEST:
                raise LogError(f"the {which} has {len(rows)} rows of '{first}'; expected at least {FEWEST}")
        a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
        for k in range(a.shape[1]):
            name = first if a.shape[1] == 1 else f"{first}[{k}]"
            if np.ptp(a[:, k]) == 0.0 or np.ptp(b[:, k]) == 0.0:
                if a.shape[1] > 1:
                    continue  # an axis that stands still says nothing
                raise LogError(f"'{name}' does not vary; take a signal that moves in both recordings")
            series.append(Series(name, reference.time, a[:, k], other.time, b[:, k]))
    if not series:
        raise LogError(f"'{next(iter(pairs))}' does not vary; take a signal that moves in both recordings")
    return series


def _widest(series: Sequence[Series]) -> tuple[float, float]:
    s = series[0]
    half = 0.5 * min(np.ptp(s.reference_time), np.ptp(s.other_time))
    return (
        float(s.reference_time[0] - s.other_time[-1] + half), float(s.reference_time[-1] - s.other_time[0] - half)
    )  # fmt: skip


def _with_scales(series: Sequence[Series], warp: Warp, scale: bool, shift: bool) -> Warp:
    """Scales and shifts at the coarse offset, by straight lines."""
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
    """The fit with the widest knots whose next two halvings explain no more than chance; else with the closest."""
    s = series[0]
    length = max(s.reference_time[-1], warp(s.other_time)[-1]) - min(s.reference_time[0], warp(s.other_time)[0])
    closest = ROWS_A_KNOT * length / (len(s.reference) + len(s.other))
    spacings = [length / COARSEST]
    while spacings[-1] / 2 >= closest:
        spacings.append(spacings[-1] / 2)
    fits = list[CurveFit]()
    noise = None
    # a curve too coarse to show the motion says nothing of the clocks: the fit would run away from the coarse offset
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
    """Whether the finer curve leaves no less than chance takes away: an F test in the noise of the finer one."""
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
        of = "" if len(series) == 1 else f" of {s.name}"
        for which, part in zip(("reference", "other"), pair, strict=True):
            tests[f"{which} signal{of}"] = _whiteness(fit.residuals[part], fit.simulated[part])
        left = fit.noise[k, 1] * fit.residuals[pair[1]]
        residuals[s.name] = fit.times[pair[1]], left
        shares = _explained(s, fit, k)
        if tests[f"reference signal{of}"].passed:
            shares.pop(" of the reference", None)  # white: the reference is noisy, and the other one is not
        explained += shares.values()
        for whose, share in shares.items():
            if share < RELATED:
                raise LogError(
                    f"the common curve explains {100 * max(share, 0.0):.0f} % of '{s.name}'{whose} at the best offset, "
                    f"{fit.warp.offset:.6g} s; expected more than half, so take signals that show the same motion"
                )
    coloured = not all(v.passed for v in tests.values())
    n, k = fit.border.shape
    if coloured:
        order = np.argsort(fit.times, kind="stable")
        lags = _lags(fit)
        covariance = newey_west(fit.border[order], fit.residuals[order], lags=lags)
        covariance *= (n - k) / fit.degrees_of_freedom  # the curve's degrees of freedom are gone, too
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
        notes.append(f"{worst}: {tests[worst].message}; intervals are those of coloured residuals (Newey and West)")
    if not resolved:
        notes.append(
            "the signals hold more than a curve of the sampling's own resolution shows: what is faster than "
            f"{1e3 * fit.spacing:.3g} ms counts as noise"
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
    """Shares of the variance of the other recording and of the reference that series k's curve explains, by whose they
    are. Only where both have rows: elsewhere the curve follows the one that has. Raises LogError for a short overlap.
    """
    u = fit.warp(s.other_time)
    low, high = max(s.reference_time[0], u[0]), min(s.reference_time[-1], u[-1])
    if high - low < OVERLAP * min(np.ptp(s.reference_time), np.ptp(u)) * 0.9:
        raise LogError(
            f"the recordings of '{s.name}' overlap for {high - low:.3g} s at the best offset, {fit.warp.offset:.6g} s, "
            "which is less than half of the shorter one; take signals that show the same motion"
        )
    shares = {}
    for whose, which, time, values in (("", 1, u, s.other), (" of the reference", 0, s.reference_time, s.reference)):
        there = (time >= low) & (time <= high)
        left = fit.noise[k, which] * fit.residuals[fit.parts[k][which]]
        shares[whose] = 1.0 - float(np.var(left[there]) / max(np.var(values[there]), np.finfo(float).tiny))
    return shares


def _norms(J: Array) -> Array:
    return 1.0 / np.linalg.norm(J, axis=0)


def _lags(fit: CurveFit) -> int:
    """Bandwidth in rows of both recordings together, from that of each."""
    longest = 1.0
    total = len(fit.times) / max(np.ptp(fit.times), np.finfo(float).tiny)
    for pair in fit.parts:
        for part in pair:
            step = np.ptp(fit.times[part]) / max(part.stop - part.start - 1, 1)
            longest = max(longest, automatic_lag(fit.residuals[part]) * step * total)
    return min(int(np.ceil(longest)), len(fit.times) // 4)


def _whiteness(r: Array, simulated: Array) -> Verdict:
    """Ljung and Box's sum of squared autocorrelations against that of white noise sent through the same fit."""
    lags = min(LAGS, len(r) // 5)
    c = autocorrelation(r, lags)[1:]
    Q = portmanteau(c, len(r))
    chance = np.array([portmanteau(autocorrelation(column, lags)[1:], len(r)) for column in simulated.T])
    mean, variance = float(chance.mean()), float(chance.var(ddof=1))
    p = float(chi_squared_chance(Q * 2 * mean / variance, 2 * mean**2 / variance))
    k = int(np.argmax(np.abs(c)))
    said = "residuals look white" if p >= SMALL_P else f"residuals are coloured (correlation {c[k]:.2f} at lag {k + 1})"
    shown = f"= {p:.2g}" if p >= TINY_P else f"below {TINY_P:g}"
    return Verdict(Q, p, p >= SMALL_P, f"{said}, p {shown} by {PROBES} simulations of white noise")
