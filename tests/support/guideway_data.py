"""Synthetic measurements of carts: no cart points of the thesis are published. Every draw has a seed and a noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UM = 1e-6
# Dressler 2012, Table 4.1 (mean of |e|) and Table 4.2 case 2 (along, across), D1, carts 1 to 3
MEAN = np.array([32, 77, 54]) * UM
ALONG = np.array([11, 58, 19]) * UM
ACROSS = np.array([28, 38, 47]) * UM
V = np.array([0.99752, -0.06598, -0.00544])
P0 = np.array([-3.08, -3.47, 0.67])
POINTS = 28  # as in measurement set 2, from -650 to 700 mm


@dataclass(frozen=True)
class Cart:
    """Synthetic cart points: q (n,), P (n, 3) and the true residuals along (n,) and across (n, 3)."""

    q: np.ndarray
    P: np.ndarray
    along: np.ndarray
    across: np.ndarray


def cart(
    number: int,
    seed: int,
    points: int = POINTS,
    noise: float = 2e-6,
    cyclic: tuple[float, float] = (0.0, 1.0),
    uneven: float = 0.0,
) -> Cart:
    """Points of cart 0, 1 or 2 with errors of the printed sizes, smooth along q.

    Args:
        seed: of all that is random.
        noise: standard deviation of each coordinate of the tracker [m].
        cyclic: amplitude and period [m] of a sine along the guideway, added.
        uneven: places shifted by up to this fraction of their distance.
    """
    rng = np.random.default_rng(seed)
    q = np.linspace(-0.65, 0.7, points)
    q = q + uneven * rng.uniform(-0.5, 0.5, points) * (q[1] - q[0])
    unit = V / np.linalg.norm(V)
    across_axes = np.linalg.svd(unit[None, :])[2][1:]
    curves = [_smooth(q, rng) for _ in range(3)]
    along = ALONG[number] * curves[0] / np.mean(np.abs(curves[0]))
    across = np.outer(curves[1], across_axes[0]) + np.outer(curves[2], across_axes[1])
    across *= ACROSS[number] / np.mean(np.linalg.norm(across, axis=1))
    along = along + cyclic[0] * np.sin(2 * np.pi * q / cyclic[1])
    P = P0 + np.outer(q, V) + np.outer(along, unit) + across + noise * rng.standard_normal((points, 3))
    return Cart(q, P, along, across)


def _smooth(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Some waves between a fifth and a half of the length, without constant and slope."""
    x = (q - q[0]) / np.ptp(q)
    wave = sum(rng.normal() * np.cos(2 * np.pi * k * x + rng.uniform(0, 6.28)) for k in (2, 3, 4, 5))
    return wave - np.polynomial.Polynomial.fit(x, wave, 1)(x)
