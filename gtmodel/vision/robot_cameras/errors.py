"""Errors of positions against true ones that stand in another frame."""

from __future__ import annotations

import numpy as np

from ...calibrate.measured.column_checks import aligned


def aligned_errors(positions: np.ndarray, truth: np.ndarray, scale: bool = False) -> np.ndarray:
    """|error| (n,) [m] once rotation and shift, and a factor where `scale`, are fitted, as between two devices.

    Rows of `positions` (n, 3) [m] that are not finite have NaN; `truth` (n, 3) [m].

    >>> truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> shifted = truth + [0.3, 0.2, 0.1]
    >>> bool(gt.vision.robot_cameras.aligned_errors(shifted, truth).max() < 1e-12)
    True
    """
    good = np.all(np.isfinite(positions), axis=1)
    a, b = positions[good], truth[good]
    _, R, _ = aligned(a, b)
    da, db = (a - a.mean(axis=0)) @ R.T, b - b.mean(axis=0)
    s = float(np.vdot(da, db) / np.vdot(da, da)) if scale else 1.0
    out = np.full(len(positions), np.nan)
    out[good] = np.linalg.norm(s * da - db, axis=1)
    return out
