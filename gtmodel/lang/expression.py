"""Expressions of the language: CasADi SX that also knows shape, physical dimension and its scope."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .condition import Condition, joined
from .scope import Scope
from .slips import floats
from .source import ModelError, SourceLocation, dropped, here
from .units import Dimension, UnitError

Shape = tuple[int, ...]
ONE = Dimension()
# what numpy functions do to expressions, by name; `functions` fills it
UFUNCS: dict[str, Callable[..., Any]] = {}


def _columns(shape: Shape) -> tuple[int, int]:
    return (shape[0] if len(shape) > 0 else 1, shape[1] if len(shape) > 1 else 1)


class DimensionError(ModelError, UnitError):
    """Units do not fit: a ModelError that is also a UnitError."""


class IndexRangeError(ModelError, IndexError):
    """An index out of range: a ModelError that is also an IndexError."""


class Expr:
    """A scalar (shape ()), vector (n,) or matrix (n, m) expression of a model.

    Inside `equations()` every `self.name` of a variable, an input or a parameter is one. It is calculated with as with
    an array of NumPy (+ - * / ** @, indices, slices, np.sin), and ==, <= and >= of two make a `Relation`, an equation
    or a constraint. `dimension` is None where it is unknown (a variable declared without a unit). Plain numbers and
    arrays adopt the other side's dimension in sums and equations and count as dimensionless in products.

    Raises ModelError, with file and line, for shapes or units that do not fit.

    >>> m = gt.Builder()
    >>> x, force = m.variable("x", 3, unit="m"), m.variable("force", unit="N")
    >>> force * x[2]
    Expr((force*x[2]), shape=(), unit=J)
    >>> force + x[2]
    Traceback (most recent call last):
        ...
    gtmodel.lang.expression.DimensionError: ...
    """

    __slots__ = ("dimension", "scope", "shape", "sx")
    __array_priority__ = 1000.0

    def __init__(self, sx: ca.SX, shape: Shape, dimension: Dimension | None, scope: Scope) -> None:
        self.sx = sx
        self.shape = shape
        self.dimension = dimension
        self.scope = scope

    # numpy on the left hands over to us; functions such as np.sin work on expressions too
    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        fun = UFUNCS.get(ufunc.__name__)
        if method != "__call__" or kwargs or fun is None:
            return NotImplemented
        return fun(*inputs)

    def __float__(self) -> float:
        raise ModelError(
            f"'{self.sx}' has no number while a model is being built; in place of functions of math use those of gt, "
            "such as gt.sin",
            here(),
        )

    __int__ = __index__ = __float__  # type: ignore[assignment]

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a scalar expression has no length")
        return self.shape[0]

    def __iter__(self) -> Iterator[Expr]:
        if not self.shape:
            raise TypeError("a scalar expression cannot be iterated over")
        return (self[i] for i in range(self.shape[0]))

    def __getitem__(self, index: int | slice | tuple[int | slice, int | slice]) -> Expr:
        if not self.shape:
            raise ModelError(f"a scalar cannot be indexed by {index}", here())
        rows, *more = index if isinstance(index, tuple) else (index,)
        if len(more) >= len(self.shape):
            indices = f"{1 + len(more)} indices {index}"
            raise IndexRangeError(
                f"an expression of shape {self.shape} takes {len(self.shape)}; found {indices}", here()
            )
        places = [_places(k, n, self.shape) for k, n in zip((rows, *more), self.shape, strict=False)]
        shape = tuple(len(p) for p in places if isinstance(p, list)) + self.shape[len(places) :]
        row, column = (*places, slice(None))[:2]
        part = self.sx[row, column]
        if not isinstance(row, list) and shape:  # one row stands as a column
            part = part.T
        return Expr(part, shape, self.dimension, self.scope)

    def __repr__(self) -> str:
        return f"Expr({self.sx}, shape={self.shape}, unit={self.dimension})"

    def __neg__(self) -> Expr:
        return Expr(-self.sx, self.shape, self.dimension, self.scope)

    def __abs__(self) -> Expr:
        return Expr(ca.fabs(self.sx), self.shape, self.dimension, self.scope)

    def __pos__(self) -> Expr:
        return self

    def __add__(self, other: Any) -> Expr:
        a, b, dim, shape, scope = aligned(self, other, "+")
        return Expr(a + b, shape, dim, scope)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Expr:
        a, b, dim, shape, scope = aligned(self, other, "-")
        return Expr(a - b, shape, dim, scope)

    def __rsub__(self, other: Any) -> Expr:
        return -(self - other)

    def __mul__(self, other: Any) -> Expr:
        other = gathered(other)
        a, b, shape, scope = _elementwise(self, other, "*")
        return Expr(a * b, shape, times(self.dimension, dimension_of(other)), scope)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Expr:
        other = gathered(other)
        a, b, shape, scope = _elementwise(self, other, "/")
        return Expr(a / b, shape, over(self.dimension, dimension_of(other)), scope)

    def __rtruediv__(self, other: Any) -> Expr:
        other = gathered(other)
        a, b, shape, scope = _elementwise(self, other, "/")
        return Expr(b / a, shape, over(dimension_of(other), self.dimension), scope)

    def __pow__(self, power: float | int) -> Expr:
        if isinstance(power, Expr):
            raise ModelError(f"an exponent must be a number; found {power}; use gt.exp and gt.log", here())
        dim = None if self.dimension is None else self.dimension**power
        return Expr(self.sx**power, self.shape, dim, self.scope)

    def __xor__(self, power: Any) -> Expr:
        raise ModelError("'^' is no power; write **", here())

    def __matmul__(self, other: Any) -> Expr:
        return matmul(self, other)

    def __rmatmul__(self, other: Any) -> Expr:
        return matmul(other, self)

    def __eq__(self, other: object) -> Relation:  # type: ignore[override]
        return relation(self, other, "==")

    def __ne__(self, other: object) -> bool:  # type: ignore[override]
        raise ModelError("'!=' is not an equation; expected '==', '<=' or '>='", here())

    def __le__(self, other: object) -> Relation:
        return relation(self, other, "<=")

    def __ge__(self, other: object) -> Relation:
        return relation(self, other, ">=")

    def __lt__(self, other: object) -> Relation:
        return relation(self, other, "<=", strict=True)

    def __gt__(self, other: object) -> Relation:
        return relation(self, other, ">=", strict=True)

    __hash__ = object.__hash__

    def at(self, instant: Any) -> Expr:
        """The value at an instant, a number [s], `self.start_time` or `self.final_time`: `x.at(0.5)`.

        For objectives and constraints of an Optimization. Raises ModelError for an instant that is no scalar.
        """
        time, shape = operand(instant, self.scope)
        if shape != ():
            raise ModelError(f"an instant is a scalar time; found shape {shape}", here())
        return Expr(self.scope.value_at(self.sx, time), self.shape, self.dimension, self.scope)


@dataclass(frozen=True, eq=False)
class Relation:
    """An equation or a constraint: `lhs == rhs`, `lhs <= rhs` or `lhs >= rhs`, with the line where it was written.

    Comparing expressions makes it. It has no truth value: yield it. In `gt.when` and `gt.If` it is a condition, and
    `&`, `|` and `~` join several. strict: written with < or >, which differ from <= and >= for discrete variables only.
    """

    lhs: ca.SX
    rhs: ca.SX
    op: str
    dimension: Dimension | None
    where: SourceLocation
    scope: Scope
    strict: bool = False

    def __and__(self, other: Any) -> Condition:
        return joined("and", self, other)

    def __or__(self, other: Any) -> Condition:
        return joined("or", self, other)

    def __invert__(self) -> Condition:
        return joined("not", self)

    def condition(self) -> Condition:
        """This relation as a condition. Raises ModelError for `==` and for more than one entry."""
        if self.op == "==":
            raise ModelError(
                "'==' of two real quantities holds at no instant that a simulation could meet; compare by <= or >=",
                self.where,
            )
        if self.residual.numel() != 1:
            raise ModelError(
                f"a condition compares scalars; found {self.residual.numel()} entries: name the one that is meant, or "
                "join several by & and |",
                self.where,
            )
        return Condition("relation", (), self, self.where)

    @property
    def residual(self) -> ca.SX:
        """lhs - rhs, a column, row by row."""
        return row_by_row(self.lhs - self.rhs)

    def __bool__(self) -> bool:
        raise ModelError(
            f"an equation or inequality ('{self.op}') has no truth value while a model is being built; "
            "expected it to be yielded; for a <= x <= b use gt.between(a, x, b), in place of if gt.If, gt.branch or "
            "gt.maximum, in place of and, or, not the signs &, |, ~ inside gt.when and gt.If",
            self.where,
        )


def row_by_row(sx: ca.SX) -> ca.SX:
    """The entries of a matrix as a column, row by row; a column as it is."""
    return sx if sx.size2() == 1 else ca.vec(sx.T)


def _places(index: Any, n: int, shape: Shape) -> int | list[int]:
    """An index or a slice as place or places; ModelError for what is none, also an IndexError where it is out of range.

    1.9 is no index: truncated, it would be another entry than meant. Nor is a slice cut off at the last entry.
    """

    def whole(k: Any) -> int:
        try:
            return operator.index(k)
        except TypeError:
            raise ModelError(f"an expression is indexed by whole numbers, not by {index!r}", here()) from None

    if not isinstance(index, slice):
        place = whole(index)
        if not -n <= place < n:
            raise IndexRangeError(f"index {place} is out of range for an expression of shape {shape}", here())
        return place
    start, stop, step = (None if k is None else whole(k) for k in (index.start, index.stop, index.step))
    if step == 0:
        raise IndexRangeError("a slice takes a step other than 0", here())
    if any(k is not None and not -n <= k <= n for k in (start, stop)):
        text = f"{'' if start is None else start}:{'' if stop is None else stop}"
        raise IndexRangeError(
            f"slice {text} is out of range for an expression of shape {shape}; expected ends from {-n} to {n}", here()
        )
    return list(range(n))[slice(start, stop, step)]


def dimension_of(value: Any) -> Dimension | None:
    """Dimension of an operand; a plain number is dimensionless in products."""
    return value.dimension if isinstance(value, Expr) else ONE


def times(a: Dimension | None, b: Dimension | None) -> Dimension | None:
    return None if a is None or b is None else a * b


def over(a: Dimension | None, b: Dimension | None) -> Dimension | None:
    return None if a is None or b is None else a / b


def gathered(value: Any) -> Any:
    """A list that holds expressions as one expression, with its unit; everything else as it is."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        parts = [gathered(v) for v in value]
        if any(isinstance(v, Expr) for v in parts):
            return vector(parts)
    return value


def scope_of(*values: Any) -> Any:
    return next((v.scope for v in values if isinstance(v, Expr)), None)


def written_out(*values: Any) -> bool:
    """Whether there are CasADi columns among these, and no expressions of a model."""
    return scope_of(*values) is None and any(isinstance(v, (ca.SX, ca.MX, ca.DM)) for v in values)


def vector(parts: Sequence[Any]) -> Expr:
    """A vector (n,) from n scalars, or a matrix (n, m), one row each, from n vectors of length m.

    All have one unit; numbers adopt it. Of the CasADi columns that a step of a filter is written with it is one of
    them. Raises ModelError for parts of different shapes or units, and for numbers alone
    (use numpy.array).

    >>> m = gt.Builder()
    >>> x, y = m.variable("x", unit="m"), m.variable("y", unit="m")
    >>> gt.vector([x, y, 0.0])
    Expr([x, y, 0], shape=(3,), unit=m)
    >>> gt.vector([[x, y], [y, x]]).shape
    (2, 2)
    """
    if not isinstance(parts, Iterable):
        raise ModelError(f"gt.vector takes the parts of a vector, [a, b, c]; found {parts!r}", here())
    if written_out(*parts):  # in a step or an output of a filter, which has no units
        return ca.vertcat(*parts)  # type: ignore[return-value]
    parts = [gathered(p) for p in parts]
    scope = scope_of(*parts)
    if scope is None:
        raise ModelError("gt.vector takes at least one expression; use numpy.array on numbers", here())
    items = [operand(p, scope) for p in parts]
    shape = items[0][1]
    if any(s != shape for _, s in items) or len(shape) > 1:
        raise ModelError(f"parts of a vector have shapes {[s for _, s in items]}; expected equal ones", here())
    dims = {p.dimension for p in parts if isinstance(p, Expr) and p.dimension is not None}
    if len(dims) > 1:
        raise ModelError(f"parts of a vector have different units: {sorted(map(str, dims))}", here())
    dim = dims.pop() if dims else None
    rows = [sx.T if shape else sx for sx, _ in items]
    return Expr(ca.vertcat(*rows), (len(items), *shape), dim, scope)


def operand(value: Any, scope: Scope) -> tuple[ca.SX, Shape]:
    """SX and shape of an expression, number, list or array."""
    value = gathered(value)
    if isinstance(value, Expr):
        if value.scope is not scope:
            raise ModelError("expressions of two different models were combined; connect them as parts", here())
        return value.sx, value.shape
    try:
        array = floats(value)
    except (TypeError, ValueError):
        kind = type(value).__name__
        raise ModelError(f"expected an expression, a number or an array; found {kind} {value!r}", here()) from None
    if array.ndim > 2:
        raise ModelError(f"arrays have at most two dimensions; found shape {array.shape}", here())
    if not np.all(np.isfinite(array)):
        raise ModelError(f"numbers in equations must be finite; found {value!r}", here())
    return ca.SX(ca.DM(array.reshape(_columns(array.shape)))), tuple(array.shape)


def _elementwise(a: Expr, b: Any, op: str) -> tuple[ca.SX, ca.SX, Shape, Scope]:
    sb, shape_b = operand(b, a.scope)
    if a.shape != shape_b and a.shape != () and shape_b != ():
        raise ModelError(f"shapes {a.shape} and {shape_b} do not fit in '{op}'; expected equal shapes", here())
    return a.sx, sb, a.shape or shape_b, a.scope


def aligned(a: Expr, b: Any, op: str) -> tuple[ca.SX, ca.SX, Dimension | None, Shape, Scope]:
    """Operands of a sum or a relation: equal shapes (a number may stand for a vector only when it is zero)
    and equal dimensions; returns both, the common dimension, shape and scope."""
    b = gathered(b)
    sb, shape_b = operand(b, a.scope)
    if a.shape != shape_b:
        zero = (not isinstance(b, Expr)) and shape_b == () and float(b) == 0.0
        comparison = op in ("<=", ">=", "minimum", "maximum") and () in (a.shape, shape_b)
        if not (zero or comparison):
            raise ModelError(f"shapes {a.shape} and {shape_b} do not fit in '{op}'; expected equal shapes", here())
    if not isinstance(b, Expr):
        dim = a.dimension
    elif a.dimension is None or b.dimension is None:
        dim = a.dimension if b.dimension is None else b.dimension
    elif a.dimension != b.dimension:
        raise DimensionError(
            f"units do not fit in '{op}': left is {a.dimension}, right is {b.dimension}; a bare number in a product "
            "has no unit: declare it as a parameter with its unit",
            here(),
        )
    else:
        dim = a.dimension
    return a.sx, sb, dim, a.shape if a.shape else shape_b, a.scope


def relation(a: Expr, b: Any, op: str, strict: bool = False) -> Relation:
    sa, sb, dimension, shape, _ = aligned(a, b, op)
    rows, cols = _columns(shape)
    if sa.shape != (rows, cols):
        sa = ca.repmat(sa, rows, cols)
    if sb.shape != (rows, cols):
        sb = ca.repmat(sb, rows, cols)
    name = dropped()
    if name is not None:
        lost = f"reads '{name}', which this '{op}' is given to" if name else f"takes what this '{op}' says"
        raise ModelError(f"nothing {lost}; write yield in front of it, or hand it to add() of a Builder", here())
    return Relation(sa, sb, op, dimension, here(), a.scope, strict)


def matmul(a: Any, b: Any) -> Expr:
    """Matrix product of expressions or arrays with inner lengths that fit."""
    a, b = gathered(a), gathered(b)
    scope = a.scope if isinstance(a, Expr) else b.scope
    (sa, shape_a), (sb, shape_b) = operand(a, scope), operand(b, scope)
    if not shape_a or not shape_b or shape_a[-1] != shape_b[0]:
        raise ModelError(f"shapes {shape_a} and {shape_b} do not fit in '@'", here())
    product = (sa.T if len(shape_a) == 1 else sa) @ sb
    shape = shape_a[:-1] + shape_b[1:]
    if len(shape) == 1 and product.shape[0] == 1:
        product = product.T
    return Expr(product, shape, times(dimension_of(a), dimension_of(b)), scope)
