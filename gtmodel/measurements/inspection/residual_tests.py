"""Tests of the residuals of a fit: colour, drift, further regressor columns, outliers; p-values allow for the number of
tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...inference.chance import f_chance, f_test
from ...inference.residuals import autocorrelation, shown_p
from ...results.suspicion import FIRST, Suspicion

LOOKED_AT = 0.5  # largest share of a group's degrees of freedom that outliers may take
HIDDEN = 3  # this number of successive insignificant deletions ends the search
CHANCE = 0.5  # probability from which a deletion counts as insignificant
MANY = 10  # least number of groups from which the distribution of their noise levels is estimated
SURELY = 1e6  # degrees of freedom of a noise level that is practically known
EXACT = 1e-9  # least variance of a residual over that of the noise; a smaller one is fixed by the fit


@dataclass(frozen=True, eq=False)
class Outliers:
    """p (n,): probability that any of n clean residuals is as large as this one, 1 for residuals not suspected;
    times (n,): length of the residual over its standard deviation, estimated from the others of its group."""

    p: np.ndarray
    times: np.ndarray

    def beyond(self, level: float = FIRST) -> np.ndarray:
        """Return the indices of the outliers at this level, by increasing p, then by decreasing length."""
        far = np.flatnonzero(self.p <= level)
        return far[np.lexsort((far, -self.times[far], self.p[far]))]

    def suspicion(self, name: str, evidence: str, remedy: str) -> Suspicion:
        """Return the suspicion of the most significant outlier."""
        return Suspicion(name, evidence, float(np.min(self.p, initial=1.0)), remedy)


def outliers(residuals: np.ndarray, basis: np.ndarray | None = None, groups: np.ndarray | None = None) -> Outliers:
    """Find outliers of a least-squares fit from deleted residuals: each residual is compared with a fit without it.

    Args:
        residuals: (n,) or (n, k), k numbers each, such as u and v; divided by their standard deviations, known up to a
            common factor, if these differ. Residuals that are not finite are ignored.
        basis: orthonormal basis of the columns of the fit's Jacobian, (n, p) or (n, k, p), in the same units. It gives
            the share of its own error that a residual shows, and the effect of a deletion on the others. Without it a
            residual shows its whole error.
        groups: (n,) numbers of groups with different noise levels, such as views or links; default: one group. From
            MANY groups on, the estimated level of each is shrunk towards the common one.

    For normal errors, a squared deleted residual has an F distribution with k degrees of freedom and those of the rest
    of its group; the p-value is that of any of n residuals (Bonferroni). The largest residuals are deleted one by one
    and tested from last to first, so that one outlier does not mask another. Sources: Cook and Weisberg 1982,
    "Residuals and influence in regression", section 2.2; Rosner 1983, Technometrics 25; Smyth 2004, Stat. Appl. Genet.
    Mol. Biol. 3 (1), section 6.2.

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
    M, remaining = np.eye(U.shape[2]), np.all(np.isfinite(e), axis=1)
    tests = max(int(remaining.sum()), 1)
    p, times = np.ones(n), np.zeros(n)
    covariance = np.eye(k) - np.einsum("nia,nja->nij", U, U)  # of each residual, for noise of variance 1
    spare = np.bincount(group[remaining], np.einsum("nii->n", covariance)[remaining], every)
    budget, deleted = LOOKED_AT * spare, np.zeros(every)
    deletions: list[tuple[int, float]] = []
    first, square, regular = True, np.zeros(n), np.zeros(n, bool)
    while remaining.any():
        if first or U.shape[2]:  # without a basis a deletion moves no other residual
            regular, square = np.linalg.eigvalsh(covariance)[:, 0] > EXACT, np.zeros(n)
            rows = remaining & regular
            scaled = np.linalg.solve(covariance[rows], e[rows][:, :, None])[:, :, 0]
            square[rows] = np.einsum("ni,ni->n", e[rows], scaled)
        total = np.bincount(group[remaining], np.sum(e[remaining] ** 2, axis=1), every)
        rest = spare[group] - k
        judged = remaining & regular & (rest > 0) & (deleted[group] + k <= budget[group])
        usual, weight = _alike(total, spare)
        degrees, size = rest + weight, np.zeros(n)
        others = np.maximum(_without(e, U, M, covariance, group, remaining, judged, total, square), 0.0)
        size[judged] = (others + weight * usual) / degrees[judged]
        with np.errstate(divide="ignore", invalid="ignore"):
            F = np.where(judged, np.nan_to_num(square / size / k, nan=0.0, posinf=np.inf), 0.0)
        if first:
            times, first = np.sqrt(F * k), False
        chance = np.minimum(tests * f_chance(F, k, np.maximum(degrees, 1.0)), 1.0)
        worst = int(np.argmin(np.where(judged, chance, 2.0)))
        if not judged[worst]:
            break
        deletions.append((worst, float(chance[worst])))
        times[worst] = np.sqrt(F[worst] * k)
        if U.shape[2]:
            u, inverse = U[worst], np.linalg.inv(covariance[worst])
            moved = U @ M @ u.T  # (n, k, k)
            e = e + (moved @ inverse @ e[worst][:, None])[:, :, 0]
            covariance = covariance - moved @ inverse @ moved.transpose(0, 2, 1)
            M = M + M @ u.T @ inverse @ u @ M
        remaining[worst] = False
        spare[group[worst]] -= k
        deleted[group[worst]] += k
        if len(deletions) > HIDDEN and min(chance for _, chance in deletions[-HIDDEN:]) > CHANCE:
            break
    least = np.ones(every)
    for worst, chance in reversed(deletions):  # a residual deleted before an outlier showed is an outlier, too
        least[group[worst]] = p[worst] = min(least[group[worst]], chance)
    return Outliers(p, times)


def _without(
    e: np.ndarray, U: np.ndarray, M: np.ndarray, covariance: np.ndarray, group: np.ndarray, remaining: np.ndarray,
    judged: np.ndarray, total: np.ndarray, square: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Sum of squares of each judged residual's group in a fit without it; `square`: its part of the sum of all groups.

    A deletion moves residuals of other groups too, by U a with a = M u' z and z the deleted residual."""
    if len(total) == 1 or not U.shape[2]:
        return total[group[judged]] - square[judged]
    z = np.linalg.solve(covariance[judged], e[judged][:, :, None])[:, :, 0]
    a, of = np.einsum("nka,nk->na", U[judged], z) @ M, group[judged]
    without = np.empty(len(a))
    for g in np.unique(of):
        rows, mine = U[remaining & (group == g)].reshape(-1, U.shape[2]), of == g
        along = rows.T @ e[remaining & (group == g)].reshape(-1)
        moved = 2 * a[mine] @ along + np.sum((a[mine] @ (rows.T @ rows)) * a[mine], axis=1)
        without[mine] = total[g] + moved - np.sum(z[mine] ** 2, axis=1)
    return without


def _alike(total: np.ndarray, spare: np.ndarray) -> tuple[float, float]:
    """Return the common variance of groups with these sums of squares, and its weight in degrees of freedom: parameters
    of a scaled inverse chi-squared prior, from the moments of the logarithms of the variances (Smyth 2004)."""
    d, z = spare / 2, np.log(np.maximum(total, np.finfo(float).tiny) / np.maximum(spare, 1.0))
    used = (spare > 2) & (total > 0)
    if used.sum() < MANY:
        return 0.0, 0.0
    d, z = d[used], z[used]
    centred = z - scipy.special.digamma(d) + np.log(d)
    spread = float(np.var(centred, ddof=1) - np.mean(scipy.special.polygamma(1, d)))
    weight = min(SURELY, 1 + 2 / spread) if spread > 0 else SURELY  # trigamma(x) is about 1 / (x - 1/2)
    return float(np.exp(centred.mean() + scipy.special.digamma(weight / 2) - np.log(weight / 2))), weight


WIDER = 1.2  # least ratio of slow residuals to white noise; below it the effect on the intervals is negligible
OCTAVES = 6  # octaves of slow waves: 1, 2 to 3, 4 to 7, ... half periods over all rows
MOST_ROWS = 1024  # longer series are averaged over neighbours first, which preserves slow waves
IN_SPAN = 1e-10  # share of a column's square; a smaller remainder is rounding, so the column lies in the span of others
TOO_FEW = "too few rows to test"


class Explained(NamedTuple):
    """F test of further columns: `F` with `more` and `rest` degrees of freedom, `p`, and the part of the data that the
    columns explain, `moved` (rows, channels). p is NaN if nothing can be tested."""

    F: float
    p: float
    more: int
    rest: int
    moved: np.ndarray


def explained_by(J: np.ndarray, r: np.ndarray, columns: np.ndarray, *, least: float = 0.0) -> Explained:
    """Test whether further columns (rows, channels, k), in addition to those of J, explain r better than chance.

    r may be residuals or measured values. `least` is the RMS of r below which it is rounding; then nothing is tested.

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
    basis = _orthonormal(further, unit=1.0)
    residuals = values - known @ (known.T @ values)
    parts = basis.T @ residuals
    more, rest = basis.shape[1], values.size - known.shape[1] - basis.shape[1]
    moved = (basis @ parts).reshape(shape)
    if more < 1 or rest < 1 or not float(residuals @ residuals) > values.size * least**2:
        return Explained(np.nan, np.nan, more, rest, moved)
    after = residuals - basis @ parts
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
    over: str = "the recording",
    rate: float = 0.0,
    by: np.ndarray | None = None,
    white: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Suspicion:
    """Test for a linear drift of the readings with `time` (rows,), with a slope for each channel; `over` names the
    range of `time`, which may be another condition, such as a temperature. rate: recordings in an hour, to say the
    drift in an hour, too. by: derivative (rows, channels, k) of the residuals by what drifts; by default the channels.
    white: whitens columns (rows, channels, k), if J and r are whitened.
    """
    rows = _rows(r)
    by = np.broadcast_to(np.eye(rows.shape[1]), (len(rows), rows.shape[1], rows.shape[1])) if by is None else by
    t = np.asarray(time, float)
    span = float(np.ptp(t))
    line = (t - t.mean()) / (span or 1.0)
    lines = line[:, None, None] * by
    lines = lines if white is None else white(lines)
    test = explained_by(J, rows, lines, least=least)
    if np.isnan(test.p):
        return Suspicion(name, f"drift: {TOO_FEW}", np.nan, remedy)
    size = float(np.linalg.norm(_factors(J, rows, lines)))
    said = f"{size:.3g}{unit and f' {unit}'} over {over}"
    said += f", {rate * size:.3g}{unit and f' {unit}'} per hour" if rate else ""
    return Suspicion(
        name, f"the readings drift by {said} ({shown_p(test.p)})", test.p,
        remedy,
    )  # fmt: skip


def coloured(J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "coloured", least: float = 0.0) -> Suspicion:
    """Test whether slow components of the residuals, in the order of the rows, are larger than those of white noise:
    intervals for white noise are then too narrow by up to this ratio. Cosines are tested by octaves; the largest F
    counts.

    `whiteness` of gtmodel.inference tests correlations at all lags of a long series; for 24 to 200 rows its p-value
    falls below 0.1 % by chance two to six times too often. This test keeps its level for any number of rows and
    unknowns.

    >>> from gtmodel.measurements.inspection.residual_tests import coloured
    >>> noise = np.random.default_rng(1).normal(size=200)
    >>> walk = np.cumsum(noise) / 5
    >>> [bool(coloured(np.ones((200, 1)), r, "average fewer").p < 1e-3) for r in (noise, noise + walk)]
    [False, True]
    """
    rows = _rows(r)
    J, short = _averaged(np.asarray(J, float).reshape(*rows.shape, -1)), _averaged(rows)
    T, channels = short.shape
    angle = np.pi * (np.arange(T) + 0.5) / T
    tests = []
    for octave in range(OCTAVES):
        if 2 ** (octave + 1) > T // 2:
            break
        waves = np.cos(angle[:, None] * np.arange(2**octave, 2 ** (octave + 1)))
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
        f"residuals are coloured: their slow components are {times:.3g} times as large as in white noise, the "
        f"correlation of neighbours is {neighbours:.2g} ({shown_p(p)})",
        p if times > WIDER else 1.0,
        remedy,
    )


def one_far_off(
    J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "largest_residual", least: float = 0.0, base: int = 0
) -> Suspicion:
    """Test whether the largest residual is an outlier: Student's t of the deleted residual, with the Bonferroni
    correction. `base`: number of the first row, for the message."""
    rows = _rows(r)
    Q = _orthonormal(np.asarray(J, float).reshape(rows.size, -1))
    values = rows.reshape(-1)
    rest, variance = values.size - Q.shape[1], 1 - np.sum(Q**2, axis=1)
    total = float(values @ values)
    if rest < 2 or not total > values.size * least**2:
        return Suspicion(name, f"largest residual: {TOO_FEW}", np.nan, remedy)
    # the residual of a row that alone determines an unknown is zero
    share = np.where(variance > IN_SPAN, values**2 / np.maximum(variance, IN_SPAN), 0.0)
    others = np.maximum(total - share, np.finfo(float).tiny * total) / (rest - 1)
    k = int(np.argmax(share / others))
    t = float(np.sqrt(share[k] / others[k]))
    p = min(1.0, values.size * float(f_chance(t**2, 1, rest - 1)))
    evidence = f"row {base + k // rows.shape[1]} is off by {t:.3g} standard deviations ({shown_p(p)})"
    return Suspicion(name, evidence, p, remedy)


def _rows(r: np.ndarray) -> np.ndarray:
    r = np.asarray(r, float)
    return r[:, None] if r.ndim == 1 else r


def _orthonormal(A: np.ndarray, unit: float | None = None) -> np.ndarray:
    """Return an orthonormal basis of the span of A; columns are scaled by `unit`, by default by their norms."""
    size = np.linalg.norm(A, axis=0) if unit is None else np.full(A.shape[1], unit)
    A = A[:, size > 0] / size[size > 0]
    if not A.size:
        return np.zeros((len(A), 0))
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return U[:, s**2 > IN_SPAN]


def _factors(J: np.ndarray, rows: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of columns (rows, channels, k), fitted together with those of J."""
    both = np.hstack([part.reshape(rows.size, -1) for part in (lines, np.asarray(J, float))])
    size = np.maximum(np.linalg.norm(both, axis=0), np.finfo(float).tiny)
    return (np.linalg.lstsq(both / size, rows.reshape(-1), rcond=IN_SPAN)[0] / size)[: lines.shape[-1]]


def _averaged(rows: np.ndarray) -> np.ndarray:
    """Sum groups of neighbours over the root of their number, to at most MOST_ROWS rows; keeps white noise white."""
    each = -(-len(rows) // MOST_ROWS)
    if each == 1:
        return rows
    whole = len(rows) // each * each
    return rows[:whole].reshape(len(rows) // each, each, *rows.shape[1:]).sum(axis=1) / np.sqrt(each)
