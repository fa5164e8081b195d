"""The greatest positioning error at many poses, chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...results import Status
from .corners import Array, first_order_corners, largest
from .ellipsoids import Ellipsoids, projected_corners
from .parallelepiped import parallelepiped

Method = Literal["support", "projection"]
CHUNK = 4096


@dataclass(frozen=True)
class ErrorCase:
    """Errors of three links: of their lengths, or of base points within ellipsoids.

    Attributes:
        lengths: (3,) nominal link lengths [m].
        radius: (3,) half-widths of length errors, or radii of spheres about the base points [m]: the same thing to
            first order (Dressler 2012, section A.3). None where there are ellipsoids.
        ellipsoids: of the base points; None where there is a radius.
        method: how ellipsoids become corners: "support", the exact first-order bound, or "projection", the
            appendix's iteration, which is a little less.
    """

    lengths: Array
    radius: Array | None = None
    ellipsoids: Ellipsoids | None = None
    method: Method = "support"

    def half_widths(self, u: Array) -> Array:
        """r (n, 3) [m] for link directions u (n, 3, 3)."""
        if self.ellipsoids is not None:
            return self.ellipsoids.support(u)
        assert self.radius is not None
        return np.broadcast_to(self.radius, (len(u), 3))

    def corners(self, a: Array, T: Array) -> tuple[Array, Array]:
        """Errors at the corners (n, 8, 3) [m] for base points a (n, 3, 3) and T (n, 3), and codes (n,) of `Status`."""
        with np.errstate(invalid="ignore"):
            u = (T[:, None] - a) / np.linalg.norm(T[:, None] - a, axis=2, keepdims=True)
        errors, status = first_order_corners(u, self.half_widths(u))
        if self.ellipsoids is not None and self.method == "projection":
            good = status == Status.OK
            corners, converged = projected_corners(a[good], T[good], self.lengths, self.ellipsoids)
            errors[good] = corners - T[good, None]
            status[np.flatnonzero(good)[~converged.all(axis=1)]] = Status.NOT_CONVERGED
            errors[status != Status.OK] = np.nan
        return errors, status


@dataclass(frozen=True)
class ErrorMap:
    """Errors at n points: greatest error [m] (n,), face areas (n, 3) [m2], codes of `Status` (n,)."""

    error: Array
    faces: Array
    status: Array
    complete: bool


def map_errors(
    case: ErrorCase,
    base_points: Callable[[Array], tuple[Array, Array]],
    T: Array,
    *,
    chunk: int = CHUNK,
    progress: Callable[[float], bool] | None = None,
) -> ErrorMap:
    """The greatest error at the points T (n, 3) [m]; NaN with a status where there is none.

    Args:
        base_points: called with T (k, 3), returns the base points (k, 3, 3) [m] and codes (k,) of `Status`.
        progress: called with the fraction done; returning True stops the work, the rest is NaN.

    The L1 at two points, whose links may be 0.1 mm too long or too short; the second is out of reach:

    >>> from gtmodel.kinematics.accuracy import ErrorCase, map_errors
    >>> from gtmodel.kinematics.workspace import Bodies, limited_mechanism
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> def base_points(T):
    ...     poses = robot.inverse(T)
    ...     return poses.a, poses.status
    ...
    >>> case = ErrorCase(lengths=robot.lengths, radius=np.full(3, 1e-4))
    >>> T = np.array([[1.4, -0.4, 0.9], [1.4, -0.4, 9.0]])
    >>> errors = map_errors(case, base_points, T)
    >>> (1e3 * errors.error).round(3), errors.status  # mm
    (array([0.42,  nan]), array([0, 1]))
    """
    n = len(T)
    error, faces = np.full(n, np.nan), np.full((n, 3), np.nan)
    status = np.full(n, Status.NOT_FINITE)
    for begin in range(0, n, chunk):
        rows = slice(begin, min(begin + chunk, n))
        a, code = base_points(T[rows])
        corners, corner_status = case.corners(a, T[rows])
        status[rows] = np.where(code != Status.OK, code, corner_status)
        good = status[rows] == Status.OK
        error[rows] = np.where(good, largest(corners), np.nan)
        u = T[rows][good][:, None] - a[good]
        u /= np.linalg.norm(u, axis=2, keepdims=True)
        faces[np.arange(n)[rows][good]] = parallelepiped(u, case.half_widths(u)).faces
        if progress is not None and progress(rows.stop / n) and rows.stop < n:
            return ErrorMap(error, faces, status, complete=False)
    return ErrorMap(error, faces, status, complete=True)
