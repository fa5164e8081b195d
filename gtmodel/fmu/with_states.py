"""A causality whose states have rates: what a unit needs of a function beside its own targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..cgen.newton_stages import samples_of
from ..compiler.causal import CausalFunction, CausalSignal, compile_causal
from ..compiler.consistency.home import home_of
from ..lang.scope import derivative_name
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from ..results.status import Status
from .table import base_and_order

Pair = tuple[int, int]
MOST_TURNS = 6  # in which the states of a target, of its states' rates and so on are complete
SMALLEST = 1e-9
EXACT, ROUGH = 15, 6  # digits of a start that stands in the description


@dataclass(frozen=True)
class WithStates:
    """A function that computes the rates of its states too.

    function: its outputs are the targets of the given one, then what lacked. asked: how many targets were asked for.
    states: its inputs that are states; known: the others, but parameters. parameters: of the model, its last inputs.
    """

    function: CausalFunction
    asked: int
    states: Sequence[CausalSignal]
    known: Sequence[CausalSignal]
    parameters: Sequence[CausalSignal] = ()


def with_states(f: CausalFunction) -> WithStates:
    """The function with the rates of all its states among its outputs.

    Raises ArgumentError for a model with events, whose instants a unit does not look for.
    """
    if f.flat.events is not None:
        raise ArgumentError(
            f"{f.flat.title} has events or sampled blocks, which are not exported; export a sampled block as "
            "gt.cgen.BlockFunction, and smooth what switches",
            "function",
        )
    known = {i for _, _, indices in f.groups for i in indices}
    names = [f.flat.variables[i].name for i in f.preferred]
    asked, full = len(f.outputs), f
    for _ in range(MOST_TURNS):
        states = [s for s in full.inputs if s.pairs[0][0] not in known]
        there = {p for s in (*states, *full.outputs) for p in s.pairs}
        wanted = [s.name for s in full.outputs]
        for s in states:
            if not all((i, k + 1) in there for i, k in s.pairs):
                base, order = base_and_order(s.name)
                wanted.append(derivative_name(base, order + 1))
        if len(wanted) == len(full.outputs):
            return WithStates(full, asked, states, [s for s in full.inputs if s not in states])
        # a rate may need further states, which the targets alone do not
        full = compile_causal(f.flat, [name for name, _, _ in f.groups], wanted, names, f.branches, f.name)
    raise ArgumentError("the rates of its states need ever further states; prefer other ones", "function")


def starts(made: WithStates, given: Mapping[str, Sequence[float] | float]) -> dict[Pair, float]:
    """A start value of each input: what is given by name, else the home pose at rest, and of known variables what keeps
    it there, such as the forces that hold a robot.

    Raises ArgumentError for a name that is no input, another number of values, and a start without an answer.
    """
    f = made.function
    posed = home_of(f.flat)
    near = {p: x for s in f.inputs for p, x in zip(s.pairs, map(float, samples_of(f, s.pairs)[0]), strict=True)}
    declared = {p: start for p in near if (start := f.flat.variables[p[0]].start) is not None}
    home = {p: posed.get(p[0], declared.get(p, x)) for p, x in near.items()}
    own = {s.name: s for s in f.inputs}
    wanted: dict[Pair, float] = {}
    for name, value in given.items():
        if name not in own:
            raise ArgumentError(f"there is no input '{name}'; there are {', '.join(own)}", "start")
        try:
            numbers = np.ravel(np.asarray(value, float))
        except (TypeError, ValueError):
            numbers = np.array([])
        if len(numbers) != own[name].size or not np.all(np.isfinite(numbers)):
            raise ArgumentError(f"'{name}' takes {own[name].size} finite numbers; found {value}", "start")
        wanted |= dict(zip(own[name].pairs, map(float, numbers), strict=True))
    status = Status.OK
    # six digits may be too few, as for a quaternion; and what is declared may be no start of this causality
    for base, digits in ((home, ROUGH), (home, EXACT), (near, EXACT)):
        values = {p: _short(x, digits) if p[1] == 0 else 0.0 for p, x in base.items()} | wanted
        if made.states:
            values |= _holding(made, values, set(wanted))
        status = _status(f, values)
        if status is Status.OK:
            return values
    raise ArgumentError(f"there is no answer at the start: {status.message}; give another start", "start")


def _short(x: float, digits: int = ROUGH) -> float:
    """In few digits: the noise of another linear algebra library must not reach the description."""
    return 0.0 if abs(x) < SMALLEST else float(f"{x:.{digits}g}")


def _status(f: CausalFunction, values: Mapping[Pair, float]) -> Status:
    arguments = [np.array([values[p] for p in s.pairs]) for s in f.inputs]
    shaped = [a.reshape(s.shape) if s.shape else float(a[0]) for a, s in zip(arguments, f.inputs, strict=True)]
    *_, status = f(*shaped, *([0.0] if f.plan.uses_time else []))
    return Status(int(status))


def _holding(made: WithStates, values: Mapping[Pair, float], given: set[Pair]) -> dict[Pair, float]:
    """Values of known variables with which the states of the start stay there; none where that has no answer."""
    f = made.function
    wanted = [s for s in made.known if s.pairs[0][1] == 0 and not set(s.pairs) & given]
    if not wanted:
        return {}
    positions = [s for s in made.states if s.pairs[0][1] == 0]
    others = [s.name for s in made.known if s.pairs[0][1] == 0 and s not in wanted]
    try:
        back = compile_causal(f.flat, [*[s.name for s in positions], *others], [s.name for s in wanted])
    except ModelError:
        return {}
    if any(p[1] == 0 and p not in values for s in back.inputs for p in s.pairs):
        return {}
    arguments = [np.array([values.get(p, 0.0) for p in s.pairs]) for s in back.inputs]
    shaped = [a.reshape(s.shape) if s.shape else float(a[0]) for a, s in zip(arguments, back.inputs, strict=True)]
    *results, status = back(*shaped, *([0.0] if back.plan.uses_time else []))
    if Status(int(status)) is not Status.OK:
        return {}
    numbers = {}
    for s, result in zip(wanted, results, strict=True):
        numbers |= dict(zip(s.pairs, map(_short, np.ravel(result)), strict=True))
    return numbers
