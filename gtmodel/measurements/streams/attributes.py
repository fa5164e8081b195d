"""What a file says of a column beside its numbers, whatever its kind: unit, scale, offset, values that mean nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...results.trajectory_checks import Array
from .form import LogError
from .heads import is_unit, spelled

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
