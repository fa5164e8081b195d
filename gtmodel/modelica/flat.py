"""A class without components: scalars and equations between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .scalars import Flat
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
