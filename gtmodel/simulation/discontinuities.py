"""Discontinuities: of equations, which integrators cannot step over, and of inputs, where they begin anew."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..compiler.flat import FlatModel
from ..compiler.rewriting import is_nonsmooth, kinked_in
from ..lang.source import ModelError
from ..results.status import SolveStatus
from .ending import Ended
from .inputs import SimulationInputs
from .reduced import TOUCH
from .systems import SimulatedSystem

# roots are looked at in so many steps between the old and the new value of a discontinuous input
STEPS = 64
# of a derivative's largest size in its table: splines of measured rows end at rest only so well
AT_REST = 1e-3


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
                f"'{e.label}' holds sign(), whose discontinuity makes integrators fail or return wrong answers; use a "
                "smoothed friction (TanhFriction, PiecewiseLinearFriction)",
                e.where,
            )


def refuse_discontinuous_inputs(
    inputs: SimulationInputs, needed: Sequence[tuple[int, int]], start: float, end: float
) -> None:
    """Raises ModelError for a table whose end inside the run makes a derivative discontinuous, where the model needs
    the derivative of that one.

    needed: (index, order) of the derivatives that the model reads.
    """
    for index, order in needed:
        table = inputs.tables.get(index)
        if table is None:
            continue
        for time, before in ((float(table.times[0]), False), (float(table.times[-1]), True)):
            held = start < time if not before else time < end
            if not held or not start <= time <= end or len(table.times) < 2:
                continue
            moving = table.piece(time, before)
            for k in range(1, min(order, table.coefficients)):
                if abs(moving[k]) > AT_REST * table.largest(k):
                    name, rate = inputs.flat.symbol_name(index, order), inputs.flat.symbol_name(index, k)
                    what = "begins" if not before else "ends"
                    raise ModelError(
                        f"the table of input '{table.name}' {what} at {time:g} s with {rate} = {moving[k]:.3g} and is "
                        f"held beyond, so that {name}, which the model needs, has an impulse there; extend the table "
                        f"over the run, or let it {what[:-1]} at rest"
                    )


def after_discontinuity(
    system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Newton unknowns after the tables' pieces change, followed from the old to the new values.

    Raises Ended where a solution turns back, or a root meets its other one, on the way.
    """
    if np.array_equal(before[1:], after[1:]):
        return z
    if system.roots and not _roots_go_on(system, x, z, time, before, after):
        labels = "; ".join(system.roots.labels[:4])
        raise _lost(time, labels)
    continuation = system.continuation
    if continuation is None:
        return z
    followed = continuation.follow(z, continuation.place(x, time, before), continuation.place(x, time, after))
    if followed is None:
        raise _lost(time, system.reduced.unknowns)
    return followed


def _roots_go_on(
    system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> bool:
    """Whether discriminants stay positive on the way; those that follow Newton unknowns are not asked."""
    if z.size or not system.roots.moved_by_inputs:
        return True
    shares = np.linspace(0.0, 1.0, STEPS + 1)
    p = before[:, None] + shares * (after - before)[:, None]
    values = system.roots.values(x, z, time, p)
    a, b, c = values[:-2], values[1:-1], values[2:]
    # a touch between two steps: a minimum whose parabola goes through zero
    curve = a - 2 * b + c
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = np.where((b <= a) & (b <= c) & (curve > 0), b - (a - c) ** 2 / (8 * curve), b)
    return bool(np.all(values > 0) and np.all((lowest > TOUCH) | (lowest == b)))


def _lost(time: float, names: str) -> Ended:
    return Ended(
        SolveStatus.FAILED,
        f"the motion ends at {time:.6g} s, where an input is discontinuous: {names} cannot be followed from its old "
        "to its new value, because the solution turns back or meets another one on the way; make its step smaller, or "
        "ramp it",
    )
