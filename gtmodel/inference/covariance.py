"""Covariance of a least-squares estimate, for white and coloured residuals, and helpers to form an Estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError
from .residuals import autocorrelation, insignificant

# of the largest singular value of the scaled Jacobian: directions below are in the null space
RANK = 1e-9
NO_SIZE = 1e-6  # of the largest nominal value of the same unit: vendor files have six digits, so smaller ones are zero


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values and right vectors of a whitened, scaled Jacobian (priors included), split at the rank."""

    singular: np.ndarray
    V: np.ndarray
    rank: int

    @property
    def inverse(self) -> np.ndarray:
        """Pseudo-inverse of the information matrix of the scaled parameters (n, n)."""
        within = self.V[:, : self.rank] / self.singular[: self.rank]
        return within @ within.T

    @property
    def null(self) -> np.ndarray:
        return self.V[:, self.rank :]


def spectrum(scaled: np.ndarray, tolerance: float = RANK) -> Spectrum:
    """Spectrum of a Jacobian (rows, n) with scaled columns; the cost is linear in the rows (QR first)."""
    n = scaled.shape[1]
    R = np.linalg.qr(scaled, mode="r") if scaled.shape[0] > n else scaled
    _, s, Vt = np.linalg.svd(R, full_matrices=True)
    s = np.concatenate([s, np.zeros(n - len(s))])
    rank = int(np.count_nonzero(s > tolerance * s[0])) if n and s[0] > 0 else 0
    return Spectrum(s, Vt.T, rank)


def scales(values: np.ndarray | None, n: int, J: np.ndarray) -> np.ndarray:
    """Column scales (n,): `values`, or the inverse norm of the column if its value is missing or zero."""
    stated = np.zeros(n) if values is None else np.abs(np.asarray(values, float)).reshape(-1)
    if stated.shape != (n,) or not np.all(np.isfinite(stated)):
        raise ArgumentError(f"scale has the shape {stated.shape}; expected {n} finite numbers, one per parameter")
    norms = np.linalg.norm(J, axis=0) / np.sqrt(max(len(J), 1))
    # a zero column stays zero with any scale
    return np.where(stated > 0, stated, 1 / np.where(norms > 0, norms, 1.0))


def negligible(nominal: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Return a mask of the nominal values (p,) that are zero, or round-off compared with the largest of the same unit.

    >>> gt.inference.negligible(np.array([1.9, -2.9e-16, 0.05, 0.0]), ["kg m2"] * 4)
    array([False,  True, False,  True])
    """
    sizes = np.abs(np.asarray(nominal, float))
    largest = [max(x for x, u in zip(sizes, units, strict=True) if u == unit) for unit in units]
    return sizes <= NO_SIZE * np.array(largest)


def nominal_sizes(nominal: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Return sizes (p,) of parameters from nominal values, to scale columns for rank and condition.

    A negligible value is replaced by the smallest other one of the same unit, or by zero if there is none: the length
    of the column is used then.

    >>> from gtmodel.inference.covariance import nominal_sizes
    >>> nominal_sizes(np.array([1.9, -2.9e-16, 0.05, 0.0]), ["kg m2"] * 4)
    array([1.9 , 0.05, 0.05, 0.05])
    """
    sizes, without = np.abs(np.asarray(nominal, float)), negligible(nominal, units)
    for k in np.flatnonzero(without).tolist():
        alike = [x for x, unit, zero in zip(sizes, units, without, strict=True) if unit == units[k] and not zero]
        sizes[k] = min(alike, default=0.0)
    return sizes


def carried(T: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of T x, for x of covariance C (n, n).

    It uses a square root of C, so that variances are sums of squares. T @ C @ T.T may give a small negative number for
    a variance of zero.
    """
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh((C + C.T) / (2 * np.outer(size, size)))
    root = T @ (size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
    return root @ root.T


def freedom_left(rows: int, scaled_data: np.ndarray, inverse: np.ndarray) -> float:
    """Degrees of freedom of the residuals: the rows minus the trace of the hat matrix, which counts the parameters that
    the data, not the priors, determine."""
    dof = rows - float(np.sum((scaled_data @ inverse) * scaled_data))
    return float(round(dof)) if abs(dof - round(dof)) < 1e-6 else dof  # remove round-off


def moved_together(null: np.ndarray, names: tuple[str, ...], least: float = 0.05) -> list[str]:
    """One sentence per null direction of scaled parameters, with the parameters that it changes."""
    sentences = []
    for column in null.T:
        size = np.abs(column)
        involved = [n for n, w in zip(names, size, strict=True) if w > least * size.max()]
        if len(involved) == 1:
            sentences.append(f"the data do not determine {involved[0]}: no measurement depends on it")
        else:
            sentences.append(
                f"the data do not determine {listed(involved)} apart from each other: fix one, "
                "or measure something that depends on only one of them"
            )
    return sentences


def listed(names: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"; empty without names."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


# the longest bandwidth is the log over this number: a correlation needs several multiples of its lag to be averaged
LONGEST = 4


def white(J: np.ndarray, sigma2: float, *, scale: np.ndarray | None = None) -> np.ndarray:
    """Return the covariance sigma2 (J'J)^-1 (n, n) of a least-squares fit with independent residuals of equal variance.

    J (rows, n) is the Jacobian, its rows divided by their standard deviations; `sigma2` is the remaining variance, 1 if
    the noise is known. For the inversion, columns are in units of `scale` (n,), which only reduces round-off. Raises
    ArgumentError if columns are linearly dependent.

    >>> J = np.ones((100, 1))  # the mean of 100 values with a standard deviation of 2
    >>> np.sqrt(gt.inference.white(J, 2.0**2))
    array([[0.2]])
    """
    n = J.shape[1]
    s = np.ones(n) if scale is None else np.abs(scale)
    R = np.asarray(np.linalg.qr(J * s, mode="r"))
    _refuse_dependent(R, len(J))
    inverse = np.linalg.inv(R)
    return sigma2 * (inverse @ inverse.T) * np.outer(s, s)


def automatic_lag(residuals: np.ndarray) -> int:
    """Return the bandwidth in samples for the Bartlett weights of newey_west().

    Residuals are (T,), or (T, channels); the channel with the largest bandwidth decides.

    It is Andrews' plug-in value for a first-order autoregression, 1.1447 (a T)^(1/3), a = 4 rho^2 / (1 - rho^2)^2, and
    at least twice the last lag before the autocorrelation first becomes insignificant.
    Source: Andrews 1991, Econometrica 59, eq. (6.2) and (6.4).

    >>> noise = np.random.default_rng(1).normal(size=400)
    >>> gt.inference.automatic_lag(noise), gt.inference.automatic_lag(np.repeat(noise, 5))
    (4, 34)
    """
    lags = 0
    for r in _channels(residuals).T:
        rho = autocorrelation(r, 1)[1]
        a = 4 * rho**2 / max((1 - rho**2) ** 2, 1e-12)
        lags = max(lags, int(1.1447 * (a * len(r)) ** (1 / 3)), 2 * insignificant(r))
    return min(lags, len(residuals) // LONGEST)


def newey_west(
    J: np.ndarray, residuals: np.ndarray, *, lags: int | None = None, starts: tuple[int, ...] = (0,)
) -> np.ndarray:
    """Return the sandwich covariance (n, n) with Bartlett weights, valid for coloured and heteroscedastic residuals.

    J (T, n) is the Jacobian with residuals (T,), or J (T, channels, n) with residuals (T, channels) that are sampled
    together, in the order of time. `starts` are the rows where recordings start: recordings count as uncorrelated.
    `lags` is the bandwidth in samples, automatic_lag() if None.

    Source: Newey and West 1987, Econometrica 55. The covariance is multiplied by N / (N - n) for N residuals in total,
    and by the square of fixed_b() for the relative bandwidth b = (lags + 1) / T. Raises ArgumentError if there are no
    more residuals than parameters, or if columns are linearly dependent.

    >>> noise = np.repeat(np.random.default_rng(1).normal(size=100), 4)  # four equal neighbours each
    >>> J = np.ones((400, 1))  # the fitted parameter is a mean
    >>> coloured, white = gt.inference.newey_west(J, noise), gt.inference.white(J, noise.var())
    >>> round(float(np.sqrt(coloured / white)[0, 0]), 1)  # two are expected of a long series
    1.8
    """
    r = _channels(residuals)
    J = J.reshape(*r.shape, -1)
    T, _, n = J.shape
    _refuse_few(r.size, n)
    L = automatic_lag(residuals) if lags is None else _at_least(0, lags, "lags")
    scores = np.einsum("tcn,tc->tn", J, r)
    meat = scores.T @ scores
    ends = (*starts[1:], T)
    for low, high in zip(starts, ends, strict=True):
        part = scores[low:high]
        for k in range(1, min(L, len(part) - 1) + 1):
            cross = part[k:].T @ part[:-k]
            meat += (1 - k / (L + 1)) * (cross + cross.T)
    bread = white(J.reshape(-1, n), 1.0, scale=_column_scale(J.reshape(-1, n)))
    total = r.size
    wider = fixed_b((L + 1) / T) if L else 1.0
    return carried(bread, meat) * total / (total - n) * wider**2


def larger(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return a covariance (n, n) with the larger variance of each parameter in two, and the correlations of the first.

    A sandwich covariance is uncertain and, in short logs, too small on average; one for white noise of equal variance
    is too small if the noise is larger where a parameter matters most.
    Source: Angrist and Pischke 2009, Mostly Harmless Econometrics, section 8.1.

    >>> from gtmodel.inference.covariance import larger
    >>> larger(np.array([[1.0, 0.5], [0.5, 1.0]]), np.diag([4.0, 0.2]))
    array([[4., 1.],
           [1., 1.]])
    """
    own, other = np.diag(first), np.diag(second)
    factor = np.sqrt(np.where(own > 0, np.maximum(other / np.where(own > 0, own, 1.0), 1.0), 1.0))
    return first * np.outer(factor, factor)


def fixed_b(b: float) -> float:
    """Return the factor on a normal 95 % interval if the Bartlett bandwidth is the share b of the samples.

    For large b the sandwich covariance is uncertain itself, and too small on average. The factor is 1 for b = 0.
    Source: Kiefer and Vogelsang 2005, Econometric Theory 21, table 1: the quantile 97.5 % over the normal one.

    >>> round(gt.inference.fixed_b(0.1), 3)
    1.153
    """
    return 1.0 + (2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3) / 1.9600


def correlation_time(residuals: np.ndarray) -> int:
    """Return the number of samples after which residuals (T,) or (T, channels) are practically independent.

    It is 1 + 2 times the sum of the significant autocorrelations, rounded up, for the channel with the largest value.

    >>> noise = np.random.default_rng(2).normal(size=400)
    >>> gt.inference.correlation_time(noise), gt.inference.correlation_time(np.repeat(noise, 5))
    (1, 5)
    """
    longest = 1.0
    for r in _channels(residuals).T:
        last = insignificant(r)
        longest = max(longest, 1 + 2 * float(np.sum(autocorrelation(r, last)[1:])))
    return int(np.ceil(longest))


def decimated(J: np.ndarray, residuals: np.ndarray, *, every: int | None = None) -> np.ndarray:
    """Return the covariance (n, n) of a fit to every k-th sample, whose residuals are assumed to be independent.

    J (T, n) and residuals (T,), or with channels as in newey_west(). `every` is k, by default the correlation time.
    Intervals are wider than necessary for a fit to all samples. Raises ArgumentError if too few samples remain, or if
    columns are linearly dependent.

    >>> J, noise = np.ones((400, 1)), np.random.default_rng(1).normal(size=400)
    >>> every, fourth = (np.sqrt(gt.inference.decimated(J, noise, every=k)[0, 0]) for k in (1, 4))
    >>> round(float(fourth / every), 2)
    2.0
    """
    r = _channels(residuals)
    k = correlation_time(residuals) if every is None else _at_least(1, every, "every")
    n = J.shape[-1]
    rest = J.reshape(*r.shape, n)[::k].reshape(-1, n)
    if len(rest) <= n:
        raise ArgumentError(
            f"every {k}-th of {len(r)} samples leaves {len(rest)} rows for {n} parameters; measure longer"
        )
    degrees_of_freedom = r.size - n
    return white(rest, float(np.sum(r**2)) / degrees_of_freedom, scale=_column_scale(rest))


def block_bootstrap(
    J: np.ndarray, residuals: np.ndarray, *, seed: int, block: int | None = None, draws: int = 400
) -> np.ndarray:
    """Return the covariance (n, n) of the linearised fit over `draws` resampled series of residual blocks.

    J and residuals as in newey_west(). `block` is the length in samples, by default ten correlation times; blocks wrap
    around the end (circular block bootstrap, Politis and Romano 1992). The same seed gives the same result. Raises
    ArgumentError as newey_west() does, and for a block below one sample or fewer than two draws.

    >>> J, noise = np.ones((400, 1)), np.random.default_rng(1).normal(size=400)
    >>> std = np.sqrt(gt.inference.block_bootstrap(J, noise, seed=1, block=1)[0, 0])
    >>> round(float(std / noise.std()), 2)  # one over the root of 400
    0.05
    """
    r = _channels(residuals)
    T, channels = r.shape
    n = J.shape[-1]
    _refuse_few(r.size, n)
    _at_least(2, draws, "draws")
    length = min(T, 10 * correlation_time(residuals) if block is None else _at_least(1, block, "block"))
    flat = J.reshape(-1, n)
    scale = _column_scale(flat)
    Q, R = np.linalg.qr(flat * scale)
    _refuse_dependent(R, len(flat))
    rng = np.random.default_rng(seed)
    centred = r - r.mean(axis=0)
    moves = np.empty((draws, n))
    for d in range(draws):
        begins = rng.integers(0, T, -(-T // length))
        order = (begins[:, None] + np.arange(length)).reshape(-1)[:T] % T
        moves[d] = np.linalg.solve(R, Q.T @ centred[order].reshape(T * channels)) * scale
    moves -= moves.mean(axis=0)
    return moves.T @ moves / (draws - 1) * r.size / (r.size - n)


def _at_least(least: int, value: int, name: str) -> int:
    if int(value) < least:
        raise ArgumentError(f"expected a whole number, at least {least}; found {value}", name)
    return int(value)


def _refuse_few(residuals: int, n: int) -> None:
    if residuals <= n:
        raise ArgumentError(f"{residuals} residuals for {n} parameters do not determine the noise; measure more")


def _refuse_dependent(R: np.ndarray, rows: int) -> None:
    """Raise ArgumentError if the columns of a Jacobian of so many rows, with the QR factor R (n, n), are dependent."""
    s = np.linalg.svd(R * _column_scale(R), compute_uv=False)
    rank = int(np.count_nonzero(s > rows * np.finfo(float).eps * s[0])) if len(R) else 0
    if rank < R.shape[1]:
        raise ArgumentError(
            f"the columns of the Jacobian are linearly dependent: its rank is {rank} for {R.shape[1]} parameters; "
            "fix some of them"
        )


def _channels(residuals: np.ndarray) -> np.ndarray:
    r = np.asarray(residuals, float)
    return r[:, None] if r.ndim == 1 else r


def _column_scale(J: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(J, axis=0)
    return 1 / np.where(norms > 0, norms, 1.0)
