"""Tests of held-out against fitted errors, of residuals against stated noise, and of agreement between recordings of
the same machine."""

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

# probability that a sound model fails one test: small enough for an exit code in scripts
FALSE_ALARM = FIRST
# smallest relevant ratio: two halves of a recording or grid differ by some tenths if the model lacks a small effect,
# and the noise of a device is seldom known to better than 30 %; beyond 1.41 noise is less than half of the mean square
MATTERS = 1.5


class _Bounded(ABC):
    """A ratio with its bound; p: probability that a sound model has a ratio this large or larger."""

    ratio: float
    bound: float
    p: float

    @property
    @abstractmethod
    def extent(self) -> str:
        """The ratio in words."""

    @property
    def passed(self) -> bool:
        """Whether the ratio is within its bound; False for an infinite bound, where nothing can be tested."""
        return bool(np.isfinite(self.bound)) and self.ratio <= self.bound

    def check(self, advice: str) -> Check:
        """Return the check of the ratio against its bound."""
        return Check(self.ratio, self.bound if np.isfinite(self.bound) else None, advice, judged=self.passed)

    def suspicion(self, name: str, remedy: str) -> Suspicion:
        """Return the suspicion that the ratio is significantly and relevantly larger than for a sound model."""
        return Suspicion(name, self.extent, 1.0 if self.ratio <= MATTERS and np.isfinite(self.p) else self.p, remedy)


@dataclass(frozen=True)
class HeldOut(_Bounded):
    """Held-out over fitted rms error: `ratio`, its average for a sound model (`expected`), and the `bound`.

    The bound is the larger of 1.5 and the ratio that a sound model exceeds with probability `false_alarm`.
    """

    ratio: float  # pyrefly: ignore[bad-override]
    expected: float
    bound: float  # pyrefly: ignore[bad-override]
    false_alarm: float
    p: float = np.nan  # pyrefly: ignore[bad-override]

    @property
    def extent(self) -> str:
        """The ratio in words, without its possible causes."""
        return (
            f"held-out errors are {self.ratio:.3g} times the fitted ones; for a sound model it is {self.expected:.3g} "
            f"on average ({shown_p(self.p)})"
        )

    @property
    def message(self) -> str:
        if not np.isfinite(self.bound):
            return "as many parameters as equations were fitted: held-out errors cannot be compared with fitted ones"
        return (
            f"held-out errors are {self.ratio:.3g} times the fitted ones; for a sound model it is {self.expected:.3g} "
            f"on average, and above {self.bound:.3g} in at most {100 * self.false_alarm:g} % of the cases"
        )


@dataclass(frozen=True)
class OverNoise(_Bounded):
    """Rms residuals over the stated noise: `ratio`, and its `bound` for a sound model, see over_noise().

    p: probability that the stated noise gives residuals this large or larger.
    """

    ratio: float  # pyrefly: ignore[bad-override]
    bound: float  # pyrefly: ignore[bad-override]
    degrees_of_freedom: float
    p: float  # pyrefly: ignore[bad-override]

    @property
    def as_stated(self) -> bool:
        """Whether the residuals are neither larger nor smaller than the stated noise (two-sided test at 1 %)."""
        return SMALL_P / 2 <= self.p <= 1 - SMALL_P / 2

    @property
    def extent(self) -> str:
        """The ratio in words, without its possible causes."""
        if not np.isfinite(self.bound):
            return "as many parameters as equations were fitted: the residuals do not show the noise"
        details = f"{self.degrees_of_freedom:.4g} degrees of freedom, {shown_p(self.p)}"
        if self.as_stated:
            return f"residuals are as large as the stated noise ({self.ratio:.3g} times, {details})"
        size = f"residuals are {self.ratio:.3g} times the stated noise"
        if self.ratio < 1:
            return f"{size}: it was stated too large ({details})"
        if self.passed:
            return f"{size} ({details}): significant, but below the {self.bound:.3g} times that matter"
        return f"{size}; a sound model has at most {self.bound:.3g} times ({details})"

    @property
    def message(self) -> str:
        if self.as_stated or not self.ratio > 1 or not np.isfinite(self.bound):
            return self.extent
        return f"{self.extent}: the model lacks an effect, or the noise was stated too small"


def over_noise(estimate: Estimate, *, false_alarm: float = FALSE_ALARM, matters: float = MATTERS) -> OverNoise:
    """Test the residuals of a fit against its stated noise, see chi_squared_over_noise().

    Raises ArgumentError if the noise was not stated.

    >>> values = 3.0 + 0.4 * np.random.default_rng(1).normal(size=50)
    >>> e = gt.inference.linear_fit(np.ones((50, 1)), values, ["mean"], sigma=0.1)
    >>> judged = gt.inference.over_noise(e)
    >>> judged.passed, round(judged.ratio, 1), judged.bound
    (False, 3.6, 1.5)
    """
    if not estimate.known_noise:
        raise ArgumentError("the noise was not stated, so the residuals cannot be compared with it; give sigma")
    squares = float(np.sum(np.square(estimate.residuals)))
    return chi_squared_over_noise(squares, estimate.degrees_of_freedom, false_alarm=false_alarm, matters=matters)


def chi_squared_over_noise(
    chi_squared: float, degrees_of_freedom: float, *, false_alarm: float = FALSE_ALARM, matters: float = MATTERS
) -> OverNoise:
    """Test a sum of squared residuals in units of the stated noise for effects that the model lacks.

    For correctly stated noise the sum is chi-squared. The bound on the rms is the larger of `matters` and the ratio
    that noise alone exceeds with probability `false_alarm`. Power of the test: with a model error of three times the
    noise, of which the fit absorbs no larger share than of the noise, the sum is noncentral, and it passes with the
    probabilities in the last column:

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
    """Return the ratio of two rms errors of equal expectation that any of so many tests exceeds with probability
    `false_alarm` by chance.

    The errors are independent and normal, with these degrees of freedom; infinite if one has none, so that nothing can
    be tested.

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
    """Test a ratio of rms errors, held out over fitted.

    Args:
        ratio: measured ratio of the rms errors.
        growth: ratio of the expected mean squares, held out over fitted, for a sound model: (1 + leverage held out) /
            (1 - leverage fitted). With p parameters, N fitted and as many similar held-out equations it is about
            (N + p) / (N - p).
        fitted_freedom, held_out_freedom: degrees of freedom of the two mean squares: the number of independent normal
            errors of equal variance whose mean square has the same relative spread; fewer for coloured errors or
            different variances, see `freedom_of`.
        tests: number of ratios that are tested together; they share the false alarms.
        false_alarm: probability that a sound model fails any of them.
        matters: smaller ratios are not reported, even if they are significant.

    Fit and held-out errors are independent, so ratio^2 / growth has the F distribution; exact for linear models and
    white normal noise. Without degrees of freedom the bound is infinite: nothing can be tested.

    >>> many = gt.inference.held_out_ratio(1.6, 1.1, 200.0, 200.0)
    >>> few = gt.inference.held_out_ratio(1.6, 1.1, 10.0, 10.0)
    >>> many.passed, few.passed, round(few.bound, 1)
    (False, True, 3.1)
    """
    if not (growth > 0 and np.isfinite(growth) and fitted_freedom > 0 and held_out_freedom > 0):
        return HeldOut(ratio, np.inf, np.inf, false_alarm)
    with np.errstate(over="ignore"):  # a bound that overflows is infinite: nothing can be tested
        chance = float(np.sqrt(growth * f_bound(false_alarm / tests, held_out_freedom, fitted_freedom)))
    p = min(1.0, tests * float(f_chance(ratio**2 / growth, held_out_freedom, fitted_freedom)))
    return HeldOut(ratio, float(np.sqrt(growth)), max(matters, chance), false_alarm, p)


def freedom_of(trace: float, trace_of_square: float) -> float:
    """Return the effective degrees of freedom of the mean square of errors with covariance S: tr(S)^2 / tr(S^2).

    The mean square of so many independent normal errors of equal variance has the same relative spread.
    Source: Satterthwaite 1946, Biometrics Bulletin 2.

    >>> round(gt.inference.freedom_of(3.1, 3.01), 2)  # three errors of variance 1 and one of 0.1
    3.19
    """
    if not trace_of_square > 0:
        return 0.0
    # scaled by a power of two: exact, and no square overflows
    mantissa, exponent = math.frexp(trace)
    return mantissa**2 / math.ldexp(trace_of_square, -2 * exponent)


@dataclass(frozen=True, eq=False)
class BetweenRecordings:
    """Comparison of recordings. names: the compared parameters; apart: those with disjoint intervals.

    spread: by name, standard deviation between recordings beyond their own noise [unit of the parameter]. worst: the
    parameter with the largest difference in standard deviations; pair: the two recordings.
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
            f"recordings have disjoint 95 % intervals of {len(self.apart)} of {len(self.names)} parameters, the worst "
            f"is {self.worst}: {ends}; between recordings it varies by {self.spread[self.worst]:.2g} {self.unit} "
            "beyond their noise: an interval describes its recordings, not the machine"
        )


def between_recordings(
    estimates: Mapping[str, Estimate], names: Sequence[str], *, false_alarm: float = FALSE_ALARM
) -> BetweenRecordings | None:
    """Compare the estimates of recordings parameter by parameter; None if they agree within their noise.

    A parameter counts as apart if two 95 % intervals do not overlap and the difference of the values is larger than
    chance gives for any pair with probability `false_alarm`. Parameters that a recording does not determine are not
    compared. Raises ArgumentError for fewer than two recordings.

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
        raise ArgumentError(f"expected at least two recordings; found {len(estimates)}", "estimates")
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
