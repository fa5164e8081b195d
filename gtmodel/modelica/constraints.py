"""A class without components, scalars and equations between them, and constraints that say more than a constraint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .scalars import Flat, Operation, Symbol, nodes, operation, operations, symbols
from .syntax import Place


@dataclass(frozen=True, eq=False)
class ScalarEquation:
    """left == right, or with another relation in a constraint."""

    left: Any
    right: Any
    at: Place
    relation: str = "=="


@dataclass(frozen=True, eq=False)
class ScalarIf:
    """One of two sets of equations, as many on each side, by a condition."""

    condition: Any
    then: tuple[ScalarEquation, ...]
    otherwise: tuple[ScalarEquation, ...]
    at: Place


@dataclass(frozen=True, eq=False)
class WhenBranch:
    """What happens at the instants at which a condition comes true, if no branch before it happens. end: the
    simulation's, by a sentence, and whether the model has failed."""

    condition: Any
    actions: tuple[ScalarEquation, ...]
    restarts: tuple[tuple[Any, Any], ...]
    end: tuple[str, bool] | None
    at: Place


@dataclass(frozen=True, eq=False)
class ScalarWhen:
    """Branches by precedence. own: gtmodel's, not of the text."""

    branches: tuple[WhenBranch, ...]
    at: Place
    own: bool = False

    @property
    def actions(self) -> list[ScalarEquation]:
        return [a for b in self.branches for a in b.actions]


def expressions(e: ScalarEquation | ScalarIf | ScalarWhen) -> list[Any]:
    """What an equation reads, conditions included; of a when clause not the variables that it sets."""
    if isinstance(e, ScalarWhen):
        values = [x for b in e.branches for x in (b.condition, *(v for _, v in b.restarts))]
        return [*values, *(a.right for a in e.actions)]
    if isinstance(e, ScalarIf):
        return [e.condition, *(x for part in (*e.then, *e.otherwise) for x in (part.left, part.right))]
    return [e.left, e.right]


@dataclass(eq=False)
class Flattened:
    """A class without components: variables, parameters and equations in the order of the text."""

    name: str
    at: Place
    description: str
    optimization: bool
    flats: list[Flat] = field(default_factory=list)
    equations: list[ScalarEquation | ScalarIf | ScalarWhen] = field(default_factory=list)
    initial: list[ScalarEquation] = field(default_factory=list)
    constraints: list[ScalarEquation] = field(default_factory=list)
    header: dict[str, Any] = field(default_factory=dict)
    branches: list[tuple[str, Any, Place]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    header_at: dict[str, Place] = field(default_factory=dict)
    static: bool = False
    # where units do not fit: lines of a file by method, and ids of declared variables
    bare: set[tuple[str, str, int]] = field(default_factory=set)
    without_unit: set[int] = field(default_factory=set)
    # variables, equations and initial equations as the text has them, before events are in the language's forms
    text: tuple[list[Flat], list[Any], list[ScalarEquation]] | None = None
    parts: list[Any] = field(default_factory=list)  # of gt.mechanics, see multibody.parts.MechanicsPart
    joined: list[tuple[str, str, Place]] = field(default_factory=list)  # ports of them
    shown: list[Flat] = field(default_factory=list)  # quantities of parts that are names of the text
    optional: set[int] = field(default_factory=set)  # variables that may be left out, by id


def constraints_settled(out: Flattened) -> None:
    """A path equality that alone speaks of a variable becomes an equation; a value at an instant that stands beside
    values along the path becomes a variable of its own, which is constant."""
    used = {id(f) for e in out.equations for x in sides(e) for f in symbols(x)}
    kept: list[ScalarEquation] = []
    for e in out.constraints:
        own = [f for f in (*symbols(e.left), *symbols(e.right)) if f.kind == "variable" and id(f) not in used]
        if e.relation == "==" and own and not any(_instants(x) for x in (e.left, e.right)):
            used |= {id(f) for f in own}
            out.equations.append(e)
        else:
            kept.append(e)
    constants: dict[str, Flat] = {}
    out.constraints = [c for e in kept for c in _separated(e, out, constants)]


def sides(e: Any) -> list[Any]:
    """Both sides of an equation, or of all inside a conditional one."""
    if isinstance(e, ScalarIf):
        return [x for part in (*e.then, *e.otherwise) for x in (part.left, part.right)]
    if isinstance(e, ScalarWhen):
        return [x for part in e.actions for x in (part.left, part.right)]
    return [e.left, e.right]


def _instants(x: Any) -> bool:
    return any(o.name == "at" for o in operations(x))


def _moves(x: Any) -> bool:
    """Does it hold anything along the path?"""
    return any(
        e.flat.kind not in ("parameter", "constant") if isinstance(e, Symbol) else getattr(e, "name", "") == "time"
        for e in nodes(x, closed=("at",))
    )


def _separated(e: ScalarEquation, out: Flattened, constants: dict[str, Flat]) -> list[ScalarEquation]:
    if not any(map(_instants, (e.left, e.right))) or not any(map(_moves, (e.left, e.right))):
        return [e]
    more: list[ScalarEquation] = []
    known: dict[int, Any] = {}
    left, right = (_with_constants(x, e.at, out, constants, more, known) for x in (e.left, e.right))
    return [*more, ScalarEquation(left, right, e.at, e.relation)]


def _with_constants(
    x: Any, at: Place, out: Flattened, constants: dict[str, Flat], more: list[ScalarEquation], known: dict[int, Any]
) -> Any:
    if not isinstance(x, Operation):
        return x
    if x.name != "at":
        if id(x) not in known:
            given = tuple(_with_constants(a, at, out, constants, more, known) for a in x.arguments)
            known[id(x)] = operation(x.name, given, x.at)
        return known[id(x)]
    inside, time = x.arguments
    name = f"{_text(inside)}({_text(time)})"
    if name not in constants:
        flat = Flat(name, "variable", "Real", at, lambda _: None, lambda: None)
        constants[name] = flat
        out.flats.append(flat)
        out.equations.append(ScalarEquation(Operation("der", (Symbol(flat),), at), 0, at))
        end = Operation("at", (Symbol(flat), Operation("start_time", (), at)), at)
        more.append(ScalarEquation(end, x, at))
    return Symbol(constants[name])


def _text(x: Any) -> str:
    if isinstance(x, Symbol):
        return x.flat.name
    if isinstance(x, Operation):
        words = {"start_time": "startTime", "final_time": "finalTime"}
        inside = ",".join(map(_text, x.arguments))
        return words.get(x.name, x.name) + (f"({inside})" if inside else "")
    return str(x)
