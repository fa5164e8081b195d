"""Quantities of options and results, each declared once: unit, description, name in a table, and the unit that a
name carries."""

from __future__ import annotations

import builtins
import inspect
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np

from ..lang.units import UnitError, convert, parse_unit

_SPELLED = {"percent": "%", "Nm": "N.m", "kgm": "kg.m", "kgm2": "kg.m2"}
_TORQUES = {"Nm": "N.m", "MNm": "MN.m"}  # before what divides: Nm_rad is N.m/rad, not rad
_PER = "per"
_NO_UNIT = {"min"}  # the smallest, never minutes


@cache
def split(name: str) -> tuple[str, str]:
    """Stem and unit of a key, ("force", "N"); the unit is "" when the name carries none.

    The longest ending that reads as a unit counts; what follows its first symbol divides: ``m_s2`` is m/s2, as
    ``m_per_s2`` is; ``per_s`` is 1/s.
    """
    words = name.split("_")
    for i in range(1, len(words)):
        unit = _unit(words[i:])
        if unit:
            return "_".join(words[:i]), unit
    return name, ""


def _unit(words: list[str]) -> str:
    if not all(words) or _NO_UNIT.intersection(words) or words[-1] == _PER:
        return ""
    if words[0] == _PER:
        words = ["1", *words]
    words = [word for word in words if word != _PER]
    if len(words) == 1 and words[0] in _SPELLED:
        return _SPELLED[words[0]]
    text = "/".join(_TORQUES.get(word, word) for word in words)
    try:
        parse_unit(text)
    except UnitError:
        return ""
    return text


def unit_of(name: str) -> str:
    """Unit text of a key; "" when its name carries none."""
    return split(name)[1]


@cache
def named(stem: str, unit: str) -> str:
    """The name that carries a unit: ("force", "N") is ``force_N``. Raises ValueError for a unit no name can carry."""
    if not unit or unit == "1":
        return stem
    text = {spelled: word for word, spelled in _SPELLED.items()}.get(unit, unit)
    name = f"{stem}_{text.replace('.', '').replace('/', '_')}"
    if split(name) != (stem, unit):
        raise ValueError(f"no name carries the unit {unit}: '{name}' reads as {split(name)[1] or 'none'}")
    return name


class Row(NamedTuple):
    """One row of the table that people see: label, value and unit."""

    label: str
    value: Any
    unit: str = ""


@dataclass(frozen=True)
class Quantity:
    """What an attribute of a study is: `stiffness: Annotated[Array, Quantity("N/m", "along the axes", "stiffness")]`.

    A text alone is the description of one without a unit: `lost: Annotated[int, "paths that ended nowhere"]`.

    unit: of the attribute, SI; "" for none.
    description: for `gtmodel schema`, in a few words.
    label: its row in the table; no row of its own if empty.
    shown: the unit of that row, if not `unit`.
    key: its name in result.json, if not the attribute's name with the unit: ``stiffness_N_m``.
    written: the unit of its name and value in result.json where people write another, as "deg" for rad.
    """

    unit: str = ""
    description: str = ""
    label: str = ""
    shown: str = ""
    key: str = ""
    written: str = ""

    def name(self, attribute: str) -> str:
        """The name in result.json."""
        return self.key or named(attribute, self.file_unit)

    @property
    def file_unit(self) -> str:
        """The unit in result.json."""
        return self.written or self.unit

    def value(self, value: Any) -> Any:
        """The value in result.json."""
        return converted(value, self.unit, self.written, out=True) if self.written else value

    def row(self, value: Any) -> Row:
        """The row of the table: numbers in the unit that is shown, vectors as text."""
        unit = self.shown or self.unit
        if self.shown and self.shown != self.unit:
            value = converted(value, self.unit, self.shown)
        if isinstance(value, (np.ndarray, list, tuple)) and np.ndim(value):
            value = listed(np.ravel(value))
        return Row(self.label, value.item() if isinstance(value, np.ndarray) else value, unit)


def converted(value: Any, unit: str, written: str, out: bool = False) -> Any:
    """A number, or numbers of any shape as an array, or by name, in another unit; None stays.

    By one factor: a file in um or deg and a call with 1e-6 * x or numpy.radians(x) give equal bits; `out`, of what is
    written to a file, by a divisor where the unit is larger, as x / 1e6.
    """
    if value is None:
        return None
    if isinstance(value, Mapping):
        return {name: converted(one, unit, written, out) for name, one in value.items()}
    x, factor = np.asarray(value, float), float(convert(1.0, unit, written))
    y = x / float(convert(1.0, written, unit)) if out and factor < 1 else x * factor
    return y if np.ndim(y) else float(y)


@cache
def quantities(cls: type) -> dict[str, Quantity]:
    """The declared quantities of a study's class by attribute, in the order of their last declaration."""
    hints: dict[str, Any] = {}
    for c in reversed(cls.__mro__):
        for name, hint in inspect.get_annotations(c).items():
            hints.pop(name, None)
            # what is no quantity is not evaluated: its type may be known to type checkers alone
            if not isinstance(hint, str) or hint.startswith("Annotated["):
                known = vars(sys.modules.get(c.__module__, builtins))
                hints[name] = eval(hint, known, dict(vars(c))) if isinstance(hint, str) else hint
    order = list(dict.fromkeys(name for c in cls.__mro__ for name in reversed(inspect.get_annotations(c))))
    order.reverse()
    carried = {name: marks_of(hints[name]) for name in order if name in hints}
    declared = {name: q for name, marks in carried.items() for q in marks if isinstance(q, (Quantity, str))}
    return {name: Quantity(description=q) if isinstance(q, str) else q for name, q in declared.items()}


def marks_of(hint: Any) -> tuple[Any, ...]:
    """What an annotation carries besides its type."""
    return tuple(get_args(hint)[1:]) if get_origin(hint) is Annotated else ()


def listed(numbers: Iterable[float]) -> str:
    """The numbers of a vector as text, with four digits.

    >>> gt.results.listed([1.0, 0.25, -0.0])
    '1, 0.25, 0'
    """
    return ", ".join(f"{x + 0.0:.4g}" for x in numbers)  # -0 is 0


def described(cls: type) -> Mapping[str, Quantity]:
    """Name in result.json -> its quantity; `file_unit` is its unit there."""
    return {q.name(attribute): q for attribute, q in quantities(cls).items()}
