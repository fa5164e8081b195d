"""Curves as expressions: linear and cubic spline interpolation, and piecewise polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np

from .expression import Expr, dimension_of, gathered, operand, over
from .source import ModelError, here


def steps_of(x: ca.SX, breaks: Sequence[ca.SX | float]) -> list[ca.SX]:
    """Return for each break a step: 0 before it and 1 from it on, with zero derivative."""
    return [x >= b for b in breaks]


def chosen(steps: Sequence[ca.SX], pieces: Sequence[ca.SX]) -> ca.SX:
    """Return the column of the piece that contains the argument: piece k + 1 begins at the step steps[k].

    It is the sum of all pieces, each times 0 or 1, and therefore exact. A sum of changes from piece to piece would lose
    digits of a small piece after a large one.
    """
    weights: dict[tuple[int, int], ca.SX] = {}

    def weight(begin: int, end: int) -> ca.SX:
        if (begin, end) not in weights:
            before = ca.SX(1) if begin == 0 else steps[begin - 1]
            weights[begin, end] = before - steps[end - 1] if end < len(pieces) else before
        return weights[begin, end]

    def entry(values: list[ca.SX]) -> ca.SX:
        changes = [k for k in range(1, len(values)) if not ca.is_equal(values[k - 1], values[k])]
        if not changes:
            return values[0]
        runs = zip([0, *changes], [*changes, len(values)], strict=True)
        return sum((weight(a, b) * values[a] for a, b in runs if not values[a].is_zero()), ca.SX(0))

    rows = [ca.vertsplit(ca.densify(p)) for p in pieces]
    return ca.vertcat(*[entry([row[j] for row in rows]) for j in range(len(rows[0]))])


def piecewise(x: Any, breaks: Any, coefficients: Any) -> Expr:
    """Return a piecewise polynomial with the pieces sum_n coefficients[n, k] * (x - breaks[k])^(order - n).

    Args:
        x: scalar expression.
        breaks: (pieces + 1,) numbers, strictly increasing, in the unit of x.
        coefficients: (order + 1, pieces) or (order + 1, pieces, m), highest power first, as in scipy's PPoly.

    The curve has no declared unit: it takes the unit of the other side of an equation. Beyond the breaks the end pieces
    are extrapolated; at a break the right piece applies. Time derivatives ignore jumps at the breaks, so the curve
    needs continuous derivatives up to the order that the model uses. Raises ModelError for wrong shapes.

    >>> class Cam(gt.Model):
    ...     phi = gt.variable(unit="rad")
    ...     lift = gt.variable(unit="m")
    ...     def equations(self):  # at rest up to 1 rad, then 0.02 m/rad^2 (phi - 1)^2
    ...         yield self.lift == gt.piecewise(self.phi, [0, 1, 2], [[0, 0.02], [0, 0], [0, 0]])
    >>> lift, status = Cam().causal(known="phi", targets="lift")([0.5, 1.5])
    >>> lift.round(6).tolist()
    [0.0, 0.005]
    """
    breaks, c = np.asarray(breaks, float), np.asarray(coefficients, float)
    if not isinstance(x, Expr) or x.shape != ():
        raise ModelError("piecewise() takes a scalar expression", here())
    if breaks.ndim != 1 or len(breaks) < 2 or not np.all(np.diff(breaks) > 0):
        raise ModelError(f"piecewise() needs strictly increasing breaks; found {breaks}", here())
    if c.ndim not in (2, 3) or c.shape[1] != len(breaks) - 1:
        raise ModelError(
            f"piecewise() takes coefficients of shape (order + 1, {len(breaks) - 1}) or (order + 1, {len(breaks) - 1}, "
            f"m); found {c.shape}",
            here(),
        )
    sx = operand(x, x.scope)[0]
    columns = c.reshape(*c.shape[:2], -1)

    steps = steps_of(sx, breaks[1:-1].tolist())
    u = sx - chosen(steps, [ca.SX(b) for b in breaks[:-1].tolist()])
    value = ca.SX.zeros(columns.shape[2], 1)
    for power in columns:
        value = value * u + chosen(steps, [ca.SX(ca.DM(row)) for row in power])
    return Expr(ca.SX(ca.densify(value)), c.shape[2:], None, x.scope)


def interpolate(
    x: Any, at: Any, values: Any, method: Literal["linear", "cubic"] = "linear", derivative: Literal[0, 1] = 0
) -> Expr:
    """Return the value, or the derivative, at x of the curve through the points (at, values).

    Args:
        x: scalar expression, with the unit of `at`.
        at: abscissae (n,), strictly increasing, n >= 2; numbers or parameters (declare these `increasing`).
        values: ordinates (n,) or (n, m); plain numbers are dimensionless.
        method: "linear": piecewise linear, continuous; "cubic": natural spline, two continuous derivatives.
        derivative: 0: the value; 1: the derivative d/dx, in the unit of values per unit of x.

    The extrapolation is straight: "linear" continues the end pieces, "cubic" continues with the tangent, which keeps
    the second derivative continuous. At a point the right piece applies, so the derivative of a piecewise linear curve
    is defined there too; its time derivative contains no impulses.

    Raises ModelError if shapes or units are incompatible, and for numbers in `at` that do not increase.

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
        raise ModelError("interpolate() needs at least one expression; for numbers use numpy or scipy", here())
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
        raise ModelError(
            f"interpolate(): x is in {units[0]}, the abscissae are in {units[1]}; expected equal units", here()
        )
    if not isinstance(at, Expr) and not np.all(np.diff(np.asarray(at, float)) > 0):
        raise ModelError(f"interpolate() needs strictly increasing abscissae; found {at}", here())
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
    """Return for each piece its start, the value there and the derivative. The end pieces extrapolate."""
    n = at.numel()
    rows = [values[k, :].T for k in range(n)]
    jacobian = [(rows[k + 1] - rows[k]) / (at[k + 1] - at[k]) for k in range(n - 1)]
    return [[at[k] for k in range(n - 1)], rows[: n - 1], jacobian]


def _cubic(at: ca.SX, values: ca.SX) -> list[list[ca.SX]]:
    """Return for each piece its start, value, slope, quadratic and cubic coefficient; both end pieces are linear."""
    n = at.numel()
    y = [values[k, :].T for k in range(n)]
    h = [at[k + 1] - at[k] for k in range(n - 1)]
    d = [(y[k + 1] - y[k]) / h[k] for k in range(n - 1)]
    zero = ca.SX.zeros(*y[0].shape)
    # m: second derivatives divided by six, zero at the ends; tridiagonal and diagonally dominant, hence no pivoting
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
