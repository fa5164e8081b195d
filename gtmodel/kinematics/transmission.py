"""Errors of the transmission and of the guideway, seen in measured cart points: backlash, a cyclic term, and how
straight the guideway is."""

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

SEED = 20080  # of the noise; the same places give the same chance
# noise rows: as many as this work allows, within these bounds; 2000 give a chance of 5 per cent to 0.5 per cent
WORK, FEWEST, MOST = 1e8, 300, 2000
TAIL = 0.02  # chances below this are extrapolated, from at least so many noise rows:
TAIL_ROWS = 20
SAME = 1e-9  # relative: a sine and a cosine that span one direction only, as for points two per period
PART = 2_000_000  # numbers of a basis held at once


def strongest(q: Array, e: Array, frequencies: Array) -> tuple[int, float]:
    """Index of the frequency that explains most of e, and the chance that white noise has one that explains as much.

    At each frequency sine, cosine, offset and slope are fitted; explained is the part of the sum of squares left by the
    line alone. The frequencies searched are neither independent nor at a known number of them, so the chance is found
    by synthetic noise at the same places (seed 20080, Gaussian, 300 to 2000 rows); below 2 per cent it is extrapolated
    by the law of one frequency, (1 - power)^((n - 4) / 2), times a number of frequencies that is taken from the noise
    and grows as in R. B. Davies, Biometrika 74 (1987).

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
    # chance of as much at one frequency given in advance
    single = np.maximum(1.0 - power, 1e-16) ** ((n - 4) / 2)
    return best, _chance(float(single[0]), np.sort(single[1:]))


def _bases(q: Array, line: Array, frequencies: Array) -> Iterator[Array]:
    """Orthonormal bases (n, frequencies, 2) of sine and cosine without their parts along the line, part by part."""
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
    """The chance of a least single-frequency chance as small as this, from those of the noise, ascending."""
    rank = int(np.searchsorted(noise, single, side="right"))
    tail = max(TAIL_ROWS, int(TAIL * len(noise)))
    if rank >= tail:
        return (rank + 1) / (len(noise) + 1)
    edge = float(noise[tail - 1])
    growth = np.sqrt(np.log(max(single, 1e-300)) / np.log(edge)) if 0.0 < edge < 1.0 else 1.0
    return float(min(tail / len(noise), tail / len(noise) * single / edge * growth))


MIN_POINTS = 3  # two points leave no residual
# metres per metre: transmission scales are 0.96 to 1.003; a factor of two is another unit or another axis
SCALE_RANGE = (0.5, 2.0)
# m: what spans more was given in millimetres, if no guideway is shorter than the thousandth part, 20 mm
LONGEST = 20.0
STANDSTILL = 1e-3  # m: nothing can be said about a guideway along which the cart moves less


class MeasurementError(ValueError):
    """Measurements that cannot be evaluated; one plain sentence."""


@dataclass(frozen=True, eq=False)
class GuidewayFit:
    """A guideway as measured: cart points P(q) = P0 + q v + e (Dressler 2012, eq. (4.10)), lengths in m.

    P0 (3,) and v (3,) minimise the sum of e.e. v points towards rising q; its length is a transmission scale [m per m],
    so it is no unit vector. `q` (n,) and the residuals `e` (n, 3) are in the order of the measurements.
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
        """Part of e along the guideway (n,) [m], signed: e.v / |v|.

        Eq. (4.11) prints e.v, which is |v| times as large (0.96 to 1.003); a length needs the unit vector.
        """
        return self.e @ self.direction

    @cached_property
    def across(self) -> np.ndarray:
        """Part of e orthogonal to the guideway (n, 3) [m], a vector.

        Eq. (4.12) prints e - e_par with a scalar e_par; meant is the vector along the guideway.
        """
        return self.e - np.outer(self.along, self.direction)

    def statistics(self) -> dict[str, float]:
        """Mean, standard deviation (of the sample, n - 1) and maximum of |e|, |e_par| and |e_perp| [m].

        `mean` and `std` are the rows of Dressler 2012, Table 4.1; the others go with Figs. 4.4 and 5.3.
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
        """`at` (k,) and `deviation` (k, 3) for PiecewiseLinearGuideway or SplineGuideway: q sorted, and e there.

        Measurements at one q are averaged. R (3, 3) turns measurement into robot coordinates where these differ
        (Dressler 2012, Table 5.2); where the points lie drops out, for A and v of the robot's own links stand for it.
        """
        at, which = np.unique(self.q, return_inverse=True)
        deviation = np.zeros((len(at), 3))
        np.add.at(deviation, which, self.e)
        deviation /= np.bincount(which)[:, None]
        return {"at": at, "deviation": deviation if R is None else deviation @ np.asarray(R, float).T}


def fit_guideway(q: Any, P: Any, *, longest: float = LONGEST) -> GuidewayFit:
    """Fit a line to cart points that were measured along one guideway (Dressler 2012, eqs. (4.10)-(4.12)).

    Args:
        q: commanded cart coordinates (n,) [m], in any order, n >= 3.
        P: measured points (n, 3) [m], any frame.
        longest: guideway that may be meant [m]; raise it for a robot that is larger.

    Raises MeasurementError: too few points, numbers that are not finite, a cart that does not move, lengths that
    look like millimetres.

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
            f"the points move by less than {1e3 * STANDSTILL:g} mm while q runs over {np.ptp(q):.4g} m; give the "
            "points of the cart that q drives"
        )
    if not low <= scale <= high:
        hint = "one of them is in millimetres, or q belongs to another cart" if _thousand(scale) else "check the units"
        raise MeasurementError(
            f"the points move {scale:.4g} m per metre of q, expected 0.96 to 1.003, at least {low:g} to "
            f"{high:g}; {hint}"
        )
    return GuidewayFit(P0=middle - np.mean(q) * v, v=v, q=q, e=P - middle - np.outer(q - np.mean(q), v))


def checked(q: Any, P: Any, longest: float = LONGEST) -> tuple[np.ndarray, np.ndarray]:
    """q (n,) and P (n, 3) as arrays. Raises MeasurementError."""
    q, P = np.asarray(q, dtype=float), np.asarray(P, dtype=float)
    if q.ndim != 1 or P.shape != (len(q), 3):
        raise MeasurementError(f"expected q of shape (n,) and points of shape (n, 3); found {q.shape} and {P.shape}")
    if len(q) < MIN_POINTS:
        raise MeasurementError(f"a line and its residuals need at least {MIN_POINTS} points; found {len(q)}")
    bad = np.flatnonzero(~(np.isfinite(q) & np.all(np.isfinite(P), axis=1)))
    if bad.size:
        more = f" and {bad.size - 1} more" if bad.size > 1 else ""
        raise MeasurementError(f"row {bad[0]}{more} (counted from 0) is not finite; leave such rows out")
    span = float(np.ptp(q))
    if span < STANDSTILL:
        raise MeasurementError(f"q runs over {span:.3g} m only; the cart has to move along its guideway")
    if span > longest:
        raise MeasurementError(
            f"q runs over {span:.4g} m, more than {longest:g}; give metres, not millimetres, or say by `longest` that "
            "the guideway is longer"
        )
    return q, P


def _thousand(scale: float) -> bool:
    """Whether a ratio is about 1000 or its inverse."""
    return 0.5 < abs(np.log10(scale)) / 3 < 1.5


CONFIDENCE = 0.95
FALSE_ALARM = 1e-3  # a cyclic term counts as found below this chance of noise alone
OVERSAMPLING = 10  # frequencies tried per 1/length of the guideway
MOST_FREQUENCIES = 200_000
MIN_CYCLIC_POINTS = 8  # five numbers are fitted: offset, slope, sine, cosine, period
ALIASES = 5
NUMBERS = ("offset", "slope", "sine", "cosine", "frequency")
APART_DEG = 1.0  # between the lines of two runs: a guideway bends by a thousandth of that


@dataclass(frozen=True)
class Backlash:
    """Width [m] of the play: backward minus forward run along the guideway, positive for a cart that lags.

    `standard_error` [m] is that of the mean, with `degrees_of_freedom`; `pairs` is the number of places compared,
    `across` (3,) [m] the mean difference orthogonal to the guideway, which no play explains.
    """

    width: float
    standard_error: float
    degrees_of_freedom: int
    pairs: int
    across: np.ndarray

    @property
    def significant(self) -> bool:
        """Whether the interval of 95 per cent excludes zero."""
        low, high = self.interval("width", CONFIDENCE)
        return low > 0.0 or high < 0.0

    def interval(self, name: str = "width", level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of the width [m], by Student's t. Raises ArgumentError for another name or no level."""
        if name != "width":
            raise ArgumentError(f"'{name}' was not estimated; it is the width that has an interval", "name")
        if not 0 < level < 1:
            raise ArgumentError(f"a confidence level lies between 0 and 1; found {level:g}", "level")
        reach = half_width(level, self.degrees_of_freedom) * self.standard_error
        return self.width - reach, self.width + reach


def backlash(q_forward: Any, P_forward: Any, q_backward: Any, P_backward: Any, *, longest: float = LONGEST) -> Backlash:
    """Play of the drive from one run with rising and one with falling q (Dressler 2012, section 4.2 and Fig. 4.3).

    The residuals of both runs about the line of the forward run are compared place by place, so that the guideway's
    own errors cancel; the backward run is interpolated to the places of the forward run within their common range.
    Visit the same places in both runs where errors vary faster than the points follow each other.

    Args:
        q_forward, q_backward: (n,) and (m,) [m], each in the order of the measurement.
        P_forward, P_backward: (n, 3) and (m, 3) [m].
        longest: as for `fit_guideway`.

    Raises MeasurementError: as `fit_guideway`; a forward run whose q does not rise, or a backward run whose q does not
    fall, from each point to the next; runs along different lines; fewer than three common places.

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
            f"the two runs go along lines {turn:.3g} deg apart, at most {APART_DEG:g} expected; give points of one "
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
    # interpolated places share measurements: no more of them count than there are points in the common range
    independent = min(len(along), max(2, int(np.sum((q_b >= fit.q[0]) & (q_b <= fit.q[-1])))))
    error = float(np.std(along, ddof=1) / np.sqrt(independent))
    width = float(np.mean(along))
    across = np.mean(difference - np.outer(along, fit.direction), axis=0)
    return Backlash(width, error, independent - 1, len(along), across)


@dataclass(frozen=True)
class CyclicTerm:
    """A periodic error along the guideway: sine sin(2 pi q / period) + cosine cos(2 pi q / period), all in m.

    `false_alarm` is the chance that white noise alone, measured at the same places, shows as much in the range searched
    (see `strongest`). `aliases` are other periods [m] that fit points so far apart equally well, the longest ones;
    empty where the points are uneven. Errors are infinite where the points do not determine the numbers.
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
        """Whether it counts as found: false_alarm below 1e-3."""
        return self.false_alarm < FALSE_ALARM

    def modifiers(self, direction: Any) -> dict[str, Any]:
        """`period`, `sine` and `cosine` of PiecewiseLinearCyclicGuideway, for a unit vector along the guideway (3,)."""
        along = np.asarray(direction, dtype=float)
        return {"period": self.period, "sine": self.sine * along, "cosine": self.cosine * along}


def cyclic_term(fit: GuidewayFit, periods: tuple[float, float] | None = None) -> CyclicTerm:
    """Find the strongest sinusoid in the residuals along the guideway: period, amplitude, and their standard errors.

    A periodogram (sinusoid, offset and slope at every frequency) finds it, a least-squares fit refines it.

    Args:
        fit: line and residuals of the guideway, from `fit_guideway`.
        periods: shortest and longest period [m]; by default from twice the median distance of the points to half the
            length measured. Points d apart cannot distinguish the frequency 1/period from k/d +- 1/period, k a whole
            number (Dressler 2012, section 4.2: 50 mm between points, teeth much closer): such `aliases` fit equally
            well, so shorter periods need points that are closer or uneven.

    Raises MeasurementError: fewer than eight places, or a range of periods that cannot be searched.

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
            f"{2 * span:.4g} m, twice the length measured"
        )
    count = int(np.ceil(OVERSAMPLING * span * (1 / shortest - 1 / longest))) + 2
    if count > MOST_FREQUENCIES:
        raise MeasurementError(f"periods from {shortest:.4g} m up are {count} frequencies to try; ask for longer ones")
    if np.max(np.abs(e)) == 0.0:
        return CyclicTerm(longest, np.inf, 0.0, 0.0, 0.0, 0.0, 1.0, ())
    frequencies = np.linspace(1 / longest, 1 / shortest, count)
    best, false_alarm = strongest(q, e, frequencies)

    def columns(f: float) -> np.ndarray:
        return np.column_stack([np.ones_like(q), q, np.sin(2 * np.pi * f * q), np.cos(2 * np.pi * f * q)])

    f0, size = float(frequencies[best]), float(np.max(np.abs(e)))
    start = np.linalg.lstsq(columns(f0), e / size, rcond=None)[0]
    # residuals of order one, and within one peak of the periodogram
    reach = 1 / span
    fitted = nonlinear_fit(
        by_differences(lambda x: columns(x[4]) @ x[:4] - e / size, len(q)), [*start, f0], NUMBERS,
        scale=[1, 1, 1, 1, reach], bounds={"frequency": (f0 - reach, f0 + reach)}, hold_undetermined=True,
    )  # fmt: skip
    known = fitted.estimate
    # sine and cosine may grow against each other: few points, about two per period
    if known is None or known.held or known.undetermined:
        sine, cosine, f, amplitude_error, frequency_error = *(size * start[2:]), f0, np.inf, np.inf
    else:
        sine, cosine, f = *(size * fitted.x[2:4]), fitted.x[4]
        gradient = np.array([sine, cosine]) / max(float(np.hypot(sine, cosine)), 1e-300)
        amplitude_error = size * float(np.sqrt(gradient @ known.covariance[2:4, 2:4] @ gradient))
        frequency_error = float(known.std[4])
    return CyclicTerm(
        float(1 / f), float(frequency_error / f**2), float(np.hypot(sine, cosine)), amplitude_error, float(sine),
        float(cosine), false_alarm, _aliases(float(f), places),
    )  # fmt: skip


def _aliases(f: float, places: np.ndarray) -> tuple[float, ...]:
    """Periods of the frequencies k/d +- f for even places d apart."""
    gaps = np.diff(places)
    d = float(np.mean(gaps))
    if np.max(np.abs(gaps - d)) > 1e-3 * d:
        return ()
    frequencies = {abs(k / d + s * f) for k in range(1, ALIASES + 1) for s in (-1, 1)}
    return tuple(1 / x for x in sorted(frequencies) if x > 0)
