"""Test whether the readings of a device drift over the recording of a calibration."""

from __future__ import annotations

import numpy as np

from ...measurements.drift import DriftBasis
from ...results.suspicion import Suspicion
from ..calibration import Calibration
from ..measurements import Pose

KINDS = ("none", "linear", "temperature")
RANK = 1e-9  # least share of a covariance's trace: a smaller eigenvalue is rounding
OTHER = "measure the poses in random order, after the device has warmed up"


def device_drifts(c: Calibration, pose: Pose, noise: tuple[np.ndarray, np.ndarray] | None) -> list[Suspicion]:
    """Test residuals against the time and the temperature of each pose, if known.

    The regressors are the effect of a moved position on each length. noise: Jacobian and covariance (N, m, m) of the
    lengths; without it their covariance is that of the residuals. Nothing is tested if the position was measured only
    partially, or if several measurements were fitted together.
    """
    p, m = c.problem, c.problem.measurements
    time, kelvin = (m.values.get(f"{word}({pose.position})") for word in ("time", "temperature"))
    place = p.reading.places.get(pose.position)
    if time is None or place is None or p.implicit or p.beside or not len(c.x) or not np.ptp(np.asarray(time)) > 0:
        return []
    J, By, _ = p.all_jacobians("length", c.x)
    by, r = By[:, :, place], c.residuals
    C = noise[1] if noise is not None else r.T @ r / len(r)
    if not np.all(np.linalg.eigvalsh(C).T[0] > RANK * np.trace(C, axis1=-2, axis2=-1)):
        return []
    root = np.linalg.cholesky(C)
    J, by, r = np.linalg.solve(root, J), np.linalg.solve(root, by), np.linalg.solve(root, r[..., None])[..., 0]
    temperature = None if kelvin is None else np.asarray(kelvin).reshape(-1)
    basis = DriftBasis(pose.drift, np.asarray(time).reshape(-1), None, temperature)
    return basis.suspicions("device", "mm", J, r, key="measurements.drift", other=OTHER, kinds=KINDS, by=1e-3 * by)
