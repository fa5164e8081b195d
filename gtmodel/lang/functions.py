"""Functions of expressions, numbers and arrays: der, dot, cross, sin, tanh, ..."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from .expression import ONE, UFUNCS, Expr, aligned, dimension_of, gathered, operand, scope_of, times, written_out
from .source import ModelError, here
from .units import SECOND


def der(x: Any, order: int = 1) -> Expr:
    """Return the time derivative of order `order` of any expression; its unit is divided by s for each order.

    The rules of differentiation apply: der(x**2) is 2 x der(x). The derivative of a parameter, or of a function of
    parameters, is 0. The compiler finds out which derivatives are states and which equations it has to differentiate.
    Raises ModelError for a plain number (its derivative is zero: write 0) or a negative order.

    >>> m = gt.Builder()
    >>> x = m.variable("x", unit="m")
    >>> gt.der(x, 2)
    Expr(der(x,2), shape=(), unit=m/s2)
    >>> gt.der(x**2)
    Expr(((2.*x)*der(x)), shape=(), unit=m2/s)
    """
    if not isinstance(x, Expr):
        raise ModelError(f"der() takes an expression of the model; found {x!r}", here())
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise ModelError(f"the order of der() must be an integer; found {order!r}", here())
    if order < 0:
        raise ModelError(f"the order of der() must be 0 or more; found {order}", here())
    for _ in range(order):
        dim = None if x.dimension is None else x.dimension / SECOND
        x = Expr(x.scope.derivative(x.sx), x.shape, dim, x.scope)
    return x


def _product(name: str, a: Any, b: Any, shape: tuple[int, ...]) -> Expr:
    """Return the product of two vectors; if the result is a vector, both must have its shape."""
    if written_out(a, b):  # in the step or output of a filter
        return getattr(ca, name)(a, b)
    a, b = gathered(a), gathered(b)
    scope = scope_of(a, b)
    if scope is None:
        raise ModelError(f"gt.{name} needs at least one expression of the model; for numbers use numpy.{name}", here())
    (sa, shape_a), (sb, shape_b) = operand(a, scope), operand(b, scope)
    if len(shape_a) != 1 or shape_a != shape_b or (shape and shape_a != shape):
        expected = f"length {shape[0]}" if shape else "equal length"
        raise ModelError(f"{name}() takes two vectors of {expected}; found {shape_a} and {shape_b}", here())
    return Expr(getattr(ca, name)(sa, sb), shape, times(dimension_of(a), dimension_of(b)), scope)


def dot(a: Any, b: Any) -> Expr:
    """Return the scalar product of two vectors of equal length; its unit is the product of their units.

    Raises ModelError for other shapes, and for two arrays of numbers (use numpy.dot).

    >>> m = gt.Builder()
    >>> force = m.variable("force", 3, unit="N")
    >>> gt.dot(force, force).shape
    ()
    >>> gt.dot([0, 0, 1], force)  # the z component
    Expr(force[2], shape=(), unit=N)
    """
    return _product("dot", a, b, ())


def cross(a: Any, b: Any) -> Expr:
    """Return the vector product of two vectors of length 3; its unit is the product of their units.

    Raises ModelError for other shapes, and for two arrays of numbers (use numpy.cross).

    >>> m = gt.Builder()
    >>> arm, force = m.variable("arm", 3, unit="m"), m.variable("force", 3, unit="N")
    >>> torque = gt.cross(arm, force)
    >>> torque[2]
    Expr(((arm[0]*force[1])-(arm[1]*force[0])), shape=(), unit=J)
    """
    return _product("cross", a, b, (3,))


def sqrt(x: Any) -> Any:
    """Return the square root, elementwise. The root of an expression in m2 is in m; for numbers it is numpy.sqrt.

    >>> m = gt.Builder()
    >>> x, y = m.variable("x", unit="m"), m.variable("y", unit="m")
    >>> gt.sqrt(x**2 + y**2)
    Expr(sqrt((sq(x)+sq(y))), shape=(), unit=m)
    >>> float(gt.sqrt(2.25))
    1.5
    """
    if not isinstance(x, Expr):
        return np.sqrt(x)
    dim = None if x.dimension is None else x.dimension ** (1 / 2)
    return Expr(ca.sqrt(x.sx), x.shape, dim, x.scope)


def norm(x: Any) -> Any:
    """Return the Euclidean norm of a vector, in its unit. The derivative is singular at the zero vector.

    >>> m = gt.Builder()
    >>> gt.norm(m.variable("r", 2, unit="m"))
    Expr(sqrt((sq(r[0])+sq(r[1]))), shape=(), unit=m)
    >>> gt.norm([3.0, 4.0])
    5.0
    """
    if not isinstance(x, Expr):
        return float(np.linalg.norm(x))
    return sqrt(dot(x, x))


def absolute(x: Any) -> Any:
    """Return the absolute value, elementwise, in the same unit. The derivative is discontinuous at zero.

    >>> m = gt.Builder()
    >>> gt.absolute(m.variable("x", unit="m"))
    Expr(fabs(x), shape=(), unit=m)
    >>> gt.absolute([-2.0, 1.5]).tolist()
    [2.0, 1.5]
    """
    return Expr(ca.fabs(x.sx), x.shape, x.dimension, x.scope) if isinstance(x, Expr) else np.abs(x)


def sign(x: Any) -> Any:
    """Return the sign, elementwise and without a unit: -1, 0 or 1.

    `simulate` treats each zero crossing of x as an event. It fails if both sides lead back to zero, as in sticking
    friction. Linearisation refuses the sign of a variable; gt.tanh(x / width) is a smooth replacement.

    >>> m = gt.Builder()
    >>> speed = m.variable("speed", unit="m/s")
    >>> 20.0 * gt.sign(speed)  # Coulomb friction
    Expr((20*sign(speed)), shape=(), unit=1)
    """
    return Expr(ca.sign(x.sx), x.shape, ONE, x.scope) if isinstance(x, Expr) else np.sign(x)


def _pure(name: str, fun: Callable[[ca.SX], ca.SX], numeric: Callable[[Any], Any], doc: str) -> Callable[[Any], Any]:
    """Return an elementwise function of dimensionless arguments; `doc`: its first sentence, and an example."""

    def apply(x: Any) -> Any:
        if not isinstance(x, Expr):
            return numeric(x)
        if x.dimension is not None and x.dimension != ONE:
            raise ModelError(f"{name}() takes a dimensionless number or radians; found {x.dimension}", here())
        return Expr(fun(x.sx), x.shape, ONE, x.scope)

    meaning, example = doc.split("\n", 1)
    apply.__name__ = apply.__qualname__ = name
    apply.__doc__ = f"""{meaning}

    Takes a scalar, vector or matrix expression, or numbers like NumPy. Raises ModelError for an expression with a unit;
    angles are in rad.

{example.rstrip()}
    """
    return apply


sin = _pure(
    "sin",
    ca.sin,
    np.sin,
    """Sine of an angle [rad], elementwise.
    >>> m = gt.Builder()
    >>> phi = m.variable("phi", unit="rad")
    >>> gt.sin(phi)
    Expr(sin(phi), shape=(), unit=1)
    >>> gt.sin(m.variable("x", unit="m"))
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: sin() takes a dimensionless number or radians; found m (...)
    """,
)
cos = _pure(
    "cos",
    ca.cos,
    np.cos,
    """Cosine of an angle [rad], elementwise.
    >>> m = gt.Builder()
    >>> phi, length = m.variable("phi", unit="rad"), m.parameter("length", 0.3, unit="m")
    >>> length * gt.cos(phi)
    Expr((length*cos(phi)), shape=(), unit=m)
    """,
)
tan = _pure(
    "tan",
    ca.tan,
    np.tan,
    """Tangent of an angle [rad], elementwise; infinite at right angles.
    >>> float(gt.tan(np.radians(45.0)).round(9))
    1.0
    """,
)
asin = _pure(
    "asin",
    ca.asin,
    np.arcsin,
    """Arcsine of a number from -1 to 1, elementwise: an angle from -pi/2 to pi/2 [rad].
    >>> float(np.degrees(gt.asin(0.5)).round(9))
    30.0
    """,
)
acos = _pure(
    "acos",
    ca.acos,
    np.arccos,
    """Arccosine of a number from -1 to 1, elementwise: an angle from 0 to pi [rad].
    >>> float(np.degrees(gt.acos(0.5)).round(9))
    60.0
    """,
)
atan = _pure(
    "atan",
    ca.atan,
    np.arctan,
    """Arctangent, elementwise: an angle from -pi/2 to pi/2 [rad]; atan2 also finds the quadrant.
    >>> float(np.degrees(gt.atan(1.0)).round(9))
    45.0
    """,
)
exp = _pure(
    "exp",
    ca.exp,
    np.exp,
    """Exponential function, elementwise.
    >>> m = gt.Builder()
    >>> decay_time = m.parameter("decay_time", 0.2, unit="s")
    >>> gt.exp(-m.time / decay_time)  # gt.exp(-m.time) is refused: its argument has a unit
    Expr(exp((-(time/decay_time))), shape=(), unit=1)
    """,
)
log = _pure(
    "log",
    ca.log,
    np.log,
    """Natural logarithm of a positive number, elementwise.
    >>> float(gt.log(np.e))
    1.0
    """,
)
tanh = _pure(
    "tanh",
    ca.tanh,
    np.tanh,
    """Hyperbolic tangent, elementwise: a smooth transition from -1 to 1.
    >>> m = gt.Builder()
    >>> speed, width = m.variable("speed", unit="m/s"), m.parameter("width", 0.01, unit="m/s")
    >>> gt.tanh(speed / width)  # a smooth replacement of gt.sign(speed)
    Expr(tanh((speed/width)), shape=(), unit=1)
    """,
)


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
    """Return the smaller of two expressions of equal unit, elementwise; its derivative jumps where they are equal.

    Raises ModelError for different units or shapes.

    >>> m = gt.Builder()
    >>> gt.minimum(m.variable("x", unit="m"), 0.5)  # 0.5 m
    Expr(fmin(x,0.5), shape=(), unit=m)
    """
    return _pair(a, b, ca.fmin, np.minimum, "minimum")


def maximum(a: Any, b: Any) -> Any:
    """Return the larger of two expressions of equal unit, elementwise; its derivative jumps where they are equal.

    Raises ModelError for different units or shapes.

    >>> m = gt.Builder()
    >>> gap = m.variable("gap", unit="m")
    >>> 1e5 * gt.maximum(-gap, 0)  # a contact only pushes
    Expr((100000*fmax((-gap),0)), shape=(), unit=m)
    """
    return _pair(a, b, ca.fmax, np.maximum, "maximum")


def atan2(y: Any, x: Any) -> Any:
    """Return the polar angle of the point (x, y), from -pi to pi [rad]; x and y have the same unit.

    The order of the arguments is y, then x, as in C and NumPy. Raises ModelError for different units.

    >>> m = gt.Builder()
    >>> x, y = m.variable("x", unit="m"), m.variable("y", unit="m")
    >>> gt.atan2(y, x)
    Expr(atan2(y,x), shape=(), unit=1)
    >>> round(float(gt.atan2(1.0, -1.0)), 4)  # 135 degrees
    2.3562
    """
    angle = _pair(y, x, ca.atan2, np.arctan2, "atan2")
    return Expr(angle.sx, angle.shape, ONE, angle.scope) if isinstance(angle, Expr) else angle


def clip(x: Any, low: float, high: float) -> Any:
    """Return x limited to [low, high], elementwise and in the unit of x (saturation).

    Its derivative is discontinuous at both limits.

    >>> m = gt.Builder()
    >>> gt.clip(m.variable("force", unit="N"), -700, 700)
    Expr(fmin(fmax(force,-700),700), shape=(), unit=N)
    >>> int(gt.clip(3, -1, 1))
    1
    """
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
