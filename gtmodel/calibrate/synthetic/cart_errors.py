"""Synthetic errors of the carts themselves: they tilt, and a reflector on each is measured in another set-up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from .guideway_errors import GuidewayError
from .options import Synthetic

REFLECTOR = np.array([0.03, 0.03, 0.03])  # m from the last joint of its cart; ours
MARGIN = 0.01  # m beyond the poses, as guideway errors are made
STREAM = 5  # of the seed's children


def tilts(s: Synthetic, curves: Sequence[GuidewayError]) -> list[GuidewayError]:
    """Small turns [rad] of each cart along its guideway, with the mean angle that is stated."""
    size = s.cart_tilt / np.sqrt(2.0)
    return [
        GuidewayError(c.direction, c.low, c.high, size, size, 0.0, 1.0, np.random.SeedSequence([s.seed, STREAM, i]))
        for i, c in enumerate(curves)
    ]


def levers(points: np.ndarray, rows: Sequence[int]) -> np.ndarray:
    """Joints (m, 3) [m] of a cart from its reflector."""
    return points[list(rows)] - points[rows[-1]] - REFLECTOR


def cart_points(
    s: Synthetic, number: int, points: np.ndarray, v: np.ndarray, rows: Sequence[Sequence[int]],
    curves: Sequence[GuidewayError], q: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:  # fmt: skip
    """Coordinates (n,) [m] over the range of the poses and, per cart, reflector positions (n, 3) [m] in a frame of
    their own, with the device's noise. The tool centre point keeps its place across the guideways: the load of the
    poses shifts no cart, another one that is stated does."""
    at = np.round(np.linspace(q[:, :3].min() - MARGIN, q[:, :3].max() + MARGIN, number), 7)
    R = Rotation.from_euler("ZYZ", s.cart_device_zyz)
    rng = np.random.default_rng(np.random.SeedSequence([s.seed, STREAM + 1]))
    sigma = np.broadcast_to(np.asarray(s.position_noise, float), 3)
    reflectors = []
    for i, (cart, curve) in enumerate(zip(rows, curves, strict=True)):
        k, size = cart[-1], s.cart_drift[i] / np.sqrt(2.0)
        seeds = np.random.SeedSequence([s.seed, STREAM + 2, i])
        drift = GuidewayError(curve.direction, curve.low, curve.high, size, size, 0.0, 1.0, seeds)
        world = points[k] + REFLECTOR + at[:, None] * v[k] + curve(at) + drift(at)
        reflectors.append(R.inv().apply(world - np.array(s.cart_device_t)) + sigma * rng.standard_normal(world.shape))
    return at, reflectors
