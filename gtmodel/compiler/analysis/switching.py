"""Models with events as engines take them: in one mode, with sign() as a switch, or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from ...lang.source import ModelError, SourceLocation
from ..flat import FlatModel
from ..rewriting import applied, of_expression, walked
from .event_names import listing, named_events
from .events import Comparison, FlatEvents, FlatMode
from .nonsmooth import is_nonsmooth


def in_mode(flat: FlatModel, values: Sequence[bool]) -> FlatModel:
    """The model while its modes have these values: a model without events, of the same symbols."""
    events = flat.events
    assert events is not None
    if not events.modes:
        return replace(flat, events=None, cache={})
    old = ca.vertcat(*[m.symbol for m in events.modes])
    new = ca.DM([float(v) for v in values])

    def fixed(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, old, new)

    return replace(
        flat,
        equations=[replace(e, residual=fixed(e.residual)) for e in flat.equations],
        branches=[replace(b, expression=fixed(b.expression)) for b in flat.branches],
        initial=[replace(e, residual=fixed(e.residual)) for e in flat.initial],
        energies=[replace(e, expression=fixed(e.expression)) for e in flat.energies],
        events=None,
        cache={},
    )


def refuse_events(flat: FlatModel) -> None:
    """Raises ModelError, with file and line, for a model with events where only smooth ones are taken."""
    events = flat.events
    if events is None:
        return
    if events.blocks:
        raise ModelError(
            f"{flat.title} has the sampled block '{events.blocks[0].name}', whose steps are no equations; optimise the "
            "continuous model, and try the result in gt.simulate",
            getattr(events.blocks[0].model, "where", None),
        )
    first = next(iter(named_events(events).values()), None)
    raise ModelError(
        f"{flat.title} has events, and an optimisation does not choose their order: give it by gt.solve_phases("
        f"gt.phases_of_events(model, [names in order])), or write a smooth function; events are {listing(events)}",
        first.where if first else None,
    )


def with_switching_signs(flat: FlatModel) -> FlatModel:
    """The model with each sign() of what moves as an event: 1 or -1, and switched where its argument is zero. The model
    itself where it has none."""
    key = "switching signs"
    if key not in flat.cache:
        flat.cache[key] = _with_signs(flat) if is_nonsmooth(flat) else flat
    return flat.cache[key]


def _with_signs(flat: FlatModel) -> FlatModel:
    fixed = {q.symbol.element_hash() for q in flat.parameters}
    events = flat.events or FlatEvents([], [], [], [], [], [], ca.SX(0, 1), [])
    comparisons, modes = list(events.comparisons), list(events.modes)
    equations = []
    for e in flat.equations:
        read, symbols = of_expression(e.residual)
        if not any(i.op == ca.OP_SIGN for i in read):
            equations.append(e)
            continue
        signs = _Signs(fixed, e.where, comparisons, modes)
        (residual,) = walked(read, symbols, signs)
        equations.append(replace(e, residual=residual))
    if len(modes) == len(events.modes):
        return flat
    return replace(flat, equations=equations, events=replace(events, comparisons=comparisons, modes=modes), cache={})


class _Signs:
    """Writes an expression anew with modes in place of sign()."""

    def __init__(
        self, fixed: set[int], where: SourceLocation, comparisons: list[Comparison], modes: list[FlatMode]
    ) -> None:
        self._fixed, self._where, self._comparisons, self._modes = fixed, where, comparisons, modes

    def leaf(self, x: ca.SX) -> ca.SX:
        return x

    def operation(self, k: int, op: int, given: list[ca.SX]) -> ca.SX:
        x = given[0]
        if op != ca.OP_SIGN or all(s.element_hash() in self._fixed for s in ca.symvar(x)):
            return applied(op, given)
        known = next((n for n, c in enumerate(self._comparisons) if ca.is_equal(c.expression, x, 100)), None)
        if known is None:
            known = len(self._comparisons)
            self._comparisons.append(Comparison(x, False, False, f"sign({x})", self._where))
        symbol = ca.SX.sym(f"mode{len(self._modes)}")
        self._modes.append(FlatMode(symbol, ("atom", known), self._where, "sign()"))
        return 2 * symbol - 1

    def whole(self, form: ca.SX) -> ca.SX:
        return form
