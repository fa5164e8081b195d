"""Observability indices O1 to O5 of a set of measured poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class Observability:
    """Indices of the scaled Jacobian with singular values s1 >= .. >= sr, r of them, and n poses; larger is better.

    o1 = (s1 .. sr)^(1/r) / sqrt(n), o2 = sr / s1, o3 = sr, o4 = sr^2 / s1 (noise amplification; eq. (5.14) of Dressler
    2012 is misprinted), o5 = 1 / sum(1 / si). `scaling` says what columns and rows were divided by.
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float
    rank: int
    poses: int
    scaling: str

    def __str__(self) -> str:
        indices = ", ".join(f"O{k} = {getattr(self, f'o{k}'):.4g}" for k in range(1, 6))
        return f"{indices} (r = {self.rank}, {self.poses} poses, {self.scaling})"


def observability(singular: np.ndarray, rank: int, poses: int, scaling: str) -> Observability:
    """Observability indices O1 to O5 of singular values in falling order, of which the first `rank` count.

    `poses` is the number of measured poses; `scaling` says in words what columns and rows were divided by. Raises
    ArgumentError for a rank or a number of poses below one, and where a singular value that counts is zero.

    >>> indices = gt.inference.observability(np.array([4.0, 2.0, 1.0]), 3, poses=10, scaling="as given")
    >>> round(indices.o1, 4), indices.o2, indices.o3, indices.o4
    (0.6325, 0.25, 1.0, 0.25)
    """
    s = np.asarray(singular, float)[:rank]
    if rank < 1 or poses < 1 or not np.all(s > 0):
        raise ArgumentError(f"observability needs a rank and poses of at least one; found {rank} and {poses}")
    o1 = float(np.exp(np.mean(np.log(s))) / np.sqrt(poses))
    return Observability(
        o1, float(s[-1] / s[0]), float(s[-1]), float(s[-1] ** 2 / s[0]), float(1 / np.sum(1 / s)), rank, poses, scaling
    )
