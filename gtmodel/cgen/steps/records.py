"""Structs of C that are records of NumPy: the same members, the same bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...compiler.causal import c_name
from ..interface import KEYWORDS, unit_suffix
from ..real import Real
from ..text import GenerationError, comment

INTEGER = np.int32


@dataclass(frozen=True)
class StepMember:
    """One member of a struct: so many numbers, of a scalar none; flags and counters where `integer`."""

    name: str
    size: int | None = None
    unit: str = "1"
    description: str = ""
    integer: bool = False

    @property
    def identifier(self) -> str:
        """Its name in C, which ends in its unit."""
        suffix = "" if self.integer else unit_suffix(self.unit)
        return f"{c_name(self.name)}_{suffix}" if suffix else c_name(self.name)

    @property
    def count(self) -> int:
        """How many numbers."""
        return 1 if self.size is None else self.size

    @property
    def declaration(self) -> str:
        """Such as `double p_m[3];`."""
        kind = "int" if self.integer else "double"
        return f"{kind} {self.identifier};" if self.size is None else f"{kind} {self.identifier}[{self.size}];"

    def elements(self, struct: str) -> list[str]:
        """C expressions of its numbers, `struct` being `in->` or `out.`."""
        if self.size is None:
            return [f"{struct}{self.identifier}"]
        return [f"{struct}{self.identifier}[{k}]" for k in range(self.size)]

    def address(self, struct: str) -> str:
        """C expression of the address of the first number."""
        return f"&{struct}{self.identifier}" if self.size is None else f"{struct}{self.identifier}"


def check_members(members: Sequence[StepMember], what: str) -> None:
    """GenerationError for two members of one identifier, and for one that is a word of C."""
    taken = set[str]()
    for m in members:
        if m.identifier in taken or m.identifier in KEYWORDS:
            raise GenerationError(f"'{m.name}' of the {what} cannot be called '{m.identifier}' in C; rename it")
        taken.add(m.identifier)


def dtype_of(members: Sequence[StepMember], real: Real) -> np.dtype:
    """The record of a struct, with the padding of C."""
    fields = [
        (m.identifier, INTEGER if m.integer else real.dtype, () if m.size is None else (m.size,)) for m in members
    ]
    return np.dtype(fields or [("unused", real.dtype)], align=True)


def record(members: Sequence[StepMember], real: Real, values: Mapping[str, Any] | None = None) -> np.ndarray:
    """A record with these values by the names of members, zero elsewhere."""
    made = np.zeros((), dtype_of(members, real))
    for m in members:
        if values and m.name in values:
            made[m.identifier] = values[m.name] if m.integer else real.array(values[m.name])
    return made


def copied(made: np.ndarray) -> np.ndarray:
    """A record of its own, its padding too, which a copy of NumPy leaves out."""
    return np.frombuffer(bytearray(made.tobytes()), made.dtype).reshape(())


def struct(name: str, members: Sequence[StepMember]) -> str:
    """Its declaration in C."""
    rows = [f"    {m.declaration} {comment([_described(m)]).rstrip()}\n" for m in members]
    rows = rows or ["    double unused; /* C knows no empty struct */\n"]
    return f"typedef struct {name} {{\n{''.join(rows)}}} {name};\n\n"


def _described(m: StepMember) -> str:
    unit = "" if m.integer else f" [{m.unit if m.unit not in ('', '?') else '1'}]"
    return f"{m.name}{unit}{': ' if m.description else ''}{m.description}"
