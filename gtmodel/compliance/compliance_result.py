"""What a compliance study answers: stiffness, deflection and natural frequencies over the workspace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..results import Quantity, Row, Study, listed

Array = np.ndarray


WORDS = {"links": "rods", "joints": "ball joints", "drives": "drives", "carts": "bearings of the carts",
         "frame": "machine frame"}  # fmt: skip


MAPPED = {"softest_N_m": ("stiffness along the softest direction", 1e-6, "N/µm"),
          "deflection_m": ("deflection under the load", 1e6, "µm"),
          "frequency_Hz": ("lowest natural frequency", 1.0, "Hz")}  # fmt: skip


def word(part: str) -> str:
    """Of a part that is compliant, by its key in `shares`: a group of springs, or "joint_1" of a serial arm."""
    return WORDS.get(part) or part.replace("_", " ")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComplianceStudy(Study):
    """Stiffness, deflection and natural frequencies of a robot: at one pose, and over a section of its workspace."""

    pose: Annotated[Array, Quantity("m", "tool centre point that the next numbers are about")]
    compliance: Annotated[Array, "at the tool, displacement by load: m/N, and rad/N, rad/(N.m) where the plate turns"]
    stiffness: Annotated[
        Array, Quantity("N/m", "along the principal directions of its translational part, softest first")
    ]
    directions: Annotated[Array, "these directions"]
    deflection: Annotated[Array, Quantity("m", "of the tool centre point under the load")]
    rotation: Annotated[Array | None, Quantity("rad", "of the plate under the load; null where it has none")]
    work: Annotated[float | None, Quantity("J", "that the load does")] = None
    shares: Annotated[
        Mapping[str, float] | None,
        "parts of this work by what is compliant: groups of springs, joints of a serial arm; null without a load",
    ]
    sag: Annotated[
        Array | None, Quantity("m", "of the tool centre point by all weights; null for robots without masses")
    ]
    frequencies: Annotated[Array | None, Quantity("Hz", "lowest natural frequencies; null for robots without masses")]
    map: Annotated[
        Mapping[str, Any],
        "over the section: points, and for softest_N_m, deflection_m and frequency_Hz least and greatest with "
        "their places in (u, v)",
    ]
    reasons: Annotated[Mapping[str, int], "number of grid points left out, by reason"]
    assumptions: Annotated[Sequence[str], "what was assumed, in sentences"]

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [
            Row("at the tool centre point", listed(self.pose), "m"),
            Row("stiffness, softest direction", self.stiffness[0] / 1e6, "N/um"),
            Row("along", listed(self.directions[0])),
            Row("stiffness, stiffest direction", self.stiffness[-1] / 1e6, "N/um"),
        ]
        if np.any(self.deflection):
            rows.append(Row("deflection under the load", listed(1e6 * self.deflection), "um"))
            if self.rotation is not None:
                rows.append(Row("rotation under it", listed(1e6 * self.rotation), "urad"))
        if self.shares is not None:
            shares = ", ".join(f"{word(k)} {100 * x:.0f} %" for k, x in self.shares.items() if x > 0)
            rows.append(Row("what takes the work", shares))
        if self.sag is not None and self.frequencies is not None:
            rows.append(Row("deflection by all weights", listed(1e6 * self.sag), "um"))
            rows.append(Row("natural frequencies", listed(self.frequencies), "Hz"))
        for name, (words, scale, unit) in MAPPED.items():
            if name in self.map:
                e = self.map[name]
                ends = (f"{scale * e[x]:.4g} at ({listed(e[f'{x}_at_m'])}) m" for x in ("least", "greatest"))
                rows.append(Row(f"over the section: {words}", " to ".join(ends), unit.replace("µ", "u")))
        rows += [Row(f"grid points left out: {reason}", count) for reason, count in self.reasons.items()]
        return rows + [Row("assumed", sentence) for sentence in self.assumptions]
