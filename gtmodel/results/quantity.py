"""Quantities of options and results: unit, description, label in a table, and the units in names."""

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
_PRODUCTS = {"Nm": "N.m", "MNm": "MN.m", "Ns": "N.s", "Nms": "N.m.s"}  # Nm_rad is N.m/rad, rad_s_Nm rad/s/(N.m)
_PER = "per"
_NO_UNIT = {"min"}  # means minimum, never minutes


@cache
def split(name: str) -> tuple[str, str]:
    """Return stem and unit of a key, ("force", "N"); the unit is "" if the name has none.

    The longest ending that reads as a unit counts. The symbols after its first one are divisors: ``m_s2`` and
    ``m_per_s2`` are m/s2; ``per_s`` is 1/s.
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
    first, *others = words
    divisors = (f"({_PRODUCTS[word]})" if word in _PRODUCTS else word for word in others)
    text = "/".join([_PRODUCTS.get(first, first), *divisors])
    try:
        parse_unit(text)
    except UnitError:
        return ""
    return text


def unit_of(name: str) -> str:
    """Return the unit in the name of a key; "" if it has none."""
    return split(name)[1]


@cache
def named(stem: str, unit: str) -> str:
    """Return the name with a unit: ("force", "N") gives ``force_N``. Raises ValueError for a unit that no name can
    express."""
    if not unit or unit == "1":
        return stem
    text = {spelled: word for word, spelled in _SPELLED.items()}.get(unit, unit)
    name = f"{stem}_{text.replace('.', '').replace('/', '_')}"
    if split(name) != (stem, unit):
        raise ValueError(f"no name can express the unit {unit}: '{name}' reads as {split(name)[1] or 'no unit'}")
    return name


class Row(NamedTuple):
    """A row of the table: label, value and unit."""

    label: str
    value: Any
    unit: str = ""


@dataclass(frozen=True)
class Quantity:
    """Declares an attribute of a study: `stiffness: Annotated[Array, Quantity("N/m", "along the axes", "stiffness")]`.

    For a quantity without a unit, the description is enough: `lost: Annotated[int, "paths that ended nowhere"]`.

    unit: SI unit of the attribute; "" for none.
    description: a few words, for `gtmodel schema`.
    label: label of its row in the table; no row if empty.
    shown: the unit in the table, if it differs.
    key: its name in result.json, if it is not the attribute's name with the unit, as ``stiffness_N_m``.
    written: its unit in result.json, if it differs, such as "deg" for rad.
    """

    unit: str = ""
    description: str = ""
    label: str = ""
    shown: str = ""
    key: str = ""
    written: str = ""

    def name(self, attribute: str) -> str:
        """Return the name in result.json."""
        return self.key or named(attribute, self.file_unit)

    @property
    def file_unit(self) -> str:
        """The unit in result.json."""
        return self.written or self.unit

    def value(self, value: Any) -> Any:
        """Return the value in result.json."""
        return converted(value, self.unit, self.written, out=True) if self.written else value

    def row(self, value: Any) -> Row:
        """Return the row of the table: numbers in the unit of the table, vectors as text."""
        unit = self.shown or self.unit
        if self.shown and self.shown != self.unit:
            value = converted(value, self.unit, self.shown)
        if isinstance(value, (np.ndarray, list, tuple)) and np.ndim(value):
            value = listed(np.ravel(value))
        return Row(self.label, value.item() if isinstance(value, np.ndarray) else value, unit)


def converted(value: Any, unit: str, written: str, out: bool = False) -> Any:
    """Convert a number, an array or a dictionary of numbers to another unit; None stays None.

    The conversion is one multiplication, so that a file in um or deg and a call with 1e-6 * x or numpy.radians(x) agree
    bit for bit. With `out`, for values written to a file, a larger unit is a division, as x / 1e6.
    """
    if value is None:
        return None
    if isinstance(value, Mapping):
        return {name: converted(item, unit, written, out) for name, item in value.items()}
    x, factor = np.asarray(value, float), float(convert(1.0, unit, written))
    y = x / float(convert(1.0, written, unit)) if out and factor < 1 else x * factor
    return y if np.ndim(y) else float(y)


@cache
def quantities(cls: type) -> dict[str, Quantity]:
    """Return the declared quantities of a study's class by attribute, in the order of their last declaration."""
    hints: dict[str, Any] = {}
    for c in reversed(cls.__mro__):
        for name, hint in inspect.get_annotations(c).items():
            hints.pop(name, None)
            # other annotations are not evaluated: only type checkers may know their types
            if not isinstance(hint, str) or hint.startswith("Annotated["):
                namespace = vars(sys.modules.get(c.__module__, builtins))
                hints[name] = eval(hint, namespace, dict(vars(c))) if isinstance(hint, str) else hint
    order = list(dict.fromkeys(name for c in cls.__mro__ for name in reversed(inspect.get_annotations(c))))
    order.reverse()
    marks_by_name = {name: marks_of(hints[name]) for name in order if name in hints}
    declared = {name: q for name, marks in marks_by_name.items() for q in marks if isinstance(q, (Quantity, str))}
    return {name: Quantity(description=q) if isinstance(q, str) else q for name, q in declared.items()}


def marks_of(hint: Any) -> tuple[Any, ...]:
    """Return the metadata of an annotation."""
    return tuple(get_args(hint)[1:]) if get_origin(hint) is Annotated else ()


def listed(numbers: Iterable[float]) -> str:
    """Return the numbers of a vector as text, with four digits.

    >>> gt.results.listed([1.0, 0.25, -0.0])
    '1, 0.25, 0'
    """
    return ", ".join(f"{x + 0.0:.4g}" for x in numbers)  # -0 is 0


def described(cls: type) -> Mapping[str, Quantity]:
    """Return name in result.json -> quantity; `file_unit` is its unit there."""
    return {q.name(attribute): q for attribute, q in quantities(cls).items()}
