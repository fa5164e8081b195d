"""What a study of several motions answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from .._lazy import hint
from ..results import Quantity, Row, Study

if TYPE_CHECKING:
    from .motion_study_result import MotionStudy
    from .table_row import TableRow
else:
    MotionStudy = hint("gtmodel.motion.motion_study_result", "MotionStudy")
    TableRow = hint("gtmodel.motion.table_row", "TableRow")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MotionTable(Study):
    """Several optimal motions beside each other; `motions` are their studies up to the first that was not solved."""

    asked: Sequence[TableRow]
    motions: Sequence[MotionStudy]
    entries: Annotated[
        Sequence[Mapping[str, Any]],
        Quantity(
            "",
            "one entry per row: name, cost, iterations, final_time_s, energy, saturation, optima, exported values",
            key="rows",
        ),
    ]
    saving: Annotated[
        float | None, Quantity("", "time that the first row saves against the last, as a share of the last")
    ] = None
    energy_ratio: Annotated[
        float | None, Quantity("", "energy of the first row over that of the last")
    ] = None  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.saving is None or self.energy_ratio is None:
            return []
        rows: list[Row] = []
        for row, s in zip(self.asked, self.motions, strict=True):
            printed = row.published
            rows += [
                Row(f"{row.name}: final time [s]", s.final_time, _beside(printed and printed.final_time)),
                Row(f"{row.name}: energy [s]", s.energy, _beside(printed and printed.energy)),
                Row(f"{row.name}: iterations", s.attempt_iterations, _beside(printed and printed.iterations)),
                Row(f"{row.name}: motors at their limit [%]", " ".join(f"{100 * x:.0f}" for x in s.saturation or ())),
            ]
            if len(s.optima or ()) > 1:
                rows.append(Row(f"{row.name}: optima", " ".join(f"{x:.6f}" for x in s.optima or ())))
        return [
            *rows,
            Row(f"{self.asked[0].name} saves", 100 * self.saving, f"% of the time of {self.asked[-1].name}"),
            Row("and takes", self.energy_ratio, "times its energy"),
        ]


def _beside(value: float | None) -> str:
    return "" if value is None else f"published {value:g}"
