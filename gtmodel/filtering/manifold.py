"""States and readings on manifolds: unit quaternions and directions besides R^n, on rows of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from ..geometry.quaternions import conjugate, exponential, guarded, logarithm, product, turn_matrix
from ..results.refusal import ArgumentError


class RowsFunction:
    """A CasADi function of columns, called with rows: arguments (m, size), results (m, size) or (m, rows, columns).

    An argument with one row is used for all rows. Each call returns new arrays. matrices: positions of the results
    that are matrices even with a single column.
    """

    def __init__(self, name: str, arguments: list[Any], results: list[Any], matrices: tuple[int, ...] = ()) -> None:
        columns = [k not in matrices and r.shape[1] == 1 for k, r in enumerate(results)]
        self.shapes = [r.shape[:1] if column else r.shape for column, r in zip(columns, results, strict=True)]
        dense = [ca.densify(r.T if r.shape[1] != 1 else r) for r in results]  # CasADi stores column by column
        self.function = ca.Function(name, arguments, dense, {"cse": True})
        self._sizes = [a.numel() for a in arguments]
        self._buffers: dict[int, tuple[list[np.ndarray], list[np.ndarray], Any, Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_buffers": {}}

    def __call__(self, *values: Any) -> list[np.ndarray]:
        rows = 1
        for v in values:
            if isinstance(v, np.ndarray) and v.ndim == 2 and len(v) > rows:
                rows = len(v)
        memories, results, run, _ = self._buffers.get(rows) or self._prepared(rows)
        for memory, value in zip(memories, values, strict=True):
            if memory.size:
                memory[...] = value
        run()
        return [r.copy() for r in results]

    def _prepared(self, rows: int) -> tuple[list[np.ndarray], list[np.ndarray], Any, Any]:
        f = self.function if rows == 1 else self.function.map(rows)
        memories = [np.zeros((rows, size)) for size in self._sizes]
        results = [np.zeros((rows, *s)) for s in self.shapes]
        buffer, run = f.buffer()
        set_arg: Any = buffer.set_arg
        set_res: Any = buffer.set_res
        places: list[tuple[Any, list[Any]]] = [(set_arg, memories), (set_res, results)]
        for setter, arrays in places:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))
        if len(self._buffers) > MOST_SIZES:
            self._buffers.pop(next(iter(self._buffers)))
        self._buffers[rows] = memories, results, run, (buffer, f)
        return self._buffers[rows]


MOST_SIZES = 8  # numbers of rows whose buffers are kept


PartKind = Literal["vector", "quaternion", "direction"]
UNIT_LENGTH = 1e-6  # a quaternion or direction further from unit length is not just rounded
DIMENSION = {"quaternion": 3, "direction": 2}
SIZE = {"quaternion": 4, "direction": 3}


@dataclass(frozen=True)
class StatePart:
    """One named part of a state or a reading.

    kind: "vector"; "quaternion", of unit length, scalar first, body to world; "direction", a unit vector in space.
    size: how many numbers it has. unit: their unit.
    """

    name: str
    kind: PartKind = "vector"
    size: int = 1
    unit: str = "1"

    def __post_init__(self) -> None:
        if self.kind != "vector" and self.size != SIZE[self.kind]:
            raise ArgumentError(f"a {self.kind} has {SIZE[self.kind]} numbers; '{self.name}' has {self.size}", "kind")

    @property
    def dimension(self) -> int:
        """Degrees of freedom: the length of its error."""
        return DIMENSION.get(self.kind, self.size)

    @property
    def error_unit(self) -> str:
        """Unit of the error of this part."""
        return self.unit if self.kind == "vector" else "rad"

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the components of its error; for a quaternion, rotations about the axes of the body."""
        if self.kind == "vector" and self.size == 1:
            return (self.name,)
        return tuple(f"{self.name}[{k}]" for k in range(self.dimension))


class Manifold:
    """Product of vectors, unit quaternions and directions, with the operations plus and minus.

    A point x has `size` numbers, an error d has `dimension` numbers: plus(x, d) is the point at distance d from x, and
    minus(y, x) is the error from x to y, so plus(x, minus(y, x)) = y. The error of a quaternion is a rotation vector
    [rad] in the axes of the body, q plus d = q * exp(d / 2); q and -q are the same orientation. The error of a
    direction is the angle [rad] along two axes perpendicular to it.

    Source: Hertzberg, Wagner, Frese, Schroeder 2013, Information Fusion 14, 57-77.

    >>> from gtmodel.filtering import Manifold, StatePart
    >>> space = Manifold([StatePart("p", size=3, unit="m"), StatePart("Q", "quaternion", 4)])
    >>> space.size, space.dimension
    (7, 6)
    >>> x = np.array([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    >>> y = space.plus(x, [0.1, 0.0, 0.0, 0.0, 0.0, np.pi / 2])
    >>> space.minus(y, x).round(9).tolist()
    [0.1, 0.0, 0.0, 0.0, 0.0, 1.570796327]
    >>> space.minus(-y, x)[5].round(9)  # the other sign of the quaternion is the same orientation
    np.float64(1.570796327)
    """

    def __init__(self, parts: Sequence[StatePart]) -> None:
        self.parts = tuple(parts)
        names = [part.name for part in self.parts]
        if len(set(names)) != len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise ArgumentError(f"'{twice}' is there twice; name each part once", "parts")
        self.size = sum(part.size for part in self.parts)
        self.dimension = sum(part.dimension for part in self.parts)

    @cached_property
    def flat(self) -> bool:
        """Whether this is R^n, where plus and minus are sum and difference."""
        return all(part.kind == "vector" for part in self.parts)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the components of an error, in order."""
        return tuple(label for part in self.parts for label in part.labels)

    @property
    def error_units(self) -> tuple[str, ...]:
        """Units of the components of an error, in order."""
        return tuple(part.error_unit for part in self.parts for _ in range(part.dimension))

    def part(self, name: str) -> tuple[StatePart, slice, slice]:
        """Return a part by name, its slice in a point and its slice in an error.

        Raises ArgumentError for an unknown name.
        """
        for part, at, along in self.places():
            if part.name == name:
                return part, at, along
        names = ", ".join(f"'{part.name}'" for part in self.parts)
        raise ArgumentError(f"there is no state '{name}'; the states are {names}", "name")

    def places(self) -> list[tuple[StatePart, slice, slice]]:
        """Return all parts, each with its slice in a point and its slice in an error."""
        places, i, j = [], 0, 0
        for part in self.parts:
            places.append((part, slice(i, i + part.size), slice(j, j + part.dimension)))
            i, j = i + part.size, j + part.dimension
        return places

    # -- on symbols ------------------------------------------------------------------------------------

    def plus_symbols(self, x: Any, d: Any) -> Any:
        """Return plus on CasADi columns."""
        return ca.vertcat(*[_PLUS[part.kind](x[at], d[along]) for part, at, along in self.places()])

    def minus_symbols(self, y: Any, x: Any) -> Any:
        """Return minus on CasADi columns."""
        return ca.vertcat(*[_MINUS[part.kind](y[at], x[at]) for part, at, along in self.places()])

    def from_error(self, x: Any) -> Any:
        """Return d plus(x, d) / dd at d = 0 (size, dimension), on CasADi columns."""
        return ca.diagcat(*[_FROM[part.kind](x[at]) for part, at, _ in self.places()])

    def to_error(self, x: Any) -> Any:
        """Return d minus(y, x) / dy at y = x (dimension, size), on CasADi columns."""
        return ca.diagcat(*[_TO[part.kind](x[at]) for part, at, _ in self.places()])

    def to_unit(self, x: Any) -> Any:
        """Scale quaternions and directions to unit length, on CasADi columns."""
        return ca.vertcat(*[x[at] if part.kind == "vector" else _unit(x[at]) for part, at, _ in self.places()])

    # -- on numbers ------------------------------------------------------------------------------------

    @cached_property
    def _functions(self) -> tuple[RowsFunction, RowsFunction, RowsFunction]:
        x, y, d = ca.SX.sym("x", self.size), ca.SX.sym("y", self.size), ca.SX.sym("d", self.dimension)
        point = self.plus_symbols(x, d)
        carried = ca.mtimes(self.to_error(point), ca.jacobian(point, d))
        return (
            RowsFunction("plus", [x, d], [point]),
            RowsFunction("minus", [y, x], [self.minus_symbols(y, x)]),
            RowsFunction("carried", [x, d], [carried], (0,)),
        )

    def plus(self, x: Any, d: Any) -> np.ndarray:
        """Return the points (..., size) at errors d (..., dimension) from x (..., size)."""
        x, d = np.asarray(x, float), np.asarray(d, float)
        return x + d if self.flat else _rows(self._functions[0], x, d)

    def minus(self, y: Any, x: Any) -> np.ndarray:
        """Return the errors (..., dimension) from x to y, both (..., size)."""
        y, x = np.asarray(y, float), np.asarray(x, float)
        return y - x if self.flat else _rows(self._functions[1], y, x)

    def carried(self, x: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Return the Jacobians (n, dimension, dimension) that transport errors at x (n, size) to plus(x, d)."""
        return self._functions[2](x, d)[0]

    def mean(self, points: np.ndarray, weights: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return the intrinsic mean (m, size) of points (m, k, size) with weights (k,) or (m, k) that sum to one.

        The weighted errors from the mean to all points sum to zero. guess: (m, size).
        """
        w = np.broadcast_to(weights, points.shape[:2])[..., None]
        if self.flat:
            return np.sum(w * points, axis=1)
        mean = guess
        for _ in range(MEAN_STEPS):
            step = np.sum(w * self.minus(points, mean[:, None]), axis=1)
            mean = self.plus(mean, step)
            if np.max(np.abs(step[:, self._angles]), initial=0.0) < MEAN_TOLERANCE:
                break
        return mean

    @cached_property
    def _angles(self) -> list[int]:
        """Places of the angles in an error."""
        curved = [along for part, _, along in self.places() if part.kind != "vector"]
        return [k for along in curved for k in range(along.start, along.stop)]

    def point(self, values: Mapping[str, Any], argument: str = "mean") -> np.ndarray:
        """Return a point (size,) from values by name; a part that is not named is zero, or the identity.

        Raises ArgumentError for a wrong name or shape, and for a quaternion or direction that is not of unit length.
        """
        point = np.concatenate([_zero(part) for part in self.parts]) if self.parts else np.zeros(0)
        for name, value in values.items():
            part, at, _ = self.part(name)
            try:
                numbers = np.asarray(value, float).reshape(-1)
            except (TypeError, ValueError):
                raise ArgumentError(f"expected numbers; found {value!r}", f"{argument}.{name}") from None
            if numbers.shape != (part.size,) or not np.all(np.isfinite(numbers)):
                raise ArgumentError(f"expected {part.size} finite numbers; found {value!r}", f"{argument}.{name}")
            if part.kind != "vector" and abs(np.linalg.norm(numbers) - 1.0) > UNIT_LENGTH:
                length = np.linalg.norm(numbers)
                raise ArgumentError(
                    f"expected a {part.kind} of unit length; found length {length:.6g}", f"{argument}.{name}"
                )
            point[at] = numbers if part.kind == "vector" else numbers / np.linalg.norm(numbers)
        return point

    def values(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Split points (..., size) by name; scalars have no last axis."""
        return {
            part.name: points[..., at.start] if part.kind == "vector" and part.size == 1 else points[..., at]
            for part, at, _ in self.places()
        }

    def errors(self, d: np.ndarray) -> dict[str, np.ndarray]:
        """Split errors (..., dimension) by name; scalars have no last axis."""
        return {
            part.name: d[..., along.start] if part.dimension == 1 else d[..., along] for part, _, along in self.places()
        }


MEAN_STEPS = 30
MEAN_TOLERANCE = 1e-13  # rad; the mean of angles is iterated to round-off


def _rows(f: RowsFunction, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    if a.ndim == b.ndim == 2 and len(a) == len(b) > 0:
        return f(a, b)[0]
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    wide = [v if v.shape[:-1] == shape else np.broadcast_to(v, (*shape, v.shape[-1])) for v in (a, b)]
    result = f(*[v.reshape(-1, v.shape[-1]) for v in wide])[0]
    return result.reshape(*shape, result.shape[-1])


def _zero(part: StatePart) -> np.ndarray:
    zero = np.zeros(part.size)
    if part.kind != "vector":
        zero[0 if part.kind == "quaternion" else 2] = 1.0
    return zero


# -- quaternions ----------------------------------------------------------------------------------------


def _plus_quaternion(q: Any, d: Any) -> Any:
    return product(q, exponential(d))


def _minus_quaternion(q: Any, q0: Any) -> Any:
    return logarithm(product(conjugate(q0), q))


def _to_quaternion(q: Any) -> Any:
    return 4 * turn_matrix(q).T


# -- directions -----------------------------------------------------------------------------------------


def _axes(n: Any) -> Any:
    """Two unit vectors (3, 2) perpendicular to a unit vector: Duff et al. 2017, J. Comput. Graph. Tech. 6(1)."""
    sign = ca.if_else(n[2] < 0, -1.0, 1.0)
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    return ca.horzcat(
        ca.vertcat(1 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]), ca.vertcat(b, sign + n[1] * n[1] * a, -n[1])
    )


def _plus_direction(n: Any, d: Any) -> Any:
    square = ca.dot(d, d)
    small, safe = guarded(square)
    angle = ca.sqrt(safe)
    scalar = ca.if_else(small, 1 - square / 2, ca.cos(angle))
    factor = ca.if_else(small, 1 - square / 6, ca.sin(angle) / angle)
    return scalar * n + factor * ca.mtimes(_axes(n), d)


def _minus_direction(n: Any, n0: Any) -> Any:
    n = _unit(n)  # a reading may have another length; zero length gives NaN
    v = ca.mtimes(_axes(n0).T, n)
    scalar = ca.dot(n, n0)
    square = ca.dot(v, v)
    small, safe = guarded(square)
    sine = ca.sqrt(safe)
    return ca.if_else(small, 1 + square / 6, ca.atan2(sine, scalar) / sine) * v


def _from_direction(n: Any) -> Any:
    return _axes(n)


def _to_direction(n: Any) -> Any:
    return _axes(n).T


def _unit(x: Any) -> Any:
    return x / ca.sqrt(ca.dot(x, x))


_PLUS = {"vector": lambda x, d: x + d, "quaternion": _plus_quaternion, "direction": _plus_direction}
_MINUS = {"vector": lambda y, x: y - x, "quaternion": _minus_quaternion, "direction": _minus_direction}
_FROM = {"vector": lambda x: ca.DM.eye(x.numel()), "quaternion": turn_matrix, "direction": _from_direction}
_TO = {"vector": lambda x: ca.DM.eye(x.numel()), "quaternion": _to_quaternion, "direction": _to_direction}
