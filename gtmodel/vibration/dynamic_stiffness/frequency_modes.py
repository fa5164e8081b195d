"""Sums of second-order receptances: their values, Jacobian in log parameters, and a linear start."""

from __future__ import annotations

import numpy as np

ROUNDS = 6  # of the reweighted linear fit; it settles in three or does not settle
LEAST = 1e-3  # of the largest: the smallest compliance and damping that a start may have
# shares of log m, log c, log k in the logarithms of what follows from them, and what is added there
SHARES = {
    "m": (1.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0), "k": (0.0, 0.0, 1.0),
    "fn": (-0.5, 0.0, 0.5), "zeta": (-0.5, 1.0, -0.5),
}  # fmt: skip
ADDED = {"fn": -np.log(2 * np.pi), "zeta": -np.log(2.0)}


def receptance(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """H (n,) [m/N] at s (n,) [1/s] of modes with m (modes,) [kg], c [N.s/m], k [N/m] in parallel.

    Each mode is m x'' + c x' + k x = F, Cvitanic 2021, eq. (8); displacements add.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> H = gt.vibration.receptance(2j * np.pi * np.array([0.0, 19.5]), m, c, k)  # static, near resonance
    >>> (1e6 * np.abs(H)).round(2)  # um/N
    array([0.33, 2.04])
    """
    return parts(s, m, c, k).sum(axis=1)


def parts(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Receptance of each mode (n, modes)."""
    s = s[:, None]
    return 1 / (s * (m * s + c) + k)


def log_derivatives(s: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray) -> np.ndarray:
    """dH / d(log m, log c, log k) of every mode (n, 3 modes), mode by mode."""
    H2 = parts(s, m, c, k) ** 2
    s = s[:, None]
    return -np.stack([H2 * m * s**2, H2 * c * s, H2 * k], axis=2).reshape(len(s), -1)


def linear_start(s: np.ndarray, H: np.ndarray, modes: int, weights: np.ndarray) -> np.ndarray:
    """log (m, c, k) (3 modes,) from a linear fit of N(s) = H(s) D(s), rows weighted by |H|^2 and by 1 / |N| before.

    One mode: N is constant and D = m s^2 + c s + k, so that 1/H is linear in the parameters and the rows are weighted
    by |H|^2. Several: poles of D give frequency and damping, a nonnegative fit of H their compliances.
    Source: Sanathanan and Koerner 1963, IEEE Transactions on Automatic Control 8.

    Raises ValueError where the lines hold fewer oscillations than asked for.
    """
    from scipy.optimize import nnls

    scale, size = float(np.mean(np.abs(s))), float(np.abs(H).max())
    z, h = s / scale, H / size
    numerator = z[:, None] ** np.arange(2 * modes - 1)
    denominator = z[:, None] ** np.arange(2 * modes)
    D, ascending = np.ones(len(z)), np.ones(1)
    for _ in range(ROUNDS):
        row = weights / np.abs(D)
        # the highest power of D has the coefficient one
        A = np.hstack([numerator, -h[:, None] * denominator]) * row[:, None]
        b = h * z ** (2 * modes) * row
        coefficients = np.linalg.lstsq(np.vstack([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=None)[0]
        ascending = np.append(coefficients[2 * modes - 1 :], 1.0)
        D = np.abs(np.polyval(ascending[::-1], z))
        D = np.maximum(D, 1e-9 * D.max())
    poles = np.roots(ascending[::-1])
    poles = poles[poles.imag > 0]
    if len(poles) < modes:
        raise ValueError(f"the lines hold {len(poles)} oscillations; {modes} were asked for")
    omega, damping = np.abs(poles), np.maximum(np.abs(poles.real) / np.abs(poles), LEAST)
    shapes = 1 / (z[:, None] * (z[:, None] + 2 * damping * omega) + omega**2)
    rows = weights[:, None] * shapes
    share, _ = nnls(np.vstack([rows.real, rows.imag]), np.concatenate([(weights * h).real, (weights * h).imag]))
    share = np.maximum(share, LEAST * share.max())  # H = size * sum share / (...), z = s / scale
    m = 1 / (share * size * scale**2)
    theta = np.stack([m, 2 * damping * omega * scale * m, (omega * scale) ** 2 * m], axis=1)
    if not np.all(np.isfinite(theta)) or theta.min() <= 0:
        raise ValueError(f"no start with {modes} modes was found among the lines")
    return np.log(theta).ravel()
