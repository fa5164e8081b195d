"""States and readings that are no plain vectors, unit quaternions and directions beside R^n, on rows of numbers."""

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
    """A function of columns, called with rows: arguments (m, size), results (m, size), of a matrix (m, rows, columns).

    An argument of one row stands for all. The results are new at each call. matrices: places of results that are
    matrices even where they have a single column.
    """

    def __init__(self, name: str, arguments: list[Any], results: list[Any], matrices: tuple[int, ...] = ()) -> None:
        columns = [k not in matrices and r.shape[1] == 1 for k, r in enumerate(results)]
        self.shapes = [r.shape[:1] if column else r.shape for column, r in zip(columns, results, strict=True)]
        dense = [ca.densify(r.T if r.shape[1] != 1 else r) for r in results]  # CasADi stores column by column
        self.function = ca.Function(name, arguments, dense, {"cse": True})
        self._sizes = [a.numel() for a in arguments]
        self._made: dict[int, tuple[list[np.ndarray], list[np.ndarray], Any, Any]] = {}

    def __call__(self, *values: Any) -> list[np.ndarray]:
        rows = 1
        for v in values:
            if isinstance(v, np.ndarray) and v.ndim == 2 and len(v) > rows:
                rows = len(v)
        given, results, run, _ = self._made.get(rows) or self._prepared(rows)
        for memory, value in zip(given, values, strict=True):
            memory[...] = value
        run()
        return [r.copy() for r in results]

    def _prepared(self, rows: int) -> tuple[list[np.ndarray], list[np.ndarray], Any, Any]:
        f = self.function if rows == 1 else self.function.map(rows)
        given = [np.zeros((rows, size)) for size in self._sizes]
        results = [np.zeros((rows, *s)) for s in self.shapes]
        buffer, run = f.buffer()
        set_arg: Any = buffer.set_arg
        set_res: Any = buffer.set_res
        places: list[tuple[Any, list[Any]]] = [(set_arg, given), (set_res, results)]
        for setter, arrays in places:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))
        if len(self._made) > MOST_SIZES:
            self._made.pop(next(iter(self._made)))
        self._made[rows] = given, results, run, (buffer, f)
        return self._made[rows]


MOST_SIZES = 8  # numbers of rows whose memory is kept


PartKind = Literal["vector", "quaternion", "direction"]
UNIT_LENGTH = 1e-6  # a quaternion or direction further from unit length is no rounded one
DIMENSION = {"quaternion": 3, "direction": 2}
SIZE = {"quaternion": 4, "direction": 3}


@dataclass(frozen=True)
class StatePart:
    """One named part of a state or a reading.

    kind: "vector"; "quaternion", of unit length, scalar first, body to world; "direction", a unit vector in space.
    size: how many numbers it has. unit: of these numbers.
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
        """Names of the components of its error; of a turn about the axes of the body."""
        if self.kind == "vector" and self.size == 1:
            return (self.name,)
        return tuple(f"{self.name}[{k}]" for k in range(self.dimension))


class Manifold:
    """A product of vectors, unit quaternions and directions, with a difference of two points.

    A point x has `size` numbers, an error d has `dimension`: plus(x, d) is the point that lies d from x, minus(y, x)
    the error that leads from x to y, so plus(x, minus(y, x)) = y. Of a quaternion the error is a rotation vector [rad]
    in the axes of the body, q plus d = q * exp(d / 2); q and -q are one orientation. Of a direction it is the angle
    [rad] along two axes at right angles to it.

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
            raise ArgumentError(f"'{twice}' is named twice; name each part once", "parts")
        self.size = sum(part.size for part in self.parts)
        self.dimension = sum(part.dimension for part in self.parts)

    @cached_property
    def flat(self) -> bool:
        """Whether it is R^n, so that plus and minus are sum and difference."""
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
        """A part by name, where it stands in a point and where in an error. Raises ArgumentError for a name that is
        not there."""
        for part, at, along in self.places():
            if part.name == name:
                return part, at, along
        there = ", ".join(f"'{part.name}'" for part in self.parts)
        raise ArgumentError(f"there is no state '{name}'; there are {there}", "name")

    def places(self) -> list[tuple[StatePart, slice, slice]]:
        """The parts, where each stands in a point, and where in an error."""
        places, i, j = [], 0, 0
        for part in self.parts:
            places.append((part, slice(i, i + part.size), slice(j, j + part.dimension)))
            i, j = i + part.size, j + part.dimension
        return places

    # -- on symbols ------------------------------------------------------------------------------------

    def plus_symbols(self, x: Any, d: Any) -> Any:
        """plus on CasADi columns."""
        return ca.vertcat(*[_PLUS[part.kind](x[at], d[along]) for part, at, along in self.places()])

    def minus_symbols(self, y: Any, x: Any) -> Any:
        """minus on CasADi columns."""
        return ca.vertcat(*[_MINUS[part.kind](y[at], x[at]) for part, at, along in self.places()])

    def from_error(self, x: Any) -> Any:
        """d plus(x, d) / dd at d = 0 (size, dimension), on CasADi columns."""
        return ca.diagcat(*[_FROM[part.kind](x[at]) for part, at, _ in self.places()])

    def to_error(self, x: Any) -> Any:
        """d minus(y, x) / dy at y = x (dimension, size), on CasADi columns."""
        return ca.diagcat(*[_TO[part.kind](x[at]) for part, at, _ in self.places()])

    def to_unit(self, x: Any) -> Any:
        """Quaternions and directions scaled to unit length, on CasADi columns."""
        return ca.vertcat(*[x[at] if part.kind == "vector" else _unit(x[at]) for part, at, _ in self.places()])

    # -- on numbers ------------------------------------------------------------------------------------

    @cached_property
    def _functions(self) -> tuple[RowsFunction, RowsFunction, RowsFunction]:
        x, y, d = ca.SX.sym("x", self.size), ca.SX.sym("y", self.size), ca.SX.sym("d", self.dimension)
        there = self.plus_symbols(x, d)
        carried = ca.mtimes(self.to_error(there), ca.jacobian(there, d))
        return (
            RowsFunction("plus", [x, d], [there]),
            RowsFunction("minus", [y, x], [self.minus_symbols(y, x)]),
            RowsFunction("carried", [x, d], [carried], (0,)),
        )

    def plus(self, x: Any, d: Any) -> np.ndarray:
        """The points (..., size) that lie d (..., dimension) from x (..., size)."""
        x, d = np.asarray(x, float), np.asarray(d, float)
        return x + d if self.flat else _rows(self._functions[0], x, d)

    def minus(self, y: Any, x: Any) -> np.ndarray:
        """The errors (..., dimension) that lead from x to y, both (..., size)."""
        y, x = np.asarray(y, float), np.asarray(x, float)
        return y - x if self.flat else _rows(self._functions[1], y, x)

    def carried(self, x: np.ndarray, d: np.ndarray) -> np.ndarray:
        """How an error at x is called at plus(x, d): Jacobians (n, dimension, dimension) for rows x (n, size)."""
        return self._functions[2](x, d)[0]

    def mean(self, points: np.ndarray, weights: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Intrinsic mean (m, size) of points (m, k, size) with weights (k,) or (m, k) that sum to one: where the
        weighted errors to all points vanish. guess (m, size)."""
        w = np.broadcast_to(weights, points.shape[:2])[..., None]
        if self.flat:
            return np.sum(w * points, axis=1)
        at = guess
        for _ in range(MEAN_STEPS):
            step = np.sum(w * self.minus(points, np.broadcast_to(at[:, None], points.shape)), axis=1)
            at = self.plus(at, step)
            if self._curved(step) < MEAN_TOLERANCE:
                break
        return at

    def _curved(self, d: np.ndarray) -> float:
        """The largest angle in errors (m, dimension)."""
        turns = [d[:, along] for part, _, along in self.places() if part.kind != "vector"]
        return max(float(np.max(np.abs(t), initial=0.0)) for t in turns)

    def point(self, values: Mapping[str, Any], argument: str = "mean") -> np.ndarray:
        """A point (size,) from values by name; what is not named is zero, or no turn.

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
        """Points (..., size) by name, scalars without a last axis."""
        return {
            part.name: points[..., at.start] if part.kind == "vector" and part.size == 1 else points[..., at]
            for part, at, _ in self.places()
        }

    def errors(self, d: np.ndarray) -> dict[str, np.ndarray]:
        """Errors (..., dimension) by name, of a scalar without a last axis."""
        return {
            part.name: d[..., along.start] if part.dimension == 1 else d[..., along] for part, _, along in self.places()
        }


MEAN_STEPS = 30
MEAN_TOLERANCE = 1e-13  # rad; the mean of angles is iterated to round-off


def _rows(f: RowsFunction, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    if a.ndim == b.ndim == 2 and len(a) == len(b) > 0:
        return f(a, b)[0]
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    rows = [np.broadcast_to(v, (*shape, v.shape[-1])).reshape(-1, v.shape[-1]) for v in (a, b)]
    result = f(*rows)[0]
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
    """Two unit vectors (3, 2) at right angles to a unit vector: Duff et al. 2017, J. Comput. Graph. Tech. 6(1)."""
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
    n = _unit(n)  # a reading of another length; of none it is no direction, and no number
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
