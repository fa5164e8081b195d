"""From the columns of a log to a quantity: scales, signs, gear ratios, motor constants, coupling, offsets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..lang.units import convert, parse_unit
from ..results.trajectory_checks import Array
from .streams.form import LogError

Numbers = float | tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]
EFFORTS = {parse_unit(u).dimension: u for u in ("N", "N.m")}
CURRENT = parse_unit("A").dimension


@dataclass(frozen=True)
class Conversion:
    """quantity = coupling (factor * columns) - offset, with one factor for each column.

    Args:
        scale: quantity per column [quantity_unit / unit], one number or one for each column; -1 reverses a sign.
        offset: scale times the reading at zero quantity [quantity_unit], one number or one for each component.
        gear_ratio: turns of the motor for one turn of the joint. A measured motor position or speed is divided by it, a
            motor torque or current multiplied.
        motor_constant: torque per current of the motor [N.m/A], for columns of a current.
        coupling: square matrix, component by column, after all factors. For positions of a wrist whose joint 6 turns by
            -1/50 of joint 5: ((1, 0), (-0.02, 1)). The efforts of the same joints have its inverse transpose.
        quantity_unit: SI unit of the quantity, or of each component; default: the unit of the columns, or N.m with a
            motor constant.

    Raises LogError for a factor of zero, a coupling that is not square or is singular, and columns whose dimension is
    not that of the quantity if there is no scale.

    >>> motors = gt.measurements.Conversion(scale=(1, -1), gear_ratio=(100, 80), coupling=((1, 0), (-0.5, 1)))
    >>> motors.apply([[100.0, 80.0]], ["rad", "rad"])
    array([[ 1. , -1.5]])
    >>> current = gt.measurements.Conversion(motor_constant=0.5, gear_ratio=100)
    >>> current.apply([[2.0]], ["A"]), current.si_unit(["A"])  # N.m at the joint
    (array([[100.]]), 'N.m')
    """

    scale: Numbers = 1.0
    offset: Numbers = 0.0
    gear_ratio: Numbers | None = None
    motor_constant: Numbers | None = None
    coupling: Matrix | None = None
    quantity_unit: str | tuple[str, ...] = ""

    def __post_init__(self) -> None:
        for name in ("scale", "gear_ratio", "motor_constant"):
            value = getattr(self, name)
            if value is not None and not (np.all(np.isfinite(value)) and np.all(np.asarray(value) != 0)):
                raise LogError(f"contains {value}; expected finite numbers other than 0", name)
        if self.coupling is None:
            return
        widths = {len(row) for row in self.coupling}
        if widths != {len(self.coupling)}:
            raise LogError(
                f"has {len(self.coupling)} rows of {sorted(widths)} numbers; expected a square matrix", "coupling"
            )
        if np.linalg.cond(np.asarray(self.coupling, float)) > 1e8:
            raise LogError("is singular: two joints would show one motion", "coupling")

    @property
    def is_plain(self) -> bool:
        """Whether the quantity is the column itself."""
        return self == _PLAIN

    def si_unit(self, units: Sequence[str]) -> str:
        """Return the SI unit of the quantity, "1" if its components differ in unit."""
        texts = {quantity for _, quantity in self._each(units)}
        return texts.pop() if len(texts) == 1 else "1"

    def is_effort(self, units: Sequence[str]) -> bool:
        """Return whether the quantity, or each component, is a force or torque."""
        return all(parse_unit(quantity).dimension in EFFORTS for _, quantity in self._each(units))

    def check(self, units: Sequence[str], column: Any) -> None:
        """Raise LogError if a column of one of these units needs a scale and has none.

        column: name or names, for the message.
        """
        for unit, quantity in self._each(units):
            differs = parse_unit(quantity).dimension != parse_unit(self._driven(unit)).dimension
            if differs and self.scale == 1.0:
                named = f"column '{column}' is" if isinstance(column, str) else f"columns {', '.join(column)} are"
                raise LogError(
                    f"the {named} in {unit} and the quantity in {quantity}; "
                    f'give the scale in {quantity} per {unit}, or scale = "estimate"'
                )

    def factors(self, units: Sequence[str], width: int) -> Array:
        """Return the quantity per column, both in SI, (width,). Raises LogError for another number of factors."""
        units = list(units) * width if len(units) == 1 else list(units)
        factor = self.each("scale", self.scale, width)
        if self.motor_constant is not None:
            factor = factor * self.each("motor_constant", self.motor_constant, width)
        pairs = self._each(units)
        for k, (unit, text) in enumerate(pairs):
            quantity, driven = parse_unit(text), parse_unit(self._driven(unit))
            if quantity.dimension != driven.dimension:  # the scale refers to the unit as declared
                factor[k] /= float(convert(1.0, unit, parse_unit(unit).si_text))
        if self.gear_ratio is not None:
            gears = self.each("gear_ratio", self.gear_ratio, width)
            multiplied = [parse_unit(text).dimension in EFFORTS for _, text in pairs]
            factor = factor * np.where(multiplied, gears, 1 / gears)
        return factor

    def apply(self, rows: Any, units: Sequence[str]) -> Array:
        """Convert rows of columns in SI (n, width) to the quantity in SI; `units`: as declared, one or one each."""
        rows = np.asarray(rows, float)
        width = rows.shape[1]
        return self.coupled(rows * self.factors(units, width)) - self.each("offset", self.offset, width)

    def coupled(self, rows: Array) -> Array:
        """Return the rows (n, width) after the coupling. Raises LogError if it has another size."""
        if self.coupling is None:
            return rows
        if len(self.coupling) != rows.shape[1]:
            raise LogError(f"has {len(self.coupling)} rows for {rows.shape[1]} columns", "coupling")
        return rows @ np.asarray(self.coupling, float).T

    def component(self, k: int, width: int) -> Conversion:
        """Return the conversion of one column of `width`. Raises LogError for a coupling: it needs all of them."""
        if self.coupling is not None:
            raise LogError("needs columns with one clock; these have a time column each", "coupling")
        given = {n: getattr(self, n) for n in ("scale", "offset", "gear_ratio", "motor_constant")}
        own = {n: None if v is None else float(self.each(n, v, width)[k]) for n, v in given.items()}
        unit = self.quantity_unit if isinstance(self.quantity_unit, str) else self.quantity_unit[k]
        return replace(self, **own, quantity_unit=unit)

    @staticmethod
    def each(name: str, value: Numbers, width: int) -> Array:
        """Return one number for each column. Raises LogError for another number of them."""
        if np.ndim(value) and len(np.atleast_1d(value)) != width:
            raise LogError(f"has {len(np.atleast_1d(value))} numbers for {width} columns; give one, or one each", name)
        return np.array(np.broadcast_to(np.asarray(value, float), width))

    def _driven(self, unit: str) -> str:
        """Return the unit after the motor constant."""
        if self.motor_constant is None:
            return unit
        if parse_unit(unit).dimension != CURRENT:
            raise LogError(f"needs columns of a current; found the unit {unit}", "motor_constant")
        return "N.m"

    def _each(self, units: Sequence[str]) -> list[tuple[str, str]]:
        """Return the unit of each column with the SI unit of its quantity. Raises LogError if they are not as many."""
        quantities = [self.quantity_unit] if isinstance(self.quantity_unit, str) else self.quantity_unit
        count = max(len(units), len(quantities))
        if {len(units), len(quantities)} - {1, count}:
            raise LogError(
                f"has {len(quantities)} units for {len(units)} columns; give one, or one each", "quantity_unit"
            )
        columns, quantities = (list(x) * count if len(x) == 1 else list(x) for x in (units, quantities))
        return [(u, parse_unit(q or self._driven(u)).si_text) for u, q in zip(columns, quantities, strict=True)]


_PLAIN = Conversion()
