"""Whether poses that no fit saw are predicted as well as a sound model would predict them: held out, left out in turn,
or of a recording that has something of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..inference import FALSE_ALARM, HeldOut, freedom_of, held_out_ratio
from ..inference.covariance import spectrum
from ..inference.held_out import MATTERS
from ..inference.weighting import prior_rows
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from ..results.work import never
from .calibration import Calibration, calibrate, residual_level
from .measured.options import Refit
from .measurements import Correction, Measurements
from .options import Choice
from .positioning import closure_jacobians
from .problem import prepare
from .unknowns import TURN

ROUNDING = 1e-9  # of the held-out mean square: where fitted poses leave less, the fit has taken all noise
UNWEIGHTED = ("length", "squared")  # costs that count all residuals alike, whatever the noise of the pose is


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
    """Rms positioning error of the poses `kept`, held out, over that of the fitted ones, against chance.

    fitted, held_out: errors as of Calibration.positioning_errors(); rows of NaN are left out. At a held-out pose the
    errors of the parameters come on top of the noise of the pose; from a fitted one the fit has taken as much away.
    That holds to the first order, for noise of one covariance at all poses; its shape is that of the fitted errors, and
    its size cancels in the ratio. `correlated`: the number of poses that have about one error, where residuals are
    coloured. Where a pose does not follow from the equations alone, parameters are counted instead.

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
        left = np.trace(fit) / len(fit) > ROUNDING * np.trace(held) / len(held)
        growth = np.trace(held) / len(held) / (np.trace(fit) / len(fit)) if left else np.inf
        degrees_of_freedom = tuple(freedom_of(float(np.trace(S)), float(np.sum(S * S))) for S in (fit, held))
    return held_out_ratio(
        ratio, float(growth), *(n / correlated for n in degrees_of_freedom), false_alarm=false_alarm, matters=matters
    )  # fmt: skip


def pose_covariances(
    c: Calibration, kept: Measurements, fitted: Mapping[str, np.ndarray], signal: str
) -> tuple[np.ndarray, np.ndarray]:
    """Of all position errors at fitted poses (3 N, 3 N) and at held-out ones (3 M, 3 M), for pose noise of size one."""
    J, B, pose = closure_jacobians(c.problem, signal, c.x)
    K, Bk, _ = closure_jacobians(c.problem.on(kept), signal, c.x)
    own = [n for n in c.problem.reading.places if n != c.problem.actuators]
    if any(n not in fitted for n in own):
        raise ModelError(f"the errors of {', '.join(n for n in own if n not in fitted)} are not known")
    errors = np.hstack([fitted[n] for n in own])
    errors = errors[np.all(np.isfinite(errors), axis=1)]
    S = errors.T @ errors
    S /= np.trace(S)
    BS = B @ S
    # the fit's own weights, and how far its unknowns move by the noise of each pose
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
    # what was known before has errors of the sizes that were stated of it
    by_prior = inverse @ prior.T * noise
    C += by_prior @ by_prior.T
    first = c.problem.reading.places[signal]
    at = [pose.index(k) for k in range(first.start, first.stop)]
    moves, others = (-np.linalg.solve(b, j * u.sizes)[:, at] for b, j in ((B, J), (Bk, K)))
    P, H = moves.reshape(-1, len(u.names)), others.reshape(-1, len(u.names))
    own = S[np.ix_(at, at)]
    by_noise = np.concatenate([g @ S[:, at] for g in gain], axis=1)
    # model less measured: what the parameters move it by, less the noise
    cross = P @ by_noise
    fit = np.kron(np.eye(len(J)), own) - cross - cross.T + P @ C @ P.T
    return fit, np.kron(np.eye(len(K)), own) + H @ C @ H.T


def _priors(c: Calibration, B: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, float]:
    """Rows of the priors (k, n), as the fit weighs them beside its own, for unknowns in units of their sizes; and their
    noise, where that of a pose has the size one and the covariance S."""
    u, p = c.problem.unknowns, c.problem
    prior, _ = prior_rows(u.priors, u.names)
    if not len(prior):
        return prior, 0.0
    # of a residual, for pose noise of size one
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


PLACES = {"offset": ".offset", "scale": ".scale", "device": ".device.", "target": ".target."}  # in names of parameters


def of_its_own(m: Measurements, refit: Refit, actuators: str) -> Measurements:
    """The poses with corrections of the actuators that are refitted, also where the fit knows none."""
    wanted = {what: True for what in ("offset", "scale") if what in refit.what}
    if not wanted:
        return m
    there = next((c for c in m.corrections if c.signal == actuators), Correction(actuators))
    others = [c for c in m.corrections if c.signal != actuators]
    return replace(m, corrections=(*others, replace(there, **wanted)))


def refitted(c: Calibration, m: Measurements, refit: Refit) -> Calibration:
    """The calibrated robot with what other measurements have of their own, fitted on these poses; all else stays.

    Raises ArgumentError where they have nothing of that kind, and where these poses do not determine it."""
    own = of_its_own(m, refit, c.problem.actuators)
    ending = c.problem.reading.ending  # of the names of what these measurements have, among several
    values = c.values | {name.replace(ending, ""): v for name, v in c.values.items() if ending and ending in name}
    try:
        free = prepare(c.flat, own, Choice(free=[]), actuators=c.problem.actuators, values=values)
        kinds = {name: next((k for k, p in PLACES.items() if p in name), "") for name in free.reading.parameters.names}
        lacking = [k for k in refit.what if k not in kinds.values()]
        if lacking:
            raise ArgumentError(f"the measurements have no {lacking[0]} of their own to refit", "refit.what")
        still = [name.partition(TURN)[0] for name, kind in kinds.items() if kind not in refit.what]
        problem = prepare(
            c.flat, own, Choice(free=[], fixed=still), actuators=c.problem.actuators, values=values,
        )  # fmt: skip
        own_fit = calibrate(problem, cost=c.cost)
    except ModelError as error:
        raise ArgumentError(str(error), "refit") from error
    if own_fit.identifiability is not None and own_fit.identifiability.redundant:
        left = own_fit.identifiability
        raise ArgumentError(
            f"{len(m)} poses determine {left.rank} of {len(own_fit.x)} values that are refitted", "refit"
        )
    return own_fit
