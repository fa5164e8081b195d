"""Gauss-Newton steps from rows in pieces: by inner products where these are precise enough, by QR where not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from .losses import Loss

# pieces (rows, n + 1) of whitened rows [J r] at x, as often as asked for; memory holds one piece at a time
Pieces = Callable[[np.ndarray], Iterable[np.ndarray]]

# of a scaled Jacobian: inner products square it and leave eight digits of a step up to here; beyond, QR in pieces
CONDITION = 1e4


@dataclass(frozen=True, eq=False)
class Sums:
    """Of all rows A = [J r] at x, weighted by the loss: the `cost`, and A'A (n + 1, n + 1) or R with R'R = A'A."""

    matrix: np.ndarray
    cost: float
    triangular: bool

    @property
    def finite(self) -> bool:
        return math.isfinite(self.cost) and math.isfinite(float(self.matrix.sum()))


@dataclass(frozen=True, eq=False)
class Directions:
    """Singular values (k,) of the scaled Jacobian, largest first, right vectors V (n, k), and U'r (k,), |r|."""

    singular: np.ndarray
    V: np.ndarray
    projected: np.ndarray
    size: float


def sums(pieces: Iterable[np.ndarray], loss: Loss, width: float, *, triangular: bool) -> Sums:
    """The sums over the pieces, by QR if `triangular`."""
    matrix, cost = np.zeros((0, 0)), 0.0
    with np.errstate(all="ignore"):  # what is not finite shows in the sums
        for A in pieces:
            rows = A
            if not loss.squares:
                cost += loss.cost(A[:, -1], width)
                rows = A * loss.weight(A[:, -1], width)[:, None]
            more = triangle(matrix, rows) if triangular else rows.T @ rows
            matrix = more if triangular or not len(matrix) else matrix + more
        if loss.squares and len(matrix):
            cost = 0.5 * float(matrix[:, -1] @ matrix[:, -1] if triangular else matrix[-1, -1])
    return Sums(matrix, cost, triangular)


def triangle(R: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The triangle of R (empty at first) and further rows below it: in pieces what QR of all rows gives."""
    return np.asarray(np.linalg.qr(np.vstack([R, rows]) if len(R) else rows, mode="r"))


def directions(s: Sums, size: np.ndarray, prior: np.ndarray) -> Directions | None:
    """Of sums and prior rows (k, n + 1), columns in units of `size` (n + 1,), of which the last is 1.

    None where inner products are not precise enough.
    """
    if s.triangular:
        R = s.matrix * size
        R = np.vstack([R, prior * size]) if len(prior) else R
        U, singular, Vt = np.linalg.svd(R[:, :-1], full_matrices=False)
        return Directions(singular, Vt.T, U.T @ R[:, -1], norm(R[:, -1]))
    G = s.matrix + prior.T @ prior if len(prior) else s.matrix
    G = G * size * size[:, None]
    values, V = np.linalg.eigh(G[:-1, :-1])
    if not values[0] * CONDITION**2 > values[-1]:
        return None
    singular, V = np.sqrt(values[::-1]), V[:, ::-1]
    return Directions(singular, V, V.T @ G[:-1, -1] / singular, math.sqrt(G[-1, -1]))


def norm(v: np.ndarray) -> float:
    """Of a vector; a call costs a third of NumPy's, which asks for axes and orders first."""
    return math.sqrt(float(v @ v))
