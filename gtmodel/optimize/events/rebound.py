"""On which side of its threshold a quantity goes on after the event that it brought about."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from ...compiler.analysis.events import Pair
from ...compiler.emission import substituted
from ...compiler.flat import FlatModel
from ...compiler.matrices import stacked
from ...compiler.plan import CausalPlan, make_plan
from .jump import Jump

# states at which the event could happen; all of them have to agree
PLACES, NEWTON_STEPS = 400, 6
# of the largest value among them: a smaller one has no sign
ZERO = 1e-9


def side_after(
    before: FlatModel, after: FlatModel, numbers: Mapping[int, float | None], quantity: ca.SX, side: int, jump: Jump
) -> int | None:
    """The side on which a quantity goes on that has reached its threshold from the other one, by the equations of both
    modes and what the event changes: 1 or -1; None where it depends on where the event happens.

    It goes on to where it went, unless its value or its rate jumps. numbers: discrete variables before the event, None
    for what the optimisation chooses; side: the one it reaches.
    """
    if not jump.moves:
        return side
    if jump.forces:
        return None
    rate = before.scope.derivative(quantity)
    new_plan, (g_new, rate_new) = _explicit(after, [quantity, rate])
    anew: dict[Pair, ca.SX] = {}
    for pair, value in jump.restarted.items():
        sign, kept, order = new_plan.alias.resolve(*pair)
        anew[kept, order] = sign * value
    states = new_plan.states
    started = [anew.get(pair, before.scope.symbol(*pair)) for pair in states]
    old_plan, values = _explicit(before, [quantity, rate, *started])
    if old_plan.newton or new_plan.newton:
        return None
    old = [before.scope.symbol(*p) for p in states] + [before.parameters[place].symbol for place in jump.assigned]
    new = [*values[2:], *[ca.SX(value) for value in jump.assigned.values()]]
    jumped = ca.substitute([g_new, rate_new], [stacked(old)], [stacked(new)]) if old else [g_new, rate_new]
    if _same(jumped[0], values[0]) and _same(jumped[1], values[1]):
        return side
    # inputs may jump at the event
    inputs = [before.scope.symbol(*p) for p in new_plan.inputs if p not in states]
    if inputs:
        others = [ca.SX.sym(f"input{n}") for n in range(len(inputs))]
        changed = ca.substitute([g_new, rate_new], [stacked(inputs)], [stacked(others)])
        jumped = ca.substitute(changed, [stacked(old)], [stacked(new)]) if old else changed
    drawn = _numbers(before, old_plan, numbers, [*values[:2], *jumped])
    g, slope, value, new_rate = drawn
    happens = np.isfinite(drawn).all(axis=0) & (side * slope > 0)
    if not happens.any():
        return None
    size = float(np.max(np.abs(value[happens])))
    moved = np.abs(value) > np.maximum(ZERO * size, 10 * np.abs(g))
    signs = np.where(moved, np.sign(value), np.where(np.abs(new_rate) > ZERO * np.abs(slope), np.sign(new_rate), 0.0))
    chosen = np.unique(signs[happens])
    return int(chosen[0]) if len(chosen) == 1 and chosen[0] else None


def _explicit(flat: FlatModel, expressions: list[ca.SX]) -> tuple[CausalPlan, list[ca.SX]]:
    """Expressions in states, inputs, parameters and time of a mode."""
    inputs = [v.index for v in flat.variables if v.role == "input"]
    asked = {(v.index, 0) for v in flat.variables} | set(flat.scope.symbols_in(ca.vertcat(*expressions)))
    plan = make_plan(flat, inputs, sorted(asked), rates=True)
    return plan, substituted(plan, plan.alias.rewrite_all(flat, expressions), [])


def _numbers(
    flat: FlatModel, plan: CausalPlan, numbers: Mapping[int, float | None], expressions: list[ca.SX]
) -> np.ndarray:
    """Values (expressions, PLACES) at drawn states where the first of them is zero."""
    states = [flat.scope.symbol(*p) for p in plan.states]
    known = {s.element_hash() for s in [*states, *(q.symbol for q in flat.parameters)]}
    others = [s for s in ca.symvar(ca.vertcat(*expressions)) if s.element_hash() not in known]
    x, u = stacked(states), stacked(others)
    slope = ca.gradient(expressions[0], x) if states else ca.SX(0, 1)
    rng = np.random.default_rng(0)
    p = np.array([_drawn(rng, q.value, q.free) for q in flat.parameters]).reshape(len(flat.parameters), PLACES)
    for place, number in numbers.items():
        p[place] = rng.normal(size=PLACES) if number is None else number
    start = np.array([flat.variables[i].start or 0.0 if k == 0 else 0.0 for i, k in plan.states])
    nominal = np.array([flat.variables[i].nominal for i, _ in plan.states])
    xs = start[:, None] + nominal[:, None] * 3.0 * rng.normal(size=(len(states), PLACES))
    us = np.array([3.0 * rng.normal(size=PLACES) for _ in others]).reshape(len(others), PLACES)
    f = ca.Function("places", [x, u, flat.p], [ca.densify(ca.vertcat(*expressions)), ca.densify(slope)]).map(PLACES)
    for _ in range(NEWTON_STEPS):
        values, normal = (np.asarray(v.full()) for v in f(xs, us, p))
        length = np.sum(normal**2, axis=0)
        xs = xs - np.where(length > 0, values[0] / np.where(length > 0, length, 1.0), 0.0) * normal
    return np.asarray(f(xs, us, p)[0].full())


def _drawn(rng: np.random.Generator, value: float, free: bool) -> np.ndarray:
    """A parameter's value, a chosen one's about its guess."""
    return value * (rng.uniform(0.5, 1.5, PLACES) if free else np.ones(PLACES))


def _same(a: ca.SX, b: ca.SX) -> bool:
    return bool(ca.is_equal(ca.simplify(a), ca.simplify(b), 100))
