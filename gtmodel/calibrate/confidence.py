"""Confidence of calibrated unknowns: blocks put together, the noise of a pose shared by its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..inference import Identifiability, identifiability
from ..inference.losses import Loss
from ..inference.make_estimate import effective_parameters, moved_together, spectrum
from ..inference.nonlinear import Descent
from ..results.estimate import Estimate
from .blocks import Block
from .implicit import Adjustment
from .problem import CalibrationProblem, noise_covariance

PART = 1e-8  # of a null direction of length one in scaled units: smaller entries are rounding


@dataclass(frozen=True, eq=False)
class Fitted:
    """A block and where its iteration ended; P its prior rows, `sigma` what its residuals were divided by."""

    block: Block
    descent: Descent
    P: np.ndarray
    sigma: float
    adjustment: Adjustment | None


@dataclass(frozen=True, eq=False)
class _Share:
    """What one block adds: `gain` (N, k, n) moves of all unknowns per unit of its residuals, psi (N, k) these with the
    loss's derivative, `by_prior` (n, p) moves per unit of its priors, null directions (n, z), degrees of freedom."""

    gain: np.ndarray
    psi: np.ndarray
    by_prior: np.ndarray
    null: np.ndarray
    degrees_of_freedom: float
    notes: list[str]


def estimated(
    problem: CalibrationProblem, fits: Sequence[Fitted], loss: Loss, width: float, hold: bool
) -> tuple[Estimate, Identifiability]:
    """The Estimate of all unknowns and how well the data determine each.

    Where all measured signals have a stated noise, it is carried to the residuals of each pose and from there to the
    unknowns: right whatever weights the cost used. Else the residuals give their covariance within a pose, the same for
    all poses, which are independent. Raises ValueError for too few poses, and for what is not determined unless `hold`.
    """
    u = problem.unknowns
    N, n = len(problem.measurements), len(u.names)
    known = all(name in problem.measurements.noise for name in problem.reading.places)
    shares = [_share(problem, f, loss, width) for f in fits]
    notes = [s for share in shares for s in share.notes]
    if notes and not hold:
        raise ValueError("; ".join(notes))
    degrees_of_freedom, least = sum(s.degrees_of_freedom for s in shares), min(s.degrees_of_freedom for s in shares)
    psi = np.hstack([s.psi for s in shares])
    if least < 0 or (least == 0 and not known):
        raise ValueError(f"{psi.size} closure residuals for {n} unknowns; measure more poses, or fix some")
    gain = np.concatenate([s.gain for s in shares], axis=1)
    if known:
        S, B = noise_covariance(problem, "orthogonal"), np.concatenate([_by_noise(problem, f) for f in fits], axis=1)
        omega = B @ S @ B.transpose(0, 2, 1)
    else:
        # residuals of a row have lost the part of the degrees of freedom that its block's unknowns took
        part = np.concatenate([np.full(s.psi.shape[1], s.degrees_of_freedom / s.psi.shape[1]) for s in shares])
        omega = (psi.T @ psi / np.sqrt(np.outer(part, part)))[None]
    cov = np.einsum("kci,kcj->ij", gain, np.broadcast_to(omega, (N, *omega.shape[1:])) @ gain)
    by_prior = np.hstack([s.by_prior for s in shares])
    cov = cov + by_prior @ by_prior.T
    scaled = _scaled(problem, fits, omega, gain, cov, degrees_of_freedom) if known else psi
    noise = float(np.sqrt(np.sum(scaled**2) / degrees_of_freedom)) if degrees_of_freedom > 0 else 1.0
    null = np.hstack([s.null for s in shares])
    estimate = Estimate(
        u.names, np.concatenate([f.descent.x for f in fits])[_order(fits)], (cov + cov.T) / 2,
        degrees_of_freedom if known else least, noise, known, scaled.reshape(-1), (), units=u.units,
        notes=(*notes, *u.notes), null_space=null if null.shape[1] else np.zeros((0, 0)),
    )  # fmt: skip
    return estimate, _identified(problem, fits, 1.0 if known else noise, N)


def _share(problem: CalibrationProblem, f: Fitted, loss: Loss, width: float) -> _Share:
    u, d, columns = problem.unknowns, f.descent, f.block.columns
    N, n = len(problem.measurements), len(u.names)
    size, z = u.sizes[columns], (d.r / width) ** 2
    weighted = loss.weight(d.r, width)[:, None] * d.J * size
    s = spectrum(np.vstack([weighted, f.P * size]))
    sharp = float(np.mean(loss.slope(z) + 2 * z * loss.bend(z)) / np.mean(loss.slope(z)))
    inverse = s.inverse * np.outer(size, size) / sharp
    gain, null, by_prior = np.zeros((N, len(d.r) // N, n)), np.zeros((n, s.null.shape[1])), np.zeros((n, len(f.P)))
    gain[:, :, columns] = (d.J @ inverse).reshape(N, -1, len(columns))
    null[columns] = np.where(np.abs(s.null) > PART, s.null, 0.0) * size[:, None]
    by_prior[columns] = (f.P @ inverse).T
    degrees_of_freedom = len(d.r) - effective_parameters(weighted, s.inverse)
    if abs(degrees_of_freedom - round(degrees_of_freedom)) < 1e-6:  # a whole number but for rounding
        degrees_of_freedom = float(round(degrees_of_freedom))
    notes = moved_together(s.null, tuple(u.names[k] for k in columns))
    return _Share(gain, (d.r * loss.slope(z)).reshape(N, -1), by_prior, null, degrees_of_freedom, notes)


def _by_noise(problem: CalibrationProblem, f: Fitted) -> np.ndarray:
    """Jacobian of the block's residuals, as the cost has them, in the noise of all signals (N, k, ny)."""
    if f.adjustment is not None:
        return f.adjustment.by_noise(f.descent.x)
    return f.block.evaluate_all(problem.reading.data, f.descent.x)[2] / f.sigma


def _scaled(
    problem: CalibrationProblem,
    fits: Sequence[Fitted],
    omega: np.ndarray,
    gain: np.ndarray,
    cov: np.ndarray,
    degrees_of_freedom: float,
) -> np.ndarray:
    """Residuals (N, k) in units of their noise, such that their squares sum to `degrees_of_freedom` on average.

    What is left of noise e is e - J G'e: its expected squares are those of e less what the fit took, which differs from
    the number of unknowns where the cost does not weigh as the noise does.
    """
    N, n = len(problem.measurements), len(problem.unknowns.names)
    J = np.zeros_like(gain)
    at = 0
    for f in fits:
        rows = f.descent.J.reshape(N, -1, len(f.block.columns))
        J[:, at : at + rows.shape[1], f.block.columns] = rows
        at += rows.shape[1]
    size = np.sqrt(np.diagonal(omega, axis1=1, axis2=2))
    size = np.where(size > 0, size, 1.0)
    J, D = J / size[..., None], omega / (size[..., None] * size[:, None])
    G = gain * size[..., None]
    taken = np.broadcast_to(D, (N, *D.shape[1:])) @ G
    expected = N * J.shape[1] - 2 * float(np.sum(taken * J))
    expected += np.einsum("kin,nm,kim->", J, cov, J, optimize=True)
    r = np.hstack([f.descent.r.reshape(N, -1) for f in fits]) / size
    return r * np.sqrt(degrees_of_freedom / expected) if degrees_of_freedom > 0 and expected > 0 and n else r


def _order(fits: Sequence[Fitted]) -> np.ndarray:
    return np.argsort(np.concatenate([f.block.columns for f in fits]))


def _identified(problem: CalibrationProblem, fits: Sequence[Fitted], noise: float, poses: int) -> Identifiability:
    """By the triangles of the blocks: as much as all their rows."""
    u = problem.unknowns
    rows = []
    for f in fits:
        J = f.descent.J / noise if noise > 0 else f.descent.J
        J = np.asarray(np.linalg.qr(J, mode="r")) if len(J) > J.shape[1] else J
        full = np.zeros((len(J) + len(f.P), len(u.names)))
        full[:, f.block.columns] = np.vstack([J, f.P])
        rows.append(full)
    return identifiability(np.vstack(rows), u.names, scale=u.sizes, poses=poses, known_noise=noise > 0)
