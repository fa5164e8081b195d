"""Columns of a table: names and units from the header, and attributes that a file stores with them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ..._near import meant
from ...lang.units import UnitError, parse_unit
from ...results.trajectory_checks import Array
from .form import LogError

# the blank distinguishes the unit in "e [1]" from the index in "e[1]"
_CELL = re.compile(r"(?P<name>.*\S)\s+\[(?P<unit>[^\[\]]+)\]")
# "pos[mm]", "pos (mm)"; brackets without a unit belong to the name, as in der(T)
_LOOSE = re.compile(r"(?P<name>.*[^\s([])(?:\[|\s+\()(?P<unit>[^\[\]()]+)[\])]")
_SPELLED = (
    ("°C", "K"), ("°", "deg"), ("µ", "u"), ("μ", "u"), ("²", "2"), ("³", "3"), ("·", "."), ("Nm", "N.m"), ("Ω", "Ohm"),
)  # fmt: skip
_WORDS = {"-": "1", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "degree": "deg", "degrees": "deg"}
_WORDS |= {"radian": "rad", "radians": "rad", "volt": "V", "volts": "V", "meter": "m", "meters": "m", "newton": "N"}
_WORDS |= {"sek": "s", "umdr": "rev", "umdr/min": "rpm", "u/min": "rpm", "revolutions": "rev", "turns": "rev"}
MOST_NAMES = 8  # columns listed in a message


def spelled(unit: str) -> str:
    """Convert the spelling of a unit, such as "°/s", "Nm" or "sec", to that of gtmodel; other texts do not change."""
    text = unit.strip()
    if text[:1] in "[(" and text[-1:] in "])" and not set(text[1:-1]) & set("[]()"):  # "(mm)", not "m/(N.s2)"
        text = text[1:-1].strip()
    text = _WORDS.get(text.lower(), text)
    for sign, word in _SPELLED:
        text = text.replace(sign, word)
    return text


def is_unit(text: str) -> bool:
    """Return whether a text is a unit in the spelling of gtmodel.

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
    """The columns of a header.

    names, units: of each column; "" if the cell is empty or has no unit. where: location of the header, for messages.
    """

    def __init__(self, cells: Sequence[str], where: str, units: Sequence[str] = ()) -> None:
        self.where = where
        self._cells = list(cells)
        parts = [_parts(cell) for cell in cells]
        self.names = [name for name, _ in parts]
        self.units = [unit or other for (_, unit), other in zip(parts, units or [""] * len(parts), strict=True)]
        self._labels = dict[str, int]()  # of time columns whose name is repeated

    def members(self, name: str | Sequence[str]) -> list[str]:
        """Return the columns of a declared name: "q", or "q[0]", "q[1]" and so on if there is no "q"."""
        members = [name] if isinstance(name, str) else list(name)
        if isinstance(name, str) and not self._places(name):
            indexed = [n for n in self.names if re.fullmatch(rf"{re.escape(name)}\[\d+\]", n)]
            members = [f"{name}[{k}]" for k in range(len(set(indexed)))] or members
        for member in members:
            self.place(member)
        return members

    def time_of(self, name: str, channel: str) -> str:
        """Return a label, which `place` knows, of the time column of a channel: of the columns with this name or
        pattern the nearest one on its left. Raises LogError if there is none."""
        place = self.place(channel)
        left = [k for k in range(place) if self.names[k] == name or fnmatchcase(self.names[k], name)]
        if not left:
            raise LogError(f"{self.where}: there is no time column '{name}' on the left of '{channel}'")
        label = f"{self.names[left[-1]]} of {self.names[left[-1] + 1]}"
        self._labels[label] = left[-1]
        return label

    def channel_times(self) -> dict[str, list[str]]:
        """Return repeated names, each with the labels of its columns, which stand one before each other channel."""
        times = dict[str, list[str]]()
        for name in dict.fromkeys(name for name in self.names if self.names.count(name) > 1):
            channels = [self.names[k + 1 : k + 2] for k, n in enumerate(self.names) if n == name]
            if all(after and self.names.count(after[0]) == 1 for after in channels):
                times[name] = [self.time_of(name, after[0]) for after in channels]
        return times

    def place(self, name: str) -> int:
        """Return the index of a column. Raises LogError if it is missing or occurs twice."""
        places = self._places(name)
        if not places:
            raise LogError(self.missing(name))
        if len(places) > 1:
            columns = f"columns {', '.join(str(k + 1) for k in places[:-1])} and {places[-1] + 1}"
            advice = "remove or rename one of them"
            if len(places) > 2 or places[1] - places[0] > 1:
                advice += "; if it is the time column of the channels on its right, set per_channel = true"
            raise LogError(f"{self.where}: '{name}' occurs {_times(len(places))}, in {columns}; {advice}")
        return places[0]

    def missing(self, name: str) -> str:
        """Return the message for a missing column."""
        return f"{self.where}: there is no column '{name}'; {self._hint(name)}"

    def refuse_other_unit(self, name: str, declared: str) -> None:
        """Raise LogError if the unit in the header differs from the declared one."""
        header_unit = self.units[self.place(name)]
        try:
            a, b = parse_unit(header_unit or declared), parse_unit(declared)
        except UnitError as error:
            raise LogError(f"{self.where}, column '{name}': {error}") from error
        if (a.dimension, a.factor, a.pi_power) != (b.dimension, b.factor, b.pi_power):
            raise LogError(
                f"{self.where}: '{name}' is in {header_unit} here and declared in {declared}; correct one of them"
            )

    def _places(self, name: str) -> list[int]:
        """Return the indices of columns with this name, or with this header cell including the unit."""
        if name in self._labels:
            return [self._labels[name]]
        return [k for k, n in enumerate(self.names) if n == name] or [
            k for k, cell in enumerate(self._cells) if cell == name
        ]

    def _hint(self, name: str) -> str:
        names = [n for n in self.names if n]
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        some = f"it has {', '.join(n[:24] for n in names[:MOST_NAMES]) or 'none'}{more}"
        return meant(name, self.names, some, cutoff=0.5)


def _times(count: int) -> str:
    return "twice" if count == 2 else f"{count} times"


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
    """Attributes of a column by the netCDF conventions: value = scale * stored + offset, in `unit`; stored values in
    `fills` mean that there is no number."""

    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    fills: tuple[float, ...] = ()

    def numbers(self, stored: np.ndarray) -> np.ndarray:
        """Convert stored numbers to values."""
        if (self.scale, self.offset, self.fills) == (1.0, 0.0, ()):
            return stored
        values: Array = stored.astype(float)
        empty = np.isin(values, self.fills)
        values = self.scale * values + self.offset
        values[empty] = np.nan
        return values


def attributes_of(stored: Mapping[str, Any], where: str) -> Attributes:
    """Return the attributes of a column from those in its file, texts or numbers. Raises LogError for a wrong value.

    where: file and column, for messages.
    """

    def numbers(name: str) -> tuple[float, ...]:
        if name not in stored:
            return ()
        value = stored[name]
        try:
            array = np.atleast_1d(np.asarray(_text(value) if isinstance(value, (bytes, str)) else value).astype(float))
        except (TypeError, ValueError):
            raise LogError(f"{where}: its attribute {name} is {str(value)[:40]!r}; expected a number") from None
        return tuple(array.ravel().tolist())

    def single(name: str, default: float) -> float:
        value = numbers(name) or (default,)
        if len(value) != 1 or not np.isfinite(value[0]) or (name == "scale_factor" and value[0] == 0):
            raise LogError(
                f"{where}: its attribute {name} is {', '.join(f'{v:g}' for v in value)}; expected one number"
            )
        return value[0]

    unit = next((_text(stored[name]) for name in _UNITS if name in stored), "")
    fills = tuple(f for name in _FILLS for f in numbers(name) if np.isfinite(f))
    return Attributes(_spelled(unit), single("scale_factor", 1.0), single("add_offset", 0.0), fills)


def _text(value: Any) -> str:
    value = np.asarray(value).ravel()[0] if np.asarray(value).size else ""
    return (value.decode(errors="replace") if isinstance(value, bytes) else str(value)).strip()


def _spelled(unit: str) -> str:
    """Convert the netCDF spelling of a unit, "m s-1", "seconds since 1970-01-01"; other texts do not change."""
    text = spelled(unit.partition(" since ")[0])
    dotted = ".".join(spelled(part) for part in text.split())
    return dotted if is_unit(dotted) else text
