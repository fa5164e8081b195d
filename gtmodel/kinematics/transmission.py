"""Errors of the transmission seen in measured cart points: backlash and a cyclic term along the guideway."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inference.nonlinear import by_differences, nonlinear_fit
from ..results import ArgumentError
from ..results.estimate import half_width
from .guideways import LONGEST, GuidewayFit, MeasurementError, checked, fit_guideway
from .periodogram import strongest

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
