"""What an integrator cannot step over: jumps of the equations where a variable changes sign."""

from __future__ import annotations

import casadi as ca

from ..compiler.flat import FlatModel
from ..lang.source import ModelError


def refuse_jumps(flat: FlatModel) -> None:
    """Raises ModelError, with file and line, for an equation that holds sign() of something that moves."""
    for e in flat.equations:
        symbols = ca.symvar(e.residual)
        fixed = {q.symbol.element_hash() for q in flat.parameters}
        if any(_signs(e.residual, symbols, fixed)):
            raise ModelError(
                f"'{e.label}' holds sign(), whose jump makes integrators fail or return wrong answers; use a "
                "smoothed friction (TanhFriction, PiecewiseLinearFriction)",
                e.where,
            )


def _signs(residual: ca.SX, symbols: list[ca.SX], fixed: set[int]) -> list[bool]:
    """For each sign() in an expression whether its argument moves."""
    f = ca.Function("equation", [ca.vertcat(*symbols)], [residual])
    moving: dict[int, bool] = {}  # by place in the function's memory
    found = []
    for k in range(f.n_instructions()):
        operation, into, out = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if operation == ca.OP_INPUT:
            moving[into[0]] = symbols[out[1]].element_hash() not in fixed
        elif operation != ca.OP_OUTPUT:
            value = operation != ca.OP_CONST and any(moving.get(i, False) for i in out)
            if operation == ca.OP_SIGN:
                found.append(value)
            moving[into[0]] = value
    return found
