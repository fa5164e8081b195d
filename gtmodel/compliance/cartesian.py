"""What joint compliances mean at the tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def cartesian_stiffness(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """K_x = J^-T K_q J^-1 (n, 6, 6), eq. (7): N/m, N/rad, N.m/rad in one matrix. NaN where J is singular."""
    J = np.asarray(J, float)
    C = (J * np.asarray(compliance, float)) @ np.swapaxes(J, 1, 2)
    regular = np.linalg.cond(J) < 1 / np.finfo(float).eps
    found = np.full(C.shape, np.nan)
    found[regular] = np.linalg.inv(C[regular])
    return found


def translational_compliance(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """C_tt (n, 3, 3) [m/N]: displacement of the tool by a force there. Finite at singular poses too."""
    v = np.asarray(J, float)[:, :3]
    return (v * np.asarray(compliance, float)) @ np.swapaxes(v, 1, 2)


def softest_and_stiffest(C: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness along the principal directions of C_tt (n, 3, 3): (n, 3) [N/m], softest first, and directions (n, 3, 3)
    as rows. In place of singular values of K_x, which mix units and have no bound near singular poses. NaN
    where C is."""
    C = np.asarray(C, float)
    finite = np.asarray(np.isfinite(C).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], C, 0.0))
    with np.errstate(divide="ignore"):
        stiffness = np.where(values > 0, 1 / values, np.inf)
    stiffness[~finite], vectors[~finite] = np.nan, np.nan
    return stiffness[:, ::-1], np.swapaxes(vectors, 1, 2)[:, ::-1]
