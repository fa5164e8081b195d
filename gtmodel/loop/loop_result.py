"""What a study of the loop returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from ..results.study import to_inherit
from .bench import HOLD_CYCLES
from .report import rows_of


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoopStudy(Study):
    """Two runs of the loop, its law off and on; without quantities where they were not both made.

    in_lockstep: whether they went cycle by cycle, as fast as it goes. notes: what the loop printed
    for a person.
    """

    in_lockstep: bool = False
    peer: Annotated[str, Quantity("", "protocol of the simulated controller")] = ""
    law: Annotated[str, Quantity("", "of the second run")] = ""
    plant: Annotated[str, Quantity("", "what moves the robot")] = ""
    plant_stopped: Annotated[
        float | None, Quantity("s", "until when the plant of the last run had an answer; null: all the time")
    ] = None
    elastic: Annotated[float | None, Quantity("Hz", "of an arm on springs; null for a rigid one")] = None
    cycles: Annotated[int, Quantity("", "of each run")] = 0
    real_time: Annotated[bool, Quantity("", "whether the system granted both runs its real-time priority")] = False
    hold_cycles: Annotated[int, Quantity("", "held when the robot is lost, before it brakes")] = HOLD_CYCLES
    deceleration: Annotated[float, Quantity("m/s2", "then, of the fastest cart")] = 0.0
    greatest_speed: Annotated[float, Quantity("m/s", "of a cart, in the reference")] = 0.0
    stopping_distance: Annotated[float, Quantity("m", "way to the stop of a lost robot from that speed")] = 0.0
    runs: Annotated[
        Sequence[Mapping[str, Any]], Quantity("", "of each run: its errors in mm, and the report of the loop")
    ] = ()

    @property
    def values(self) -> Mapping[str, Any]:
        """The quantities, where both runs were made."""
        return super().values if self.runs else {}

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if not self.runs:
            return []
        stopped = self.plant_stopped
        return [
            *rows_of(self.runs, self.in_lockstep),
            *([] if stopped is None else [Row("the plant had an answer until", stopped, "s")]),
            Row("greatest speed of a cart", self.greatest_speed, "m/s"),
            Row(f"a lost robot: held for {self.hold_cycles} cycles, then braked at", self.deceleration, "m/s2"),
            Row("a lost robot: way to the stop from that speed", self.stopping_distance, "m"),
        ]
