"""Columns of a table by the names and units of its header, and by what a file says of them beside their numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._near import meant
from ...lang.units import UnitError, parse_unit
from ...results.trajectory_checks import Array
from .form import LogError

# the blank tells e[1] from e [1]
_CELL = re.compile(r"(?P<name>.*\S)\s+\[(?P<unit>[^\[\]]+)\]")
# "pos[mm]", "pos (mm)": where that is a unit, else it belongs to the name, as in der(T)
_LOOSE = re.compile(r"(?P<name>.*[^\s([])(?:\[|\s+\()(?P<unit>[^\[\]()]+)[\])]")
_SPELLED = (
    ("°C", "K"), ("°", "deg"), ("µ", "u"), ("μ", "u"), ("²", "2"), ("³", "3"), ("·", "."), ("Nm", "N.m"), ("Ω", "Ohm"),
)  # fmt: skip
_WORDS = {"-": "1", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "degree": "deg", "degrees": "deg"}
_WORDS |= {"radian": "rad", "radians": "rad", "volt": "V", "volts": "V", "meter": "m", "meters": "m", "newton": "N"}
MOST_NAMES = 8  # of a message that lists the columns


def spelled(unit: str) -> str:
    """A unit as instruments write it, "°/s", "Nm", "sec", in the spelling of gtmodel; unchanged if there is none."""
    text = unit.strip()
    if text[:1] in "[(" and text[-1:] in "])" and not set(text[1:-1]) & set("[]()"):  # "(mm)", not "m/(N.s2)"
        text = text[1:-1].strip()
    text = _WORDS.get(text.lower(), text)
    for sign, word in _SPELLED:
        text = text.replace(sign, word)
    return text


def is_unit(text: str) -> bool:
    """Whether a text is a unit, in the spelling of gtmodel.

    >>> from gtmodel.measurements.streams.heads import is_unit
    >>> is_unit("deg/s"), is_unit("filtered")
    (True, False)
    """
    try:
        parse_unit(text)
    except UnitError:
        return False
    return bool(text)


class Heads:
    """The columns of a header; columns that nobody asks for are left alone.

    names, units: of each column; "" where a cell is empty or has no unit. where: the header, for messages.
    """

    def __init__(self, cells: Sequence[str], where: str, units: Sequence[str] = ()) -> None:
        self.where = where
        self._cells = list(cells)
        both = [_parts(cell) for cell in cells]
        self.names = [name for name, _ in both]
        self.units = [own or given for (_, own), given in zip(both, units or [""] * len(both), strict=True)]

    def members(self, name: str | Sequence[str]) -> list[str]:
        """The columns that a declared name means: "q" means "q[0]", "q[1]" and so on where there is no "q"."""
        members = [name] if isinstance(name, str) else list(name)
        if isinstance(name, str) and not self._places(name):
            indexed = [n for n in self.names if re.fullmatch(rf"{re.escape(name)}\[\d+\]", n)]
            members = [f"{name}[{k}]" for k in range(len(set(indexed)))] or members
        for member in members:
            self.place(member)
        return members

    def place(self, name: str) -> int:
        """Where a column stands. Raises LogError where it does not, or twice: which is meant is not clear."""
        places = self._places(name)
        if not places:
            raise LogError(self.missing(name))
        if len(places) > 1:
            columns = f"columns {places[0] + 1} and {places[1] + 1}"
            raise LogError(f"{self.where}: '{name}' is there twice, in {columns}; leave one of them out")
        return places[0]

    def missing(self, name: str) -> str:
        """What is said of a column that is not there."""
        return f"{self.where}: there is no column '{name}'; {self._hint(name)}"

    def refuse_other_unit(self, name: str, declared: str) -> None:
        """Raises LogError where the header says another unit than was declared."""
        headed = self.units[self.place(name)]
        try:
            here, wanted = parse_unit(headed or declared), parse_unit(declared)
        except UnitError as error:
            raise LogError(f"{self.where}, column '{name}': {error}") from error
        if (here.dimension, here.factor, here.pi_power) != (wanted.dimension, wanted.factor, wanted.pi_power):
            said = f"'{name}' is in {headed} here and declared in {declared}; correct one of them"
            raise LogError(f"{self.where}: {said}")

    def _places(self, name: str) -> list[int]:
        """By the name, or by the whole cell with its unit."""
        return [k for k, n in enumerate(self.names) if n == name] or [
            k for k, cell in enumerate(self._cells) if cell == name
        ]

    def _hint(self, name: str) -> str:
        there = [n for n in self.names if n]
        more = f" and {len(there) - MOST_NAMES} more" if len(there) > MOST_NAMES else ""
        some = f"it has {', '.join(n[:24] for n in there[:MOST_NAMES]) or 'none'}{more}"
        return meant(name, self.names, some, cutoff=0.5)


def _parts(cell: str) -> tuple[str, str]:
    if match := _CELL.fullmatch(cell):
        return match["name"], spelled(match["unit"])
    if (match := _LOOSE.fullmatch(cell)) and not match["unit"].isdigit() and is_unit(spelled(match["unit"])):
        return match["name"], spelled(match["unit"])
    return cell, ""


_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_FILLS = ("_FillValue", "missing_value")


@dataclass(frozen=True)
class Attributes:
    """Of a column, by the conventions of netCDF: its numbers are scale times what is stored plus offset, in `unit`;
    what is stored as one of `fills` is no number."""

    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    fills: tuple[float, ...] = ()

    def numbers(self, stored: np.ndarray) -> np.ndarray:
        """The numbers that are meant; as they are stored where there is nothing to be done."""
        if (self.scale, self.offset, self.fills) == (1.0, 0.0, ()):
            return stored
        values: Array = stored.astype(float)
        empty = np.isin(values, self.fills)
        values = self.scale * values + self.offset
        values[empty] = np.nan
        return values


def attributes_of(said: Mapping[str, Any], where: str) -> Attributes:
    """The attributes of a column as its file has them, texts or numbers. Raises LogError for a scale that is none.

    where: file and column, for messages.
    """

    def numbers(name: str) -> tuple[float, ...]:
        if name not in said:
            return ()
        value = said[name]
        try:
            made = np.atleast_1d(np.asarray(_text(value) if isinstance(value, (bytes, str)) else value).astype(float))
        except (TypeError, ValueError):
            raise LogError(f"{where}: its attribute {name} is {str(value)[:40]!r}; expected a number") from None
        return tuple(made.ravel().tolist())

    def one(name: str, other: float) -> float:
        value = numbers(name) or (other,)
        if len(value) != 1 or not np.isfinite(value[0]) or (name == "scale_factor" and value[0] == 0):
            raise LogError(
                f"{where}: its attribute {name} is {', '.join(f'{v:g}' for v in value)}; expected one number"
            )
        return value[0]

    unit = next((_text(said[name]) for name in _UNITS if name in said), "")
    fills = tuple(f for name in _FILLS for f in numbers(name) if np.isfinite(f))
    return Attributes(_spelled(unit), one("scale_factor", 1.0), one("add_offset", 0.0), fills)


def _text(value: Any) -> str:
    value = np.asarray(value).ravel()[0] if np.asarray(value).size else ""
    return (value.decode(errors="replace") if isinstance(value, bytes) else str(value)).strip()


def _spelled(unit: str) -> str:
    """A unit as netCDF writes it: "m s-1", "seconds since 1970-01-01"; one that is none as it stands."""
    text = spelled(unit.partition(" since ")[0])
    dotted = ".".join(spelled(part) for part in text.split())
    return dotted if is_unit(dotted) else text
