"""Errors of positions against true ones that stand in another frame."""

from __future__ import annotations

import numpy as np

from .starts import rigid


def aligned_errors(positions: np.ndarray, truth: np.ndarray, scale: bool = False) -> np.ndarray:
    """|error| (n,) [m] once rotation and shift, and a factor where `scale`, are fitted, as between two devices."""
    good = np.all(np.isfinite(positions), axis=1)
    a, b = positions[good], truth[good]
    R, _ = rigid(a, b)
    da, db = (a - a.mean(axis=0)) @ R.T, b - b.mean(axis=0)
    s = float(np.vdot(da, db) / np.vdot(da, da)) if scale else 1.0
    out = np.full(len(positions), np.nan)
    out[good] = np.linalg.norm(s * da - db, axis=1)
    return out
