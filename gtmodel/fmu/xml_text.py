"""What both versions of the model description have in common: elements, numbers, units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from ..lang.units import BASE_SYMBOLS, UnitError, parse_unit
from .table import FmuTable, FmuVariable

Attributes = Mapping[str, str | int | float | bool | None]
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
LOGS = {"logStatusDiscard": "there is no answer at these values", "logStatusError": "a call that is refused"}
_RADIANS = re.compile(r"(/\(?[^/]*?)?\brad(-?\d*)\b")
LICENSE = "MIT AND BSD-2-Clause"


def element(name: str, attributes: Attributes, inside: Sequence[str] = ()) -> str:
    """An element with its children, indented by two; attributes that are None are left out.

    >>> from gtmodel.fmu.xml_text import element
    >>> element("Unit", {"name": "m", "offset": None}, [element("BaseUnit", {"m": 1})])
    '<Unit name="m">\\n  <BaseUnit m="1"/>\\n</Unit>\\n'
    """
    text = "".join(f' {key}="{_value(v)}"' for key, v in attributes.items() if v is not None)
    if not inside:
        return f"<{name}{text}/>\n"
    body = "".join(f"  {line}\n" for part in inside for line in part.splitlines())
    return f"<{name}{text}>\n{body}</{name}>\n"


def _value(value: str | int | float | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return escaped(repr(value) if isinstance(value, float) else str(value))


def escaped(text: str) -> str:
    """A text inside of an attribute or of a page."""
    for sign, word in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ('"', "&quot;")):
        text = text.replace(sign, word)
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def listed(numbers: Sequence[int]) -> str:
    """Value references or indices, separated by blanks."""
    return " ".join(map(str, numbers))


def limits(v: FmuVariable) -> dict[str, float | None]:
    """Attributes of the least and the greatest value."""
    return {name: x if math.isfinite(x) else None for name, x in (("min", v.least), ("max", v.most))}


def unit_elements(table: FmuTable) -> list[str]:
    """One Unit for each in use, with its exponents where these are whole; all numbers are in SI."""
    return [
        element("Unit", {"name": unit}, [element("BaseUnit", base)] if (base := base_unit(unit)) is not None else [])
        for unit in sorted({v.unit for v in table.numbers})
    ]


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents of the base units of FMI that are not zero; None for a unit that has no such.

    >>> from gtmodel.fmu.xml_text import base_unit
    >>> base_unit("N.m/rad"), base_unit("m.rad-1")
    ({'kg': 1, 'm': 2, 's': -2, 'rad': -1}, {'m': 1, 'rad': -1})
    """
    try:
        parsed = parse_unit(unit)
    except UnitError:
        return None
    exponents: dict[str, Any] = dict(zip(BASE_SYMBOLS, parsed.dimension.exponents, strict=True))
    for below, power in _RADIANS.findall(unit):
        exponents["rad"] = exponents.get("rad", 0) + (-1 if below else 1) * int(power or 1)
    if not parsed.is_si or any(Fraction(e).denominator != 1 for e in exponents.values()):
        return None
    return {symbol: int(e) for symbol, e in exponents.items() if e}


def log_categories() -> str:
    """What the unit says, and when."""
    inside = [element("Category", {"name": name, "description": about}) for name, about in LOGS.items()]
    return element("LogCategories", {}, inside)
