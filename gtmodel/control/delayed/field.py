"""Gain limits over the poses of an arm: Gaussian processes of m, c, k over two joints, and what they leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..._lazy import hint
from ...results import ArgumentError
from .limit import gain_limit
from .loop import DelayedLoop
from .margins import margin_limit
from .options import GainMargins
from .plants import equivalent_plant
from .worst_case import recommended_gain

if TYPE_CHECKING:
    from ...vibration import GaussianProcess
else:
    GaussianProcess = hint("gtmodel.vibration", "GaussianProcess")

SCALES = (0.35, 0.6)  # rad, of joints 2 and 3: over which the printed poses spread
DRAWS = 400
QUANTITIES = ("m", "c", "k")
TABLE_STEP, TABLE_EDGE = 0.01, 1e-6  # of logarithms of frequency; how far beyond the draws the table goes
FEW = 400  # limits that are computed one by one


@dataclass(frozen=True, eq=False)
class GainField:
    """m, c and k of `equivalent_plant` over two joint angles [rad], each the exponential of a Gaussian process.

    directions: their names, such as "x" and "y". processes: (direction, quantity) -> process of the logarithm.
    synthetic: seed and noise of synthetic data.
    """

    directions: tuple[str, ...]
    processes: dict[tuple[str, str], GaussianProcess]
    synthetic: str | None = None

    def at(self, joints: ArrayLike, direction: str) -> tuple[np.ndarray, np.ndarray]:
        """Means and standard deviations (3, n) of log m, log c, log k at joints (n, 2) [rad]."""
        if direction not in self.directions:
            raise ArgumentError(f"there is no '{direction}'; there are {', '.join(self.directions)}", "direction")
        poses = np.atleast_2d(np.asarray(joints, float))
        rows = [self.processes[direction, q].predict(poses) for q in QUANTITIES]
        return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])


def fit_gain_field(
    joints: ArrayLike, m: ArrayLike, c: ArrayLike, k: ArrayLike, *, directions: Sequence[str] = ("x", "y"),
    scale: tuple[float, float] = SCALES, seed: int = 0, synthetic: str | None = None,
) -> GainField:  # fmt: skip
    """The field through measured m, c, k (n, d) at joints (n, 2) [rad], d directions (Cvitanic 2021, section 5.3.4).

    The processes of a direction share their lengths, found by marginal likelihood; seed: of their starts. Raises
    ArgumentError for shapes that do not fit, values that are not positive, and fewer than four different poses.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 1))) for size in (3.0, 57.7, 34200.0))
    >>> field = gt.control.delayed.fit_gain_field(joints, m, c, k, directions=["x"])
    >>> limits = gt.control.delayed.limits_over(field, np.deg2rad([[-40.0, 90.0]]), "x", cycle=0.004, delay=0.052)
    >>> limits.shape, bool(0.1 < np.median(limits) < 0.4)  # draws of the processes at each pose
    ((1, 400), True)
    """
    from ...vibration import KernelInputs, fit_gaussian_processes

    poses = np.atleast_2d(np.asarray(joints, float))
    values = [np.asarray(v, float) for v in (m, c, k)]
    if poses.ndim != 2 or poses.shape[1] != 2:
        raise ArgumentError(f"have the shape {poses.shape}; expected (n, 2)", "joints")
    processes = {}
    for q, v in zip(QUANTITIES, values, strict=True):
        if v.shape != (len(poses), len(directions)):
            raise ArgumentError(f"has the shape {v.shape}; expected {(len(poses), len(directions))}", q)
        if not np.all((v > 0) & np.isfinite(v)):
            row = int(np.argwhere(~((v > 0) & np.isfinite(v)))[0, 0])
            raise ArgumentError(f"is not a positive number at pose {row}", q)
    inputs = KernelInputs(scale, (False, False))
    for d, direction in enumerate(directions):
        logs = np.log(np.stack([v[:, d] for v in values]))
        try:
            fitted = fit_gaussian_processes(poses, logs, inputs, seed=seed)
        except ValueError as fault:
            raise ArgumentError(str(fault), "joints") from fault
        processes |= {(direction, q): g for q, g in zip(QUANTITIES, fitted, strict=True)}
    return GainField(tuple(directions), processes, synthetic)


def limits_over(
    field: GainField, joints: ArrayLike, direction: str, *, cycle: float, delay: float, draws: int = DRAWS,
    seed: int = 0, margins: GainMargins | None = None,
) -> np.ndarray:  # fmt: skip
    """Gain limits (n, draws) at joints (n, 2) [rad]: of draws of m, c and k from what the processes leave open. With
    `margins` they are the gains up to which these are kept (`margin_limit`).

    The same draws serve all poses, so that neighbours vary together. For a given frequency and damping ratio the limit
    is proportional to the mass: limits come from a table over these two, linear between its points: where
    two modes of the loop take turns it is up to a per cent off. Raises ArgumentError
    for a direction that is not there.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    >>> m, c, k = gt.control.delayed.true_plants(joints, gt.control.delayed.SyntheticCommands())
    >>> field = gt.control.delayed.fit_gain_field(joints, m, c, k)
    >>> limits = gt.control.delayed.limits_over(field, joints[:2], "y", cycle=0.004, delay=0.052, draws=100)
    >>> limits.shape
    (2, 100)
    """
    mean, std = field.at(joints, direction)
    free = np.random.default_rng(seed).standard_normal((3, 1, draws))
    log_m, log_c, log_k = mean[..., None] + std[..., None] * free
    log_w, log_zeta = (log_k - log_m) / 2, log_c - np.log(2) - (log_k + log_m) / 2
    return np.exp(log_m + _log_limit_of_one(log_w, log_zeta, cycle, delay, margins))


def recommended_over(limits: np.ndarray, step: float) -> np.ndarray:
    """`recommended_gain` (n,) of the least of limits (n, draws), of draws that each keep the margins.

    >>> gt.control.delayed.recommended_over(np.array([[0.021, 0.026], [0.05, 0.06]]), step=0.01)
    array([0.02, 0.05])
    """
    return np.array([recommended_gain(float(row.min()), step) for row in np.atleast_2d(limits)])


def _log_limit_of_one(
    log_w: np.ndarray, log_zeta: np.ndarray, cycle: float, delay: float, margins: GainMargins | None
) -> np.ndarray:
    """Logarithm of the limit of a mass of one."""

    def exact(w: float, zeta: float) -> float:
        plant = equivalent_plant(1.0, 2 * zeta * w, w**2, cycle)
        loop = DelayedLoop(plant, cycle, delay)
        return float(np.log(gain_limit(loop).gain if margins is None else margin_limit(loop, margins)))

    if log_w.size <= FEW:
        pairs = zip(np.exp(log_w).ravel().tolist(), np.exp(log_zeta).ravel().tolist(), strict=True)
        return np.array([exact(w, z) for w, z in pairs]).reshape(log_w.shape)
    axes = []
    for values, step in ((log_w, TABLE_STEP), (log_zeta, 5 * TABLE_STEP)):
        low, high = float(values.min()) - TABLE_EDGE, float(values.max()) + TABLE_EDGE
        axes.append(np.linspace(low, high, max(4, 2 + int((high - low) / step))))
    table = np.array([[exact(float(w), float(z)) for z in np.exp(axes[1])] for w in np.exp(axes[0])])
    between = scipy.interpolate.RegularGridInterpolator(axes, table, method="linear")
    return between(np.stack([log_w, log_zeta], axis=-1))
