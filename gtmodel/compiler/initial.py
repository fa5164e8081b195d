"""Consistent initialisation: a system of its own, over all chain symbols at the start time."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .plan import Plan

Pair = tuple[int, int]

STEPS = 80
# in nominals; initial values are states of an integrator with far looser tolerance
TOLERANCE = 1e-10


def initial_point(
    plan: Plan, held: Mapping[Pair, float], guess: Mapping[Pair, float], time: float = 0.0, near: np.ndarray | None = None
) -> np.ndarray:
    """A point over `plan.pairs` that satisfies all differentiated equations and the initial equations.

    held: symbols with a prescribed value (fixed starts, known inputs and their derivatives).
    guess: values from which free symbols move as little as possible; others start at the sample point.

    Raises ModelError naming what contradicts the equations.
    """
    flat, sampler = plan.flat, plan.sampler
    position = {pair: n for n, pair in enumerate(plan.pairs)}
    w = (plan.samples[0] if near is None else near).copy()
    for pair, value in {**guess, **held}.items():
        if pair in position:
            w[position[pair]] = value
    free = np.array([n for n, pair in enumerate(plan.pairs) if pair not in held], dtype=int)
    initial = [plan.alias.rewrite(flat, e.residual) for e in flat.initial]
    residual = ca.vertcat(*sampler.stages, *initial)
    inside = {p for p in flat.scope.symbols_in(residual)}
    missing = inside - set(position)
    if missing:
        name = flat.symbol_name(*sorted(missing)[0])
        raise ModelError(f"{flat.title}: an initial equation uses {name}, which no equation determines")
    columns = ca.vertcat(*[sampler.w[int(n)] for n in free]) if free.size else ca.SX(0, 1)
    f = ca.Function("initial", [sampler.w, flat.p, flat.scope.time], [residual, ca.densify(ca.jacobian(residual, columns))])
    p = flat.require_values()
    scale = np.array([flat.variables[plan.pairs[n][0]].nominal for n in free])
    # what was guessed gives way less than what was not
    reach = scale * np.array([0.1 if plan.pairs[n] in guess else 1.0 for n in free])
    for _ in range(STEPS):
        r, jacobian = (np.asarray(x.full()) for x in f(w, p, time))
        r = r.reshape(-1)
        size = float(np.max(np.abs(r), initial=0.0))
        if not np.isfinite(size):
            raise ModelError(f"{flat.title}: the equations are not finite at the start values; give others")
        if size == 0.0:
            break
        if free.size == 0:
            break
        step = reach * np.linalg.lstsq(jacobian * reach, -r, rcond=1e-11)[0]
        damp = min(1.0, 2.0 / max(1e-300, float(np.max(np.abs(step) / np.maximum(scale, 1e-300)))))
        w[free] += damp * step
        if np.max(np.abs(step) / (1 + np.abs(w[free]))) < 1e-15:
            break
    r = np.asarray(f(w, p, time)[0].full()).reshape(-1)
    if not np.max(np.abs(r), initial=0.0) <= TOLERANCE * max(1.0, float(np.max(np.abs(w), initial=0.0))):
        raise ModelError(_contradiction(plan, r, held))
    return w


def _contradiction(plan: Plan, r: np.ndarray, held: Mapping[Pair, float]) -> str:
    flat = plan.flat
    worst = int(np.argmax(np.abs(r)))
    shown = ", ".join(f"{flat.symbol_name(*p)} = {v:g}" for p, v in sorted(held.items())[:8])
    return (
        f"{flat.title}: the prescribed start values contradict the equations (residual {abs(r[worst]):.3g}): {shown}; "
        "prescribe fewer of them, or mend them"
    )


def start_values(plan: Plan, given: Mapping[str, object] | None = None) -> tuple[dict[Pair, float], dict[Pair, float]]:
    """(held, guess) by kept symbol: fixed starts and what the caller gives are held, other starts guessed.

    `given` maps names such as "T", "der(q)", "x" to values. Raises ModelError for a wrong name or shape.
    """
    flat = plan.flat
    held: dict[Pair, float] = {}
    guess: dict[Pair, float] = {}
    for v in flat.variables:
        if v.start is None:
            continue
        sign, kept, order = plan.alias.resolve(v.index, 0)
        (held if v.fixed else guess).setdefault((kept, order), sign * v.start)
    for name, value in (given or {}).items():
        shape, indices, order = flat.lookup(name)
        array = np.asarray(value, dtype=float).reshape(-1)
        if array.size != len(indices):
            raise ModelError(f"the start of '{name}' has {len(indices)} entries; found {array.size}")
        if not np.all(np.isfinite(array)):
            raise ModelError(f"the start of '{name}' must be finite; found {value}")
        for i, x in zip(indices, array, strict=True):
            sign, kept, k = plan.alias.resolve(i, order)
            held[(kept, k)] = sign * float(x)
            guess.pop((kept, k), None)
    return held, guess


def missing_starts(plan: Plan, held: Mapping[Pair, float]) -> list[str]:
    """States without a prescribed value, by name: the initialisation chose them."""
    return [plan.flat.symbol_name(*p) for p in plan.states if p not in held]
