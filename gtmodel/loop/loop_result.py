"""Result of a loop study, and the table rows of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from ..results.study import to_inherit
from .one_run import HOLD_CYCLES

# bin edges of the printed histograms; loop.json holds all bins of the loop, in powers of two
REPLIES_US, PERIODS_US, COMPUTING_US = (64, 512, 4096), (2048, 4096, 8192), (4, 16, 64)


def rows_of(runs: Sequence[Mapping[str, Any]], in_lockstep: bool) -> list[Row]:
    """Return per run the errors, the late cycles and, in real time, the timing. runs: as in `LoopStudy.runs`."""
    rows: list[Row] = []
    for run in runs:
        label = run["label"]
        rows += [
            Row(f"{label}: rms error of T", run["tcp_rms_mm"], "mm"),
            Row(f"{label}: largest error of T", run["tcp_largest_mm"], "mm"),
            Row(f"{label}: late, lost, repeated", " ".join(str(run[k]) for k in ("late", "lost", "repeated"))),
        ]
        if not in_lockstep:
            rows += [
                Row(f"{label}: replies later than a cycle", str(run["missed_deadlines"])),
                Row(f"{label}: worst reply, worst period", _worst_ms(run), "ms"),
                Row(f"{label}: longest computing of a cycle", f"{run['compute_worst_us']}", "us"),
                Row(f"{label}: computing", _histogram(run["compute_below_us"], COMPUTING_US)),
                Row(f"{label}: replies", _histogram(run["reply_below_us"], REPLIES_US)),
                Row(f"{label}: periods", _histogram(run["period_below_us"], PERIODS_US)),
            ]
    return rows


def _worst_ms(report: Mapping[str, Any]) -> str:
    return " ".join(f"{report[f'{kind}_worst_us'] / 1000:.2f}" for kind in ("reply", "period"))


def _histogram(below_us: dict[str, int], edges_us: Sequence[int]) -> str:
    """Merge the loop's fine bins: counts between successive edges, and the rest."""
    cells, before = [], 0
    for edge in edges_us:
        up_to = sum(count for us, count in below_us.items() if int(us) <= edge)
        cells.append(f"<{edge / 1000:.2g} ms: {up_to - before}")
        before = up_to
    return ", ".join([*cells, f"more: {sum(below_us.values()) - before}"])


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoopStudy(Study):
    """Two runs of the loop, without and with its law; has no quantities unless both runs took place.

    in_lockstep: the runs went cycle by cycle, as fast as the machine allows. notes: text that the loop printed.
    """

    in_lockstep: bool = False
    peer: Annotated[str, Quantity("", "protocol of the simulated controller")] = ""
    law: Annotated[str, Quantity("", "control law of the second run")] = ""
    plant: Annotated[str, Quantity("", "simulated plant")] = ""
    plant_stopped: Annotated[
        float | None, Quantity("s", "time at which the plant of the last run failed; null: it did not fail")
    ] = None
    elastic: Annotated[float | None, Quantity("Hz", "natural frequency of an arm on springs; null: rigid arm")] = None
    cycles: Annotated[int, Quantity("", "number of cycles of each run")] = 0
    real_time: Annotated[bool, Quantity("", "whether the system granted both runs real-time priority")] = False
    hold_cycles: Annotated[int, Quantity("", "cycles held after the robot is lost, before braking")] = HOLD_CYCLES
    deceleration: Annotated[float | None, Quantity("m/s2", "braking deceleration of the fastest cart")] = None
    greatest_speed: Annotated[float | None, Quantity("m/s", "greatest cart speed in the reference")] = None
    stopping_distance: Annotated[
        float | None, Quantity("m", "distance to the stop of a lost robot from that speed")
    ] = None
    joint_deceleration: Annotated[
        float | None, Quantity("rad/s2", "braking deceleration of the fastest joint; null for carts")
    ] = None
    greatest_joint_speed: Annotated[
        float | None, Quantity("rad/s", "greatest joint speed in the reference; null for carts")
    ] = None
    stopping_angle: Annotated[
        float | None, Quantity("rad", "angle to the stop of a lost robot from that speed; null for carts")
    ] = None
    runs: Annotated[
        Sequence[Mapping[str, Any]], Quantity("", "per run: its errors in mm, and the report of the loop")
    ] = ()

    @property
    def values(self) -> Mapping[str, Any]:
        """The quantities; empty unless both runs took place."""
        return super().values if self.runs else {}

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if not self.runs:
            return []
        stopped = self.plant_stopped
        return [
            *rows_of(self.runs, self.in_lockstep),
            *([] if stopped is None else [Row("the plant failed at", stopped, "s")]),
            *self._stop(),
        ]

    def _stop(self) -> list[Row]:
        held = f"robot lost: held for {self.hold_cycles} cycles, then braked at"
        if self.greatest_joint_speed is not None:
            return [
                Row("greatest speed of a joint", self.greatest_joint_speed, "rad/s"),
                Row(held, self.joint_deceleration, "rad/s2"),
                Row("robot lost: stopping angle from that speed", self.stopping_angle, "rad"),
            ]
        return [
            Row("greatest speed of a cart", self.greatest_speed, "m/s"),
            Row(held, self.deceleration, "m/s2"),
            Row("robot lost: stopping distance from that speed", self.stopping_distance, "m"),
        ]
