"""Covariance of a least-squares estimate, for white and for coloured residuals."""

from __future__ import annotations

import numpy as np

from ..results.refusal import ArgumentError
from .residuals import autocorrelation, insignificant

# a correlation counted with both signs of the lag needs this many multiples of itself in the log to be averaged
LONGEST = 4


def white(J: np.ndarray, sigma2: float, *, scale: np.ndarray | None = None) -> np.ndarray:
    """sigma2 (J'J)^-1 (n, n) of whitened derivatives (rows, n); columns in units of `scale` while inverting."""
    n = J.shape[1]
    s = np.ones(n) if scale is None else np.abs(scale)
    R = np.linalg.qr(J * s, mode="r")
    inverse = np.linalg.inv(R)
    return sigma2 * (inverse @ inverse.T) * np.outer(s, s)


def automatic_lag(residuals: np.ndarray) -> int:
    """Bartlett bandwidth for residuals (T,) or (T, channels): the largest of the channels.

    Andrews' plug-in value for a first-order autoregression, 1.1447 (a T)^(1/3), a = 4 rho^2 / (1 - rho^2)^2, and not
    less than twice the lag at which the autocorrelation is last significant before it first is not.
    Source: Andrews 1991, Econometrica 59, eq. (6.2) and (6.4).
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
    """Sandwich covariance (n, n) with Bartlett weights: true under coloured and heteroscedastic residuals.

    J (T, n) with residuals (T,), or J (T, channels, n) with (T, channels) sampled together, in the order of time;
    `starts`: where recordings begin, across which nothing is correlated. `lags`: None for automatic_lag().
    Source: Newey and West 1987, Econometrica 55; with the factor T / (T - n) for few samples, and wider by what a
    bandwidth b = (lags + 1) / T that is no small share of the log costs: see fixed_b().
    """
    r = _channels(residuals)
    J = J.reshape(*r.shape, -1)
    T, _, n = J.shape
    L = automatic_lag(residuals) if lags is None else int(lags)
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
    return bread @ meat @ bread * total / (total - n) * wider**2


def fixed_b(b: float) -> float:
    """By how much wider than normal a 95 % interval must be when Bartlett's bandwidth is the share b of the samples.

    The sandwich is then itself uncertain, and too small on average; 1 for b = 0. Source: Kiefer and Vogelsang 2005,
    Econometric Theory 21, table 1, the quantile 97.5 % over the normal one.
    """
    return 1.0 + (2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3) / 1.9600


def correlation_time(residuals: np.ndarray) -> int:
    """Samples after which residuals (T,) or (T, channels) are as good as independent: 1 + 2 sum of the significant
    autocorrelations, rounded up, the largest of the channels."""
    longest = 1.0
    for r in _channels(residuals).T:
        last = insignificant(r)
        longest = max(longest, 1 + 2 * float(np.sum(autocorrelation(r, last)[1:])))
    return int(np.ceil(longest))


def decimated(J: np.ndarray, residuals: np.ndarray, *, every: int | None = None) -> np.ndarray:
    """Covariance (n, n) of a fit on every k-th sample only (default: the correlation time), taken as white.

    J (T, n), residuals (T,), or with channels as in newey_west(). Wider than need be, never too narrow.
    """
    r = _channels(residuals)
    k = correlation_time(residuals) if every is None else int(every)
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
    """Covariance (n, n) of the linearised fit when blocks of residuals are dealt out anew.

    J and residuals as in newey_west(). `block`: samples, default ten correlation times; blocks wrap round the end
    (circular block bootstrap, Politis and Romano 1992). The same seed gives the same result.
    """
    r = _channels(residuals)
    T, channels = r.shape
    n = J.shape[-1]
    length = min(T, 10 * correlation_time(residuals) if block is None else int(block))
    flat = J.reshape(-1, n)
    scale = _column_scale(flat)
    Q, R = np.linalg.qr(flat * scale)
    rng = np.random.default_rng(seed)
    centred = r - r.mean(axis=0)
    moves = np.empty((draws, n))
    for d in range(draws):
        begins = rng.integers(0, T, -(-T // length))
        order = (begins[:, None] + np.arange(length)).reshape(-1)[:T] % T
        moves[d] = np.linalg.solve(R, Q.T @ centred[order].reshape(T * channels)) * scale
    moves -= moves.mean(axis=0)
    return moves.T @ moves / (draws - 1) * r.size / (r.size - n)


def _channels(residuals: np.ndarray) -> np.ndarray:
    r = np.asarray(residuals, float)
    return r[:, None] if r.ndim == 1 else r


def _column_scale(J: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(J, axis=0)
    return 1 / np.where(norms > 0, norms, 1.0)
