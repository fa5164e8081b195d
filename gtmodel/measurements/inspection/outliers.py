"""Outliers of a fit: each residual against its own deviation, and a threshold for how many there are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...inference.chance import f_chance
from .suspicion import Suspicion

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

    def beyond(self, level: float) -> np.ndarray:
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

    >>> from gtmodel.measurements.inspection.outliers import outliers
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
