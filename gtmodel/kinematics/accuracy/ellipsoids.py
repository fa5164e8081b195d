"""Bounds of a link's free end when its base point lies in an ellipsoid (Dressler 2012, section A.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry.rotations import right_handed
from .corners import SIGNS, Array

ITERATIONS = 50
# distance of the three projections from their common point [m]: far below a micrometre, above rounding at 1e1 m
CLOSE = 1e-12


@dataclass(frozen=True)
class Ellipsoids:
    """Where the base points of three links may lie: about each nominal one, an ellipsoid.

    Attributes:
        axes: (3, 3, 3), row k of axes[i] is the unit vector of the k-th half-axis of link i.
        half: (3, 3) half-axes [m].
    """

    axes: Array
    half: Array

    @classmethod
    def about_guideways(cls, directions: Array, along: Array, across: Array) -> Ellipsoids:
        """One half-axis `along` each guideway, two equal ones `across` it, (3,) each [m] (Dressler 2012, Table 4.2)."""
        axes = [right_handed(v) for v in directions]
        return cls(np.array(axes), np.stack([along, across, across], axis=1).astype(float))

    def support(self, u: Array) -> Array:
        """How far each ellipsoid reaches along the links: sqrt(sum_k (r_k a_k.u)^2) [m], (n, 3), for u (n, 3, 3).

        This is the exact first-order bound: no base point within the ellipsoid changes the distance by more.
        """
        along = np.einsum("ikc,nic->nik", self.axes, u)
        return np.sqrt(np.einsum("nik,ik->ni", along**2, self.half**2))


def projected_corners(a: Array, T: Array, lengths: Array, ellipsoids: Ellipsoids) -> tuple[Array, Array]:
    """Corners by the iterative projection of Dressler 2012, section A.2.

    The free end of link i stays between the ellipsoids about its base point with half-axes L_i - r_ik and L_i + r_ik.
    From the nominal point: project along the rays from the centres onto one ellipsoid of each link, intersect the
    tangent planes there, repeat. To first order link i may be longer by sum_k r_k (a_k.u)^2, which is less than the
    support: the thesis says itself that the exact set is slightly larger.

    Args:
        a: (n, 3, 3) nominal base points [m]. T: (n, 3) nominal intersection [m]. lengths: (3,) [m].

    Returns: corners (n, 8, 3) [m] in the order of SIGNS, and whether each converged, (n, 8). Others are NaN.

    Base points 1 m away from where the links meet, each within 0.1 mm in all directions:

    >>> from gtmodel.kinematics.accuracy import Ellipsoids, largest, projected_corners
    >>> within = Ellipsoids(np.tile(np.eye(3), (3, 1, 1)), np.full((3, 3), 1e-4))
    >>> corners, converged = projected_corners(-np.eye(3)[None], np.zeros((1, 3)), np.ones(3), within)
    >>> (1e3 * largest(corners)).round(3), bool(converged.all())  # mm
    (array([0.173]), True)
    """
    n = len(T)
    # rows of corners, so that all are iterated at once
    centre = np.repeat(a[:, None], 8, axis=1).reshape(n * 8, 3, 3)
    half = lengths[:, None] + SIGNS[:, :, None] * ellipsoids.half
    half = np.tile(half, (n, 1, 1))
    x = np.repeat(T, 8, axis=0)
    good = np.zeros(n * 8, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            d = x[:, None] - centre
            own = np.einsum("ikc,nic->nik", ellipsoids.axes, d)
            scaled = own / half
            size = np.sqrt((scaled**2).sum(axis=2))
            point = centre + d / size[..., None]
            good = np.max(np.linalg.norm(point - x[:, None], axis=2), axis=1) < CLOSE
            if good.all():
                break
            normal = np.einsum("ikc,nik->nic", ellipsoids.axes, scaled / half)
            normal /= np.linalg.norm(normal, axis=2, keepdims=True)
            x = _solve(normal, np.einsum("nic,nic->ni", normal, point))
    x[~good] = np.nan
    return x.reshape(n, 8, 3), good.reshape(n, 8)


def _solve(matrices: Array, rhs: Array) -> Array:
    """Solutions of 3 x 3 systems in rows; NaN where a matrix is singular or not finite."""
    determinant = np.linalg.det(np.where(np.isfinite(matrices), matrices, 0.0))
    usable = np.isfinite(matrices).all(axis=(1, 2)) & np.isfinite(rhs).all(axis=1) & (np.abs(determinant) > 1e-12)
    solution = np.full(rhs.shape, np.nan)
    solution[usable] = np.linalg.solve(matrices[usable], rhs[usable][..., None])[..., 0]
    return solution
