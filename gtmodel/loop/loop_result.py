"""What a study of the loop returns, and what its runs say as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from ..results.study import to_inherit
from .one_run import HOLD_CYCLES

# edges of the histogram that is printed, among the loop's powers of two; loop.json holds all
REPLIES_US, PERIODS_US, COMPUTING_US = (64, 512, 4096), (2048, 4096, 8192), (4, 16, 64)


def rows_of(runs: Sequence[Mapping[str, Any]], in_lockstep: bool) -> list[Row]:
    """By run: its errors, late cycles, and in real time how long everything took. runs: as in `LoopStudy.runs`."""
    rows: list[Row] = []
    for one in runs:
        label = one["label"]
        rows += [
            Row(f"{label}: rms error of T", one["tcp_rms_mm"], "mm"),
            Row(f"{label}: largest error of T", one["tcp_largest_mm"], "mm"),
            Row(f"{label}: late, lost, repeated", " ".join(str(one[k]) for k in ("late", "lost", "repeated"))),
        ]
        if not in_lockstep:
            rows += [
                Row(f"{label}: replies later than a cycle", str(one["missed_deadlines"])),
                Row(f"{label}: worst reply, worst period", _worst_ms(one), "ms"),
                Row(f"{label}: longest computing of a cycle", f"{one['compute_worst_us']}", "us"),
                Row(f"{label}: computing", _histogram(one["compute_below_us"], COMPUTING_US)),
                Row(f"{label}: replies", _histogram(one["reply_below_us"], REPLIES_US)),
                Row(f"{label}: periods", _histogram(one["period_below_us"], PERIODS_US)),
            ]
    return rows


def _worst_ms(report: Mapping[str, Any]) -> str:
    return " ".join(f"{report[f'{what}_worst_us'] / 1000:.2f}" for what in ("reply", "period"))


def _histogram(below_us: dict[str, int], edges_us: Sequence[int]) -> str:
    """The loop's fine classes added up: how many lie below each edge and not below the one before, and the rest."""
    cells, before = [], 0
    for edge in edges_us:
        up_to = sum(count for us, count in below_us.items() if int(us) <= edge)
        cells.append(f"<{edge / 1000:.2g} ms: {up_to - before}")
        before = up_to
    return ", ".join([*cells, f"more: {sum(below_us.values()) - before}"])


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
