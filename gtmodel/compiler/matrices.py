"""Entries of symbolic matrices as scalars, and QR with column pivoting, under types that checkers understand."""

from __future__ import annotations

from typing import cast

import casadi as ca
import numpy as np
from scipy.linalg import qr


def nonzeros(m: ca.SX) -> list[ca.SX]:
    """Structural nonzeros, column by column."""
    return cast("list[ca.SX]", m.nonzeros())


def triplets(m: ca.SX) -> list[tuple[int, int, ca.SX]]:
    """(row, column, value) of the structural nonzeros, column by column."""
    return list(zip(*m.sparsity().get_triplet(), nonzeros(m), strict=True))


def elements(m: ca.SX) -> list[ca.SX]:
    """All elements of a matrix, column by column."""
    return ca.vertsplit(ca.vec(ca.densify(m)))


def stacked(values: list[ca.SX]) -> ca.SX:
    """A column of scalars; an empty one where there is none."""
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def pivoted_qr(a: np.ndarray, mode: str = "full") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Q, R and the column order, largest remaining column first; mode "full" or "economic"."""
    return cast("tuple[np.ndarray, np.ndarray, np.ndarray]", qr(a, mode=mode, pivoting=True))
