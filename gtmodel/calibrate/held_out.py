"""Whether held-out poses are predicted as well as a sound model would predict them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..inference import FALSE_ALARM, HeldOut, freedom_of, held_out_ratio
from ..inference.held_out import MATTERS
from ..inference.make_estimate import spectrum
from ..inference.weighting import prior_rows
from ..lang.source import ModelError
from .calibration import Calibration, residual_level
from .measurements import Measurements
from .positioning import closure_jacobians

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
