"""Functions of the language on expressions, numbers and arrays: der, dot, cross, sin, tanh, ..."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from .expression import ONE, UFUNCS, Expr, aligned, dimension_of, gathered, operand, scope_of, times
from .source import ModelError, here
from .units import SECOND


def der(x: Any, order: int = 1) -> Expr:
    """Time derivative of any expression, `order` times; unit divided by s each time.

    Raises ModelError for a plain number (its derivative is zero: write 0) or a negative order.
    """
    if not isinstance(x, Expr):
        raise ModelError(f"der() takes an expression of the model; found {x!r}", here())
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise ModelError(f"der() takes an order that is a whole number; found {order!r}", here())
    if order < 0:
        raise ModelError(f"der() takes an order of 0 or more; found {order}", here())
    for _ in range(order):
        dim = None if x.dimension is None else x.dimension / SECOND
        x = Expr(x.scope.derivative(x.sx), x.shape, dim, x.scope)
    return x


def _product(name: str, a: Any, b: Any, shape: tuple[int, ...]) -> Expr:
    """A product of two vectors, which both have the shape of the result where that is no scalar."""
    a, b = gathered(a), gathered(b)
    scope = scope_of(a, b)
    if scope is None:
        raise ModelError(f"gt.{name} takes at least one expression of the model; use numpy.{name} on numbers", here())
    (sa, shape_a), (sb, shape_b) = operand(a, scope), operand(b, scope)
    if len(shape_a) != 1 or shape_a != shape_b or (shape and shape_a != shape):
        wanted = f"length {shape[0]}" if shape else "equal length"
        raise ModelError(f"{name}() takes two vectors of {wanted}; found {shape_a} and {shape_b}", here())
    return Expr(getattr(ca, name)(sa, sb), shape, times(dimension_of(a), dimension_of(b)), scope)


def dot(a: Any, b: Any) -> Expr:
    """Scalar product of two vectors of equal length."""
    return _product("dot", a, b, ())


def cross(a: Any, b: Any) -> Expr:
    """Vector product of two vectors of length 3."""
    return _product("cross", a, b, (3,))


def sqrt(x: Any) -> Any:
    """Square root; the unit is halved."""
    if not isinstance(x, Expr):
        return np.sqrt(x)
    dim = None if x.dimension is None else x.dimension ** (1 / 2)
    return Expr(ca.sqrt(x.sx), x.shape, dim, x.scope)


def norm(x: Any) -> Any:
    """Euclidean length of a vector."""
    if not isinstance(x, Expr):
        return float(np.linalg.norm(x))
    return sqrt(dot(x, x))


def absolute(x: Any) -> Any:
    """Absolute value."""
    return Expr(ca.fabs(x.sx), x.shape, x.dimension, x.scope) if isinstance(x, Expr) else np.abs(x)


def sign(x: Any) -> Any:
    """Sign, dimensionless: for identification away from zero; simulation refuses it."""
    return Expr(ca.sign(x.sx), x.shape, ONE, x.scope) if isinstance(x, Expr) else np.sign(x)


def _pure(name: str, fun: Callable[[ca.SX], ca.SX], numeric: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def apply(x: Any) -> Any:
        if not isinstance(x, Expr):
            return numeric(x)
        if x.dimension is not None and x.dimension != ONE:
            raise ModelError(f"{name}() takes a dimensionless number or radians; found {x.dimension}", here())
        return Expr(fun(x.sx), x.shape, ONE, x.scope)

    apply.__name__ = name
    apply.__doc__ = f"{name} of a dimensionless expression (angles in rad), elementwise."
    return apply


sin = _pure("sin", ca.sin, np.sin)
cos = _pure("cos", ca.cos, np.cos)
tan = _pure("tan", ca.tan, np.tan)
asin = _pure("asin", ca.asin, np.arcsin)
acos = _pure("acos", ca.acos, np.arccos)
atan = _pure("atan", ca.atan, np.arctan)
exp = _pure("exp", ca.exp, np.exp)
log = _pure("log", ca.log, np.log)
tanh = _pure("tanh", ca.tanh, np.tanh)


def _pair(a: Any, b: Any, fun: Callable[[Any, Any], Any], numeric: Any, name: str) -> Any:
    a, b = gathered(a), gathered(b)
    if not isinstance(a, Expr) and not isinstance(b, Expr):
        return numeric(a, b)
    if isinstance(a, Expr):
        sa, sb, dim, shape, scope = aligned(a, b, name)
    else:
        sb, sa, dim, shape, scope = aligned(b, a, name)
    return Expr(fun(sa, sb), shape, dim, scope)


def minimum(a: Any, b: Any) -> Any:
    """Smaller of two expressions of equal unit, elementwise."""
    return _pair(a, b, ca.fmin, np.minimum, "minimum")


def maximum(a: Any, b: Any) -> Any:
    """Larger of two expressions of equal unit, elementwise."""
    return _pair(a, b, ca.fmax, np.maximum, "maximum")


def atan2(y: Any, x: Any) -> Any:
    """Angle of the point (x, y) in rad; both of equal unit."""
    e = _pair(y, x, ca.atan2, np.arctan2, "atan2")
    return Expr(e.sx, e.shape, ONE, e.scope) if isinstance(e, Expr) else e


def clip(x: Any, low: float, high: float) -> Any:
    """x limited to [low, high]: piecewise linear."""
    return minimum(maximum(x, low), high)


UFUNCS |= {
    "add": lambda a, b: b + a if isinstance(b, Expr) else a + b,
    "subtract": lambda a, b: b.__rsub__(a) if isinstance(b, Expr) and not isinstance(a, Expr) else a - b,
    "multiply": lambda a, b: b * a if isinstance(b, Expr) else a * b,
    "divide": lambda a, b: b.__rtruediv__(a) if isinstance(b, Expr) and not isinstance(a, Expr) else a / b,
    "matmul": lambda a, b: b.__rmatmul__(a) if isinstance(b, Expr) and not isinstance(a, Expr) else a @ b,
    "equal": lambda a, b: b == a if isinstance(b, Expr) else a == b,
    "less_equal": lambda a, b: b >= a if isinstance(b, Expr) else a <= b,
    "greater_equal": lambda a, b: b <= a if isinstance(b, Expr) else a >= b,
    "negative": lambda a: -a,
    "power": lambda a, b: a**b,
    "square": lambda a: a**2,
    "sqrt": sqrt,
    "absolute": absolute,
    "sign": sign,
    "sin": sin,
    "cos": cos,
    "tan": tan,
    "arcsin": asin,
    "arccos": acos,
    "arctan": atan,
    "arctan2": atan2,
    "exp": exp,
    "log": log,
    "tanh": tanh,
    "minimum": minimum,
    "maximum": maximum,
}
