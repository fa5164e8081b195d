"""What a friction study answers: a line per actuator and direction, the mass held, and what is undetermined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ...results import Quantity, Row, Study, listed
from ...results.study import to_inherit

Array = np.ndarray


LABELS = {
    "coulomb_plus": "Coulomb friction forwards",
    "coulomb_minus": "Coulomb friction backwards",
    "viscous_plus": "viscous forwards",
    "viscous_minus": "viscous backwards",
}


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrictionStudy(Study):
    """Friction by actuator and direction of motion, and the mass held; None where it was stopped before the fit."""

    mass: Annotated[float | None, Quantity("kg", "plate and half the links, as the carts' forces hold them")] = None
    mass_interval: Annotated[
        Sequence[float] | None, Quantity("kg", "95 % interval; of the choice where the runs leave the mass open")
    ] = None
    mass_by_norm: Annotated[
        Mapping[str, Any] | None,
        Quantity("kg", "mass of least asymmetry by norm: two, one (interval), maximum"),
    ] = None
    coulomb_plus: Annotated[Array | None, Quantity("N", "Coulomb friction forwards, by cart")] = None
    coulomb_minus: Annotated[Array | None, Quantity("N", "Coulomb friction backwards, by cart")] = None
    viscous_plus: Annotated[Array | None, Quantity("kg/s", "viscous friction forwards, by cart")] = None
    viscous_minus: Annotated[Array | None, Quantity("kg/s", "viscous friction backwards, by cart")] = None
    intervals: Annotated[
        Mapping[str, Sequence[float]] | None, Quantity("", "95 % intervals by name: m, coulomb_plus[0], ...")
    ] = None
    middle: Annotated[
        Array | None,
        Quantity("N", "level between the two directions, by pose and cart: gravity and asymmetric friction together"),
    ] = None
    pattern: Annotated[Array | None, Quantity("N/kg", "force of each cart that holds one kilogram, by pose")] = None
    residual: Annotated[Array | None, Quantity("N", "rms of the fitted lines, by cart")] = None
    runs: Annotated[int | None, Quantity("", "number of runs at constant velocity")] = None
    synthetic: Annotated[
        str | None, Quantity("", "seed and noise of synthetic logs; null for measured ones")
    ] = None  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.mass_interval is None or self.mass_by_norm is None or self.residual is None:
            return []
        (low, high), (first, last) = self.mass_interval, self.mass_by_norm["one"]
        return [
            Row("mass held", self.mass, "kg"),
            Row("95 % interval", f"{low:.4g} .. {high:.4g}", "kg"),
            Row("1-norm: least anywhere from", f"{first:.4g} to {last:.4g}", "kg"),
            Row("maximum norm", self.mass_by_norm["maximum"], "kg"),
            *self._coefficients(),
            Row("residual of the lines", listed(self.residual), "N"),
            Row("runs at constant velocity", self.runs),
            *([Row("SYNTHETIC", self.synthetic)] if self.synthetic else []),
        ]

    def _coefficients(self) -> list[Row]:
        units = {name: q.unit for name, q in self.quantities().items()}
        return [Row(label, listed(getattr(self, name)), units[name]) for name, label in LABELS.items()]
