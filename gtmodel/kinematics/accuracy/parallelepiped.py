"""The shape of the positioning error: a parallelepiped (Dressler 2012, section A.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .corners import Array


@dataclass(frozen=True)
class Parallelepiped:
    """The body |u_i . x| <= r_i of three links, in rows.

    Attributes:
        edges: (n, 3, 3) [m], row i is the edge on which only link i changes: column i of U^-1 times 2 r_i.
        link_angles: (n, 3) [rad] between links j and k, opposite to link i: alpha_i, also the angle of the faces F_j
            and F_k (or its supplement, for the outer normals).
        pyramid_angles: (n, 3) [rad] between the pyramid sides that meet in link i: beta_i, also an angle of the
            parallelograms F_i.
        faces: (n, 3) [m2] areas of the parallelograms orthogonal to link i.
        diagonals: (n, 4) [m], from corner to opposite corner; half of the longest is the greatest error.
        volume: (n,) [m3].
    """

    edges: Array
    link_angles: Array
    pyramid_angles: Array
    faces: Array
    diagonals: Array
    volume: Array

    @property
    def longest(self) -> Array:
        """(n,) the longest diagonal [m]."""
        return self.diagonals.max(axis=1)


def parallelepiped(u: Array, r: Array) -> Parallelepiped:
    """Edges, angles, faces and diagonals for unit vectors u (n, 3, 3), one row per link, and half-widths r (n, 3) [m].

    Rows whose links lie in a plane have no such body: they are infinite or NaN; test them first
    (`first_order_corners` gives a status).

    Links at right angles, with errors of at most 1, 2 and 3 mm, give a box:

    >>> box = gt.kinematics.accuracy.parallelepiped(np.eye(3)[None], np.array([[1e-3, 2e-3, 3e-3]]))
    >>> (1e3 * box.edges[0]).round(6)  # mm, the whole width of the errors
    array([[2., 0., 0.],
           [0., 4., 0.],
           [0., 0., 6.]])
    >>> (1e6 * box.faces).round(6)  # mm2
    array([[24., 12.,  8.]])
    """
    u = np.asarray(u, dtype=float)
    r = np.broadcast_to(np.asarray(r, dtype=float), (len(u), 3))
    turn = [(1, 2), (2, 0), (0, 1)]
    # column i of U^-1 is u_j x u_k / det U: orthogonal to the two links that keep their length
    normals = np.stack([np.cross(u[:, j], u[:, k]) for j, k in turn], axis=1)
    determinant = np.einsum("nc,nc->n", u[:, 0], normals[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = 2 * r[..., None] * normals / determinant[:, None, None]
        alpha = np.stack([_angle(u[:, j], u[:, k]) for j, k in turn], axis=1)
        # the sides that meet in link i hold (i, j) and (i, k)
        beta = np.stack(
            [_angle(np.cross(u[:, i], u[:, j]), np.cross(u[:, i], u[:, k])) for i, (j, k) in enumerate(turn)], 1
        )
        faces = np.stack([np.linalg.norm(np.cross(edges[:, j], edges[:, k]), axis=1) for j, k in turn], axis=1)
        signs = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float)
        diagonals = np.linalg.norm(np.einsum("ji,nic->njc", signs, edges), axis=2)
        volume = np.abs(np.einsum("nc,nc->n", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])))
    return Parallelepiped(edges, alpha, beta, faces, diagonals, volume)


def _angle(x: Array, y: Array) -> Array:
    return np.arctan2(np.linalg.norm(np.cross(x, y), axis=1), np.einsum("nc,nc->n", x, y))
