"""Models with events for the engines: in one mode, with sign() as a switch, or refused; names and values of events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from ...lang.source import ModelError, SourceLocation
from ..alias import AliasResult
from ..flat import FlatModel
from ..rewriting import applied, is_nonsmooth, of_expression, walked
from .events import Comparison, FlatEvents, FlatMode, FlatWhen, Logic, Pair


@dataclass(frozen=True, eq=False)
class NamedEvent:
    """An event that acts when its condition becomes true (`when`: its number), or a switch (`mode`: its number)."""

    name: str
    logic: Logic
    where: SourceLocation
    when: int | None = None
    mode: int | None = None

    def shown(self, events: FlatEvents) -> str:
        """Return the name, the line and the condition."""
        return f"{self.name} ({self.where}): {text_of(self.logic, events)}"


def named_events(events: FlatEvents) -> dict[str, NamedEvent]:
    """Return all events of a model by name: "event 1" of gt.when, "If 1" of gt.If, "sign() 1", in order of lines."""
    named = {w.name: NamedEvent(w.name, w.logic, w.where, when=n) for n, w in enumerate(events.whens)}
    count: Counter[str] = Counter()
    for n, m in enumerate(events.modes):
        count[m.name] += 1
        name = f"{m.name} {count[m.name]}"
        named[name] = NamedEvent(name, m.logic, m.where, mode=n)
    return named


def listing(events: FlatEvents) -> str:
    """Return all events with their lines and conditions."""
    return "; ".join(e.shown(events) for e in named_events(events).values())


def comparisons_in(logic: Logic) -> list[int]:
    """Return the numbers of the comparisons in a condition."""
    operation, *parts = logic
    if operation == "atom":
        return [parts[0]]
    return [] if operation == "sample" else [n for part in parts for n in comparisons_in(part)]


def samples_in(logic: Logic) -> list[int]:
    """Return the numbers of the samples in a condition."""
    operation, *parts = logic
    if operation == "sample":
        return [parts[0]]
    return [] if operation == "atom" else [n for part in parts for n in samples_in(part)]


def text_of(logic: Logic, events: FlatEvents) -> str:
    """Return the text of a condition."""
    operation, *parts = logic
    if operation == "atom":
        return events.comparisons[parts[0]].text
    if operation == "sample":
        return "gt.initial()" if events.samples[parts[0]].period is None else "gt.sample()"
    texts = [text_of(part, events) for part in parts]
    if operation == "not":
        return f"~({texts[0]})"
    return f" {'&' if operation == 'and' else '|'} ".join(f"({t})" for t in texts)


def keys_of(when: FlatWhen) -> list[int | Pair]:
    """Return the quantities that an event changes: positions in `flat.p`, derivatives of variables."""
    return [*(place for place, _ in when.assigns), *(pair for pair, _ in when.reinits)]


def values_of(when: FlatWhen) -> list[ca.SX]:
    """Return the new values in the order of `keys_of`, followed by the energy loss if it is declared."""
    loss = [] if when.loss is None else [when.loss]
    return [*(x for _, x in when.assigns), *(x for _, x in when.reinits), *loss]


def acting_together(flat: FlatModel, whens: Sequence[FlatWhen]) -> ca.SX:
    """Return the values of several simultaneous events as one column.

    Discrete variables that an event sets are replaced by their new values; the old ones are `FlatEvents.before`. Raises
    ModelError if new values depend on each other in a loop.
    """
    column = ca.SX(ca.vertcat(*[x for w in whens for x in values_of(w)]))
    new: dict[int, ca.SX] = {}
    for when in whens:
        for place, value in when.assigns:
            new.setdefault(place, value)
    symbols = {place: flat.parameters[place].symbol for place in new}
    # each substitution resolves one link of a chain
    for _ in new:
        column = ca.substitute(column, ca.vertcat(*symbols.values()), ca.vertcat(*new.values()))
    if new and ca.depends_on(column, ca.vertcat(*symbols.values())):
        names = ", ".join(str(s) for s in symbols.values())
        raise ModelError(
            f"the new values of {names} depend on each other in a loop of events; write gt.pre(...) for the value "
            "before the event",
            whens[-1].where,
        )
    return column


def differentiated(flat: FlatModel) -> list[Pair]:
    """Return the derivatives of variables whose time derivative occurs in an equation: these are continuous.

    An alias of such a quantity is not necessarily continuous: another mode may equate it with another quantity.
    """
    if "differentiated" not in flat.cache:
        highest: dict[int, int] = {}
        for pairs in flat.scope.symbols_in_each([e.residual for e in flat.equations]):
            for index, order in pairs:
                highest[index] = max(highest.get(index, 0), order)
        flat.cache["differentiated"] = [(i, k) for i in sorted(highest) for k in range(highest[i])]
    return flat.cache["differentiated"]


def names_of(continuous: Iterable[Pair], alias: AliasResult) -> dict[Pair, list[Pair]]:
    """Return the continuous quantities that are aliases of each kept one, the kept one first."""
    names: dict[Pair, list[Pair]] = {}
    for pair in continuous:
        names.setdefault(alias.resolve(*pair)[1:], []).append(pair)
    return {kept: sorted(pairs, key=lambda pair: pair != kept) for kept, pairs in names.items()}


def in_mode(flat: FlatModel, values: Sequence[bool]) -> FlatModel:
    """Return the model with fixed values of its modes: a model without events and with the same symbols."""
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
    """Raise ModelError, with file and line, for a model with events."""
    events = flat.events
    if events is None:
        return
    if events.blocks:
        raise ModelError(
            f"{flat.title} has the sampled block '{events.blocks[0].name}', whose steps are not equations; optimise "
            "the continuous model, then test the result with gt.simulate",
            getattr(events.blocks[0].model, "where", None),
        )
    first = next(iter(named_events(events).values()), None)
    raise ModelError(
        f"{flat.title} has events, and an optimisation does not choose their order: set it with gt.solve_phases("
        f"gt.phases_of_events(model, [names in order])), or use a smooth function; the events are {listing(events)}",
        first.where if first else None,
    )


def with_switching_signs(flat: FlatModel) -> FlatModel:
    """Return the model with each sign() of a variable as a switch with the values 1 and -1; the model itself if it has
    none."""
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
    """Forms that replace sign() by modes."""

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
