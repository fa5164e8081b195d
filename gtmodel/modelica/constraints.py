"""A flattened class: scalars and equations; and constraints that are rewritten as equations or with constants."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .scalars import Flat, Operation, Symbol, nodes, operation, operations, symbols
from .syntax import Place


@dataclass(frozen=True, eq=False)
class ScalarEquation:
    """left == right; in a constraint, relation may also be an inequality."""

    left: Any
    right: Any
    at: Place
    relation: str = "=="


@dataclass(frozen=True, eq=False)
class ScalarIf:
    """Two sets of equations of the same size; a condition selects one."""

    condition: Any
    then: tuple[ScalarEquation, ...]
    otherwise: tuple[ScalarEquation, ...]
    at: Place


@dataclass(frozen=True, eq=False)
class WhenBranch:
    """One branch of a when clause: its actions at the instants at which its condition becomes true.

    A branch acts only if no branch before it does. end: message of terminate(), and whether an assertion failed.
    """

    condition: Any
    actions: tuple[ScalarEquation, ...]
    restarts: tuple[tuple[Any, Any], ...]
    end: tuple[str, bool] | None
    at: Place


@dataclass(frozen=True, eq=False)
class ScalarWhen:
    """A when clause; earlier branches have precedence. internal: added by gtmodel, not in the text."""

    branches: tuple[WhenBranch, ...]
    at: Place
    internal: bool = False

    @property
    def actions(self) -> list[ScalarEquation]:
        return [a for b in self.branches for a in b.actions]


def expressions(e: ScalarEquation | ScalarIf | ScalarWhen) -> list[Any]:
    """Return the expressions of an equation, with conditions; for a when clause without the assigned variables."""
    if isinstance(e, ScalarWhen):
        values = [x for b in e.branches for x in (b.condition, *(v for _, v in b.restarts))]
        return [*values, *(a.right for a in e.actions)]
    if isinstance(e, ScalarIf):
        return [e.condition, *(x for part in (*e.then, *e.otherwise) for x in (part.left, part.right))]
    return [e.left, e.right]


@dataclass(eq=False)
class Flattened:
    """A flattened class: variables, parameters and equations in the order of the text."""

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
    # inconsistent units: lines without units (method, file, line), and ids of variables declared without unit
    bare: set[tuple[str, str, int]] = field(default_factory=set)
    without_unit: set[int] = field(default_factory=set)
    # variables, equations and initial equations of the text, before settle_events rewrites them
    text: tuple[list[Flat], list[Any], list[ScalarEquation]] | None = None
    parts: list[Any] = field(default_factory=list)  # of gt.mechanics, see multibody.parts.MechanicsPart
    joined: list[tuple[str, str, Place]] = field(default_factory=list)  # connected ports of parts
    shown: list[Flat] = field(default_factory=list)  # quantities of parts that have names in the text
    optional: set[int] = field(default_factory=set)  # ids of variables that may be left out


def constraints_settled(out: Flattened) -> None:
    """Rewrite constraints that are not pure path or point constraints.

    A path equality becomes an equation if it contains a variable that no equation contains. In a constraint that
    mixes path and point values, each point value becomes a new variable, which is constant.
    """
    used = {id(f) for e in out.equations for x in sides(e) for f in symbols(x)}
    kept: list[ScalarEquation] = []
    for e in out.constraints:
        new_variables = [f for f in (*symbols(e.left), *symbols(e.right)) if f.kind == "variable" and id(f) not in used]
        if e.relation == "==" and new_variables and not any(_instants(x) for x in (e.left, e.right)):
            used |= {id(f) for f in new_variables}
            out.equations.append(e)
        else:
            kept.append(e)
    constants: dict[str, Flat] = {}
    out.constraints = [c for e in kept for c in _separated(e, out, constants)]


def sides(e: Any) -> list[Any]:
    """Return both sides of an equation, or of all equations in a conditional or when equation."""
    if isinstance(e, ScalarIf):
        return [x for part in (*e.then, *e.otherwise) for x in (part.left, part.right)]
    if isinstance(e, ScalarWhen):
        return [x for part in e.actions for x in (part.left, part.right)]
    return [e.left, e.right]


def _instants(x: Any) -> bool:
    return any(o.name == "at" for o in operations(x))


def _moves(x: Any) -> bool:
    """True if an expression contains a value along the path, outside of values at an instant."""
    return any(
        e.flat.kind not in ("parameter", "constant") if isinstance(e, Symbol) else getattr(e, "name", "") == "time"
        for e in nodes(x, closed=("at",))
    )


def _separated(e: ScalarEquation, out: Flattened, constants: dict[str, Flat]) -> list[ScalarEquation]:
    if not any(map(_instants, (e.left, e.right))) or not any(map(_moves, (e.left, e.right))):
        return [e]
    point_constraints: list[ScalarEquation] = []
    known: dict[int, Any] = {}
    left, right = (_with_constants(x, e.at, out, constants, point_constraints, known) for x in (e.left, e.right))
    return [*point_constraints, ScalarEquation(left, right, e.at, e.relation)]


def _with_constants(
    x: Any,
    at: Place,
    out: Flattened,
    constants: dict[str, Flat],
    point_constraints: list[ScalarEquation],
    known: dict[int, Any],
) -> Any:
    if not isinstance(x, Operation):
        return x
    if x.name != "at":
        if id(x) not in known:
            arguments = tuple(_with_constants(a, at, out, constants, point_constraints, known) for a in x.arguments)
            known[id(x)] = operation(x.name, arguments, x.at)
        return known[id(x)]
    expression, time = x.arguments
    name = f"{_text(expression)}({_text(time)})"
    if name not in constants:
        flat = Flat(name, "variable", "Real", at, lambda _: None, lambda: None)
        constants[name] = flat
        out.flats.append(flat)
        out.equations.append(ScalarEquation(Operation("der", (Symbol(flat),), at), 0, at))
        end = Operation("at", (Symbol(flat), Operation("start_time", (), at)), at)
        point_constraints.append(ScalarEquation(end, x, at))
    return Symbol(constants[name])


def _text(x: Any) -> str:
    if isinstance(x, Symbol):
        return x.flat.name
    if isinstance(x, Operation):
        words = {"start_time": "startTime", "final_time": "finalTime"}
        arguments = ",".join(map(_text, x.arguments))
        return words.get(x.name, x.name) + (f"({arguments})" if arguments else "")
    return str(x)
