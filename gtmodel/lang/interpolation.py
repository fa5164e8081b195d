"""Interpolation through points as an expression: straight pieces or a natural cubic spline."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np

from .expression import Expr, dimension_of, gathered, operand, over
from .source import ModelError, here
from .steps import chosen, steps_of


def interpolate(
    x: Any, at: Any, values: Any, method: Literal["linear", "cubic"] = "linear", derivative: Literal[0, 1] = 0
) -> Expr:
    """The curve through the points (at, values), evaluated at x; or its derivative.

    Args:
        x: scalar expression, with the unit of `at`.
        at: abscissae (n,), strictly increasing, n >= 2; numbers or parameters (declare these `increasing`).
        values: (n,) or (n, m); plain numbers make a curve without a unit.
        method: "linear": straight pieces, continuous; "cubic": natural spline, two continuous derivatives.
        derivative: 0 the value, 1 its derivative d/dx, in the unit of values per unit of x.

    Beyond the first and the last point the curve goes on straight: "linear" with its end pieces, "cubic" tangentially,
    which keeps the second derivative continuous. At a point the piece to its right counts, so the derivative of
    straight pieces is defined there too; time derivatives of it take the pieces as they are, without impulses.

    Raises ModelError for shapes and units that do not fit, and for numbers in `at` that do not increase.

    >>> class Rail(gt.Model):
    ...     at = gt.parameter([0.0, 1.0, 2.0], unit="m", increasing=True)
    ...     heights = gt.parameter([0.0, 0.0, 3e-4], unit="m")
    ...     s = gt.variable(unit="m")
    ...     height = gt.variable(unit="m")
    ...     def equations(self):
    ...         yield self.height == gt.interpolate(self.s, self.at, self.heights)
    >>> height, status = Rail().causal(known="s", targets="height")(1.5)
    >>> round(height, 6)
    0.00015
    """
    at, values = gathered(at), gathered(values)
    scope = next((e.scope for e in (x, at, values) if isinstance(e, Expr)), None)
    if scope is None:
        raise ModelError("interpolate() takes at least one expression; use numpy or scipy on numbers", here())
    (sx, shape), (sa, shape_a), (sv, shape_v) = (operand(e, scope) for e in (x, at, values))
    if shape != () or len(shape_a) != 1 or not shape_v or shape_v[0] != shape_a[0] or shape_a[0] < 2:
        raise ModelError(
            "interpolate() takes a scalar, n >= 2 abscissae and n values; "
            f"found shapes {shape}, {shape_a} and {shape_v}",
            here(),
        )
    if method not in ("linear", "cubic") or derivative not in (0, 1):
        raise ModelError(
            "interpolate() takes method 'linear' or 'cubic' and derivative 0 or 1; "
            f"found {method!r} and {derivative!r}",
            here(),
        )
    units = [e.dimension for e in (x, at) if isinstance(e, Expr)]
    if None not in units and len(set(units)) > 1:
        raise ModelError(f"interpolate(): x is in {units[0]}, its abscissae are in {units[1]}", here())
    if not isinstance(at, Expr) and not np.all(np.diff(np.asarray(at, float)) > 0):
        raise ModelError(f"interpolate() takes abscissae that increase; found {at}", here())
    pieces = _linear(sa, sv) if method == "linear" else _cubic(sa, sv)
    steps = steps_of(sx, ca.vertsplit(sa) if method == "cubic" else ca.vertsplit(sa)[1:-1])
    begin, *coefficients = (chosen(steps, c) for c in pieces)
    u = sx - begin
    powers = range(len(coefficients))
    if derivative:
        result = sum((k * coefficients[k] * u ** (k - 1) for k in powers[1:]), ca.SX(0))
    else:
        result = sum((coefficients[k] * u**k for k in powers), ca.SX(0))
    dimension = dimension_of(values)
    if derivative:
        dimension = over(dimension, units[0] if units else None)
    return Expr(ca.SX(result), shape_v[1:], dimension, scope)


def _linear(at: ca.SX, values: ca.SX) -> list[list[ca.SX]]:
    """Per piece: where it begins, value there, derivative. The end pieces go on for ever."""
    n = at.numel()
    rows = [values[k, :].T for k in range(n)]
    slopes = [(rows[k + 1] - rows[k]) / (at[k + 1] - at[k]) for k in range(n - 1)]
    return [[at[k] for k in range(n - 1)], rows[: n - 1], slopes]


def _cubic(at: ca.SX, values: ca.SX) -> list[list[ca.SX]]:
    """Per piece: where it begins, value, derivative, quadratic and cubic coefficient; straight pieces at both ends."""
    n = at.numel()
    y = [values[k, :].T for k in range(n)]
    h = [at[k + 1] - at[k] for k in range(n - 1)]
    d = [(y[k + 1] - y[k]) / h[k] for k in range(n - 1)]
    zero = ca.SX.zeros(*y[0].shape)
    # second derivatives over six, zero at the ends: tridiagonal and diagonally dominant, so without pivoting
    m, upper, right = [zero] * n, [ca.SX(0)] * n, [zero] * n
    for k in range(1, n - 1):
        pivot = 2 * (h[k - 1] + h[k]) - h[k - 1] * upper[k - 1]
        upper[k] = h[k] / pivot
        right[k] = (d[k] - d[k - 1] - h[k - 1] * right[k - 1]) / pivot
    for k in reversed(range(1, n - 1)):
        m[k] = right[k] - upper[k] * m[k + 1]
    slope = [d[k] - h[k] * (2 * m[k] + m[k + 1]) for k in range(n - 1)]
    last = d[-1] + h[-1] * m[-2]
    return [
        [at[0], *(at[k] for k in range(n))],
        [y[0], *y],
        [slope[0], *slope, last],
        [zero, *(3 * m[k] for k in range(n - 1)), zero],
        [zero, *((m[k + 1] - m[k]) / h[k] for k in range(n - 1)), zero],
    ]
