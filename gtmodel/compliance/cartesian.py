"""What joint compliances mean at the tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# beyond this condition number of J its inverse keeps fewer than four digits
SINGULAR = 1e-4 / np.finfo(float).eps


def cartesian_stiffness(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """K_x = J^-T K_q J^-1 (n, 6, 6), eq. (7): N/m, N/rad, N.m/rad in one matrix. NaN where J is singular or not finite.

    J (n, 6, 6) or one (6, 6); compliance (6,) [rad/N.m] of the joints. J itself is inverted, not the compliance at the
    tool, whose condition is the square. Raises ValueError for another shape and compliances that are not positive.
    """
    J, c = np.asarray(J, float), np.asarray(compliance, float)
    if J.ndim not in (2, 3) or J.shape[-1] != J.shape[-2] or c.shape != J.shape[-1:]:
        raise ValueError(f"found J {J.shape} and compliances {c.shape}; expected (n, 6, 6) and (6,)")
    if not np.all((c > 0) & np.isfinite(c)):
        raise ValueError(f"the compliances are {c.tolist()} rad/(N.m); expected positive numbers")
    many = J.reshape(-1, *J.shape[-2:])
    found = np.full(many.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(many).all(axis=(1, 2)))
    regular = finite[np.linalg.cond(many[finite]) < SINGULAR]
    inverse = np.linalg.inv(many[regular])
    found[regular] = np.swapaxes(inverse, 1, 2) @ (inverse / c[:, None])
    return found.reshape(J.shape)


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
