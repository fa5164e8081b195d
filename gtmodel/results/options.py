"""Options of a study: dataclasses whose fields say unit, bounds and meaning, from which the keys of files are made.

    @dataclass(frozen=True)
    class Limits(Options):
        force: Annotated[float | None, Unit("N"), Within(above=0.0), "largest motor force"] = None

In a problem file that is the key ``force_N``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from .quantity import marks_of
from .refusal import ArgumentError
from .unit_names import named


@dataclass(frozen=True)
class Unit:
    """Unit of a field, SI; `written`: that of the key in a file where people write another, as "deg" for rad; `key`:
    the whole key, if not the field's name with the unit."""

    text: str
    written: str = ""
    key: str = ""


@dataclass(frozen=True)
class Within:
    """Bounds of a number, or of each number of a list: > above, >= least, <= most, < below."""

    above: float | None = None
    least: float | None = None
    most: float | None = None
    below: float | None = None

    def holds(self, x: float) -> bool:
        """Whether a number keeps all bounds."""
        return (
            (self.above is None or x > self.above)
            and (self.least is None or x >= self.least)
            and (self.most is None or x <= self.most)
            and (self.below is None or x < self.below)
        )

    def __str__(self) -> str:
        words = (("more than", self.above), ("at least", self.least), ("at most", self.most), ("less than", self.below))
        return " and ".join(f"{word} {x:g}" for word, x in words if x is not None)


@dataclass(frozen=True)
class Long:
    """How many entries a list has; one number for all of them is no list."""

    count: int


class Options:
    """Base of the options of studies: checked when made, whoever makes them. Raises ArgumentError."""

    def __post_init__(self) -> None:
        for name, marks in declared(type(self)).items():
            value = getattr(self, name)
            if value is None:
                continue
            words = choices(type(self))[name]
            if words and value not in words:
                raise ArgumentError(f"expected one of {', '.join(words)}; found {value!r}", name)
            bounds = [m for m in marks if isinstance(m, Within)]
            for x in _numbers(value):
                if not math.isfinite(x):
                    raise ArgumentError(f"expected finite numbers; found {x:g}", name)
                for bound in bounds:
                    if not bound.holds(x):
                        raise ArgumentError(f"must be {bound}; found {x:g}", name)
            for mark in marks:
                if isinstance(mark, Long) and not isinstance(value, (int, float)):
                    wrong = [len(x) for x in (value if _deep(type(self))[name] else [value]) if len(x) != mark.count]
                    if wrong:
                        raise ArgumentError(f"expected {mark.count} numbers; found {wrong[0]}", name)


@cache
def declared(cls: type) -> dict[str, tuple[Any, ...]]:
    """What the fields of an options class carry besides their types: Unit, Within, Long and a description."""
    hints = get_type_hints(cls, include_extras=True)
    return {f.name: marks_of(hints[f.name]) for f in dataclasses.fields(cls)}


def written_name(field: str, marks: tuple[Any, ...]) -> str:
    """The name of a field in a file, with the unit in which people write it there; without the underscore behind a word
    of Python, as in `from_`."""
    field, unit = field.rstrip("_"), next((m for m in marks if isinstance(m, Unit)), None)
    return field if unit is None else unit.key or named(field, unit.written or unit.text)


@cache
def choices(cls: type) -> dict[str, tuple[str, ...]]:
    """The words that a field takes, empty where it is no word of a few."""
    found = get_type_hints(cls)
    return {f.name: get_args(h) if get_origin(h := found[f.name]) is Literal else () for f in dataclasses.fields(cls)}


@cache
def _deep(cls: type) -> dict[str, bool]:
    """Whether a field is a list of lists."""

    def depth(hint: Any) -> int:
        return (get_origin(hint) in (list, tuple)) + max((depth(h) for h in get_args(hint)), default=0)

    return {name: depth(hint) > 1 for name, hint in get_type_hints(cls).items()}


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, np.ndarray):
        yield from np.ravel(value).tolist() if value.dtype.kind in "fiu" else ()
    elif isinstance(value, Mapping):
        yield from _numbers(list(value.values()))
    elif isinstance(value, (list, tuple)) or (isinstance(value, Sequence) and not isinstance(value, str)):
        for one in value:
            yield from _numbers(one)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield float(value)
