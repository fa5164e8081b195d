"""How much larger than fitted errors held-out ones may be before chance no longer explains it, and whether
recordings of one machine agree."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..results.check import Check
from ..results.estimate import Estimate, half_width
from ..results.refusal import ArgumentError
from ..results.suspicion import FIRST, Suspicion
from .chance import chi_squared_bound, chi_squared_chance, f_bound, f_chance
from .residuals import SMALL_P, shown_p

# probability that a sound model fails one verdict: seldom enough for an exit code that scripts rely on
FALSE_ALARM = FIRST
# a ratio that matters: two halves of one recording or grid differ by some tenths where the model lacks a little, and
# the noise of a device is seldom known to better than 30 %; beyond 1.41 more than half of the mean square is no noise
MATTERS = 1.5


class _Bounded(ABC):
    """A ratio that is judged by a bound; `p`: how often a sound model has one as large as this or larger."""

    ratio: float
    bound: float
    p: float

    @property
    @abstractmethod
    def extent(self) -> str:
        """The ratio in words."""

    @property
    def passed(self) -> bool:
        """Within the bound; not where nothing can be judged, whose bound is infinite."""
        return bool(np.isfinite(self.bound)) and self.ratio <= self.bound

    def check(self, advice: str) -> Check:
        """The ratio against its bound."""
        return Check(self.ratio, self.bound if np.isfinite(self.bound) else None, advice, judged=self.passed)

    def suspicion(self, name: str, remedy: str) -> Suspicion:
        """Whether it is larger than a sound model has it, by more than matters."""
        return Suspicion(name, self.extent, 1.0 if self.ratio <= MATTERS and np.isfinite(self.p) else self.p, remedy)


@dataclass(frozen=True)
class HeldOut(_Bounded):
    """Held-out over fitted rms error: `ratio`, what a sound model has on average (`expected`), and the `bound`.

    The bound is the larger of 1.5 and of the ratio that a sound model exceeds with probability `false_alarm`.
    """

    ratio: float
    expected: float
    bound: float
    false_alarm: float
    p: float = np.nan

    @property
    def extent(self) -> str:
        """The ratio in words, without what it may come from."""
        return (
            f"held-out errors are {self.ratio:.3g} times the fitted ones; a sound model has {self.expected:.3g} on "
            f"average ({shown_p(self.p)})"
        )

    @property
    def message(self) -> str:
        if not np.isfinite(self.bound):
            return "as many parameters as equations were fitted: held-out errors have nothing to be judged by"
        return (
            f"held-out errors are {self.ratio:.3g} times the fitted ones; a sound model has {self.expected:.3g} on "
            f"average, and more than {self.bound:.3g} in {100 * self.false_alarm:g} % of the cases at most"
        )


@dataclass(frozen=True)
class OverNoise(_Bounded):
    """Rms residuals over the stated noise: `ratio`, and the `bound` of a sound model, see over_noise().

    `p`: how often noise as it was stated leaves residuals as large as these or larger.
    """

    ratio: float
    bound: float
    degrees_of_freedom: float
    p: float

    @property
    def as_stated(self) -> bool:
        """Whether noise as it was stated explains the residuals, neither more nor less; p is 1 % or more."""
        return SMALL_P / 2 <= self.p <= 1 - SMALL_P / 2

    @property
    def extent(self) -> str:
        """The ratio in words, without what it may come from."""
        if not np.isfinite(self.bound):
            return "as many parameters as equations were fitted: residuals say nothing of the noise"
        of = f"{self.degrees_of_freedom:.4g} degrees of freedom, {shown_p(self.p)}"
        if self.as_stated:
            return f"residuals are as large as the stated noise ({self.ratio:.3g} times, {of})"
        size = f"residuals are {self.ratio:.3g} times the stated noise"
        if self.ratio < 1:
            return f"{size}: it was stated too large ({of})"
        if self.passed:
            return f"{size} ({of}): more than chance, but less than the {self.bound:.3g} times that matter"
        return f"{size}, of a sound model {self.bound:.3g} times at most ({of})"

    @property
    def message(self) -> str:
        if self.as_stated or not self.ratio > 1 or not np.isfinite(self.bound):
            return self.extent
        return f"{self.extent}: the model lacks an effect, or the noise was stated too small"


def over_noise(estimate: Estimate, *, false_alarm: float = FALSE_ALARM, matters: float = MATTERS) -> OverNoise:
    """Judge the residuals of a fit whose noise was stated, see chi_squared_over_noise(). Raises ArgumentError where it
    was not stated.

    >>> values = 3.0 + 0.4 * np.random.default_rng(1).normal(size=50)
    >>> e = gt.inference.linear_fit(np.ones((50, 1)), values, ["mean"], sigma=0.1)
    >>> judged = gt.inference.over_noise(e)
    >>> judged.passed, round(judged.ratio, 1), judged.bound
    (False, 3.6, 1.5)
    """
    if not estimate.known_noise:
        raise ArgumentError("the noise was not given, so that the residuals cannot be compared with it; give sigma")
    squares = float(np.sum(np.square(estimate.residuals)))
    return chi_squared_over_noise(squares, estimate.degrees_of_freedom, false_alarm=false_alarm, matters=matters)


def chi_squared_over_noise(
    chi_squared: float, degrees_of_freedom: float, *, false_alarm: float = FALSE_ALARM, matters: float = MATTERS
) -> OverNoise:
    """Judge a sum of squared residuals in units of a stated noise: is something in them that the model lacks?

    The bound on their rms is the larger of `matters` and of the ratio that noise alone exceeds with probability
    `false_alarm`: a noise that was stated as it is leaves a chi-squared sum of squares. The power: an error of three
    times the noise, of which the fit takes up no more than of the noise, leaves a noncentral sum, and passes so seldom:

    >>> from scipy import stats
    >>> for n in (3, 5, 10, 100):
    ...     bound = gt.inference.chi_squared_over_noise(n, n).bound
    ...     print(n, round(bound, 2), f"{stats.ncx2.cdf(n * bound**2, n, 9 * n):.0e}")
    3 2.33 8e-02
    5 2.03 6e-03
    10 1.72 2e-06
    100 1.5 3e-67
    """
    if not degrees_of_freedom > 0:
        return OverNoise(np.nan, np.inf, degrees_of_freedom, np.nan)
    chance = float(np.sqrt(chi_squared_bound(false_alarm, degrees_of_freedom) / degrees_of_freedom))
    ratio, p = np.sqrt(chi_squared / degrees_of_freedom), chi_squared_chance(chi_squared, degrees_of_freedom)
    return OverNoise(float(ratio), max(matters, chance), degrees_of_freedom, float(p))


def chance_ratio(
    numerator_freedom: float, denominator_freedom: float, *, tests: int = 1, false_alarm: float = FALSE_ALARM
) -> float:
    """Ratio of two rms errors of one size that chance exceeds with probability `false_alarm` in any of so many tests.

    Of independent normal errors with these degrees of freedom; infinite where one has none, and nothing can be judged.

    >>> few, many = (gt.inference.chance_ratio(n, n, tests=5) for n in (3.0, 100.0))
    >>> round(few, 1), round(many, 2)
    (20.4, 1.43)
    """
    if not (numerator_freedom > 0 and denominator_freedom > 0):
        return np.inf
    return float(np.sqrt(f_bound(false_alarm / tests, numerator_freedom, denominator_freedom)))


def held_out_ratio(
    ratio: float,
    growth: float,
    fitted_freedom: float,
    held_out_freedom: float,
    *,
    tests: int = 1,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> HeldOut:
    """Judge a ratio of rms errors, held out over fitted.

    Args:
        ratio: of the rms errors as they are.
        growth: ratio of the expected mean squares, held out over fitted, for a sound model: (1 + leverage held out) /
            (1 - leverage fitted). With p parameters, N fitted and as many alike held-out equations it is about
            (N + p) / (N - p).
        fitted_freedom, held_out_freedom: degrees of freedom of the two mean squares, the number of independent normal
            errors of one size whose mean square has the same relative spread; fewer where errors are coloured or of
            different sizes, see `freedom_of`.
        tests: how many such ratios are judged together, each getting its part of the false alarms.
        false_alarm: probability that a sound model fails any of them.
        matters: ratio below which nothing is reported, however certain it is.

    The fit and the errors it has not seen are independent, so that ratio^2 / growth has the F distribution; exact for
    linear models and white normal noise. With no degrees of freedom left the bound is infinite: nothing can be judged.

    >>> many = gt.inference.held_out_ratio(1.6, 1.1, 200.0, 200.0)
    >>> few = gt.inference.held_out_ratio(1.6, 1.1, 10.0, 10.0)
    >>> many.passed, few.passed, round(few.bound, 1)
    (False, True, 3.1)
    """
    if not (growth > 0 and np.isfinite(growth) and fitted_freedom > 0 and held_out_freedom > 0):
        return HeldOut(ratio, np.inf, np.inf, false_alarm)
    with np.errstate(over="ignore"):  # a bound beyond all numbers is infinite: nothing can be judged
        chance = float(np.sqrt(growth * f_bound(false_alarm / tests, held_out_freedom, fitted_freedom)))
    p = min(1.0, tests * float(f_chance(ratio**2 / growth, held_out_freedom, fitted_freedom)))
    return HeldOut(ratio, float(np.sqrt(growth)), max(matters, chance), false_alarm, p)


def freedom_of(trace: float, trace_of_square: float) -> float:
    """Effective degrees of freedom of the mean square of errors with covariance S: tr(S)^2 / tr(S^2).

    So many independent normal errors of one size have a mean square of the same relative spread.
    Source: Satterthwaite 1946, Biometrics Bulletin 2.

    >>> round(gt.inference.freedom_of(3.1, 3.01), 2)  # three errors of variance 1 and one of 0.1
    3.19
    """
    if not trace_of_square > 0:
        return 0.0
    # in units of a power of two: exact, and no square overflows
    mantissa, exponent = math.frexp(trace)
    return mantissa**2 / math.ldexp(trace_of_square, -2 * exponent)


@dataclass(frozen=True, eq=False)
class BetweenRecordings:
    """Parameters of which recordings give disjoint intervals, `apart`, of all `names` that were compared.

    `spread`: by name, the standard deviation [unit of the parameter] between recordings beyond what their own noise
    explains. `worst`: the name that is farthest apart in standard deviations, `pair` the two recordings.
    """

    names: tuple[str, ...]
    apart: tuple[str, ...]
    spread: dict[str, float]
    worst: str
    pair: tuple[str, str]
    intervals: tuple[tuple[float, float], tuple[float, float]]
    unit: str

    @property
    def message(self) -> str:
        ends = " and ".join(
            f"{low:.6g} to {high:.6g} in {name}"
            for name, (low, high) in zip(self.pair, self.intervals, strict=True)
        )  # fmt: skip
        return (
            f"recordings have disjoint 95 % intervals of {len(self.apart)} of {len(self.names)} parameters, most of "
            f"all {self.worst}: {ends}; between recordings it varies by {self.spread[self.worst]:.2g} {self.unit} "
            "beyond their noise: an interval describes its recordings, not the machine"
        )


def between_recordings(
    estimates: Mapping[str, Estimate], names: Sequence[str], *, false_alarm: float = FALSE_ALARM
) -> BetweenRecordings | None:
    """Compare the estimates of recordings, by name, parameter by parameter; None where they agree within their noise.

    Disjoint are 95 % intervals that do not meet, of values that lie farther apart than chance puts any two of them with
    probability `false_alarm`. What a recording does not determine is not compared. Raises ArgumentError for fewer than
    two recordings.

    >>> def recorded(rng, k):  # the mean of fifty values, which another day shifts
    ...     return gt.inference.linear_fit(np.ones((50, 1)), 3 + 0.5 * k + 0.1 * rng.normal(size=50), ["m"])
    >>> first, second = gt.inference.monte_carlo(recorded, 2, seed=1, processes=0).results
    >>> seen = gt.inference.between_recordings({"monday": first, "friday": second}, ["m"])
    >>> seen.apart, round(seen.spread["m"], 1)
    (('m',), 0.4)
    >>> gt.inference.between_recordings({"monday": first, "again": first}, ["m"]) is None
    True
    """
    if len(estimates) < 2:
        raise ArgumentError(f"expected two recordings or more; found {len(estimates)}", "estimates")
    pairs = list(combinations(estimates, 2))
    bound = half_width(1 - false_alarm / max(len(pairs) * len(names), 1))
    apart, spread, best = [], {}, (0.0, "", pairs[0])
    for name in names:
        known = {s: (e.value(name), float(e.std[e.names.index(name)]), e.interval(name)) for s, e in estimates.items()
                 if name in e.names and np.isfinite(e.std[e.names.index(name)])}  # fmt: skip
        if len(known) < 2:
            continue
        values, std, _ = (np.array(x) for x in zip(*known.values(), strict=True))
        spread[name] = float(np.sqrt(max(np.var(values, ddof=1) - np.mean(std**2), 0.0)))
        farthest = 0.0
        for a, b in pairs:
            if a not in known or b not in known:
                continue
            (x, sx, (low, high)), (y, sy, (least, most)) = known[a], known[b]
            z = abs(x - y) / max(float(np.hypot(sx, sy)), np.finfo(float).tiny)
            if z > bound and (high < least or most < low):
                farthest = max(farthest, z)
                best = max(best, (z, name, (a, b)))
        if farthest:
            apart.append(name)
    if not apart:
        return None
    _, worst, pair = best
    first, second = estimates[pair[0]], estimates[pair[1]]
    unit = first.units[first.names.index(worst)] if first.units else ""
    return BetweenRecordings(
        tuple(spread), tuple(apart), spread, worst, pair, (first.interval(worst), second.interval(worst)), unit or "1"
    )
