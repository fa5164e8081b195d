"""Arrays of scalar expressions, and Modelica's operators on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from .scalars import Scalar, is_number, operation
from .syntax import ModelicaError, Place

Values = np.ndarray  # of dtype object; a scalar has the shape ()


class RecordValue(dict[str, Any]):
    """A record value: name -> value."""


def scalar(x: Scalar) -> Values:
    """Return a scalar as an array of shape ()."""
    result = np.empty((), object)
    result[()] = x
    return result


def array(items: Sequence[Any], shape: tuple[int, ...]) -> Values:
    """Return scalars as an array; the last index varies fastest."""
    result = np.empty(len(items), object)
    for n, item in enumerate(items):
        result[n] = item
    return result.reshape(shape)


def stacked(items: Sequence[Any], at: Place | None) -> Any:
    """Stack arrays along a new first dimension. Raises ModelicaError if their shapes differ."""
    if items and all(isinstance(x, RecordValue) for x in items):
        result = np.empty(len(items), object)
        for n, x in enumerate(items):
            result[n] = x
        return result
    shapes = {x.shape if isinstance(x, np.ndarray) else None for x in items}
    if len(shapes) > 1 or None in shapes:
        raise ModelicaError(f"the entries of an array have shapes {' and '.join(map(_shape, shapes))}", at)
    if not items:
        return np.empty((0,), object)
    return np.stack(items) if items[0].shape else array([x[()] for x in items], (len(items),))


def _shape(shape: Any) -> str:
    return "of a record" if shape is None else str(shape)


def each(function: Callable[..., Scalar], *given: Values) -> Values:
    """Apply a function of scalars entry by entry to arrays of one shape; a scalar is used for every entry."""
    shape = next((g.shape for g in given if g.shape), ())
    if not shape:
        return scalar(function(*[g[()] for g in given]))
    columns = [g.ravel() if g.shape else [g[()]] * int(np.prod(shape)) for g in given]
    return array([function(*row) for row in zip(*columns, strict=True)], shape)


def entries(value: Values) -> Iterator[Scalar]:
    return iter([value[()]]) if value.shape == () else iter(value.ravel())


def same_shape(a: Values, b: Values, what: str, at: Place | None, scalars: bool = False) -> None:
    if a.shape != b.shape and not (scalars and (a.shape == () or b.shape == ())):
        hint = f"; write .{what} between a scalar and an array" if what in "+-" and () in (a.shape, b.shape) else ""
        raise ModelicaError(
            f"'{what}' needs operands of the same shape; found {shape_words(a.shape)} and {shape_words(b.shape)}{hint}",
            at,
        )


def shape_words(shape: tuple[int, ...]) -> str:
    return "a scalar" if not shape else f"an array of shape {shape}"


def binary(name: str, a: Values, b: Values, at: Place | None) -> Values:
    """Apply one of Modelica's binary operators. Raises ModelicaError if the shapes do not match."""
    if name in (".+", ".-", ".*", "./", ".^"):
        same_shape(a, b, name, at, scalars=True)
        plain = "**" if name == ".^" else name[1:]
        return each(lambda x, y: _power(x, y, at) if plain == "**" else operation(plain, (x, y), at), a, b)
    if name in ("+", "-"):
        same_shape(a, b, name, at)
        return each(lambda x, y: operation(name, (x, y), at), a, b)
    if name == "*":
        return product(a, b, at)
    if name == "/":
        if b.shape:
            raise ModelicaError("the divisor of '/' must be a scalar; write ./ for each entry", at)
        return each(lambda x, y: operation("/", (x, y), at), a, b)
    if name == "^":
        return _raised(a, b, at)
    if name in ("and", "or", "<", "<=", ">", ">=", "==", "<>"):
        if (a.shape or b.shape) and name not in ("and", "or"):
            same_shape(a, b, name, at, scalars=True)  # in constraints: one relation for each entry
        return each(lambda x, y: operation(name, (x, y), at), a, b)
    raise ModelicaError(f"there is no operator '{name}'", at)


def _power(x: Scalar, y: Scalar, at: Place | None) -> Scalar:
    if isinstance(y, float) and y.is_integer() and abs(y) < 1000:
        y = int(y)
    return operation("**", (x, y), at)


def _raised(a: Values, b: Values, at: Place | None) -> Values:
    if b.shape:
        raise ModelicaError("the exponent of '^' must be a scalar; write .^ for each entry", at)
    if not a.shape:
        return scalar(_power(a[()], b[()], at))
    n = b[()]
    if a.ndim != 2 or a.shape[0] != a.shape[1] or not is_number(n) or n != int(n) or not 0 <= n <= 1000:
        raise ModelicaError(
            "'^' of an array needs a square matrix and an Integer exponent from 0 to 1000; write .^ for each entry", at
        )
    result = identity(a.shape[0])
    for _ in range(int(n)):
        result = product(result, a, at)
    return result


# terms of a chain; longer ones would be nested deeper than recursive functions allow
LONG_CHAIN = 200


def identity(n: int) -> Values:
    return array([int(i == j) for i in range(n) for j in range(n)], (n, n))


def summed(items: Sequence[Scalar], at: Place | None) -> Scalar:
    """Return the sum, added from the left; 0 for no items."""
    return chained([("+", scalar(x), at) for x in items])[()] if items else 0


def chained(terms: Sequence[tuple[str, Values, Place | None]]) -> Values:
    """Return a + b - c ..., or a chain of another operator, from the left; each term has the operator before it.

    A chain of more than LONG_CHAIN terms is halved recursively, so that its expression is less deep.
    """
    if len(terms) <= LONG_CHAIN:
        total = terms[0][1]
        for name, x, at in terms[1:]:
            total = binary(name, total, x, at)
        return total
    half = len(terms) // 2
    name, _, at = terms[half]
    other = {"+": "-", "-": "+"} if name == "-" else {}  # a - b + c is a - (b - c)
    return binary(name, chained(terms[:half]), chained([(other.get(n, n), x, p) for n, x, p in terms[half:]]), at)


def dotted(a: Sequence[Scalar], b: Sequence[Scalar], at: Place | None) -> Scalar:
    """Return the sum of products without products in which a factor is the literal 0."""
    terms = [
        operation("*", (x, y), at)
        for x, y in zip(a, b, strict=True)
        if not any(is_number(z) and z == 0 for z in (x, y))
    ]
    return summed(terms, at)


def product(a: Values, b: Values, at: Place | None) -> Values:
    if not a.shape or not b.shape:
        return each(lambda x, y: operation("*", (x, y), at), a, b)
    if a.ndim > 2 or b.ndim > 2 or a.shape[-1] != b.shape[0]:
        raise ModelicaError(f"'*' needs matching shapes; found {a.shape} and {b.shape}; write .* for each entry", at)
    inner = a.shape[-1]
    rows = a.reshape(int(np.prod(a.shape[:-1])), inner)
    columns = b.reshape(inner, int(np.prod(b.shape[1:]))).T
    flat = [dotted(list(r), list(c), at) for r in rows for c in columns]
    return array(flat, a.shape[:-1] + b.shape[1:])


def negative(a: Values, at: Place | None) -> Values:
    return each(lambda x: operation("neg", (x,), at), a)


def joined(dimension: int, items: Sequence[Values], at: Place | None) -> Values:
    """Return cat(dimension, ...); dimension counts from 1."""
    try:
        return np.concatenate([x if x.ndim >= dimension else x.reshape((*x.shape, 1)) for x in items], dimension - 1)
    except ValueError:
        shapes = " and ".join(str(x.shape) for x in items)
        raise ModelicaError(
            f"arrays of shapes {shapes} cannot be concatenated along dimension {dimension}", at
        ) from None


def matrix_of(rows: Sequence[Sequence[Values]], at: Place | None) -> Values:
    """[a, b; c, d]."""

    def promoted(x: Values) -> Values:
        return x.reshape(x.shape + (1,) * (2 - x.ndim)) if x.ndim < 2 else x

    return joined(1, [joined(2, [promoted(x) for x in row], at) for row in rows], at)
