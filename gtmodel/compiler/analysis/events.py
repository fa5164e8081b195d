"""Events of a flat model: comparisons, modes, actions, sampled blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...lang.bind import ParameterRecord, Tree
from ...lang.condition import Condition
from ...lang.declarations import Discrete, Variable
from ...lang.events import EnergyLoss, Reinit, SampledBlock, Termination, When
from ...lang.expression import Relation
from ...lang.model import Model
from ...lang.source import ModelError, SourceLocation

if TYPE_CHECKING:
    from ..flat import FlatEquation, FlatModel

Pair = tuple[int, int]
# ("atom", number), ("sample", number), ("not", logic), ("and", logic, logic), ("or", logic, logic)
Logic = tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Comparison:
    """A relation of a condition: true if `expression` is not negative, or positive if `strict`.

    discrete: it changes only at events.
    """

    expression: ca.SX
    strict: bool
    discrete: bool
    text: str
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class SampleTimes:
    """The times offset, offset + period, ... [s], as expressions of parameters; None: only the start."""

    period: ca.SX | None
    offset: ca.SX | None
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class FlatMode:
    """A symbol that is 1 while its condition is true, else 0; name: of the function in the model, "If" or "sign()"."""

    symbol: ca.SX
    logic: Logic
    where: SourceLocation
    name: str = "If"


@dataclass(frozen=True, eq=False)
class FlatWhen:
    """One event with its actions.

    `assigns`: positions in `flat.p` with new values; `reinits`: derivatives of variables with new values; `forces`: for
    reinits by an impulse, the variable whose impulse it is; `loss`: energy loss [J], None if not declared; `before`:
    numbers of the events that have precedence in the same round; `end`: the end of the simulation, or None. Values are
    expressions of flat symbols: a discrete variable's symbol is its new value, and `FlatEvents.before` its old one.
    """

    name: str
    logic: Logic
    assigns: list[tuple[int, ca.SX]]
    reinits: list[tuple[Pair, ca.SX]]
    forces: dict[Pair, Pair]
    loss: ca.SX | None
    where: SourceLocation
    before: tuple[int, ...] = ()
    end: Termination | None = None


@dataclass(frozen=True, eq=False)
class BlockSignal:
    """An input (indices of variables), an output or a state (positions in `flat.p`) of a sampled block."""

    name: str
    shape: tuple[int, ...]
    places: list[int]
    unit: str | None
    helper: bool = False  # recorded only if requested as an output


@dataclass(frozen=True, eq=False)
class FlatBlock:
    """A sampled block: its bound model, its times as expressions of parameters, its signals."""

    name: str
    model: SampledBlock
    period: ca.SX
    delay: ca.SX
    offset: ca.SX
    inputs: list[BlockSignal]
    outputs: list[BlockSignal]
    state: list[BlockSignal]


@dataclass(frozen=True, eq=False)
class FlatEvents:
    """All events of a model.

    `discrete`: positions in `flat.p` of the discrete variables; `before`: symbols for their values just before an
    event; `shown`: the declared discrete variables with their names.
    """

    comparisons: list[Comparison]
    samples: list[SampleTimes]
    modes: list[FlatMode]
    whens: list[FlatWhen]
    blocks: list[FlatBlock]
    discrete: list[int]
    before: ca.SX
    shown: list[BlockSignal]


def collect_events(tree: Tree, whens: Sequence[tuple[When, Model]], equations: list[FlatEquation]) -> FlatEvents | None:
    """Return the events of a bound model; None if it has none.

    Raises ModelError for a discrete variable that no event sets or that one event sets twice, and for pre() outside the
    actions of gt.when.
    """
    records = [r for r in tree.parameters if isinstance(r.item, Discrete)]
    blocks = [c for c in tree.components if isinstance(c, SampledBlock)]
    if not (whens or records or blocks or tree.scope.modes):
        return None
    collector = _Collector(tree, records)
    for e in equations:
        collector.refuse_earlier(e.residual, e.where)
    modes = [FlatMode(symbol, collector.logic(c), c.where) for symbol, c in tree.scope.modes]
    events: list[FlatWhen] = []
    for when, component in whens:
        first = len(events)
        for branch in when.branches():
            events.append(collector.when(branch, component, len(events), tuple(range(first, len(events)))))
    flat_blocks = [_block(tree, b) for b in blocks]
    _refuse_unset(records, events, flat_blocks)
    shown = [BlockSignal(r.name, r.shape, r.indices, r.item.unit, r.item.helper) for r in records]
    return FlatEvents(
        collector.comparisons, collector.samples, modes, events, flat_blocks, collector.places, collector.before, shown
    )


class _Collector:
    """Collects conditions as logic over numbered comparisons, and actions as expressions of symbols."""

    def __init__(self, tree: Tree, records: list[ParameterRecord]) -> None:
        self._scope = tree.scope
        self.places = [i for r in records for i in r.indices]
        self._owner = {tree.scope.parameters[i].element_hash(): (i, r) for r in records for i in r.indices}
        symbols = [tree.scope.parameters[i] for i in self.places]
        self.before = ca.vertcat(*[ca.SX.sym(f"pre({s})") for s in symbols]) if symbols else ca.SX(0, 1)
        self._discrete = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
        self._earlier = [s for s, _ in tree.scope.earlier]
        self.comparisons: list[Comparison] = []
        self.samples: list[SampleTimes] = []
        self._known: dict[int, Logic] = {}

    def refuse_earlier(self, expression: ca.SX, where: SourceLocation) -> None:
        """Raise ModelError if an equation or condition contains pre()."""
        if self._earlier and ca.depends_on(expression, ca.vertcat(*self._earlier)):
            raise ModelError("pre() can be used only in the actions of gt.when; here write the variable itself", where)

    def logic(self, condition: Condition) -> Logic:
        """Return the logic of a condition; equal relations share a comparison."""
        if condition.operation in ("sample", "initial"):
            self.samples.append(SampleTimes(condition.every, condition.offset, condition.where))
            return "sample", len(self.samples) - 1
        if condition.relation is None:
            return (condition.operation, *map(self.logic, condition.parts))
        relation = condition.relation
        if id(relation) not in self._known:
            self.refuse_earlier(relation.residual, relation.where)
            sign = 1 if relation.op == ">=" else -1
            expression = ca.SX(sign * relation.residual)
            if not ca.symvar(expression):
                raise ModelError("a condition compares only numbers and never changes; remove it", relation.where)
            text = f"{relation.lhs} {relation.op} {relation.rhs}"
            time = ca.depends_on(expression, self._scope.time)
            discrete = not time and not self._scope.symbols_in(expression)
            self.comparisons.append(Comparison(expression, relation.strict, discrete, text, relation.where))
            self._known[id(relation)] = "atom", len(self.comparisons) - 1
        return self._known[id(relation)]

    def when(self, when: When, component: Model, n: int, before: tuple[int, ...]) -> FlatWhen:
        path = component._path
        assigns: dict[int, ca.SX] = {}
        reinits: dict[Pair, ca.SX] = {}
        forces: dict[Pair, Pair] = {}
        loss: ca.SX | None = None
        end: Termination | None = None
        for action in when.actions:
            if isinstance(action, Termination):
                end = end or action
            elif isinstance(action, EnergyLoss):
                value = self._value(action.expression)
                loss = value if loss is None else loss + value
            elif isinstance(action, Reinit):
                for variable, value in zip(_entries(action.variable), _entries(action.value), strict=True):
                    pair = self._scope.owner(variable)
                    assert pair is not None
                    if pair in reinits:
                        raise ModelError(
                            f"'{variable}' is reset twice in one event; remove one gt.reinit", action.where
                        )
                    reinits[pair] = self._value(value)
                if action.force is not None:
                    owner = self._scope.owner
                    for variable, by in zip(_entries(action.variable), _entries(action.force), strict=True):
                        pair, force = owner(variable), owner(by)
                        assert pair is not None
                        assert force is not None
                        forces[pair] = force
            else:
                for place, value in self._assigned(action):
                    if place in assigns:
                        name = self._scope.parameter_names[place]
                        raise ModelError(f"'{name}' gets two values in one event; remove one of them", action.where)
                    assigns[place] = value
        ordered = self._ordered(assigns, when.where)
        name = f"{path}.event {n + 1}" if path else f"event {n + 1}"
        logic = self.logic(when.condition)
        return FlatWhen(name, logic, ordered, list(reinits.items()), forces, loss, when.where, before, end)

    def _assigned(self, action: Relation) -> list[tuple[int, ca.SX]]:
        result = []
        for left, right in zip(_entries(action.lhs), _entries(action.rhs), strict=True):
            owner = self._owner.get(left.element_hash()) if left.is_symbolic() else None
            if owner is None:
                advice = "; reset a continuous variable with gt.reinit" if self._scope.symbols_in(left) else ""
                raise ModelError(
                    f"an action n == expression needs a discrete variable on its left; found {left}{advice}",
                    action.where,
                )
            result.append((owner[0], self._value(right)))
        return result

    def _value(self, expression: ca.SX) -> ca.SX:
        """Replace pre(...) by expressions of the symbols `before`, inner ones first."""
        for symbol, earlier in reversed(self._scope.earlier):
            if ca.depends_on(expression, symbol):
                before = ca.substitute(earlier, self._discrete, self.before) if self.places else earlier
                expression = ca.substitute(expression, symbol, before)
        return ca.SX(expression)

    def _ordered(self, assigns: dict[int, ca.SX], where: SourceLocation) -> list[tuple[int, ca.SX]]:
        """Sort new values so that each comes after those that it reads. Raises ModelError for a loop."""
        remaining = dict(assigns)
        ordered: list[tuple[int, ca.SX]] = []
        while remaining:
            ready = [
                place
                for place, value in remaining.items()
                if not any(ca.depends_on(value, self._scope.parameters[n]) for n in remaining)
            ]
            if not ready:
                names = ", ".join(self._scope.parameter_names[place] for place in remaining)
                raise ModelError(
                    f"the new values of {names} depend on each other in a loop; write gt.pre(...) for the value before "
                    "the event",
                    where,
                )
            ordered += [(place, remaining.pop(place)) for place in ready]
        return ordered


def _entries(sx: ca.SX) -> list[ca.SX]:
    """Return the entries row by row, in the order of their names."""
    return ca.vertsplit(ca.vec(ca.densify(sx).T)) if sx.numel() else []


def _block(tree: Tree, block: SampledBlock) -> FlatBlock:
    path = block._path
    cls = type(block)
    if cls.step is SampledBlock.step:
        block.step(None, None)  # raises the error
    prefix = f"{path}." if path else ""
    inputs = [
        BlockSignal(r.name.removeprefix(prefix), r.item.shape, r.indices, r.item.unit)
        for r in tree.variables
        if r.component == path
    ]
    for r in tree.variables:
        if r.component == path and isinstance(r.item, Variable) and r.item.role != "input":
            raise ModelError(
                f"'{r.name}' of a sampled block is a continuous variable; a block can have inputs, outputs and "
                "discrete variables",
                r.item.where,
            )
    discrete = [r for r in tree.parameters if r.component == path and isinstance(r.item, Discrete)]
    outputs, state = (
        [BlockSignal(r.name.removeprefix(prefix), r.shape, r.indices, r.item.unit) for r in discrete
         if r.item.output is is_output]
        for is_output in (True, False)
    )  # fmt: skip
    if not outputs:
        raise ModelError(f"sampled block '{path or cls.__name__}' has no output; declare one with gt.output", None)
    values = block._values
    period, delay, offset = (ca.SX(values[name].sx) for name in ("period", "delay", "offset"))
    return FlatBlock(path or cls.__name__, block, period, delay, offset, inputs, outputs, state)


def _refuse_unset(records: list[ParameterRecord], whens: list[FlatWhen], blocks: list[FlatBlock]) -> None:
    of_blocks = {place for b in blocks for s in (*b.outputs, *b.state) for place in s.places}
    set_by = {place for w in whens for place, _ in w.assigns}
    for r in records:
        if of_blocks.issuperset(r.indices):
            if both := set_by.intersection(r.indices):
                when = next(w for w in whens if any(place in both for place, _ in w.assigns))
                raise ModelError(f"'{r.name}' is set by its sampled block; an event must not set it too", when.where)
        elif isinstance(r.item, Discrete) and r.item.output:
            raise ModelError(f"'{r.name}' is an output, which only a SampledBlock has; use gt.discrete", r.where)
        elif not set_by.intersection(r.indices):
            raise ModelError(f"no event sets the discrete variable '{r.name}'; declare a parameter instead", r.where)


def acting(whens: Sequence[FlatWhen], became: Sequence[int]) -> list[int]:
    """Return the events that act among those whose conditions became true in one round, by precedence."""
    return [n for n in became if not set(whens[n].before).intersection(became)]


def holds(logic: Logic, atoms: np.ndarray, samples: Sequence[bool] = ()) -> bool:
    """Return whether a condition is true for given values of its comparisons and samples."""
    operation, *parts = logic
    if operation == "atom":
        return bool(atoms[parts[0]])
    if operation == "sample":
        return bool(samples[parts[0]]) if len(samples) else False
    if operation == "not":
        return not holds(parts[0], atoms, samples)
    joined = (holds(part, atoms, samples) for part in parts)
    return all(joined) if operation == "and" else any(joined)


def block_numbers(block: SampledBlock, flat: FlatModel, p: np.ndarray) -> Any:
    """Return the block with numbers as parameters, for calls of `step`."""
    known: dict[str, Any] = {}
    for name, value in block._values.items():
        item = type(block)._declared.get(name)
        if isinstance(item, Discrete) or not hasattr(value, "sx") or flat.scope.symbols_in(value.sx):
            continue
        number = np.asarray(ca.Function("value", [flat.p], [ca.densify(value.sx)])(p).full())
        known[name] = float(number[0, 0]) if value.shape == () else number.reshape(value.shape)
    view = object.__new__(type(block))
    view._keep(_path=block._path, _values=known)
    return view
