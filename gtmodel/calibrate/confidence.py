"""Confidence of calibrated unknowns: blocks put together, the noise of a pose shared by its links."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..inference import Identifiability, identifiability
from ..inference.losses import Loss
from ..inference.make_estimate import effective_parameters, moved_together, spectrum
from ..inference.nonlinear import Descent
from ..inference.normal_equations import triangle
from ..results.estimate import Estimate
from .block_rows import BlockRows, parts
from .problem import CalibrationProblem, noise_covariance

PART = 1e-8  # of a null direction of length one in scaled units: smaller entries are rounding


@dataclass(frozen=True, eq=False)
class Fitted:
    """Rows of a block, where the iteration ended, and P its prior rows."""

    rows: BlockRows
    descent: Descent
    P: np.ndarray


@dataclass(frozen=True, eq=False)
class _Share:
    """What one block adds, at the end of its iteration.

    Residuals r (N, k), and psi (N, k) with the loss's derivative; R (n, n) the triangle of its Jacobian J. With T (n,
    rank) the rows U = J T have length one or less altogether, and T U' moves the block's unknowns per unit of the
    residuals, over `sharp`; `by_prior` (rank, p) per unit of the priors, times T. Null directions (n, z).
    """

    r: np.ndarray
    psi: np.ndarray
    R: np.ndarray
    T: np.ndarray
    sharp: float
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
    if known:
        C, scaled = _by_stated_noise(problem, fits, shares, degrees_of_freedom)
    else:
        C, scaled = _by_residuals(fits, shares, psi), psi
    columns = [f.rows.block.columns for f in fits]
    T = _placed([s.T for s in shares], columns, n)
    cov = T @ C @ T.T
    noise = float(np.sqrt(np.sum(scaled**2) / degrees_of_freedom)) if degrees_of_freedom > 0 else 1.0
    null = _placed([s.null for s in shares], columns, n)
    estimate = Estimate(
        u.names, np.concatenate([f.descent.x for f in fits])[np.argsort(np.concatenate(columns))], (cov + cov.T) / 2,
        degrees_of_freedom if known else least, noise, known, scaled.reshape(-1), (), units=u.units,
        notes=(*notes, *u.notes), null_space=null if null.shape[1] else np.zeros((0, 0)),
    )  # fmt: skip
    return estimate, _identified(problem, fits, shares, 1.0 if known else noise, N)


def _share(problem: CalibrationProblem, f: Fitted, loss: Loss, width: float) -> _Share:
    u, columns = problem.unknowns, f.rows.block.columns
    N, size = len(problem.measurements), u.sizes[columns]
    residuals, R, weighted = [], np.zeros((0, 0)), np.zeros((0, 0))
    for A in f.rows(f.descent.x):
        residuals.append(A[:, -1].copy())
        R = triangle(R, A[:, :-1])
        if not loss.squares:
            weighted = triangle(weighted, A[:, :-1] * loss.weight(A[:, -1], width)[:, None])
    r = np.concatenate(residuals)
    data = (R if loss.squares else weighted) * size
    s = spectrum(np.vstack([data, f.P * size]))
    z = (r / width) ** 2
    slope = loss.slope(z)
    sharp = float(np.mean(slope + 2 * z * loss.bend(z)) / np.mean(slope))
    T = size[:, None] * s.V[:, : s.rank] / s.singular[: s.rank]
    degrees_of_freedom = len(r) - effective_parameters(data, s.inverse)
    if abs(degrees_of_freedom - round(degrees_of_freedom)) < 1e-6:  # a whole number but for rounding
        degrees_of_freedom = float(round(degrees_of_freedom))
    return _Share(
        r.reshape(N, -1), (r * slope).reshape(N, -1), R, T, sharp, (f.P @ T).T / sharp,
        np.where(np.abs(s.null) > PART, s.null, 0.0) * size[:, None], degrees_of_freedom,
        moved_together(s.null, tuple(u.names[k] for k in columns)),
    )  # fmt: skip


def _by_residuals(fits: Sequence[Fitted], shares: Sequence[_Share], psi: np.ndarray) -> np.ndarray:
    """Covariance of the moves, of all blocks' T, where the residuals say what the noise of a pose is."""
    # residuals of a row have lost the part of the degrees of freedom that its block's unknowns took
    part = np.concatenate([np.full(s.psi.shape[1], s.degrees_of_freedom / s.psi.shape[1]) for s in shares])
    omega = (psi.T @ psi / np.sqrt(np.outer(part, part)))[None]
    rows = _slices([s.psi.shape[1] for s in shares])
    sums = _Moments(shares)
    for pieces in zip(*(f.rows(f.descent.x) for f in fits), strict=True):
        U = sums.moved(pieces)
        sums.add(U, lambda a, b: omega[:, rows[a], rows[b]])
    return sums.covariance()


def _by_stated_noise(
    problem: CalibrationProblem, fits: Sequence[Fitted], shares: Sequence[_Share], degrees_of_freedom: float
) -> tuple[np.ndarray, np.ndarray]:
    """The same where the noise of all signals is stated, and the residuals (N, k) in units of their noise.

    Their squares sum to `degrees_of_freedom` on average: what is left of noise e is e - J G'e, whose expected squares
    are those of e less what the fit took, which differs from the number of unknowns where the cost does not weigh as
    the noise does.
    """
    S, N = noise_covariance(problem, "orthogonal"), len(problem.measurements)
    sums, taken = _Moments(shares), 0.0
    left = [np.zeros((s.T.shape[1],) * 2) for s in shares]  # sums of rows in units of their noise
    sizes = []
    for part, pieces in zip(parts(N), zip(*(f.rows.with_noise(f.descent.x) for f in fits), strict=True), strict=True):
        own = S if len(S) == 1 else S[part]
        B = [b for _, b in pieces]
        BS = [b @ own for b in B]
        U = sums.moved([A for A, _ in pieces])

        def omega(a: int, b: int, B: list[np.ndarray] = B, BS: list[np.ndarray] = BS) -> np.ndarray:
            return BS[a] @ B[b].transpose(0, 2, 1)

        sums.add(U, omega)
        for k, (V, s) in enumerate(zip(U, shares, strict=True)):
            covariance = omega(k, k)
            size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
            size = np.where(size > 0, size, 1.0)
            shared = V / size[..., None]
            taken += float(np.sum(shared * ((covariance @ V) / size[..., None]))) / s.sharp
            left[k] += (flat := shared.reshape(-1, shared.shape[2])).T @ flat
            sizes.append(size)
    C, rows = sums.covariance(), len(shares)
    size = np.hstack([np.concatenate(sizes[k::rows]) for k in range(rows)])
    expected = size.size - 2 * taken
    expected += sum(float(np.sum(C[w, w] * m)) for w, m in zip(sums.widths, left, strict=True))
    r = np.hstack([s.r for s in shares]) / size
    return C, r * np.sqrt(degrees_of_freedom / expected) if degrees_of_freedom > 0 and expected > 0 else r


class _Moments:
    """Sums over the poses of U' omega U, block by block, U (c, k, rank) = J T."""

    def __init__(self, shares: Sequence[_Share]) -> None:
        self.shares, self.widths = shares, _slices([s.T.shape[1] for s in shares])
        self.sum = np.zeros((sum(s.T.shape[1] for s in shares),) * 2)

    def moved(self, pieces: Sequence[np.ndarray]) -> list[np.ndarray]:
        """U of rows [J r] of each block."""
        return [(A[:, :-1] @ s.T).reshape(-1, s.r.shape[1], s.T.shape[1])
                for A, s in zip(pieces, self.shares, strict=True)]  # fmt: skip

    def add(self, U: Sequence[np.ndarray], omega: Callable[[int, int], np.ndarray]) -> None:
        """`omega` (c or 1, k, k) of two blocks: the covariance of their residuals within a pose."""
        for a in range(len(U)):
            for b in range(a, len(U)):
                right = omega(a, b) @ U[b]
                cross = U[a].reshape(-1, U[a].shape[2]).T @ right.reshape(-1, right.shape[2])
                self.sum[self.widths[a], self.widths[b]] += cross
                if a != b:
                    self.sum[self.widths[b], self.widths[a]] += cross.T

    def covariance(self) -> np.ndarray:
        """Of the moves, those of the priors with them."""
        sharp = np.concatenate([np.full(s.T.shape[1], s.sharp) for s in self.shares])
        C = self.sum / np.outer(sharp, sharp)
        for w, s in zip(self.widths, self.shares, strict=True):
            C[w, w] += s.by_prior @ s.by_prior.T
        return C


def _slices(lengths: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *lengths])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _placed(parts: Sequence[np.ndarray], columns: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Matrices (of a block's unknowns, any) side by side over all n unknowns."""
    whole = np.zeros((n, sum(p.shape[1] for p in parts)))
    for p, own, w in zip(parts, columns, _slices([p.shape[1] for p in parts]), strict=True):
        whole[own, w] = p
    return whole


def _identified(
    problem: CalibrationProblem, fits: Sequence[Fitted], shares: Sequence[_Share], noise: float, poses: int
) -> Identifiability:
    """By the triangles of the blocks: as much as all their rows."""
    u = problem.unknowns
    rows = []
    for f, s in zip(fits, shares, strict=True):
        J = s.R / noise if noise > 0 else s.R
        full = np.zeros((len(J) + len(f.P), len(u.names)))
        full[:, f.rows.block.columns] = np.vstack([J, f.P])
        rows.append(full)
    return identifiability(np.vstack(rows), u.names, scale=u.sizes, poses=poses, known_noise=noise > 0)
