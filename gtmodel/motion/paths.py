"""Paths to follow: the curve x(s), s from 0 to 1, evaluated numerically or as an expression in a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Protocol

import numpy as np
import scipy

from .. import lang as gt
from ..results import ArgumentError, TrajectoryError
from ..results.trajectory_csv import Header, read_table
from .options import Arc, Line, Polyline, Shape, Spline, Taught

SAME_M = 1e-6  # largest distance of the path's ends from start and goal
COLUMNS = ("x_m", "y_m", "z_m")
NODES = 32  # of the quadrature of the speed along one piece: exact to rounding even for sharp bends
Sampled = tuple[np.ndarray, np.ndarray, np.ndarray]


class Path(Protocol):
    """A curve x(s) (3,) [m] with two continuous derivatives, s from 0 to 1.

    Calling it with s (n,) returns x and its first and second derivative, (n, 3) each; `expression` returns x for a
    model's equations. length: of the curve [m]; for a polyline with rounded corners.
    """

    @property
    def length(self) -> float: ...

    def __call__(self, s: np.ndarray) -> Sampled: ...

    def expression(self, s: Any, metre: Any) -> Any: ...


@dataclass(frozen=True, eq=False)
class Pieces:
    """A curve of polynomial pieces on [0, 1]."""

    poly: scipy.interpolate.PPoly
    length: float

    def __call__(self, s: np.ndarray) -> Sampled:
        return self.poly(s), self.poly(s, 1), self.poly(s, 2)

    def expression(self, s: Any, metre: Any) -> Any:
        return metre * gt.piecewise(s, self.poly.x, self.poly.c)


@dataclass(frozen=True, eq=False)
class CircleArc:
    """A circular arc: center + a cos(angle s) + b sin(angle s) [m]."""

    center: np.ndarray
    a: np.ndarray
    b: np.ndarray
    angle: float

    @property
    def length(self) -> float:
        return float(self.angle * np.linalg.norm(self.a))

    def __call__(self, s: np.ndarray) -> Sampled:
        c, d = (np.multiply.outer(f(self.angle * s), v) for f, v in ((np.cos, self.a), (np.sin, self.b)))
        e, f = (np.multiply.outer(f(self.angle * s), v) for f, v in ((np.sin, self.a), (np.cos, self.b)))
        return self.center + c + d, self.angle * (f - e), -(self.angle**2) * (c + d)

    def expression(self, s: Any, metre: Any) -> Any:
        cos_sin = gt.cos(self.angle * s), gt.sin(self.angle * s)
        return gt.vector([metre * (self.center[i] + self.a[i] * cos_sin[0] + self.b[i] * cos_sin[1]) for i in range(3)])


def path_of(shape: Shape, start: np.ndarray, goal: np.ndarray) -> Path:
    """Return the path of a shape from start (3,) to goal (3,) [m]. Raises ArgumentError."""
    match shape:
        case Line():
            return line(start, goal)
        case Polyline():
            return polyline(np.array([start, *shape.via, goal]), shape.blend)
        case Arc():
            return arc(start, np.array(shape.through), goal)
        case Spline():
            path, within = spline(_points(shape)), SAME_M
        case Taught():
            path, within = taught(_points(shape), shape.tolerance), max(SAME_M, 3 * shape.tolerance)
        case _:
            raise ArgumentError(f"is a {type(shape).__name__}; expected Line, Polyline, Arc, Spline or Taught", "path")
    ends = path(np.array([0.0, 1.0]))[0]
    for name, point, end in (("start", start, ends[0]), ("goal", goal, ends[1])):
        if np.linalg.norm(point - end) > within:
            coordinates = ", ".join(f"{x:.6g}" for x in end)
            raise ArgumentError(
                f"is {1e3 * np.linalg.norm(point - end):.3g} mm from the end of the path through the points, "
                f"({coordinates}) m; use these coordinates",
                f"{name}.tcp",
            )
    return path


def _points(shape: Spline | Taught) -> np.ndarray:
    points = np.asarray(shape.points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ArgumentError(f"expected shape (n, 3); found {points.shape}", "path.points")
    if isinstance(shape, Spline):
        if len(points) < 3:
            raise ArgumentError(f"has {len(points)} points; a spline needs at least 3", "path.points")
        if np.any(np.all(np.diff(points, axis=0) == 0, axis=1)):
            raise ArgumentError("contains a point twice in a row; remove it, or use a taught path", "path.points")
    return points


def read_points(file: str | FilePath) -> np.ndarray:
    """Read points (n, 3) [m] from a CSV file with the columns x_m, y_m and z_m; lines that begin with # are comments.

    Raises ArgumentError if the file cannot be read, lacks a column, or has a cell that is not a finite number.

    >>> with open("points.csv", "w") as file:
    ...     file.write("# taught on Monday\\nx_m,y_m,z_m\\n0.0,-0.9,0.1\\n0.1,-0.9,0.2\\n0.2,-0.9,0.1\\n") and None
    >>> gt.motion.read_points("points.csv").shape
    (3, 3)
    """
    try:
        return read_table(file, _coordinates).values
    except OSError as error:
        raise ArgumentError(f"{FilePath(file).name} cannot be read: {error.strerror}", "file") from error
    except TrajectoryError as error:
        raise ArgumentError(error.message, "file") from error


def _coordinates(cells: Sequence[str], where: str) -> Header:
    missing = [column for column in COLUMNS if column not in cells]
    if missing:
        raise TrajectoryError(f"{where} has no column '{missing[0]}'; expected {', '.join(COLUMNS)}")
    return list(COLUMNS), ["m"] * 3, [cells.index(column) for column in COLUMNS]


def line(start: np.ndarray, goal: np.ndarray) -> Path:
    """Return the straight line."""
    step = goal - start
    piece = scipy.interpolate.PPoly(np.array([[step], [start]]), np.array([0.0, 1.0]))
    return Pieces(piece, float(np.linalg.norm(step)))


def polyline(points: np.ndarray, blend: float) -> Path:
    """Return straight segments; a quintic with continuous curvature rounds each corner over `blend` [m] per side."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if np.any(lengths == 0):
        raise ArgumentError(f"contains point {int(np.argmin(lengths)) + 1} twice in a row; remove it", "path.via")
    d = steps / lengths[:, None]
    inner = np.where(np.arange(len(lengths)) % (len(lengths) - 1 or 1) == 0, blend, 2 * blend)  # ends: one blend only
    if len(lengths) > 1 and np.any(lengths <= inner):
        k = int(np.argmin(lengths - inner))
        raise ArgumentError(f"segment {k + 1} is {lengths[k]:.4g} m long, too short for its blends", "path.blend")
    breaks, coefficients, position = [0.0], [], 0.0

    def add(length: float, c: np.ndarray) -> None:
        nonlocal position
        position += length
        breaks.append(position)
        coefficients.append(np.vstack([np.zeros((6 - len(c), 3)), c]))

    for k, (p, direction, length) in enumerate(zip(points[:-1], d, lengths, strict=True)):
        first, last = (blend if k > 0 else 0.0), (blend if k < len(d) - 1 else 0.0)
        add(length - first - last, np.array([direction, p + first * direction]))
        if last:
            corner, after = points[k + 1], d[k + 1]
            bezier = [corner + blend * f * e for f, e in ((-1, direction), (-0.6, direction), (-0.2, direction),
                                                           (0.2, after), (0.6, after), (1, after))]  # fmt: skip
            add(2 * blend, _powers(np.array(bezier)) / (2 * blend) ** np.arange(5, -1, -1)[:, None])
    return _scaled(np.array(breaks), np.stack(coefficients, axis=1))


def _powers(bezier: np.ndarray) -> np.ndarray:
    """Return the power coefficients (6, 3), highest first, of a quintic with these control points."""
    from scipy.interpolate import BPoly

    return scipy.interpolate.PPoly.from_bernstein_basis(BPoly(bezier[:, None, :], [0.0, 1.0])).c[:, 0]


def _arc_length(curve: scipy.interpolate.PPoly) -> float:
    """Return the length of a curve [m] by Gauss-Legendre quadrature of its speed on each piece."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    half = np.diff(curve.x)[:, None] / 2
    speed = np.linalg.norm(curve(curve.x[:-1, None] + half * (1 + nodes), 1), axis=-1)
    return float(np.sum(half * weights * speed))


def _scaled(breaks: np.ndarray, coefficients: np.ndarray) -> Pieces:
    """Return the curve over the length of its polygon, rescaled to s in [0, 1]."""
    total = float(breaks[-1])
    powers = total ** np.arange(len(coefficients) - 1, -1, -1)
    x = breaks / total
    x[-1] = 1.0
    curve = scipy.interpolate.PPoly(coefficients * powers[:, None, None], x)
    return Pieces(curve, _arc_length(curve))


def arc(start: np.ndarray, through: np.ndarray, goal: np.ndarray) -> Path:
    """Return the circular arc from start to goal through a third point."""
    u, w = through - start, goal - start
    normal = np.cross(u, w)
    size = float(normal @ normal)
    if size <= 1e-12 * float(u @ u) * float(w @ w):
        raise ArgumentError("lies on the straight line from start to goal, so there is no circle", "path.through")
    center = start + np.cross(float(u @ u) * w - float(w @ w) * u, normal) / (2 * size)
    a = start - center
    b = np.cross(normal, a) / np.sqrt(size)
    angle = float(np.arctan2((goal - center) @ b, (goal - center) @ a)) % (2 * np.pi)
    return CircleArc(center, a, b, angle)


def spline(points: np.ndarray) -> Path:
    """Return the natural cubic spline through the points, over the length of their polygon."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    curve = scipy.interpolate.CubicSpline(lengths, points, bc_type="natural")
    return _scaled(lengths, curve.c)


def taught(points: np.ndarray, tolerance: float) -> Path:
    """Return a smooth curve with an RMS distance of `tolerance` [m] from recorded points."""
    distinct = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9])
    points = points[distinct]  # a robot led by hand pauses at times
    if len(points) < 6:
        raise ArgumentError(f"has {len(points)} distinct points; a taught path needs at least 6", "path.points")
    (fitted, _) = scipy.interpolate.make_splprep(points.T, k=3, s=len(points) * tolerance**2)  # type: ignore[arg-type]
    knots = np.unique(np.clip(fitted.t, 0.0, 1.0))
    c = [fitted(knots[:-1], nu).T / factor for nu, factor in ((3, 6.0), (2, 2.0), (1, 1.0), (0, 1.0))]
    curve = scipy.interpolate.PPoly(np.array(c), knots)
    return Pieces(curve, _arc_length(curve))
