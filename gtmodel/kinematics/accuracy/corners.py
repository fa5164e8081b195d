"""Positioning error of three links with errors of their lengths or base points: its eight corners, their
parallelepiped, bounds for base points in ellipsoids (Dressler 2012, appendix A), and the largest error at many
poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from ...geometry.rotations import right_handed
from ...results import Status
from ...workers.mapped import mapped

Array = np.ndarray

# (8, 3) signs of the three links, corner by corner
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
# |det| of three unit vectors; below it errors are amplified a million times
SINGULAR = 1e-6
# largest deviation of a corner's link lengths from their intended values [m]
LENGTH_TOLERANCE = 1e-9


def first_order_corners(u: Array, r: Array) -> tuple[Array, Array]:
    """Return the errors dT_j = U^-1 (s_j * r), j = 1..8.

    Args:
        u: (n, 3, 3) unit vectors of the links, one row per link: the matrix U. r: (n, 3) or (3,) half-widths [m].

    Returns: errors (n, 8, 3) [m] and codes (n,) of `Status`: SINGULAR if the links are coplanar, NOT_FINITE for rows
    with NaN. The errors in such rows are NaN; other rows are not affected.

    Three links, two at a right angle and one oblique, with length errors of up to 0.1 mm:

    >>> u = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]]])  # links along the rows
    >>> errors, status = gt.kinematics.accuracy.first_order_corners(u, np.full(3, 1e-4))
    >>> errors.shape, status
    ((1, 8, 3), array([0]))
    >>> (1e3 * gt.kinematics.accuracy.largest(errors)).round(3)  # mm
    array([0.245])
    """
    u = np.asarray(u, dtype=float)
    r = np.broadcast_to(np.asarray(r, dtype=float), (len(u), 3))
    finite = np.asarray(np.isfinite(u).all(axis=(1, 2)) & np.isfinite(r).all(axis=1))
    status = np.where(finite, Status.OK, Status.NOT_FINITE)
    determinant = np.linalg.det(np.where(finite[:, None, None], u, np.eye(3)))
    status = np.where(finite & (np.abs(determinant) < SINGULAR), Status.SINGULAR, status)
    errors = np.full((len(u), 8, 3), np.nan)
    good = status == Status.OK
    errors[good] = np.einsum("nci,ni,ji->njc", np.linalg.inv(u[good]), r[good], SIGNS)
    return errors, status


def exact_corners(
    forward: Callable[[Array, Array], tuple[Array, Array]], q: Array, a: Array, lengths: Array, r: Array
) -> tuple[Array, Array]:
    """Return corner positions from the robot's forward kinematics with link lengths L + s_j * r (section A.3).

    Args:
        forward: called with q (k, m) and lengths (k, 3); returns T (k, 3) and codes (k,) of `Status`.
        q: (n, m) actuator coordinates. a: (n, 3, 3) base points [m]. lengths: (3,) [m]. r: (n, 3) or (3,) [m].

    Returns: corners (n, 8, 3) [m] and codes (n,). The link lengths of each corner are checked.

    The L1 with length errors of up to 0.1 mm, at the home pose:

    >>> from gtmodel.kinematics.accuracy import ForwardWithLengths, exact_corners, largest
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> forward = ForwardWithLengths(robot.causal(known="q", targets="T"), [f"L[{i}]" for i in range(3)])
    >>> q, status = robot.causal(known="T", targets="q")(robot.home)
    >>> a = robot.A + q[:, None] * robot.v
    >>> corners, status = exact_corners(forward, q[None], a[None], robot.L, np.full(3, 1e-4))
    >>> (1e3 * largest(corners - robot.home)).round(3), status  # mm
    (array([0.418]), array([0]))
    """
    n = len(q)
    r = np.broadcast_to(np.asarray(r, dtype=float), (n, 3))
    corner_lengths = (np.asarray(lengths, dtype=float) + r[:, None] * SIGNS).reshape(8 * n, 3)
    T, code = forward(np.repeat(q, 8, axis=0), corner_lengths)
    distances = np.linalg.norm(T[:, None] - np.repeat(a, 8, axis=0), axis=2)
    with np.errstate(invalid="ignore"):
        wrong = (code == Status.OK) & ~(np.abs(distances - corner_lengths) < LENGTH_TOLERANCE).all(axis=1)
    code = np.where(wrong, Status.NOT_CONVERGED, code).reshape(n, 8)
    status = code.max(axis=1)
    corners = T.reshape(n, 8, 3).copy()
    corners[status != Status.OK] = np.nan
    return corners, status


def largest(errors: Array) -> Array:
    """Return the largest error [m] (n,) of corners (n, 8, 3) relative to the nominal point.

    >>> corners = np.zeros((1, 8, 3))
    >>> corners[0, 5] = [3e-5, 0.0, 4e-5]
    >>> gt.kinematics.accuracy.largest(corners)
    array([5.e-05])
    """
    return np.linalg.norm(errors, axis=2).max(axis=1)


ITERATIONS = 50
# largest distance of the three projections from their common point [m]: just above rounding
CLOSE = 1e-12


@dataclass(frozen=True)
class Ellipsoids:
    """Ellipsoids about the nominal base points of three links, which contain the actual base points.

    Attributes:
        axes: (3, 3, 3), row k of axes[i] is the unit vector of the k-th half-axis of link i.
        half: (3, 3) half-axes [m].
    """

    axes: Array
    half: Array

    @classmethod
    def about_guideways(cls, directions: Array, along: Array, across: Array) -> Ellipsoids:
        """Return ellipsoids with one half-axis `along` each guideway and two equal half-axes `across` it, (3,) each [m]
        (Dressler 2012, Table 4.2)."""
        axes = [right_handed(v) for v in directions]
        return cls(np.array(axes), np.stack([along, across, across], axis=1).astype(float))

    def support(self, u: Array) -> Array:
        """Return the half-width of each ellipsoid along its link: sqrt(sum_k (r_k a_k.u)^2) [m], (n, 3), u (n, 3, 3).

        This is the exact first-order bound of the change in distance for base points within the ellipsoid.
        """
        along = np.einsum("ikc,nic->nik", self.axes, u)
        return np.sqrt(np.einsum("nik,ik->ni", along**2, self.half**2))


def projected_corners(a: Array, T: Array, lengths: Array, ellipsoids: Ellipsoids) -> tuple[Array, Array]:
    """Return the corners from the iterative projection of Dressler 2012, section A.2.

    The free end of link i stays between the ellipsoids about its base point with half-axes L_i - r_ik and L_i + r_ik.
    Starting at the nominal point, each iteration projects the point along the rays from the centres onto one ellipsoid
    per link and intersects the tangent planes there. To first order link i can be longer by sum_k r_k (a_k.u)^2, which
    is less than the support; the thesis notes that the exact set is slightly larger.

    Args:
        a: (n, 3, 3) nominal base points [m]. T: (n, 3) nominal intersection [m]. lengths: (3,) [m].

    Returns: corners (n, 8, 3) [m] in the order of SIGNS, NaN without convergence, and whether each converged, (n, 8).

    Base points 1 m from the common point of the links, with errors of up to 0.1 mm in all directions:

    >>> from gtmodel.kinematics.accuracy import Ellipsoids, largest, projected_corners
    >>> within = Ellipsoids(np.tile(np.eye(3), (3, 1, 1)), np.full((3, 3), 1e-4))
    >>> corners, converged = projected_corners(-np.eye(3)[None], np.zeros((1, 3)), np.ones(3), within)
    >>> (1e3 * largest(corners)).round(3), bool(converged.all())  # mm
    (array([0.173]), True)
    """
    n = len(T)
    # one row per corner: all are iterated together
    centre = np.repeat(a[:, None], 8, axis=1).reshape(n * 8, 3, 3)
    half = lengths[:, None] + SIGNS[:, :, None] * ellipsoids.half
    half = np.tile(half, (n, 1, 1))
    x = np.repeat(T, 8, axis=0)
    good = np.zeros(n * 8, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            d = x[:, None] - centre
            scaled = np.einsum("ikc,nic->nik", ellipsoids.axes, d) / half
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
    """Solve 3 x 3 systems row by row; NaN if a matrix is singular or not finite."""
    determinant = np.linalg.det(np.where(np.isfinite(matrices), matrices, 0.0))
    usable = np.isfinite(matrices).all(axis=(1, 2)) & np.isfinite(rhs).all(axis=1) & (np.abs(determinant) > 1e-12)
    solution = np.full(rhs.shape, np.nan)
    solution[usable] = np.linalg.solve(matrices[usable], rhs[usable][..., None])[..., 0]
    return solution


@dataclass(frozen=True)
class Parallelepiped:
    """The body |u_i . x| <= r_i of three links, in rows.

    Attributes:
        edges: (n, 3, 3) [m]; along row i only the length of link i changes: column i of U^-1 times 2 r_i.
        link_angles: (n, 3) [rad] angle alpha_i between links j and k, opposite to link i; also the angle between the
            faces F_j and F_k (or its supplement, for the outer normals).
        pyramid_angles: (n, 3) [rad] angle beta_i between the pyramid sides that meet in link i; also an angle of the
            parallelograms F_i.
        faces: (n, 3) [m2] areas of the parallelograms orthogonal to link i.
        diagonals: (n, 4) [m], between opposite corners; half of the longest is the largest error.
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
        """Length (n,) of the longest diagonal [m]."""
        return self.diagonals.max(axis=1)


def parallelepiped(u: Array, r: Array) -> Parallelepiped:
    """Return the parallelepiped of unit vectors u (n, 3, 3), one row per link, and half-widths r (n, 3) [m].

    Rows with coplanar links are infinite or NaN; `first_order_corners` gives their status.

    Links at right angles, with errors of at most 1, 2 and 3 mm, give a box:

    >>> box = gt.kinematics.accuracy.parallelepiped(np.eye(3)[None], np.array([[1e-3, 2e-3, 3e-3]]))
    >>> (1e3 * box.edges[0]).round(6)  # mm, full widths
    array([[2., 0., 0.],
           [0., 4., 0.],
           [0., 0., 6.]])
    >>> (1e6 * box.faces).round(6)  # mm2
    array([[24., 12.,  8.]])
    """
    u = np.asarray(u, dtype=float)
    r = np.broadcast_to(np.asarray(r, dtype=float), (len(u), 3))
    pairs = [(1, 2), (2, 0), (0, 1)]
    # column i of U^-1 is u_j x u_k / det U: orthogonal to the two links that keep their length
    normals = np.stack([np.cross(u[:, j], u[:, k]) for j, k in pairs], axis=1)
    determinant = np.einsum("nc,nc->n", u[:, 0], normals[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = 2 * r[..., None] * normals / determinant[:, None, None]
        alpha = np.stack([_angle(u[:, j], u[:, k]) for j, k in pairs], axis=1)
        # the pyramid sides that meet in link i contain (i, j) and (i, k)
        beta = np.stack(
            [_angle(np.cross(u[:, i], u[:, j]), np.cross(u[:, i], u[:, k])) for i, (j, k) in enumerate(pairs)], 1
        )
        faces = np.stack([np.linalg.norm(np.cross(edges[:, j], edges[:, k]), axis=1) for j, k in pairs], axis=1)
        signs = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float)
        diagonals = np.linalg.norm(np.einsum("ji,nic->njc", signs, edges), axis=2)
        volume = np.abs(np.einsum("nc,nc->n", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])))
    return Parallelepiped(edges, alpha, beta, faces, diagonals, volume)


def _angle(x: Array, y: Array) -> Array:
    return np.arctan2(np.linalg.norm(np.cross(x, y), axis=1), np.einsum("nc,nc->n", x, y))


Method = Literal["support", "projection"]
CHUNK = 4096


@dataclass(frozen=True)
class ErrorCase:
    """Errors of three links: of their lengths, or of base points within ellipsoids.

    Attributes:
        lengths: (3,) nominal link lengths [m].
        radius: (3,) half-widths of length errors, or radii of spheres about the base points [m], which are equivalent
            to first order (Dressler 2012, section A.3). None if `ellipsoids` is set.
        ellipsoids: of the base points; None if `radius` is set.
        method: how corners are computed from ellipsoids: "support", the exact first-order bound, or "projection", the
            iteration of the appendix, which gives slightly smaller errors.
    """

    lengths: Array
    radius: Array | None = None
    ellipsoids: Ellipsoids | None = None
    method: Method = "support"

    def half_widths(self, u: Array) -> Array:
        """Return r (n, 3) [m] for link directions u (n, 3, 3)."""
        if self.ellipsoids is not None:
            return self.ellipsoids.support(u)
        assert self.radius is not None
        return np.broadcast_to(self.radius, (len(u), 3))

    def corners(self, a: Array, T: Array) -> tuple[Array, Array]:
        """Return the errors at the corners (n, 8, 3) [m] for base points a (n, 3, 3) and T (n, 3), and codes (n,) of
        `Status`."""
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
    """Errors at n points: largest error [m] (n,), face areas (n, 3) [m2], codes of `Status` (n,)."""

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
    """Return the largest error at the points T (n, 3) [m]; NaN if the status is not OK.

    Args:
        base_points: called with T (k, 3), returns the base points (k, 3, 3) [m] and codes (k,) of `Status`.
        progress: called with the completed fraction; if it returns True, the work stops and the rest is NaN.

    The L1 with length errors of up to 0.1 mm at two points; the second point is out of reach:

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
    slices = [slice(begin, min(begin + chunk, n)) for begin in range(0, n, chunk)]
    parts = mapped(partial(_errors, case, base_points), (T[rows] for rows in slices))
    for rows, part in zip(slices, parts, strict=True):
        error[rows], faces[rows], status[rows] = part
        if progress is not None and progress(rows.stop / n) and rows.stop < n:
            return ErrorMap(error, faces, status, complete=False)
    return ErrorMap(error, faces, status, complete=True)


def _errors(case: ErrorCase, base_points: Callable[[Array], tuple[Array, Array]], T: Array) -> tuple[Array, ...]:
    """Return error (k,), face areas (k, 3) and codes (k,) at some points."""
    a, code = base_points(T)
    corners, corner_status = case.corners(a, T)
    status, faces = np.where(code != Status.OK, code, corner_status), np.full((len(T), 3), np.nan)
    good = status == Status.OK
    u = T[good][:, None] - a[good]
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    faces[good] = parallelepiped(u, case.half_widths(u)).faces
    return np.where(good, largest(corners), np.nan), faces, status
