"""What an integrator cannot step over: jumps of the equations where a variable changes sign."""

from __future__ import annotations

import casadi as ca

from ..compiler.analysis.nonsmooth import is_nonsmooth, kinked_in
from ..compiler.flat import FlatModel
from ..lang.source import ModelError


def refuse_discontinuities(flat: FlatModel) -> None:
    """Raises ModelError, with file and line, for an equation that holds sign() of something that moves."""
    if not is_nonsmooth(flat):
        return
    fixed = {q.symbol.element_hash() for q in flat.parameters}
    residuals = [e.residual for e in flat.equations]
    moving = [s for s in ca.symvar(ca.vertcat(*residuals)) if s.element_hash() not in fixed]
    for e, inside in zip(flat.equations, kinked_in(residuals, moving, frozenset([ca.OP_SIGN])), strict=True):
        if inside:
            raise ModelError(
                f"'{e.label}' holds sign(), whose jump makes integrators fail or return wrong answers; use a "
                "smoothed friction (TanhFriction, PiecewiseLinearFriction)",
                e.where,
            )
