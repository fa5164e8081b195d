"""Errors of what was measured, not of equations: the smallest changes of the data that close every pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..lang.source import ModelError
from .blocks import Block

ROUNDS = 50
# an error that moves by no more than this part of the noise, and this part of the data's size, has arrived
STILL, FLOOR = 1e-10, 1e-13


@dataclass(eq=False)
class Adjustment:
    """Per pose the smallest noise y, in units of its covariance, with r(d + y, z; x) = 0 for some latent z.

    Gauss-Helmert steps; y and z of each pose are eliminated, so that unknowns x are all that is left. With noise in
    the actuators alone this is the error of the inverse kinematics, in the pose alone that of the forward kinematics in
    the assembly mode of the measurement, in both the orthogonal distance. It starts where it last ended.
    """

    block: Block
    data: np.ndarray
    covariance: np.ndarray  # (N or 1, ny, ny), zero where there is no noise
    latent: int
    y: np.ndarray = field(init=False)
    z: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        n = self.data.shape[1]
        self.y = np.zeros((n, self.covariance.shape[1]))
        self.z = np.zeros((n, self.latent))

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals (N * k,) and their Jacobian (N * k, n); infinite where a pose cannot be closed."""
        e, J = self.per_pose(x)
        return e.reshape(-1), J.reshape(-1, J.shape[-1])

    def per_pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same as (N, k) and (N, k, n), k equations less latent values."""
        y, z = self.y, self.z
        S = np.broadcast_to(self.covariance, (len(y), *self.covariance.shape[1:]))
        size = float(np.sqrt(np.max(np.diagonal(S, axis1=1, axis2=2))))
        floor = FLOOR * float(np.abs(self.data).max(initial=1.0))
        with np.errstate(all="ignore"):
            for _ in range(ROUNDS):
                r, J, By, Bz = self.block.evaluate_all(self.data, x, y, z)
                W = _whitening(By, Bz, S) if np.all(np.isfinite(r)) else None
                if W is None:
                    break
                w = r - _times(By, y)
                e = _times(W, w)
                # the multipliers of the equations, from which all errors follow
                new = -_times(S @ By.transpose(0, 2, 1), _times(W.transpose(0, 2, 1), e))
                step = -_times(np.linalg.pinv(Bz), w + _times(By, new)) if self.latent else np.zeros_like(z)
                moved = max(float(np.abs(new - y).max(initial=0.0)), float(np.abs(step).max(initial=0.0)))
                y, z = new, z + step
                if moved <= STILL * max(size, float(np.abs(y).max(initial=0.0))) + floor:
                    self.y, self.z = y, z
                    return e, W @ J
        rows = len(self.block.rows) - self.latent
        return np.full((len(y), rows), np.inf), np.full((len(y), rows, len(x)), np.inf)

    def closing(self, x: np.ndarray) -> np.ndarray:
        """The changes y (N, ny) that close the poses; rows of NaN where a pose cannot be closed."""
        if np.all(np.isfinite(self.per_pose(x)[0])):
            return self.y
        y = np.full_like(self.y, np.nan)
        for k in range(len(y)):  # one that does not close stops all that are solved beside it
            S = self.covariance[k : k + 1] if len(self.covariance) > 1 else self.covariance
            alone = Adjustment(self.block, self.data[:, k : k + 1], S, self.latent)
            if np.all(np.isfinite(alone.per_pose(x)[0])):
                y[k] = alone.y[0]
        return y

    def by_noise(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the whitened residuals in the noise of all signals (N, k, ny), where the iteration ended."""
        _, _, By, Bz = self.block.evaluate_all(self.data, x, self.y, self.z)
        W = _whitening(By, Bz, np.broadcast_to(self.covariance, (len(self.y), *self.covariance.shape[1:])))
        if W is None:
            raise ModelError("a pose is singular at the solution: its errors have no slopes")
        return W @ By


def _times(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (A @ b[..., None])[..., 0]


def _whitening(By: np.ndarray, Bz: np.ndarray, S: np.ndarray) -> np.ndarray | None:
    """W (N, m - nz, m), which makes residuals white and blind to latent values; None where a pose is singular."""
    nz = Bz.shape[2]
    omega = By @ S @ By.transpose(0, 2, 1)
    try:
        if not nz:
            return np.linalg.inv(np.linalg.cholesky(omega))
        blind = np.linalg.qr(Bz, mode="complete")[0][:, :, nz:].transpose(0, 2, 1)
        return np.linalg.solve(np.linalg.cholesky(blind @ omega @ blind.transpose(0, 2, 1)), blind)
    except np.linalg.LinAlgError:
        return None


def require_noise_enough(block: Block, data: np.ndarray, covariance: np.ndarray, latent: int, x: np.ndarray,
                         labels: tuple[str, ...]) -> None:  # fmt: skip
    """ModelError where the noise has fewer directions than there are equations to close per pose."""
    _, _, By, Bz = block.evaluate_all(data[:, :1], x)
    blind = np.linalg.qr(Bz[0], mode="complete")[0][:, latent:].T if latent else np.eye(len(block.rows))
    omega = blind @ By[0] @ covariance[0] @ By[0].T @ blind.T
    scale = np.sqrt(np.diag(omega))
    rank = 0 if not np.all(scale > 0) else int(np.linalg.matrix_rank(omega / np.outer(scale, scale), tol=1e-10))
    if rank < len(omega):
        raise ModelError(
            f"the stated noise can close {rank} of the {len(omega)} equations of a pose ({', '.join(labels)}); "
            "give noise to more signals, or take the cost 'length'"
        )
