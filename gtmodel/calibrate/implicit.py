"""Errors of measured signals instead of equations: the smallest changes of the data that close every pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..lang.source import ModelError
from .blocks import Block

ROUNDS = 50
QUICK = 5  # rounds of full steps; poses that have not converged by then are treated one by one
# a pose has converged if its errors move by no more than this part of the noise plus this part of the data's size
STILL, FLOOR = 1e-10, 1e-13
# a step is shortened if it leaves the equations farther from zero than a bound, which falls by this factor per round
FALLING = 0.8
ALLOWED = 0.1  # of a step's length: residual allowed for its curvature where the equations already held
SHORTEST = 1e-4  # fraction of a step below which shortening is given up
WIDE = 1e4  # ratio of largest to smallest noise beyond which squares lose digits
NEIGHBOURS = 3  # number of nearest closed poses from which an unclosed pose is tried again

Begin = tuple[np.ndarray | None, np.ndarray | None]


@dataclass(eq=False)
class Adjustment:
    """Per pose the smallest noise y, in units of its covariance, with r(d + y, z; x) = 0 for some latent z.

    Gauss-Newton steps with y and z eliminated pose by pose (Gauss-Helmert), so that only the unknowns x are left. With
    noise in the actuators alone y is the error of the inverse kinematics; in the pose alone, that of the forward
    kinematics in the assembly mode of the measurement; in both, the orthogonal distance. Each call starts from the last
    solution. A step that leads away from the closed pose is shortened; a pose that does not close is tried again from
    the solutions of the nearest closed poses. `closed` (N,): which poses closed at the last x.
    """

    block: Block
    data: np.ndarray
    covariance: np.ndarray  # (N or 1, ny, ny), zero where there is no noise
    start: Begin = (None, None)  # changes (N, ny) and latent values (N, nz), zero if left out
    y: np.ndarray = field(init=False)
    z: np.ndarray = field(init=False)
    closed: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        n = self.data.shape[1]
        y, z = self.start
        self.y = np.zeros((n, self.covariance.shape[1])) if y is None else y.copy()
        self.z = np.zeros((n, self.latent)) if z is None else z.copy()
        self.closed = np.ones(n, bool)

    @property
    def latent(self) -> int:
        """Number of latent values per pose."""
        return len(self.block.hidden)

    @cached_property
    def roots(self) -> np.ndarray | None:
        """Roots (N or 1, ny, ny) of the covariance if its sizes differ so much that squares lose digits; else None."""
        sizes = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        if sizes.max(initial=0.0) <= WIDE * np.min(sizes, initial=np.inf, where=sizes > 0):
            return None
        scale = np.where(sizes > 0, sizes, 1.0)
        units = np.eye(sizes.shape[1]) * (sizes == 0)[:, None, :]
        correlation = self.covariance / (scale[:, :, None] * scale[:, None, :]) + units
        return sizes[:, :, None] * np.linalg.cholesky(correlation)

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals (N * k,) and their Jacobian (N * k, n); infinite if a pose cannot be closed."""
        e, J = self.per_pose(x)
        return e.reshape(-1), J.reshape(-1, J.shape[-1])

    def per_pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals (N, k) and their Jacobian (N, k, n); k: equations less latent values."""
        n, every = len(self.y), np.arange(len(self.y))
        rows = len(self.block.rows) - self.latent
        e, J = np.empty((n, rows)), np.empty((n, rows, len(x)))
        closed = np.zeros(n, bool)
        self._close(x, every, self.y, self.z, e, J, closed)
        if not closed.all():
            if closed.any():
                self._from_neighbours(x, e, J, closed)
            e[~closed], J[~closed] = np.inf, np.inf
        self.closed = closed
        return e, J

    def closing(self, x: np.ndarray) -> np.ndarray:
        """The changes y (N, ny) that close the poses; rows of NaN if a pose cannot be closed."""
        self.per_pose(x)
        return np.where(self.closed[:, None], self.y, np.nan)

    def by_noise(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the whitened residuals in the noise of all signals (N, k, ny), at the last solution."""
        _, _, By, Bz = self.block.evaluate_all(self.data, x, self.y, self.z)
        W, good, _ = self._whitening(By, Bz, np.arange(len(self.y)))
        if not good.all():
            raise ModelError("a pose is singular at the solution: its errors have no derivatives")
        return W @ By

    def _close(
        self, x: np.ndarray, index: np.ndarray, y: np.ndarray, z: np.ndarray, e: np.ndarray, J: np.ndarray,
        closed: np.ndarray,
    ) -> None:  # fmt: skip
        """Iterate poses (of `index`) from y, z and store closed ones in self, e, J and closed.

        First with full steps, which mostly suffice for all poses, then with a guard per pose."""
        if not self._stepped(x, index, y, z, e, J, closed, None):
            self._stepped(x, index, y, z, e, J, closed, _Guard(y, z))

    def _stepped(
        self, x: np.ndarray, index: np.ndarray, y: np.ndarray, z: np.ndarray, e: np.ndarray, J: np.ndarray,
        closed: np.ndarray, guard: _Guard | None,
    ) -> bool:  # fmt: skip
        """Whether all poses close; without a guard, nothing is stored unless all do."""
        S = self._at(self.covariance, index)
        data = self.data if len(index) == self.data.shape[1] else self.data[:, index]
        size = float(np.sqrt(np.max(np.diagonal(S, axis1=1, axis2=2))))
        floor = FLOOR * float(np.abs(self.data).max(initial=1.0))
        with np.errstate(all="ignore"):
            for _ in range(QUICK if guard is None else ROUNDS):
                r, Jx, By, Bz = self.block.evaluate_all(data, x, y, z)
                W, good, to_data = self._whitening(By, Bz, index)
                w = r - _times(By, y)
                v = _times(W, w)
                # the multipliers of the equations give all errors
                if to_data is None:
                    new = -_times(S @ By.transpose(0, 2, 1), _times(W.transpose(0, 2, 1), v))
                else:
                    new = -_times(to_data, v)
                step = -_times(_inverse(Bz), w + _times(By, new)) if self.latent else np.zeros_like(z)
                arrived = STILL * max(size, float(np.abs(y).max(initial=0.0))) + floor
                if guard is None:
                    change = max(float(np.abs(new - y).max(initial=0.0)), float(np.abs(step).max(initial=0.0)))
                    if not good.all() or not np.isfinite(change):
                        return False
                    settled, refused = np.full(len(index), change <= arrived), ~good
                else:
                    refused = guard.refused(r, By, Bz, S)
                    each = np.abs(new - y).max(axis=1, initial=0.0)
                    each = np.maximum(each, np.abs(step).max(axis=1, initial=0.0))
                    settled = (each <= arrived) & good & ~refused
                if settled.all():
                    poses = slice(None) if len(index) == len(closed) else index
                    self.y[poses], self.z[poses], closed[poses] = new, z + step, True
                    e[poses] = v
                    J[poses] = W @ Jx
                    return True
                if guard is None:
                    y, z = new, z + step
                    continue
                done = np.flatnonzero(settled & ~closed[index])
                if len(done):  # store these now: others may never close
                    poses = index[done]
                    self.y[poses], self.z[poses], closed[poses] = new[done], (z + step)[done], True
                    e[poses], J[poses] = v[done], (W @ Jx)[done]
                y, z, dead = guard.next(y, z, new, z + step, refused, good)
                if dead is not None and (settled | dead).all():
                    break
        return False

    def _from_neighbours(self, x: np.ndarray, e: np.ndarray, J: np.ndarray, closed: np.ndarray) -> None:
        """Try unclosed poses again from the solutions of their nearest closed poses."""
        spread = np.ptp(self.data, axis=1)
        places = (self.data / np.where(spread > 0, spread, 1.0)[:, None]).T
        done = np.flatnonzero(closed)
        for rank in range(min(NEIGHBOURS, len(done))):
            lost = np.flatnonzero(~closed)
            if not len(lost):
                return
            distances = np.linalg.norm(places[lost, None] - places[None, done], axis=2)
            near = done[np.argsort(distances, axis=1, kind="stable")[:, rank]]
            self._close(x, lost, np.zeros_like(self.y[near]), self.z[near].copy(), e, J, closed)

    def _whitening(
        self, By: np.ndarray, Bz: np.ndarray, index: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """W (N, m - nz, m), which whitens residuals and removes latent values; which poses have one; with `roots` also
        the matrix from white residuals to changes of the data."""
        good = np.ones(len(By), bool)
        if not np.isfinite(By.sum() + Bz.sum()):
            good = np.array([np.isfinite(a).all() and np.isfinite(b).all() for a, b in zip(By, Bz, strict=True)])
            By, Bz = (np.where(good[:, None, None], B, 0.0) for B in (By, Bz))
        nz = Bz.shape[2]
        blind = np.linalg.qr(Bz, mode="complete")[0][:, :, nz:].transpose(0, 2, 1) if nz else None
        if self.roots is not None:
            roots = self._at(self.roots, index)
            A = By @ roots if blind is None else blind @ By @ roots
            Q, R = np.linalg.qr(A.transpose(0, 2, 1))
            pivots = np.abs(np.diagonal(R, axis1=1, axis2=2))
            good = np.logical_and(good, pivots.min(axis=1, initial=np.inf) > 0)
            R = np.where(good[:, None, None], R, np.eye(R.shape[1]))
            right = np.broadcast_to(np.eye(R.shape[1]), R.shape) if blind is None else blind
            return np.linalg.solve(R.transpose(0, 2, 1), right), good, roots @ Q
        S = self._at(self.covariance, index)
        omega = By @ S @ By.transpose(0, 2, 1)
        omega = omega if blind is None else blind @ omega @ blind.transpose(0, 2, 1)
        L, good = _lower(omega, good)
        return (np.linalg.inv(L) if blind is None else np.linalg.solve(L, blind)), good, None

    def _at(self, rows: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Rows of some poses from an array with one row for all or one per pose."""
        return np.broadcast_to(rows, (len(index), *rows.shape[1:])) if len(rows) == 1 else rows[index]


class _Guard:
    """Shortens steps pose by pose if they leave the equations farther from zero than a bound that falls each round."""

    def __init__(self, y: np.ndarray, z: np.ndarray) -> None:
        self.base, self.aim = (y, z), (y, z)
        self.part = np.ones(len(y))
        self.left = self.bound = np.full(len(y), np.inf)
        self.weights: np.ndarray | None = None
        self.begun = False

    def refused(self, r: np.ndarray, By: np.ndarray, Bz: np.ndarray, S: np.ndarray) -> np.ndarray:
        """(N,) poses whose last step led too far from the closed pose."""
        if self.weights is None:
            noisy = np.diagonal(S, axis1=1, axis2=2)[:, None, :] > 0
            size = np.sqrt(np.sum((By * noisy) ** 2, axis=2) + np.sum(Bz**2, axis=2))
            self.weights = 1 / np.where(np.isfinite(size) & (size > 0), size, 1.0)
        self.left = np.sum(np.abs(r) * self.weights, axis=1)
        return ~(self.left <= self.bound)

    def next(
        self, y: np.ndarray, z: np.ndarray, new: np.ndarray, new_z: np.ndarray, refused: np.ndarray, good: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """The next y and z, and the poses that no step closes; None if all take a full step."""
        on = good & ~refused
        if not self.begun:
            self.begun = True
            length = np.abs(new - y).sum(axis=1) + np.abs(new_z - z).sum(axis=1)
            self.bound = np.where(on, 2 * np.maximum(self.left, ALLOWED * length), np.inf)
        else:
            self.bound = np.where(on, FALLING * self.bound, self.bound)
        if on.all():
            self.base, self.aim = (y, z), (new, new_z)
            self.part[:] = 1.0
            return new, new_z, None
        pick = on[:, None]
        self.base = np.where(pick, y, self.base[0]), np.where(pick, z, self.base[1])
        self.aim = np.where(pick, new, self.aim[0]), np.where(pick, new_z, self.aim[1])
        shorter = np.clip(np.sqrt(self.bound / self.left), 0.05, 0.5)
        self.part = np.where(on, 1.0, np.where(np.isfinite(shorter), shorter, 0.1) * self.part)
        dead = (~refused & ~good) | (self.part < SHORTEST)
        part = np.where(dead, 0.0, self.part)[:, None]
        y, z = (np.where(part == 1, b, a + part * (b - a)) for a, b in zip(self.base, self.aim, strict=True))
        return y, z, dead


def _times(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (A @ b[..., None])[..., 0]


def _inverse(B: np.ndarray) -> np.ndarray:
    return np.linalg.pinv(B if np.isfinite(B.sum()) else np.where(np.isfinite(B), B, 0.0))


def _lower(omega: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky factors, and where they exist; the identity elsewhere."""
    try:
        if good.all():
            return np.linalg.cholesky(omega), good
    except np.linalg.LinAlgError:
        pass
    L, good = np.broadcast_to(np.eye(omega.shape[1]), omega.shape).copy(), good.copy()
    for k in np.flatnonzero(good):
        try:
            L[k] = np.linalg.cholesky(omega[k])
        except np.linalg.LinAlgError:
            good[k] = False
    return L, good


def require_noise_enough(block: Block, data: np.ndarray, covariance: np.ndarray, start: Begin,
                         x: np.ndarray, labels: tuple[str, ...]) -> None:  # fmt: skip
    """Raise ModelError if the noise has fewer directions than a pose has equations to close."""
    latent = len(block.hidden)
    _, _, By, Bz = block.evaluate_all(data[:, :1], x, *(None if s is None else s[:1] for s in start))
    if not np.all(np.isfinite(By)) or not np.all(np.isfinite(Bz)):
        return  # the first pose does not close at the start; the fit reports it
    blind = np.linalg.qr(Bz[0], mode="complete")[0][:, latent:].T if latent else np.eye(len(block.rows))
    noisy = np.diagonal(covariance[0]) > 0  # only directions count, not sizes
    A = blind @ By[0] * noisy
    scale = np.linalg.norm(A, axis=1)
    rank = 0 if not np.all(scale > 0) else int(np.linalg.matrix_rank(A / scale[:, None], tol=1e-5))
    if rank < len(A):
        raise ModelError(
            f"the stated noise can close {rank} of the {len(A)} equations of a pose ({', '.join(labels)}); "
            "state noise of more signals, or choose the cost 'length'"
        )
