"""A curve of polynomial pieces as an expression."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from .expression import Expr, operand
from .source import ModelError, here
from .steps import chosen, steps_of


def piecewise(x: Any, breaks: Any, coefficients: Any) -> Expr:
    """The curve whose piece k is sum_n coefficients[n, k] * (x - breaks[k])^(order - n), n = 0 ... order.

    Args:
        x: scalar expression.
        breaks: (pieces + 1,) numbers, strictly increasing, in the unit of x.
        coefficients: (order + 1, pieces) or (order + 1, pieces, m), highest power first, as scipy's PPoly has them.

    Its unit is that of what it is compared with. Beyond both ends the end pieces go on; at a break the piece on its
    right counts. Time derivatives take the pieces as they are, so the curve should be as smooth as the model
    differentiates it. Raises ModelError for wrong shapes.

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
        raise ModelError(f"piecewise() takes breaks that increase; found {breaks}", here())
    if c.ndim not in (2, 3) or c.shape[1] != len(breaks) - 1:
        raise ModelError(
            f"piecewise() takes coefficients (order + 1, {len(breaks) - 1}) or (order + 1, {len(breaks) - 1}, m); "
            f"found {c.shape}",
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
