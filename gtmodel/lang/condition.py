"""What is true or false at each instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca

from .._lazy import hint
from .source import ModelError, SourceLocation, here

if TYPE_CHECKING:
    from .expression import Relation
else:
    Relation = hint("gtmodel.lang.expression", "Relation")

Operation = Literal["relation", "and", "or", "not", "sample", "initial"]


@dataclass(frozen=True, eq=False)
class Condition:
    """What is true or false at each instant: a relation `a <= b`, or several joined by `&` (and), `|` (or), `~` (not).

    Comparing expressions makes a `Relation`, which is one; parentheses are needed, `(a <= b) & (c >= d)`. Of continuous
    quantities a strict `<` is the same as `<=`: at the instant itself the side counts on which the motion goes on.
    Where a quantity jumps to equality, or an input comes to it, and rests there, `<=` is true and `<` is not.
    """

    operation: Operation
    parts: tuple[Condition, ...]
    relation: Relation | None
    where: SourceLocation
    every: ca.SX | None = None
    offset: ca.SX | None = None

    def __and__(self, other: Any) -> Condition:
        return joined("and", self, other)

    def __or__(self, other: Any) -> Condition:
        return joined("or", self, other)

    def __invert__(self) -> Condition:
        return joined("not", self)

    def __bool__(self) -> bool:
        raise ModelError(
            "a condition has no truth value while a model is being built; hand it to gt.when or gt.If", self.where
        )

    def condition(self) -> Condition:
        """Itself."""
        return self

    def walk(self) -> Iterator[Condition]:
        """This condition and all inside it."""
        yield self
        for part in self.parts:
            yield from part.walk()


def condition_of(value: Any) -> Condition:
    """A relation or a condition as a condition. Raises ModelError for what is none."""
    if not hasattr(value, "condition"):
        raise ModelError(f"a condition is a relation such as x <= 0; found {value!r}", here())
    return value.condition()


def joined(operation: Operation, *parts: Any) -> Condition:
    """Conditions joined to one."""
    return Condition(operation, tuple(map(condition_of, parts)), None, here())
