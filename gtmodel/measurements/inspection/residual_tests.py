"""Tests of what a fit leaves: colour, drift, other columns, and outliers, each against its own deviation and a
threshold for how many there are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...inference.chance import f_chance, f_test
from ...inference.residuals import autocorrelation, shown_p
from ...results.suspicion import FIRST, Suspicion

LOOKED_AT = 0.5  # share of a group's degrees of freedom that outliers may take; more are no outliers
HIDDEN = 3  # so many deletions in a row that change nothing end the search
CHANCE = 0.5  # probability from which on a deletion changes nothing
MANY = 10  # groups; of fewer the noise does not say how alike it is
SURELY = 1e6  # degrees of freedom: noise as good as known
EXACT = 1e-9  # of a residual's deviation: a smaller one is fixed by the fit and says nothing


@dataclass(frozen=True, eq=False)
class Outliers:
    """p (n,): probability that any of n clean residuals lies as far off as this one, 1 for those not suspected;
    times (n,): its length in its own deviations, as the others of its group say it."""

    p: np.ndarray
    times: np.ndarray

    def beyond(self, level: float = FIRST) -> np.ndarray:
        """Indices of the outliers at this level, the most unlikely first, those of one p by their lengths."""
        far = np.flatnonzero(self.p <= level)
        return far[np.lexsort((far, -self.times[far], self.p[far]))]

    def suspicion(self, name: str, evidence: str, remedy: str) -> Suspicion:
        """Of the most unlikely of them."""
        return Suspicion(name, evidence, float(np.min(self.p, initial=1.0)), remedy)


def outliers(residuals: np.ndarray, basis: np.ndarray | None = None, groups: np.ndarray | None = None) -> Outliers:
    """Which residuals of a least-squares fit are no noise, by deleted residuals: each is judged by a fit without it.

    Args:
        residuals: (n,) or (n, k), k numbers each, such as u and v; divided by their deviations where these differ and
            are known but for a factor. Those that are not finite are left out.
        basis: orthonormal columns of the fit's Jacobian, (n, p) or (n, k, p), in the same units: they say how much of
            its own error each residual shows, and what deleting it does to the others. Without them a residual shows
            its whole error.
        groups: (n,) numbers of groups, each with a noise of its own, such as views or links; one if left out. Where
            there are MANY, the noise of each is also judged by how alike they are.

    A deleted residual has the F distribution with k and the rest of its group's degrees of freedom, for normal errors;
    the probability is that of any of the n (Bonferroni). The largest are deleted one by one and judged last to first,
    so that one does not hide another. Sources: Cook and Weisberg 1982, "Residuals and influence in regression",
    section 2.2; Rosner 1983, Technometrics 25; Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3 (1), section 6.2.

    >>> from gtmodel.measurements.inspection.residual_tests import outliers
    >>> x, e = np.linspace(0.0, 1.0, 30), np.random.default_rng(1).normal(size=30)  # synthetic: seed 1
    >>> e[[4, 20]] = 8.0, -7.0
    >>> U = np.linalg.qr(np.column_stack([np.ones(30), x]))[0]
    >>> outliers(e - U @ (U.T @ e), U).beyond(0.01)
    array([ 4, 20])
    """
    e = np.array(residuals, float)
    e = e.reshape(len(e), -1)
    n, k = e.shape
    U = np.zeros((n, k, 0)) if basis is None else np.asarray(basis, float).reshape(n, k, -1)
    group = np.zeros(n, int) if groups is None else np.unique(np.asarray(groups), return_inverse=True)[1].reshape(-1)
    every = int(group.max(initial=-1)) + 1
    M, left = np.eye(U.shape[2]), np.all(np.isfinite(e), axis=1)
    tests = max(int(left.sum()), 1)
    p, times = np.ones(n), np.zeros(n)
    own = np.eye(k) - np.einsum("nia,nja->nij", U, U)  # covariance of a residual, of noise of size 1
    spare = np.bincount(group[left], np.einsum("nii->n", own)[left], every)
    budget, taken = LOOKED_AT * spare, np.zeros(every)
    deletions: list[tuple[int, float]] = []
    first, square, shown = True, np.zeros(n), np.zeros(n, bool)
    while left.any():
        if first or U.shape[2]:  # without a basis a deletion moves no other residual
            shown, square = np.linalg.eigvalsh(own)[:, 0] > EXACT, np.zeros(n)
            at = left & shown
            square[at] = np.einsum("ni,ni->n", e[at], np.linalg.solve(own[at], e[at][:, :, None])[:, :, 0])
        known = left & shown
        total = np.bincount(group[left], np.sum(e[left] ** 2, axis=1), every)
        rest = spare[group] - k
        judged = known & (rest > 0) & (taken[group] + k <= budget[group])
        usual, weight = _alike(total, spare)
        worth, size = rest + weight, np.zeros(n)
        own_sum = np.maximum(total[group[judged]] - square[judged], 0.0)
        size[judged] = (own_sum + weight * usual) / worth[judged]
        with np.errstate(divide="ignore", invalid="ignore"):
            F = np.where(judged, np.nan_to_num(square / size / k, nan=0.0, posinf=np.inf), 0.0)
        if first:
            times, first = np.sqrt(F * k), False
        chance = np.minimum(tests * f_chance(F, k, np.maximum(worth, 1.0)), 1.0)
        worst = int(np.argmin(np.where(judged, chance, 2.0)))
        if not judged[worst]:
            break
        deletions.append((worst, float(chance[worst])))
        times[worst] = np.sqrt(F[worst] * k)
        if U.shape[2]:
            u, by = U[worst], np.linalg.inv(own[worst])
            moved = U @ M @ u.T  # (n, k, k)
            e = e + (moved @ by @ e[worst][:, None])[:, :, 0]
            own = own - moved @ by @ moved.transpose(0, 2, 1)
            M = M + M @ u.T @ by @ u @ M
        left[worst] = False
        spare[group[worst]] -= k
        taken[group[worst]] += k
        if len(deletions) > HIDDEN and min(chance for _, chance in deletions[-HIDDEN:]) > CHANCE:
            break
    least = np.ones(every)
    for worst, chance in reversed(deletions):  # what had to be deleted before another one showed is an outlier like it
        least[group[worst]] = p[worst] = min(least[group[worst]], chance)
    return Outliers(p, times)


def _alike(total: np.ndarray, spare: np.ndarray) -> tuple[float, float]:
    """The usual variance of groups with these sums of squares, and as how many degrees of freedom it counts in each:
    those of the scaled inverse chi-squared distribution that the variances come from, by the moments of their logs."""
    d, z = spare / 2, np.log(np.maximum(total, np.finfo(float).tiny) / np.maximum(spare, 1.0))
    used = (spare > 2) & (total > 0)
    if used.sum() < MANY:
        return 0.0, 0.0
    d, z = d[used], z[used]
    centred = z - scipy.special.digamma(d) + np.log(d)
    spread = float(np.var(centred, ddof=1) - np.mean(scipy.special.polygamma(1, d)))
    weight = min(SURELY, 1 + 2 / spread) if spread > 0 else SURELY  # trigamma(x) is 1 / (x - 1/2) nearly
    return float(np.exp(centred.mean() + scipy.special.digamma(weight / 2) - np.log(weight / 2))), weight


WIDER = 1.2  # slow residuals so many times as large as white ones: below, intervals are too narrow by less than matters
OCTAVES = 6  # of slow waves, 1, 2 to 3, 4 to 7, ... half periods over all rows
MOST_ROWS = 1024  # longer series are averaged over neighbours first, which slow waves survive
IN_SPAN = 1e-10  # of a column's square: what is left of it is rounding, it lies in the span of the others
TOO_FEW = "too few rows are left to test"


class Explained(NamedTuple):
    """F test of further columns: `F` for `more` and `rest` degrees of freedom, `p`, and what is moved by them (rows,
    channels); p is NaN where nothing can be tested."""

    F: float
    p: float
    more: int
    rest: int
    moved: np.ndarray


def explained_by(J: np.ndarray, r: np.ndarray, columns: np.ndarray, *, least: float = 0.0) -> Explained:
    """Whether further columns (rows, channels, k) beside those of J explain of r more than chance does.

    r may be the measured values too. `least` is the rms of r that is rounding: below it nothing is tested.

    >>> from gtmodel.measurements.inspection.residual_tests import explained_by
    >>> time = np.linspace(0.0, 1.0, 30)
    >>> noise = np.random.default_rng(1).normal(size=30)
    >>> for drift in (0.0, 3.0):
    ...     print(round(explained_by(np.ones((30, 1)), noise + drift * time, time[:, None]).p, 4))
    0.1559
    0.0001
    """
    r = np.asarray(r, float)
    shape, values = r.shape, r.reshape(-1)
    known = _orthonormal(np.asarray(J, float).reshape(values.size, -1))
    further = np.asarray(columns, float).reshape(values.size, -1)
    size = np.sum(further**2, axis=0)
    further = further[:, size > 0] / np.sqrt(size[size > 0])
    further = further - known @ (known.T @ further)
    further = further - known @ (known.T @ further)
    own = _orthonormal(further, of=1.0)
    left = values - known @ (known.T @ values)
    parts = own.T @ left
    more, rest = own.shape[1], values.size - known.shape[1] - own.shape[1]
    moved = (own @ parts).reshape(shape)
    if more < 1 or rest < 1 or not float(left @ left) > values.size * least**2:
        return Explained(np.nan, np.nan, more, rest, moved)
    after = left - own @ parts
    explained, unexplained = float(parts @ parts), float(after @ after)
    return Explained(*f_test(explained + unexplained, unexplained, more, rest), more, rest, moved)


def drifts(
    J: np.ndarray,
    r: np.ndarray,
    time: np.ndarray,
    remedy: str,
    *,
    name: str = "drift",
    unit: str = "",
    least: float = 0.0,
) -> Suspicion:
    """Whether what is measured moves with `time` (rows,) in a straight line, each channel by its own slope."""
    rows = _rows(r)
    t = np.asarray(time, float)
    span = float(np.ptp(t))
    line = (t - t.mean()) / (span or 1.0)
    test = explained_by(J, rows, line[:, None, None] * np.eye(rows.shape[1]), least=least)
    if np.isnan(test.p):
        return Suspicion(name, f"drift: {TOO_FEW}", np.nan, remedy)
    # the slope beside the other unknowns
    slopes = _beside(J, rows, line)
    size = float(np.linalg.norm(slopes))
    return Suspicion(
        name, f"the readings move by {size:.3g}{unit and f' {unit}'} over the recording ({shown_p(test.p)})", test.p,
        remedy,
    )  # fmt: skip


def coloured(J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "coloured", least: float = 0.0) -> Suspicion:
    """Whether slow residuals, in the order of the rows, are larger than white noise has them: intervals for white noise
    are then too narrow by up to the ratio. Cosines over all rows are tested by octaves, the strongest counts.

    `whiteness` of gtmodel.inference tests correlations at all lags of a long series; its p of 0.1 % comes by chance two
    to six times as often for 24 to 200 rows. This test keeps its level for any number, and beside many unknowns.

    >>> from gtmodel.measurements.inspection.residual_tests import coloured
    >>> noise = np.random.default_rng(1).normal(size=200)
    >>> walk = np.cumsum(noise) / 5
    >>> [bool(coloured(np.ones((200, 1)), r, "average fewer").p < 1e-3) for r in (noise, noise + walk)]
    [False, True]
    """
    rows = _rows(r)
    J, short = _averaged(np.asarray(J, float).reshape(*rows.shape, -1)), _averaged(rows)
    T, channels = short.shape
    at = np.pi * (np.arange(T) + 0.5) / T
    tests = []
    for octave in range(OCTAVES):
        if 2 ** (octave + 1) > T // 2:
            break
        waves = np.cos(at[:, None] * np.arange(2**octave, 2 ** (octave + 1)))
        columns = np.einsum("tk,cd->tckd", waves, np.eye(channels)).reshape(T, channels, -1)
        tests.append(explained_by(J, short, columns, least=least / np.sqrt(len(rows) / T)))
    tests = [t for t in tests if not np.isnan(t.p)]
    if not tests:
        return Suspicion(name, f"colour: {TOO_FEW}", np.nan, remedy)
    strongest = min(tests, key=lambda t: (t.p, -t.F))
    p, times = min(1.0, len(tests) * strongest.p), float(np.sqrt(strongest.F))
    neighbours = max((float(autocorrelation(x, 1)[1]) for x in rows.T), key=abs)
    return Suspicion(
        name,
        f"residuals are coloured: slow ones are {times:.3g} times as large as white noise has them, neighbours have a "
        f"correlation of {neighbours:.2g} ({shown_p(p)})",
        p if times > WIDER else 1.0,
        remedy,
    )


def one_far_off(
    J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "largest_residual", least: float = 0.0, base: int = 0
) -> Suspicion:
    """Whether one residual is larger than the others let it be, each in units of its own deviation (Student's, by a fit
    without it) and all counted. `base`: the number of the first row, for the sentence."""
    rows = _rows(r)
    Q = _orthonormal(np.asarray(J, float).reshape(rows.size, -1))
    values = rows.reshape(-1)
    rest, own = values.size - Q.shape[1], 1 - np.sum(Q**2, axis=1)
    total = float(values @ values)
    if rest < 2 or not total > values.size * least**2:
        return Suspicion(name, f"largest residual: {TOO_FEW}", np.nan, remedy)
    # a row that determines an unknown alone leaves nothing
    share = np.where(own > IN_SPAN, values**2 / np.maximum(own, IN_SPAN), 0.0)
    others = np.maximum(total - share, np.finfo(float).tiny * total) / (rest - 1)
    k = int(np.argmax(share / others))
    t = float(np.sqrt(share[k] / others[k]))
    p = min(1.0, values.size * float(f_chance(t**2, 1, rest - 1)))
    evidence = f"row {base + k // rows.shape[1]} is off by {t:.3g} deviations of the others ({shown_p(p)})"
    return Suspicion(name, evidence, p, remedy)


def _rows(r: np.ndarray) -> np.ndarray:
    r = np.asarray(r, float)
    return r[:, None] if r.ndim == 1 else r


def _orthonormal(A: np.ndarray, of: float | None = None) -> np.ndarray:
    """Orthonormal columns with the span of A, whose columns count in units of `of`, of their own size if left out."""
    size = np.linalg.norm(A, axis=0) if of is None else np.full(A.shape[1], of)
    A = A[:, size > 0] / size[size > 0]
    if not A.size:
        return np.zeros((len(A), 0))
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return U[:, s**2 > IN_SPAN]


def _beside(J: np.ndarray, rows: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Slope of each channel along a line (rows,), fitted together with the columns of J."""
    T, channels = rows.shape
    lines = (line[:, None, None] * np.eye(channels)).reshape(T * channels, channels)
    both = np.hstack([lines, _orthonormal(np.asarray(J, float).reshape(T * channels, -1))])
    return np.linalg.lstsq(both, rows.reshape(-1), rcond=None)[0][:channels]


def _averaged(rows: np.ndarray) -> np.ndarray:
    """Sums of equally many neighbours over the root of their number, at most MOST_ROWS: white noise stays so."""
    each = -(-len(rows) // MOST_ROWS)
    if each == 1:
        return rows
    whole = len(rows) // each * each
    return rows[:whole].reshape(len(rows) // each, each, *rows.shape[1:]).sum(axis=1) / np.sqrt(each)
