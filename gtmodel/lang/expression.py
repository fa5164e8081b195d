"""Expressions of the language: a CasADi SX with its shape, physical dimension and scope."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from .condition import Condition, joined
from .scope import Scope
from .slips import floats
from .source import ModelError, SourceLocation, dropped, here
from .units import Dimension, UnitError

Shape = tuple[int, ...]
ONE = Dimension()
# implementations of NumPy's functions for expressions, by name; filled in `functions`
UFUNCS: dict[str, Callable[..., Any]] = {}


def _columns(shape: Shape) -> tuple[int, int]:
    return (shape[0] if len(shape) > 0 else 1, shape[1] if len(shape) > 1 else 1)


class DimensionError(ModelError, UnitError):
    """Different units where equal ones are needed: a ModelError that is also a UnitError."""


class IndexRangeError(ModelError, IndexError):
    """An index out of range: a ModelError that is also an IndexError."""


class Expr(Portable):
    """A scalar (shape ()), vector (n,) or matrix (n, m) expression of a model.

    Inside `equations()` every `self.name` of a variable, an input or a parameter is an expression. It supports NumPy's
    operations (+ - * / ** @, indices, slices, np.sin); ==, <= and >= create a `Relation`, an equation or a constraint.
    `dimension` is None if it is unknown (a variable declared without a unit). In sums and equations, plain numbers and
    arrays take the dimension of the other side; in products they are dimensionless.

    Raises ModelError, with file and line, if shapes or units are incompatible.

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

    # called by NumPy if its operand is on the left, and by functions such as np.sin
    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        fun = UFUNCS.get(ufunc.__name__)
        if method != "__call__" or kwargs or fun is None:
            return NotImplemented
        return fun(*inputs)

    def __float__(self) -> float:
        raise ModelError(
            f"'{self.sx}' has no numeric value while a model is being built; use functions of gt, such as gt.sin, "
            "instead of those of math",
            here(),
        )

    __int__ = __index__ = __float__  # type: ignore[assignment]

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a scalar expression has no length")
        return self.shape[0]

    def __iter__(self) -> Iterator[Expr]:
        if not self.shape:
            raise TypeError("cannot iterate over a scalar expression")
        return (self[i] for i in range(self.shape[0]))

    def __getitem__(self, index: int | slice | tuple[int | slice, int | slice]) -> Expr:
        if not self.shape:
            raise ModelError(f"a scalar cannot be indexed with {index}", here())
        rows, *more = index if isinstance(index, tuple) else (index,)
        if len(more) >= len(self.shape):
            indices = f"{1 + len(more)} indices {index}"
            raise IndexRangeError(
                f"an expression of shape {self.shape} has {len(self.shape)} dimensions; found {indices}", here()
            )
        positions = [_positions(k, n, self.shape) for k, n in zip((rows, *more), self.shape, strict=False)]
        shape = tuple(len(p) for p in positions if isinstance(p, list)) + self.shape[len(positions) :]
        row, column = (*positions, slice(None))[:2]
        part = self.sx[row, column]
        if not isinstance(row, list) and shape:  # a single row becomes a column
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
        raise ModelError("'^' is not the power operator in Python; write **", here())

    @property
    def T(self) -> Expr:
        """The transposed matrix; a scalar or a vector is its own."""
        return Expr(self.sx.T, self.shape[::-1], self.dimension, self.scope) if len(self.shape) == 2 else self

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
        """Return the value at an instant: a number [s], `self.start_time` or `self.final_time`, as in `x.at(0.5)`.

        For objectives and constraints of an Optimization. Raises ModelError for an instant that is not scalar.
        """
        time, shape = operand(instant, self.scope)
        if shape != ():
            raise ModelError(f"an instant must be a scalar time; found shape {shape}", here())
        return Expr(self.scope.value_at(self.sx, time), self.shape, self.dimension, self.scope)


@dataclass(frozen=True, eq=False)
class Relation(Portable):
    """An equation or a constraint: `lhs == rhs`, `lhs <= rhs` or `lhs >= rhs`, with its file and line.

    Comparing expressions creates it. It has no truth value: yield it. In `gt.when` and `gt.If` it is a condition;
    combine several with `&`, `|` and `~`. strict: written with < or >, which differ from <= and >= only for discrete
    variables.
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
        """Return this relation as a condition. Raises ModelError for `==` and for more than one entry."""
        if self.op == "==":
            raise ModelError(
                "a simulation cannot detect '==' of two real quantities; compare them with <= or >=",
                self.where,
            )
        if self.residual.numel() != 1:
            raise ModelError(
                f"a condition compares scalars; found {self.residual.numel()} entries: select one, or combine several "
                "conditions with & and |",
                self.where,
            )
        return Condition("relation", (), self, self.where)

    @property
    def residual(self) -> ca.SX:
        """lhs - rhs as a column, row by row."""
        return row_by_row(self.lhs - self.rhs)

    def __bool__(self) -> bool:
        raise ModelError(
            f"an equation or inequality ('{self.op}') has no truth value while a model is being built: yield it. "
            "Instead of a <= x <= b write gt.between(a, x, b); instead of if use gt.If, gt.branch or gt.maximum; "
            "instead of and, or, not write &, |, ~ inside gt.when and gt.If",
            self.where,
        )


def row_by_row(sx: ca.SX) -> ca.SX:
    """Return the entries of a matrix as a column, row by row; a column is unchanged."""
    return sx if sx.size2() == 1 else ca.vec(sx.T)


def _positions(index: Any, n: int, shape: Shape) -> int | list[int]:
    """Return the position of an index or the positions of a slice.

    Raises ModelError for an index that is not an integer, and IndexRangeError for one out of range. Unlike in Python, a
    slice must not exceed the range.
    """

    def whole(k: Any) -> int:
        try:
            return operator.index(k)
        except TypeError:
            raise ModelError(f"an index must be an integer; found {index!r}", here()) from None

    if not isinstance(index, slice):
        position = whole(index)
        if not -n <= position < n:
            raise IndexRangeError(f"index {position} is out of range for an expression of shape {shape}", here())
        return position
    start, stop, step = (None if k is None else whole(k) for k in (index.start, index.stop, index.step))
    if step == 0:
        raise IndexRangeError("the step of a slice must not be 0", here())
    if any(k is not None and not -n <= k <= n for k in (start, stop)):
        text = f"{'' if start is None else start}:{'' if stop is None else stop}"
        raise IndexRangeError(
            f"slice {text} is out of range for an expression of shape {shape}; expected limits from {-n} to {n}", here()
        )
    return list(range(n))[slice(start, stop, step)]


def dimension_of(value: Any) -> Dimension | None:
    """Return the dimension of an operand; a plain number is dimensionless in products."""
    return value.dimension if isinstance(value, Expr) else ONE


def times(a: Dimension | None, b: Dimension | None) -> Dimension | None:
    return None if a is None or b is None else a * b


def over(a: Dimension | None, b: Dimension | None) -> Dimension | None:
    return None if a is None or b is None else a / b


def gathered(value: Any) -> Any:
    """Combine a list that holds expressions into one expression; return any other value unchanged."""
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
    """Return whether some values are CasADi matrices and none is an expression of a model."""
    return scope_of(*values) is None and any(isinstance(v, (ca.SX, ca.MX, ca.DM)) for v in values)


def vector(parts: Sequence[Any]) -> Expr:
    """Return a vector (n,) from n scalars, or a matrix (n, m) from n rows of length m.

    All parts have the same unit; plain numbers take it. For CasADi columns, as in the step of a filter, the result is a
    CasADi column. Raises ModelError for parts of different shapes or units, and if all parts are numbers (use
    numpy.array).

    >>> m = gt.Builder()
    >>> x, y = m.variable("x", unit="m"), m.variable("y", unit="m")
    >>> gt.vector([x, y, 0.0])
    Expr([x, y, 0], shape=(3,), unit=m)
    >>> gt.vector([[x, y], [y, x]]).shape
    (2, 2)
    """
    if not isinstance(parts, Iterable):
        raise ModelError(f"gt.vector takes a list of the entries, [a, b, c]; found {parts!r}", here())
    if written_out(*parts):  # the step or output of a filter has no units
        return ca.vertcat(*parts)  # type: ignore[return-value]
    parts = [gathered(p) for p in parts]
    scope = scope_of(*parts)
    if scope is None:
        raise ModelError("gt.vector needs at least one expression; for numbers use numpy.array", here())
    items = [operand(p, scope) for p in parts]
    shape = items[0][1]
    if any(s != shape for _, s in items) or len(shape) > 1:
        raise ModelError(f"parts of a vector have shapes {[s for _, s in items]}; expected equal shapes", here())
    dims = {p.dimension for p in parts if isinstance(p, Expr) and p.dimension is not None}
    if len(dims) > 1:
        raise ModelError(f"parts of a vector have different units: {sorted(map(str, dims))}", here())
    dim = dims.pop() if dims else None
    rows = [sx.T if shape else sx for sx, _ in items]
    return Expr(ca.vertcat(*rows), (len(items), *shape), dim, scope)


def operand(value: Any, scope: Scope) -> tuple[ca.SX, Shape]:
    """Return the SX and the shape of an expression, number, list or array."""
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
        raise ModelError(f"shapes {a.shape} and {shape_b} differ in '{op}'; expected equal shapes", here())
    return a.sx, sb, a.shape or shape_b, a.scope


def aligned(a: Expr, b: Any, op: str) -> tuple[ca.SX, ca.SX, Dimension | None, Shape, Scope]:
    """Check the operands of a sum or a relation; return both and the common dimension, shape and scope.

    Shapes and dimensions must be equal. Only the number 0 is broadcast to a vector, or any number in a comparison.
    """
    b = gathered(b)
    sb, shape_b = operand(b, a.scope)
    if a.shape != shape_b:
        zero = (not isinstance(b, Expr)) and shape_b == () and float(b) == 0.0
        comparison = op in ("<=", ">=", "minimum", "maximum") and () in (a.shape, shape_b)
        if not (zero or comparison):
            raise ModelError(f"shapes {a.shape} and {shape_b} differ in '{op}'; expected equal shapes", here())
    if not isinstance(b, Expr):
        dim = a.dimension
    elif a.dimension is None or b.dimension is None:
        dim = a.dimension if b.dimension is None else b.dimension
    elif a.dimension != b.dimension:
        raise DimensionError(
            f"units differ in '{op}': left is {a.dimension}, right is {b.dimension}; a plain number in a product has "
            "no unit: declare it as a parameter with its unit",
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
        fate = f"assigned to '{name}', which is never read" if name else "discarded"
        raise ModelError(
            f"the result of this '{op}' is {fate}; write yield in front of it, or pass it to Builder.add()", here()
        )
    return Relation(sa, sb, op, dimension, here(), a.scope, strict)


def matmul(a: Any, b: Any) -> Expr:
    """Return the matrix product of expressions or arrays."""
    a, b = gathered(a), gathered(b)
    scope = a.scope if isinstance(a, Expr) else b.scope
    (sa, shape_a), (sb, shape_b) = operand(a, scope), operand(b, scope)
    if not shape_a or not shape_b or shape_a[-1] != shape_b[0]:
        raise ModelError(f"shapes {shape_a} and {shape_b} do not fit in '@'; expected equal inner dimensions", here())
    product = (sa.T if len(shape_a) == 1 else sa) @ sb
    shape = shape_a[:-1] + shape_b[1:]
    if len(shape) == 1 and product.shape[0] == 1:
        product = product.T
    return Expr(product, shape, times(dimension_of(a), dimension_of(b)), scope)
