"""Where the search for latent values starts: poses of the robot as it was, at the measured actuators."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.rows import map_columns

ROUNDS = 60
LEFT = 1e-8  # of the equations, in units of their derivatives: the pose is closed
NEIGHBOURS = 3
LEAST, MOST = 1e-12, 1e12


def closed_start(equations: ca.SX, d: ca.SX, latent: ca.SX, data: np.ndarray) -> np.ndarray:
    """Latent values (N, nz) that close `equations` of d and latent alone, for data (nd, N), from zero: by Levenberg
    steps, each row by itself; where a row does not close, from those of its nearest neighbours that do."""
    f = ca.Function("stances", [d, latent], ca.cse([ca.densify(equations), ca.densify(ca.jacobian(equations, latent))]))
    N, nz = data.shape[1], latent.numel()
    z, left = _levenberg(f, data, np.zeros((N, nz)))
    good = left <= LEFT
    spread = np.ptp(data, axis=1)
    places = (data / np.where(spread > 0, spread, 1.0)[:, None]).T
    for rank in range(NEIGHBOURS):
        lost, there = np.flatnonzero(~good), np.flatnonzero(good)
        if not len(lost) or len(there) <= rank:
            break
        distances = np.linalg.norm(places[lost, None] - places[None, there], axis=2)
        near = there[np.argsort(distances, axis=1, kind="stable")[:, rank]]
        again, rest = _levenberg(f, data[:, lost], z[near])
        better = rest < left[lost]
        z[lost[better]], left[lost[better]] = again[better], rest[better]
        good = left <= LEFT
    return z


def _levenberg(f: ca.Function, data: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z and what is left of the equations, in units of their derivatives (N,)."""
    N, nz = z.shape
    damping = np.full(N, 1e-3)

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = map_columns(f, [data, z.T])
        return r.T, J.reshape(J.shape[0], N, nz).transpose(1, 0, 2)

    with np.errstate(all="ignore"):
        r, J = at(z)
        J = np.nan_to_num(J, posinf=0.0, neginf=0.0)
        cost = np.where(np.isfinite(r).all(axis=1), np.sum(r**2, axis=1), np.inf)
        for _ in range(ROUNDS):
            A = J.transpose(0, 2, 1) @ J
            scale = np.trace(A, axis1=1, axis2=2) / nz
            A += (damping * np.where(scale > 0, scale, 1.0))[:, None, None] * np.eye(nz)
            step = -np.linalg.solve(A, J.transpose(0, 2, 1) @ np.nan_to_num(r)[..., None])[..., 0]
            there, slopes = at(z + step)
            finite = np.isfinite(there).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
            new = np.where(finite, np.sum(there**2, axis=1), np.inf)
            better = new < cost
            damping = np.clip(np.where(better, damping / 10, damping * 10), LEAST, MOST)
            z, r = np.where(better[:, None], z + step, z), np.where(better[:, None], there, r)
            J, cost = np.where(better[:, None, None], slopes, J), np.where(better, new, cost)
            if not better.any() and damping.min() >= 1.0:
                break
        size = np.linalg.norm(J, axis=(1, 2))
    return z, np.where(size > 0, np.sqrt(cost) / np.where(size > 0, size, 1.0), np.inf)
