"""What joint compliances mean at the tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# beyond this condition number of J its inverse keeps fewer than four digits
SINGULAR = 1e-4 / np.finfo(float).eps


def cartesian_stiffness(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """K_x = J^-T K_q J^-1 (n, 6, 6), eq. (7) (Cvitanic 2021): N/m, N/rad, N.m/rad in one matrix.

    J (n, 6, 6) or one (6, 6); compliance (6,) [rad/(N.m)] of the joints. NaN where J is singular or not finite. J
    itself is inverted, not the compliance at the tool, whose condition number is the square. Raises ValueError for
    another shape and for compliances that are not positive.

    >>> J = gt.compliance.arm_poses(gt.robots.kr500(), [0.3, -0.9, 2.0, 0.2, -1.1, -0.1]).J
    >>> c = np.full(6, 1e-6)
    >>> K = gt.compliance.cartesian_stiffness(J, c)
    >>> np.allclose(K[0] @ (J[0] * c) @ J[0].T, np.eye(6))
    True
    """
    J, c = np.asarray(J, float), np.asarray(compliance, float)
    if J.ndim not in (2, 3) or J.shape[-1] != J.shape[-2] or c.shape != J.shape[-1:]:
        raise ValueError(f"found J {J.shape} and compliances {c.shape}; expected (n, 6, 6) and (6,)")
    if not np.all((c > 0) & np.isfinite(c)):
        raise ValueError(f"the compliances are {c.tolist()} rad/(N.m); expected positive numbers")
    many = J.reshape(-1, *J.shape[-2:])
    stiffness = np.full(many.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(many).all(axis=(1, 2)))
    regular = finite[np.linalg.cond(many[finite]) < SINGULAR]
    inverse = np.linalg.inv(many[regular])
    stiffness[regular] = np.swapaxes(inverse, 1, 2) @ (inverse / c[:, None])
    return stiffness.reshape(J.shape)


def translational_compliance(J: ArrayLike, compliance: ArrayLike) -> np.ndarray:
    """C_tt (n, 3, 3) [m/N]: displacement of the tool by a force there. It is finite at singular poses too.

    J (n, 6, k), linear rows first; compliance (k,) [rad/(N.m)] of the joints.

    >>> J = np.zeros((1, 6, 1))
    >>> J[0, :, 0] = [0, 2.0, 0, 0, 0, 1]  # one joint about z, the tool 2 m away along x
    >>> gt.compliance.translational_compliance(J, [1e-6])[0, 1, 1]  # m/N
    np.float64(4e-06)
    """
    v = np.asarray(J, float)[:, :3]
    return (v * np.asarray(compliance, float)) @ np.swapaxes(v, 1, 2)


def softest_and_stiffest(C: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness along the principal directions of C_tt (n, 3, 3) [m/N].

    Returns (n, 3) [N/m], softest first, and the directions (n, 3, 3) as rows; both are NaN where C is. Singular values
    of K_x would mix units and have no bound near singular poses.

    >>> stiffness, directions = gt.compliance.softest_and_stiffest(np.diag([1e-6, 2e-6, 4e-6])[None])
    >>> stiffness
    array([[ 250000.,  500000., 1000000.]])
    >>> directions[0, 0]
    array([0., 0., 1.])
    """
    C = np.asarray(C, float)
    finite = np.asarray(np.isfinite(C).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], C, 0.0))
    with np.errstate(divide="ignore"):
        stiffness = np.where(values > 0, 1 / values, np.inf)
    stiffness[~finite], vectors[~finite] = np.nan, np.nan
    return stiffness[:, ::-1], np.swapaxes(vectors, 1, 2)[:, ::-1]
