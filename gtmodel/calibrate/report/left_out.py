"""Errors of poses that are left out of the fit in turn: one by one, or in folds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...inference import FALSE_ALARM, HeldOut, freedom_of, held_out_ratio
from ...inference.held_out import MATTERS
from ...lang.source import ModelError
from ...results.refusal import ArgumentError
from ...results.work import never
from ..calibration import Calibration, calibrate
from ..held_out import pose_covariances
from ..measurements import Measurements


@dataclass(frozen=True, eq=False)
class PosesLeftOut:
    """`errors`: signal -> errors (N, k) of each pose by the fit on the poses outside its fold, as of
    Calibration.positioning_errors(), NaN where it does not close. `judged`: against those of the fit on all poses."""

    errors: dict[str, np.ndarray]
    folds: tuple[np.ndarray, ...]
    judged: HeldOut


def folds_of(poses: int, count: int | None = None, together: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
    """Indices of so many poses in folds: one pose each, or dealt in turn to `count` folds; groups stay `together`.

    Raises ArgumentError for fewer than two folds, and for more folds than poses or groups.

    >>> [f.tolist() for f in gt.calibrate.folds_of(5, 2, together=[np.array([0, 3])])]
    [[0, 2, 3], [1, 4]]
    """
    first = np.arange(poses)
    for group in together:
        first[group] = group[0]
    apart = list(dict.fromkeys(first.tolist()))
    number = len(apart) if count is None else count
    if not 2 <= number <= len(apart):
        raise ArgumentError(f"{number} folds of {len(apart)} poses; take from 2 to {len(apart)}", "folds")
    fold = {p: k % number for k, p in enumerate(apart)}
    which = np.array([fold[p] for p in first.tolist()])
    return [np.flatnonzero(which == k) for k in range(number)]


def leave_out(
    c: Calibration,
    folds: Sequence[np.ndarray] | None = None,
    signal: str = "T",
    *,
    loss: str = "linear",
    width: float = 1.0,
    limit: int = 100,
    correlated: int = 1,
    stop: Callable[[], bool] = never,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> PosesLeftOut:
    """Fit anew without each of the folds, one pose each by default, and predict it: nothing is linearised.

    Every refit begins at the start of the calibration's problem, so that it knows nothing of what is left out; `loss`,
    `width` and `limit` as of calibrate(). The ratio of the rms errors is judged as that of held-out poses, by the
    leverages of the refits; errors of neighbouring refits hang together, so that its bound is never too narrow. A pose
    whose refit does not end is lost. Raises ArgumentError for several measurements together, for folds that leave too
    few poses, and where `stop` says True.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2])
    >>> c = gt.calibrate.calibrate(robot, gt.calibrate.made_poses(robot, grid).measurements)
    >>> left = gt.calibrate.leave_out(c)
    >>> left.errors["T"].shape, len(left.folds), left.judged.passed
    ((12, 3), 12, True)
    """
    m, every = c.problem.measurements, np.arange(len(c.problem.measurements))
    if c.problem.beside:
        raise ArgumentError("poses are left out of one table of measurements; there are several", "method")
    chosen = tuple(folds_of(len(m)) if folds is None else folds)
    fitted = c.positioning_errors()
    errors = {n: np.full_like(e, np.nan) for n, e in fitted.items()}
    held, ends = np.zeros(2), []
    for fold in chosen:
        if stop():
            raise ArgumentError(f"stopped after {len(ends)} of {len(chosen)} refits", "stop")
        rest = m.part(np.setdiff1d(every, fold))
        try:
            again = calibrate(c.problem.on(rest), cost=c.cost, loss=loss, width=width, limit=limit, confidence=False)
        except (ModelError, ValueError) as error:
            raise ArgumentError(f"without {len(fold)} of {len(m)} poses: {error}", "folds") from error
        ends.append(again.status.ok)
        if not again.status.ok:
            continue
        kept = m.part(fold)
        for name, own in again.positioning_errors(kept).items():
            errors[name][fold] = own
        held += _moments(again, kept, fitted, signal)
    return PosesLeftOut(errors, chosen, _judged(c, fitted, errors, held, signal, correlated, false_alarm, matters))


def _moments(c: Calibration, kept: Measurements, fitted: dict[str, np.ndarray], signal: str) -> np.ndarray:
    """Trace of the covariance of held-out errors, and that of its square; not numbers where they are not known."""
    try:
        _, S = pose_covariances(c, kept, fitted, signal)
    except (ModelError, np.linalg.LinAlgError):
        return np.full(2, np.nan)
    return np.array([np.trace(S), np.sum(S * S)])


def _judged(
    c: Calibration, fitted: dict[str, np.ndarray], errors: dict[str, np.ndarray], held: np.ndarray, signal: str,
    correlated: int, false_alarm: float, matters: float,
) -> HeldOut:  # fmt: skip
    inside, outside = (e[signal][np.all(np.isfinite(e[signal]), axis=1)] for e in (fitted, errors))
    rms = [float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) if len(e) else np.nan for e in (inside, outside)]
    ratio = rms[1] / rms[0] if rms[0] > 0 and len(outside) else np.inf
    try:
        fit, _ = pose_covariances(c, c.problem.measurements.part([0]), fitted, signal)
    except (ModelError, np.linalg.LinAlgError):
        fit = np.full((1, 1), np.nan)
    if np.all(np.isfinite(held)) and np.all(np.isfinite(fit)) and len(outside):
        growth = (held[0] / outside.size) / (np.trace(fit) / len(fit))
        independent = freedom_of(float(np.trace(fit)), float(np.sum(fit * fit))), freedom_of(*held.tolist())
    else:  # parameters are counted instead
        n = len(inside) * max(len(c.problem.labels), 1)
        growth = (n / (n - len(c.x))) ** 2 if n > len(c.x) else np.inf
        independent = float(n - len(c.x)), float(outside.size)
    fitted_of, held_of = (f / correlated for f in independent)
    return held_out_ratio(ratio, float(growth), fitted_of, held_of, false_alarm=false_alarm, matters=matters)
