"""Are poses outside the fit predicted as well as a sound model would predict them? Held-out poses, cross-validation,
and recordings with specific parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..inference import FALSE_ALARM, HeldOut, freedom_of, held_out_ratio
from ..inference.covariance import spectrum
from ..inference.held_out import MATTERS
from ..inference.weighting import prior_rows
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from ..results.work import never
from ..workers.mapped import mapped
from .calibration import Calibration, calibrate, residual_level
from .measured.options import Refit
from .measurements import Correction, Measurements
from .options import Choice
from .positioning import closure_jacobians
from .problem import prepare
from .unknowns import TURN

ROUNDING = 1e-9  # of the held-out mean square: if fitted poses leave less, the fit has taken all noise
UNWEIGHTED = ("length", "squared")  # costs that weight all residuals equally, whatever the noise of the pose


def judge_held_out(
    c: Calibration,
    kept: Measurements,
    fitted: Mapping[str, np.ndarray],
    held_out: Mapping[str, np.ndarray],
    signal: str = "T",
    *,
    correlated: int = 1,
    false_alarm: float = FALSE_ALARM,
    matters: float = MATTERS,
) -> HeldOut:
    """Compare the rms positioning error of held-out poses `kept` with that of the fitted poses.

    fitted, held_out: errors as from Calibration.positioning_errors(); rows of NaN are left out. At a held-out pose the
    parameter errors add to the noise of the pose; at a fitted pose the fit has absorbed part of the noise. True to
    first order, for noise of one covariance at all poses; the fitted errors give its shape, and its size cancels in the
    ratio. `correlated`: number of poses with about the same error, if residuals are coloured. If the equations alone do
    not determine a pose, parameters are counted instead.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[4, 4, 3])
    >>> poses = gt.calibrate.made_poses(robot, grid).measurements
    >>> third = np.arange(len(poses)) % 3 == 2
    >>> c = gt.calibrate.calibrate(robot, poses.part(~third))
    >>> kept = poses.part(third)
    >>> judged = gt.calibrate.judge_held_out(c, kept, c.positioning_errors(), c.positioning_errors(kept))
    >>> bool(judged.ratio < judged.bound)
    True
    """
    inside, outside = (e[signal][np.all(np.isfinite(e[signal]), axis=1)] for e in (fitted, held_out))
    N, M = len(inside), len(outside)
    mean = float(np.mean(np.sum(inside**2, axis=1))) if N else 0.0
    ratio = float(np.sqrt(np.mean(np.sum(outside**2, axis=1)) / mean)) if mean > 0 and M else np.inf
    try:
        fit, held = pose_covariances(c, kept, fitted, signal)
    except (ModelError, np.linalg.LinAlgError):
        determined = len(c.x) if c.estimate is None else len(c.x) - c.estimate.null_space.shape[1]
        equations = N * max(len(c.problem.labels), 1)
        if c.problem.implicit and c.estimate is not None:  # of all measurements
            equations = c.estimate.degrees_of_freedom + determined
        growth = (equations + determined) / (equations - determined) if equations > determined else np.inf
        degrees_of_freedom = float(equations - determined), float(outside.size)
    else:
        noisy = np.trace(fit) / len(fit) > ROUNDING * np.trace(held) / len(held)
        growth = np.trace(held) / len(held) / (np.trace(fit) / len(fit)) if noisy else np.inf
        degrees_of_freedom = tuple(freedom_of(float(np.trace(S)), float(np.sum(S * S))) for S in (fit, held))
    return held_out_ratio(
        ratio, float(growth), *(n / correlated for n in degrees_of_freedom), false_alarm=false_alarm, matters=matters
    )  # fmt: skip


def pose_covariances(
    c: Calibration, kept: Measurements, fitted: Mapping[str, np.ndarray], signal: str
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of all position errors at fitted (3 N, 3 N) and held-out poses (3 M, 3 M), for unit pose noise."""
    J, B, pose = closure_jacobians(c.problem, signal, c.x)
    K, Bk, _ = closure_jacobians(c.problem.on(kept), signal, c.x)
    signals = [n for n in c.problem.reading.places if n != c.problem.actuators]
    if any(n not in fitted for n in signals):
        raise ModelError(f"the errors of {', '.join(n for n in signals if n not in fitted)} are not known")
    errors = np.hstack([fitted[n] for n in signals])
    errors = errors[np.all(np.isfinite(errors), axis=1)]
    S = errors.T @ errors
    S /= np.trace(S)
    BS = B @ S
    # weights of the fit, and how far its unknowns move with the noise of each pose
    W = np.broadcast_to(np.eye(B.shape[1]), B.shape)
    if c.cost not in UNWEIGHTED:
        W = np.linalg.inv(BS @ B.transpose(0, 2, 1))
    u = c.problem.unknowns
    scaled = J * u.sizes
    prior, noise = _priors(c, B, S)
    roots = np.linalg.cholesky(W).transpose(0, 2, 1)
    rows = np.vstack([(roots @ scaled).reshape(-1, len(u.names)), prior])
    inverse = spectrum(rows).inverse
    gain = -inverse @ (scaled.transpose(0, 2, 1) @ W @ B)
    C = np.einsum("kip,pq,kjq->ij", gain, S, gain)
    # priors have errors of their stated sizes
    by_prior = inverse @ prior.T * noise
    C += by_prior @ by_prior.T
    first = c.problem.reading.places[signal]
    columns = [pose.index(k) for k in range(first.start, first.stop)]
    moves, others = (-np.linalg.solve(b, j * u.sizes)[:, columns] for b, j in ((B, J), (Bk, K)))
    P, H = moves.reshape(-1, len(u.names)), others.reshape(-1, len(u.names))
    covariance = S[np.ix_(columns, columns)]
    by_noise = np.concatenate([g @ S[:, columns] for g in gain], axis=1)
    # model less measured: the move by the parameters, less the noise
    cross = P @ by_noise
    fit = np.kron(np.eye(len(J)), covariance) - cross - cross.T + P @ C @ P.T
    return fit, np.kron(np.eye(len(K)), covariance) + H @ C @ H.T


def _priors(c: Calibration, B: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, float]:
    """Rows of the priors (k, n) with their weight in the fit, for unknowns in units of their sizes, and their noise.

    Pose noise has the size one and the covariance S."""
    u, p = c.problem.unknowns, c.problem
    prior, _ = prior_rows(u.priors, u.names)
    if not len(prior):
        return prior, 0.0
    # size of a residual for unit pose noise
    unit = np.sqrt(np.mean(np.einsum("kip,pq,kiq->ki", B, S, B)))
    if all(n in p.measurements.noise for n in p.reading.places):
        level = np.ones(len(u.names))
        for b in p.blocks_of(c.cost):
            level[b.columns] = residual_level(p, b, c.x)
    else:
        r = c.residuals
        level = np.full(len(u.names), np.sqrt(np.mean(r**2) * r.size / max(r.size - len(c.x), 1)))
    size = float(np.sqrt(np.mean(level**2))) / unit
    if c.cost in UNWEIGHTED:
        return prior * u.sizes * level, unit
    return prior * u.sizes * size, 1.0


@dataclass(frozen=True, eq=False)
class PosesLeftOut:
    """`errors`: signal -> errors (N, k) of each pose predicted by the fit without its fold, as in
    Calibration.positioning_errors(), NaN if it does not close. `judged`: these against the errors of the full fit."""

    errors: dict[str, np.ndarray]
    folds: tuple[np.ndarray, ...]
    judged: HeldOut


def folds_of(poses: int, count: int | None = None, together: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
    """Return folds of pose indices: one pose each, or dealt to `count` folds; groups in `together` are not split.

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
    """Refit without each fold (one pose each by default) and predict it: cross-validation without linearisation.

    Every refit begins at the start values of the calibration's problem, so that it knows nothing of the left-out poses;
    `loss`, `width` and `limit` as in calibrate(). The ratio of the rms errors is judged as for held-out poses, with the
    leverages of the refits. Errors of neighbouring refits are correlated; the bound is therefore never too narrow.
    Poses whose refit fails get NaN. Raises ArgumentError for several measurements, if a fold leaves too few poses, and
    if `stop` returns True.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2])
    >>> c = gt.calibrate.calibrate(robot, gt.calibrate.made_poses(robot, grid).measurements)
    >>> left = gt.calibrate.leave_out(c)
    >>> left.errors["T"].shape, len(left.folds), left.judged.passed
    ((12, 3), 12, True)
    """
    m, every = c.problem.measurements, np.arange(len(c.problem.measurements))
    if c.problem.beside:
        raise ArgumentError("cross-validation takes one table of measurements; found several", "method")
    chosen = tuple(folds_of(len(m)) if folds is None else folds)
    fitted = c.positioning_errors()
    errors = {n: np.full_like(e, np.nan) for n, e in fitted.items()}
    moments = np.zeros(2)

    def without(fold: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
        rest, kept = m.part(np.setdiff1d(every, fold)), m.part(fold)
        try:
            result = calibrate(c.problem.on(rest), cost=c.cost, loss=loss, width=width, limit=limit, confidence=False)
        except (ModelError, ValueError) as error:
            raise ArgumentError(f"without {len(fold)} of {len(m)} poses: {error}", "folds") from error
        if not result.status.ok:
            return None
        return result.positioning_errors(kept), _moments(result, kept, fitted, signal)

    refits = mapped(without, chosen, waiting=stop)
    for n, fold in enumerate(chosen):
        if stop() or (refit := next(refits, _STOPPED)) is _STOPPED:
            raise ArgumentError(f"stopped after {n} of {len(chosen)} refits", "stop")
        if refit is None:
            continue
        for name, values in refit[0].items():
            errors[name][fold] = values
        moments += refit[1]
    return PosesLeftOut(errors, chosen, _judged(c, fitted, errors, moments, signal, correlated, false_alarm, matters))


def _moments(c: Calibration, kept: Measurements, fitted: dict[str, np.ndarray], signal: str) -> np.ndarray:
    """Trace of the covariance of held-out errors, and of its square; NaN if the covariance is not known."""
    try:
        _, S = pose_covariances(c, kept, fitted, signal)
    except (ModelError, np.linalg.LinAlgError):
        return np.full(2, np.nan)
    return np.array([np.trace(S), np.sum(S * S)])


def _judged(
    c: Calibration, fitted: dict[str, np.ndarray], errors: dict[str, np.ndarray], moments: np.ndarray, signal: str,
    correlated: int, false_alarm: float, matters: float,
) -> HeldOut:  # fmt: skip
    inside, outside = (e[signal][np.all(np.isfinite(e[signal]), axis=1)] for e in (fitted, errors))
    rms = [float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) if len(e) else np.nan for e in (inside, outside)]
    ratio = rms[1] / rms[0] if rms[0] > 0 and len(outside) else np.inf
    try:
        fit, _ = pose_covariances(c, c.problem.measurements.part([0]), fitted, signal)
    except (ModelError, np.linalg.LinAlgError):
        fit = np.full((1, 1), np.nan)
    if np.all(np.isfinite(moments)) and np.all(np.isfinite(fit)) and len(outside):
        growth = (moments[0] / outside.size) / (np.trace(fit) / len(fit))
        independent = freedom_of(float(np.trace(fit)), float(np.sum(fit * fit))), freedom_of(*moments.tolist())
    else:  # count parameters instead
        n = len(inside) * max(len(c.problem.labels), 1)
        growth = (n / (n - len(c.x))) ** 2 if n > len(c.x) else np.inf
        independent = float(n - len(c.x)), float(outside.size)
    fitted_of, held_of = (f / correlated for f in independent)
    return held_out_ratio(ratio, float(growth), fitted_of, held_of, false_alarm=false_alarm, matters=matters)


_STOPPED: Any = object()
PLACES = {"offset": ".offset", "scale": ".scale", "device": ".device.", "target": ".target."}  # in names of parameters


def of_its_own(m: Measurements, refit: Refit, actuators: str) -> Measurements:
    """Return the poses with the actuator corrections that are refitted, even if the fit has none."""
    flags: dict[str, Any] = {what: True for what in ("offset", "scale") if what in refit.what}
    if not flags:
        return m
    correction = next((c for c in m.corrections if c.signal == actuators), Correction(actuators))
    others = [c for c in m.corrections if c.signal != actuators]
    return replace(m, corrections=(*others, replace(correction, **flags)))


def refitted(c: Calibration, m: Measurements, refit: Refit) -> Calibration:
    """Return the calibrated robot with the parameters in `refit.what` fitted on these poses; all others stay fixed.

    Raises ArgumentError if the measurements have no such parameters, or if the poses do not determine them."""
    poses = of_its_own(m, refit, c.problem.actuators)
    ending = c.problem.reading.ending  # of parameter names of these measurements, if there are several
    values = c.values | {name.replace(ending, ""): v for name, v in c.values.items() if ending and ending in name}
    try:
        free = prepare(c.flat, poses, Choice(free=[]), actuators=c.problem.actuators, values=values)
        kinds = {name: next((k for k, p in PLACES.items() if p in name), "") for name in free.reading.parameters.names}
        lacking = [k for k in refit.what if k not in kinds.values()]
        if lacking:
            raise ArgumentError(f"the measurements have no parameter of kind '{lacking[0]}' to refit", "refit.what")
        fixed = [name.partition(TURN)[0] for name, kind in kinds.items() if kind not in refit.what]
        problem = prepare(
            c.flat, poses, Choice(free=[], fixed=fixed), actuators=c.problem.actuators, values=values,
        )  # fmt: skip
        result = calibrate(problem, cost=c.cost)
    except ModelError as error:
        raise ArgumentError(str(error), "refit") from error
    if result.identifiability is not None and result.identifiability.redundant:
        identified = result.identifiability
        raise ArgumentError(f"{len(m)} poses determine {identified.rank} of {len(result.x)} refitted values", "refit")
    return result
