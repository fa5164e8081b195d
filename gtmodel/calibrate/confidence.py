"""Confidence of calibrated unknowns: blocks combined, with the noise of a pose common to its links."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..inference import Identifiability, identifiability
from ..inference.covariance import carried, freedom_left, moved_together, spectrum
from ..inference.descent import Descent
from ..inference.nonlinear import triangle
from ..inference.weighting import Loss
from ..results.estimate import Estimate
from .block_rows import JointRows, parts
from .problem import CalibrationProblem, noise_covariance

PART = 1e-8  # entries of a null direction of length one (scaled units) below this are rounding


@dataclass(frozen=True, eq=False)
class Fitted:
    """Rows of the blocks solved together, the end of the iteration, and the prior rows P."""

    rows: JointRows
    descent: Descent
    P: np.ndarray


@dataclass(frozen=True, eq=False)
class _Share:
    """Blocks solved together, at the end of their iteration.

    By member: residuals r (N, k), and psi (N, k), the residuals times the slope of the loss. R (n, n): triangle of the
    Jacobian J. The rows U = J T, T (n, rank), have length one or less in total; T U' / `sharp` moves the unknowns
    per unit of the residuals, and T `by_prior` (rank, p) per unit of the priors. `null`: null directions (n, z).
    """

    r: list[np.ndarray]
    psi: list[np.ndarray]
    R: np.ndarray
    T: np.ndarray
    sharp: float
    by_prior: np.ndarray
    null: np.ndarray
    degrees_of_freedom: float
    notes: list[str]


def estimated(
    problem: CalibrationProblem, fits: Sequence[Fitted], loss: Loss, width: float, hold: bool
) -> tuple[Estimate | None, Identifiability]:
    """Return the Estimate of all unknowns and how well the data determine each.

    If the noise of all signals is stated, it is propagated to the residuals of each pose and to the unknowns; this is
    right for any weights of the cost. Otherwise the residuals give their covariance within a pose, equal for all poses,
    which count as independent; with several measurements, whose residuals are in units of their noise, they give only
    its size. Without degrees of freedom there is no estimate. Raises ValueError for undetermined directions unless
    `hold`.
    """
    u = problem.unknowns
    n = len(u.names)
    known = all(name in p.measurements.noise for p in problem.parts for name in p.reading.places)
    shares = [_share(problem, f, loss, width) for f in fits]
    notes = [s for share in shares for s in share.notes]
    if notes and not hold:
        raise ValueError("; ".join(notes))
    degrees_of_freedom, least = sum(s.degrees_of_freedom for s in shares), min(s.degrees_of_freedom for s in shares)
    if least <= 0 and not known:
        return None, _identified(problem, fits, shares, 0.0)
    scaled, level = _side_by_side(problem, fits, [s.psi for s in shares]), 1.0
    if known:
        C, scaled, level = _by_stated_noise(problem, fits, shares, degrees_of_freedom)
    elif problem.beside:
        C = _by_size(shares, np.concatenate([r.reshape(-1) for r in scaled]), degrees_of_freedom)
    else:
        C = _by_residuals(fits, shares, scaled[0])
    columns = [f.rows.columns for f in fits]
    T = _placed([s.T for s in shares], columns, n)
    residuals = np.concatenate([r.reshape(-1) for r in scaled])
    noise = float(np.sqrt(np.sum(residuals**2) / degrees_of_freedom)) if degrees_of_freedom > 0 else 1.0
    null = _placed([s.null for s in shares], columns, n)
    estimate = Estimate(
        u.names, np.concatenate([f.descent.x for f in fits])[np.argsort(np.concatenate(columns))], carried(T, C),
        degrees_of_freedom if known else least, noise, known, residuals, (), units=u.units,
        notes=(*notes, *u.notes), null_space=null if null.shape[1] else np.zeros((0, 0)),
    )  # fmt: skip
    return estimate, _identified(problem, fits, shares, level if known else noise)


def _share(problem: CalibrationProblem, f: Fitted, loss: Loss, width: float) -> _Share:
    u, columns = problem.unknowns, f.rows.columns
    size = u.sizes[columns]
    residuals, R, weighted = [], np.zeros((0, 0)), np.zeros((0, 0))
    for k, part in enumerate(f.rows.parts):
        member = []
        for A in f.rows.of_member(k, f.descent.x):
            member.append(A[:, -1].copy())
            R = triangle(R, A[:, :-1])
            if not loss.squares:
                weighted = triangle(weighted, A[:, :-1] * loss.weight(A[:, -1], width)[:, None])
        residuals.append(np.concatenate(member).reshape(len(problem.parts[part].measurements), -1))
    r = np.concatenate([member.reshape(-1) for member in residuals])
    data = (R if loss.squares else weighted) * size
    s = spectrum(np.vstack([data, f.P * size]))
    z = (r / width) ** 2
    slope = loss.slope(z)
    sharp = float(np.mean(slope + 2 * z * loss.bend(z)) / np.mean(slope))
    T = size[:, None] * s.V[:, : s.rank] / s.singular[: s.rank]
    psi = [member * loss.slope((member / width) ** 2) for member in residuals]
    return _Share(
        residuals, psi, R, T, sharp, (f.P @ T).T / sharp,
        np.where(np.abs(s.null) > PART, s.null, 0.0) * size[:, None], freedom_left(len(r), data, s.inverse),
        moved_together(s.null, tuple(u.names[k] for k in columns)),
    )  # fmt: skip


def _members(fits: Sequence[Fitted], part: int) -> list[tuple[int, int]]:
    """Indices of the fits, and of their members, for one of the measurements."""
    return [(a, k) for a, f in enumerate(fits) for k, owner in enumerate(f.rows.parts) if owner == part]


def _side_by_side(
    problem: CalibrationProblem, fits: Sequence[Fitted], values: Sequence[list[np.ndarray]]
) -> list[np.ndarray]:
    """Residuals (N, k) of each of the measurements, with all its blocks side by side."""
    return [np.hstack([values[a][k] for a, k in _members(fits, p)] or [np.zeros((len(member.measurements), 0))])
            for p, member in enumerate(problem.parts)]  # fmt: skip


def _by_size(shares: Sequence[_Share], psi: np.ndarray, degrees_of_freedom: float) -> np.ndarray:
    """Covariance of the moves if residuals, in units of their noise, give only its size."""
    sums = _Moments(shares)
    size = float(psi @ psi) / degrees_of_freedom
    for w, s in zip(sums.widths, shares, strict=True):
        U = s.R @ s.T
        sums.sum[w, w] += size * (U.T @ U)
    return sums.covariance()


def _by_residuals(fits: Sequence[Fitted], shares: Sequence[_Share], psi: np.ndarray) -> np.ndarray:
    """Covariance of the moves (of all blocks' T) if the residuals give the noise of a pose."""
    # the block's unknowns took a part of the degrees of freedom of each row
    part = np.concatenate([np.full(s.psi[0].shape[1], s.degrees_of_freedom / s.psi[0].shape[1]) for s in shares])
    omega = (psi.T @ psi / np.sqrt(np.outer(part, part)))[None]
    rows = _slices([s.psi[0].shape[1] for s in shares])
    sums = _Moments(shares)
    for pieces in zip(*(f.rows(f.descent.x) for f in fits), strict=True):
        U = sums.moved(pieces, list(range(len(shares))), [s.r[0].shape[1] for s in shares])
        sums.add(U, list(range(len(shares))), lambda a, b: omega[:, rows[a], rows[b]])
    return sums.covariance()


def _by_stated_noise(
    problem: CalibrationProblem, fits: Sequence[Fitted], shares: Sequence[_Share], degrees_of_freedom: float
) -> tuple[np.ndarray, list[np.ndarray], float]:
    """Covariance of the moves if all noise is stated; residuals (N, k) per measurements in units of their noise; the
    rms of these units.

    The squares sum to `degrees_of_freedom` on average. Noise e leaves e - J G'e; its expected squares are those of e
    less what the fit took, which differs from the number of unknowns if the cost has other weights than the noise.
    """
    sums, absorbed = _Moments(shares), 0.0
    grams = [np.zeros((s.T.shape[1],) * 2) for s in shares]  # sums of rows in units of their noise
    whole: list[np.ndarray] = []
    for p, own_problem in enumerate(problem.parts):
        S, N = noise_covariance(own_problem, "orthogonal"), len(own_problem.measurements)
        members = _members(fits, p)
        owners = [a for a, _ in members]
        sizes = []
        each = (fits[a].rows.with_noise(k, fits[a].descent.x) for a, k in members)
        for part, pieces in zip(parts(N), zip(*each, strict=True), strict=bool(members)):
            covariances = S if len(S) == 1 else S[part]
            B = [b for _, b in pieces]
            BS = [b @ covariances for b in B]
            U = sums.moved([A for A, _ in pieces], owners, [b.shape[1] for b in B])

            def omega(a: int, b: int, B: list[np.ndarray] = B, BS: list[np.ndarray] = BS) -> np.ndarray:
                return BS[a] @ B[b].transpose(0, 2, 1)

            sums.add(U, owners, omega)
            for k, (V, a) in enumerate(zip(U, owners, strict=True)):
                covariance = omega(k, k)
                size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
                size = np.where(size > 0, size, 1.0)
                shared = V / size[..., None]
                absorbed += float(np.sum(shared * ((covariance @ V) / size[..., None]))) / shares[a].sharp
                grams[a] += (flat := shared.reshape(-1, shared.shape[2])).T @ flat
                sizes.append(size)
        rows = len(members)
        whole.append(np.hstack([np.concatenate(sizes[k::rows]) for k in range(rows)]) if rows else np.zeros((N, 0)))
    C = sums.covariance()
    expected = sum(size.size for size in whole) - 2 * absorbed
    expected += sum(float(np.sum(C[w, w] * m)) for w, m in zip(sums.widths, grams, strict=True))
    raw = _side_by_side(problem, fits, [s.r for s in shares])
    scaled = [r / size for r, size in zip(raw, whole, strict=True)]
    if degrees_of_freedom > 0 and expected > 0:
        scaled = [r * np.sqrt(degrees_of_freedom / expected) for r in scaled]
    every = np.concatenate([size.reshape(-1) for size in whole])
    return C, scaled, float(np.sqrt(np.mean(every**2)))


class _Moments:
    """Sums over the poses of U' omega U, block by block, with U (c, k, rank) = J T."""

    def __init__(self, shares: Sequence[_Share]) -> None:
        self.shares, self.widths = shares, _slices([s.T.shape[1] for s in shares])
        self.sum = np.zeros((sum(s.T.shape[1] for s in shares),) * 2)

    def moved(self, pieces: Sequence[np.ndarray], owners: Sequence[int], rows: Sequence[int]) -> list[np.ndarray]:
        """U of rows [J r] of blocks; `of`: the share of each block, `rows`: its rows per pose."""
        return [(A[:, :-1] @ self.shares[a].T).reshape(-1, k, self.shares[a].T.shape[1])
                for A, a, k in zip(pieces, owners, rows, strict=True)]  # fmt: skip

    def add(self, U: Sequence[np.ndarray], owners: Sequence[int], omega: Callable[[int, int], np.ndarray]) -> None:
        """Add the poses; `omega` (c or 1, k, k) is the covariance of two blocks' residuals within a pose."""
        for a in range(len(U)):
            for b in range(a, len(U)):
                right = omega(a, b) @ U[b]
                cross = U[a].reshape(-1, U[a].shape[2]).T @ right.reshape(-1, right.shape[2])
                self.sum[self.widths[owners[a]], self.widths[owners[b]]] += cross
                if a != b:
                    self.sum[self.widths[owners[b]], self.widths[owners[a]]] += cross.T

    def covariance(self) -> np.ndarray:
        """Covariance of the moves, including the priors."""
        sharp = np.concatenate([np.full(s.T.shape[1], s.sharp) for s in self.shares])
        C = self.sum / np.outer(sharp, sharp)
        for w, s in zip(self.widths, self.shares, strict=True):
            C[w, w] += s.by_prior @ s.by_prior.T
        return C


def _slices(lengths: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *lengths])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _placed(parts: Sequence[np.ndarray], columns: Sequence[np.ndarray], n: int) -> np.ndarray:
    """Matrices (unknowns of a block, any) side by side over all n unknowns."""
    whole = np.zeros((n, sum(p.shape[1] for p in parts)))
    for p, rows, w in zip(parts, columns, _slices([p.shape[1] for p in parts]), strict=True):
        whole[rows, w] = p
    return whole


def _identified(
    problem: CalibrationProblem, fits: Sequence[Fitted], shares: Sequence[_Share], noise: float
) -> Identifiability:
    """Return the identifiability from the triangular factors of the blocks, which are equivalent to all rows."""
    u = problem.unknowns
    poses = sum(len(p.measurements) for p in problem.parts)
    rows = []
    for f, s in zip(fits, shares, strict=True):
        J = s.R / noise if noise > 0 else s.R
        full = np.zeros((len(J) + len(f.P), len(u.names)))
        full[:, f.rows.columns] = np.vstack([J, f.P])
        rows.append(full)
    return identifiability(np.vstack(rows), u.names, scale=u.sizes, poses=poses, known_noise=noise > 0)
