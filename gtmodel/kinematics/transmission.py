"""Errors of transmission and guideway from measured cart points: straightness, backlash, cyclic error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..inference.nonlinear import by_differences, nonlinear_fit
from ..results import ArgumentError
from ..results.estimate import half_width

Array = np.ndarray

SEED = 20080  # of the noise, so that results are reproducible
# noise rows: limited by this amount of work, within these bounds; 2000 determine a probability of 5 % to 0.5 %
WORK, FEWEST, MOST = 1e8, 300, 2000
TAIL = 0.02  # smaller probabilities are extrapolated, from at least TAIL_ROWS noise rows
TAIL_ROWS = 20
SAME = 1e-9  # relative size below which sine and cosine span one direction only, as with two points per period
PART = 2_000_000  # numbers of a basis in memory at once


def strongest(q: Array, e: Array, frequencies: Array) -> tuple[int, float]:
    """Return the index of the frequency that explains most of e, and the probability that white noise does as well.

    At each frequency sine, cosine, offset and slope are fitted; the power is the explained share of the sum of squares
    that remains after the fit of a line. The frequencies are not independent and their effective number is unknown, so
    the probability comes from synthetic noise at the same places (seed 20080, Gaussian, 300 to 2000 rows). Below 2 % it
    is extrapolated with the law of a single frequency, (1 - power)^((n - 4) / 2), times an effective number of
    frequencies, which is estimated from the noise and grows as in R. B. Davies, Biometrika 74 (1987).

    Args:
        q: (n,) places [m], n > 4. e: (n,) [m], not all on a line. frequencies: [1/m].
    """
    n = len(q)
    rows = int(np.clip(WORK / (n * len(frequencies)), FEWEST, MOST))
    line = np.linalg.qr(np.column_stack([np.ones(n), q - np.mean(q)]))[0]
    signals = np.vstack([e, np.random.default_rng(SEED).standard_normal((rows, n))])
    signals -= (signals @ line) @ line.T
    signals /= np.linalg.norm(signals, axis=1, keepdims=True)
    power, best, first = np.zeros(rows + 1), 0, 0
    for basis in _bases(q, line, frequencies):
        explained = np.sum((signals @ basis.reshape(n, -1)).reshape(rows + 1, -1, 2) ** 2, axis=2)
        if np.max(explained[0]) > power[0]:
            best = first + int(np.argmax(explained[0]))
        power = np.maximum(power, explained.max(axis=1))
        first += basis.shape[1]
    # probability of this power at a single, predetermined frequency
    single = np.maximum(1.0 - power, 1e-16) ** ((n - 4) / 2)
    return best, _chance(float(single[0]), np.sort(single[1:]))


def _bases(q: Array, line: Array, frequencies: Array) -> Iterator[Array]:
    """Yield orthonormal bases (n, frequencies, 2) of sine and cosine, orthogonal to the line, for parts of the
    frequencies."""
    size = max(1, PART // len(q))
    for first in range(0, len(frequencies), size):
        phase = 2 * np.pi * np.outer(q, frequencies[first : first + size])
        waves = np.stack([np.sin(phase), np.cos(phase)], axis=2)
        waves -= np.einsum("ik,kfj->ifj", line, np.einsum("ik,ifj->kfj", line, waves))
        gram = np.einsum("ifj,ifk->fjk", waves, waves)
        sizes, turn = np.linalg.eigh(gram)
        usable = sizes > SAME * sizes[:, 1:]
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, sizes, 1.0)), 0.0)
        yield np.einsum("ifj,fjk->ifk", waves, turn * scale[:, None])


def _chance(single: float, noise: Array) -> float:
    """Return the probability of a single-frequency probability this small, given those of the noise, ascending."""
    rank = int(np.searchsorted(noise, single, side="right"))
    tail = max(TAIL_ROWS, int(TAIL * len(noise)))
    if rank >= tail:
        return (rank + 1) / (len(noise) + 1)
    edge = float(noise[tail - 1])
    growth = np.sqrt(np.log(max(single, 1e-300)) / np.log(edge)) if 0.0 < edge < 1.0 else 1.0
    return float(min(tail / len(noise), tail / len(noise) * single / edge * growth))


MIN_POINTS = 3  # two points leave no residual
# metres per metre: transmission scales are 0.96 to 1.003; beyond a factor of two, unit or axis is wrong
SCALE_RANGE = (0.5, 2.0)
# m: larger spans are probably in millimetres; this assumes guideways longer than 20 mm
LONGEST = 20.0
STANDSTILL = 1e-3  # m: least motion of the cart


class MeasurementError(ValueError):
    """Measurements that cannot be evaluated; the message is one sentence."""


@dataclass(frozen=True, eq=False)
class GuidewayFit:
    """A measured guideway: cart points P(q) = P0 + q v + e (Dressler 2012, eq. (4.10)), lengths in m.

    P0 (3,) and v (3,) minimise the sum of e.e. v points towards increasing q; its length is the transmission scale
    [m per m]. `q` (n,) and the residuals `e` (n, 3) are in the order of the measurements.
    """

    P0: np.ndarray
    v: np.ndarray
    q: np.ndarray
    e: np.ndarray

    @property
    def direction(self) -> np.ndarray:
        """Unit vector along the guideway, v / |v| (3,)."""
        return self.v / np.linalg.norm(self.v)

    @cached_property
    def along(self) -> np.ndarray:
        """Component of e along the guideway (n,) [m], signed: e.v / |v|.

        Eq. (4.11) in print is e.v, which is |v| times as large (0.96 to 1.003); a length needs the unit vector.
        """
        return self.e @ self.direction

    @cached_property
    def across(self) -> np.ndarray:
        """Component of e orthogonal to the guideway (n, 3) [m], a vector.

        Eq. (4.12) in print is e - e_par with a scalar e_par, which means the vector along the guideway.
        """
        return self.e - np.outer(self.along, self.direction)

    def statistics(self) -> dict[str, float]:
        """Return mean, sample standard deviation (n - 1) and maximum of |e|, |e_par| and |e_perp| [m].

        `mean` and `std` are the rows of Dressler 2012, Table 4.1; the others belong to Figs. 4.4 and 5.3.
        """
        sizes = {
            "": np.linalg.norm(self.e, axis=1),
            "along_": np.abs(self.along),
            "across_": np.linalg.norm(self.across, axis=1),
        }
        statistics: dict[str, float] = {}
        for name, size in sizes.items():
            statistics |= {
                f"{name}mean": float(np.mean(size)),
                f"{name}std": float(np.std(size, ddof=1)),
                f"{name}max": float(np.max(size)),
            }
        return statistics

    def modifiers(self, R: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return `at` (k,), sorted q, and `deviation` (k, 3), e there, for PiecewiseLinearGuideway or SplineGuideway.

        Measurements at equal q are averaged. R (3, 3) rotates measurement into robot coordinates if these differ
        (Dressler 2012, Table 5.2). The position of the line is not needed, because the links of the robot have their
        own A and v.
        """
        at, which = np.unique(self.q, return_inverse=True)
        deviation = np.zeros((len(at), 3))
        np.add.at(deviation, which, self.e)
        deviation /= np.bincount(which)[:, None]
        return {"at": at, "deviation": deviation if R is None else deviation @ np.asarray(R, float).T}


def fit_guideway(q: Any, P: Any, *, longest: float = LONGEST) -> GuidewayFit:
    """Fit a line to cart points measured along one guideway (Dressler 2012, eqs. (4.10)-(4.12)).

    Args:
        q: commanded cart coordinates (n,) [m], in any order, n >= 3.
        P: measured points (n, 3) [m], in any frame.
        longest: largest plausible span of q [m]; raise it for a larger robot.

    Raises MeasurementError for too few points, numbers that are not finite, a cart that does not move, and lengths that
    seem to be in millimetres.

    >>> q = np.linspace(0.0, 2.0, 21)
    >>> straight = np.outer(q, [0.99, 0.0, 0.0]) + [0.0, 0.0, 1.0]
    >>> bent = straight + np.outer(np.sin(np.pi * q), [0.0, 0.0, 1e-4])  # 0.1 mm up and down
    >>> fit = gt.kinematics.fit_guideway(q, bent)
    >>> np.linalg.norm(fit.v).round(3), round(1e3 * fit.statistics()["across_max"], 3)  # transmission scale; mm
    (np.float64(0.99), 0.082)
    """
    q, P = checked(q, P, longest)
    design = np.column_stack([np.ones(len(q)), q - np.mean(q)])
    (middle, v), *_ = np.linalg.lstsq(design, P, rcond=None)
    scale = float(np.linalg.norm(v))
    low, high = SCALE_RANGE
    if scale < STANDSTILL / np.ptp(q) or np.max(np.linalg.norm(P - P[0], axis=1)) < STANDSTILL:
        raise MeasurementError(
            f"the points move by less than {1e3 * STANDSTILL:g} mm while q spans {np.ptp(q):.4g} m; expected points of "
            "the cart that q drives"
        )
    if not low <= scale <= high:
        hint = "one of them is in millimetres, or q belongs to another cart" if _thousand(scale) else "check the units"
        raise MeasurementError(
            f"the points move {scale:.4g} m per metre of q, expected 0.96 to 1.003, at least {low:g} to "
            f"{high:g}; {hint}"
        )
    return GuidewayFit(P0=middle - np.mean(q) * v, v=v, q=q, e=P - middle - np.outer(q - np.mean(q), v))


def checked(q: Any, P: Any, longest: float = LONGEST) -> tuple[np.ndarray, np.ndarray]:
    """Return q (n,) and P (n, 3) as arrays. Raises MeasurementError if they cannot be evaluated."""
    q, P = np.asarray(q, dtype=float), np.asarray(P, dtype=float)
    if q.ndim != 1 or P.shape != (len(q), 3):
        raise MeasurementError(f"expected q of shape (n,) and points of shape (n, 3); found {q.shape} and {P.shape}")
    if len(q) < MIN_POINTS:
        raise MeasurementError(f"a line and its residuals need at least {MIN_POINTS} points; found {len(q)}")
    bad = np.flatnonzero(~(np.isfinite(q) & np.all(np.isfinite(P), axis=1)))
    if bad.size:
        more = f" and {bad.size - 1} more" if bad.size > 1 else ""
        raise MeasurementError(f"row {bad[0]}{more} (counted from 0) is not finite; remove such rows")
    span = float(np.ptp(q))
    if span < STANDSTILL:
        raise MeasurementError(f"q spans only {span:.3g} m; the cart has to move along its guideway")
    if span > longest:
        raise MeasurementError(
            f"q spans {span:.4g} m, more than {longest:g} m; give metres, not millimetres, or increase `longest` for a "
            "longer guideway"
        )
    return q, P


def _thousand(scale: float) -> bool:
    """Return whether a ratio is about 1000 or 1/1000."""
    return 0.5 < abs(np.log10(scale)) / 3 < 1.5


CONFIDENCE = 0.95
FALSE_ALARM = 1e-3  # significance level of a cyclic term
OVERSAMPLING = 10  # frequencies per 1/length of the guideway
MOST_FREQUENCIES = 200_000
MIN_CYCLIC_POINTS = 8  # five numbers are fitted: offset, slope, sine, cosine, period
ALIASES = 5
NUMBERS = ("offset", "slope", "sine", "cosine", "frequency")
APART_DEG = 1.0  # largest angle between the lines of two runs; a guideway bends by a thousandth of that


@dataclass(frozen=True)
class Backlash:
    """Width [m] of the backlash: backward minus forward run along the guideway, positive for a cart that lags.

    `standard_error` [m]: of the mean, with `degrees_of_freedom`. `pairs`: number of places compared. `across` (3,) [m]:
    mean difference orthogonal to the guideway, which backlash does not explain.
    """

    width: float
    standard_error: float
    degrees_of_freedom: int
    pairs: int
    across: np.ndarray

    @property
    def significant(self) -> bool:
        """Whether the 95 % confidence interval excludes zero."""
        low, high = self.interval("width", CONFIDENCE)
        return low > 0.0 or high < 0.0

    def interval(self, name: str = "width", level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of the width [m] (Student's t). Raises ArgumentError for a wrong argument."""
        if name != "width":
            raise ArgumentError(f"'{name}' was not estimated; only 'width' has an interval", "name")
        if not 0 < level < 1:
            raise ArgumentError(f"a confidence level lies between 0 and 1; found {level:g}", "level")
        reach = half_width(level, self.degrees_of_freedom) * self.standard_error
        return self.width - reach, self.width + reach


def backlash(q_forward: Any, P_forward: Any, q_backward: Any, P_backward: Any, *, longest: float = LONGEST) -> Backlash:
    """Estimate the backlash of a drive from runs with increasing and decreasing q (Dressler 2012, sec. 4.2, Fig. 4.3).

    The residuals of both runs from the line of the forward run are compared place by place, so that the errors of the
    guideway cancel. The backward run is interpolated at the places of the forward run within the common range. If
    errors vary between neighbouring points, visit the same places in both runs.

    Args:
        q_forward, q_backward: (n,) and (m,) [m], each in the order of the measurement.
        P_forward, P_backward: (n, 3) and (m, 3) [m].
        longest: as for `fit_guideway`.

    Raises MeasurementError as `fit_guideway` does, if q does not increase in the forward or decrease in the backward
    run, for runs along different lines, and for fewer than three common places.

    >>> q = np.linspace(0.0, 1.0, 11)
    >>> there = np.outer(q, [1.0, 0.0, 0.0])
    >>> back = there[::-1] + [5e-5, 0.0, 0.0]  # on the way back the cart lags by 0.05 mm
    >>> play = gt.kinematics.backlash(q, there, q[::-1], back)
    >>> round(1e3 * play.width, 3), play.significant
    (0.05, True)
    """
    fit, back_fit = (fit_guideway(*run, longest=longest) for run in ((q_forward, P_forward), (q_backward, P_backward)))
    q_b, P_b = checked(q_backward, P_backward, longest)
    turn = float(np.degrees(np.arccos(np.clip(fit.direction @ back_fit.direction, -1, 1))))
    if turn > APART_DEG:
        raise MeasurementError(
            f"the lines of the two runs are {turn:.3g} deg apart; expected at most {APART_DEG:g} deg: points of one "
            "guideway in one frame"
        )
    for name, q, sign in (("forward", fit.q, 1), ("backward", q_b, -1)):
        wrong = int(np.sum(sign * np.diff(q) <= 0))
        if wrong:
            word = "rise" if sign > 0 else "fall"
            raise MeasurementError(
                f"q of the {name} run has to {word} from each point to the next; it does not at {wrong} of {len(q) - 1}"
            )
    e_b = (P_b - fit.P0 - np.outer(q_b, fit.v))[::-1]
    inside = (fit.q >= q_b[-1]) & (fit.q <= q_b[0])
    if np.sum(inside) < 3:
        raise MeasurementError(
            f"the runs have {np.sum(inside)} places in common, at least 3 are needed; forward covers {fit.q[0]:.4g} to "
            f"{fit.q[-1]:.4g} m, backward {q_b[-1]:.4g} to {q_b[0]:.4g} m"
        )
    back = np.column_stack([np.interp(fit.q[inside], q_b[::-1], e_b[:, k]) for k in range(3)])
    difference = back - fit.e[inside]
    along = difference @ fit.direction
    # interpolated places share measurements: count at most the measured points in the common range
    independent = min(len(along), max(2, int(np.sum((q_b >= fit.q[0]) & (q_b <= fit.q[-1])))))
    error = float(np.std(along, ddof=1) / np.sqrt(independent))
    width = float(np.mean(along))
    across = np.mean(difference - np.outer(along, fit.direction), axis=0)
    return Backlash(width, error, independent - 1, len(along), across)


@dataclass(frozen=True)
class CyclicTerm:
    """A periodic error along the guideway: sine sin(2 pi q / period) + cosine cos(2 pi q / period), all in m.

    `false_alarm`: probability that white noise at the same places has a term as strong in the searched range (see
    `strongest`). `aliases`: the longest other periods [m] that fit evenly spaced points equally well; empty for uneven
    points. Errors are infinite if the points do not determine the parameters.
    """

    period: float
    period_error: float
    amplitude: float
    amplitude_error: float
    sine: float
    cosine: float
    false_alarm: float
    aliases: tuple[float, ...]

    @property
    def significant(self) -> bool:
        """Whether false_alarm is below 1e-3."""
        return self.false_alarm < FALSE_ALARM

    def modifiers(self, direction: Any) -> dict[str, Any]:
        """Return `period`, `sine` and `cosine` for PiecewiseLinearCyclicGuideway; direction: unit vector (3,)."""
        along = np.asarray(direction, dtype=float)
        return {"period": self.period, "sine": self.sine * along, "cosine": self.cosine * along}


def cyclic_term(fit: GuidewayFit, periods: tuple[float, float] | None = None) -> CyclicTerm:
    """Find the strongest sinusoid in the residuals along the guideway: period, amplitude, and their standard errors.

    The start is the maximum of a periodogram (sinusoid, offset and slope at every frequency); a least-squares fit
    refines it.

    Args:
        fit: line and residuals of the guideway, from `fit_guideway`.
        periods: shortest and longest period [m]; default: from twice the median spacing of the points to half the
            measured length. With a spacing d the frequency 1/period cannot be distinguished from k/d +- 1/period for
            integer k (Dressler 2012, section 4.2: 50 mm between points, teeth much closer). Shorter periods need a
            closer or uneven spacing.

    Raises MeasurementError for fewer than eight places, or for a range of periods that cannot be searched.

    >>> q = np.linspace(0.0, 1.0, 101)
    >>> points = np.outer(q, [1.0, 0.0, 0.0])
    >>> points[:, 0] += 2e-5 * np.sin(2 * np.pi * q / 0.08)  # 0.02 mm, every 80 mm
    >>> term = gt.kinematics.cyclic_term(gt.kinematics.fit_guideway(q, points))
    >>> round(term.period, 4), round(1e3 * term.amplitude, 4), term.significant
    (0.08, 0.02, True)
    """
    order = np.argsort(fit.q, kind="stable")
    q, e = fit.q[order], fit.along[order]
    places = np.unique(q)
    if len(places) < MIN_CYCLIC_POINTS:
        raise MeasurementError(f"a cyclic term needs at least {MIN_CYCLIC_POINTS} places; found {len(places)}")
    span, gap = float(np.ptp(q)), float(np.median(np.diff(places)))
    shortest, longest = periods or (2 * gap, span / 2)
    if not 0 < shortest < longest <= 2 * span:
        raise MeasurementError(
            f"periods from {shortest:.4g} to {longest:.4g} m cannot be searched; expected 0 < shortest < longest <= "
            f"{2 * span:.4g} m, twice the measured length"
        )
    count = int(np.ceil(OVERSAMPLING * span * (1 / shortest - 1 / longest))) + 2
    if count > MOST_FREQUENCIES:
        raise MeasurementError(f"periods from {shortest:.4g} m need {count} frequencies; raise the shortest period")
    if np.max(np.abs(e)) == 0.0:
        return CyclicTerm(longest, np.inf, 0.0, 0.0, 0.0, 0.0, 1.0, ())
    frequencies = np.linspace(1 / longest, 1 / shortest, count)
    best, false_alarm = strongest(q, e, frequencies)

    def columns(f: float) -> np.ndarray:
        return np.column_stack([np.ones_like(q), q, np.sin(2 * np.pi * f * q), np.cos(2 * np.pi * f * q)])

    f0, size = float(frequencies[best]), float(np.max(np.abs(e)))
    start = np.linalg.lstsq(columns(f0), e / size, rcond=None)[0]
    # residuals scaled to order one; the frequency stays within one peak of the periodogram
    reach = 1 / span
    fitted = nonlinear_fit(
        by_differences(lambda x: columns(x[4]) @ x[:4] - e / size, len(q)), [*start, f0], NUMBERS,
        scale=[1, 1, 1, 1, reach], bounds={"frequency": (f0 - reach, f0 + reach)}, hold_undetermined=True,
    )  # fmt: skip
    estimate = fitted.estimate
    # with about two points per period, sine and cosine may grow against each other
    if estimate is None or estimate.held or estimate.undetermined:
        sine, cosine, f, amplitude_error, frequency_error = *(size * start[2:]), f0, np.inf, np.inf
    else:
        sine, cosine, f = *(size * fitted.x[2:4]), fitted.x[4]
        gradient = np.array([sine, cosine]) / max(float(np.hypot(sine, cosine)), 1e-300)
        amplitude_error = size * float(np.sqrt(gradient @ estimate.covariance[2:4, 2:4] @ gradient))
        frequency_error = float(estimate.std[4])
    return CyclicTerm(
        float(1 / f), float(frequency_error / f**2), float(np.hypot(sine, cosine)), amplitude_error, float(sine),
        float(cosine), false_alarm, _aliases(float(f), places),
    )  # fmt: skip


def _aliases(f: float, places: np.ndarray) -> tuple[float, ...]:
    """Return the periods of the frequencies k/d +- f for evenly spaced places at distance d."""
    gaps = np.diff(places)
    d = float(np.mean(gaps))
    if np.max(np.abs(gaps - d)) > 1e-3 * d:
        return ()
    frequencies = {abs(k / d + s * f) for k in range(1, ALIASES + 1) for s in (-1, 1)}
    return tuple(1 / x for x in sorted(frequencies) if x > 0)
