"""What a run of the loop leaves, how a robot that is lost comes to rest, and the table of both for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmodel.problem_files.base import Row

from .loop_bench import Bench
from .loop_motion import CYCLE_MS

# as long as the C program holds by itself
HOLD_CYCLES = 5
# edges of the histogram that is printed, among the loop's powers of two; loop.json holds all
REPLIES_US, PERIODS_US, COMPUTING_US = (64, 512, 4096), (2048, 4096, 8192), (4, 16, 64)


@dataclass
class OneRun:
    """One run: its log, the loop's report, what it said; carts and tool centre point measured (cycles, 3) [m]."""

    label: str
    log: bytes
    report: dict[str, Any]
    said: str
    carts_m: np.ndarray
    tcp_m: np.ndarray
    programme_tcp_m: np.ndarray


@dataclass(frozen=True)
class Stop:
    """What a cart does when the robot is lost at the reference's greatest speed: it holds, then brakes."""

    speed_m_s: float
    deceleration_m_s2: float

    @classmethod
    def of(cls, bench: Bench, deceleration_m_s2: float | None) -> Stop:
        """Of the reference's carts; where they rest any deceleration will do."""
        rates = np.abs(bench.reference.rows[: bench.cycles, 3:9])
        return cls(float(np.max(rates[:, :3])), deceleration_m_s2 or float(np.max(rates[:, 3:])) or 1.0)

    @property
    def distance_m(self) -> float:
        """Held cycles at full speed, then a ramp in whole cycles."""
        step = 1e-3 * CYCLE_MS
        ramp = math.ceil(self.speed_m_s / (self.deceleration_m_s2 * step))
        return self.speed_m_s * step * (HOLD_CYCLES + max(0, ramp - 1) / 2)


def rows_of(runs: list[OneRun], errors: list[dict[str, float]], in_lockstep: bool) -> list[Row]:
    rows: list[Row] = []
    for one, error in zip(runs, errors, strict=True):
        rows += [
            Row(f"{one.label}: rms error of T", error["tcp_rms_mm"], "mm"),
            Row(f"{one.label}: largest error of T", error["tcp_largest_mm"], "mm"),
            Row(
                f"{one.label}: late, lost, repeated", " ".join(str(one.report[k]) for k in ("late", "lost", "repeated"))
            ),
        ]
        if not in_lockstep:
            rows += [
                Row(f"{one.label}: replies later than a cycle", str(one.report["missed_deadlines"])),
                Row(f"{one.label}: worst reply, worst period", " ".join(_worst_ms(one.report)), "ms"),
                Row(f"{one.label}: longest computing of a cycle", f"{one.report['compute_worst_us']}", "us"),
                Row(f"{one.label}: computing", _histogram(one.report["compute_below_us"], COMPUTING_US)),
                Row(f"{one.label}: replies", _histogram(one.report["reply_below_us"], REPLIES_US)),
                Row(f"{one.label}: periods", _histogram(one.report["period_below_us"], PERIODS_US)),
            ]
    for line in dict.fromkeys(line for one in runs for line in one.said.splitlines()):
        rows.append(Row("the loop says", line))
    return rows


def stopping(stop: Stop) -> list[Row]:
    return [
        Row("greatest speed of a cart", stop.speed_m_s, "m/s"),
        Row(f"a lost robot: held for {HOLD_CYCLES} cycles, then braked at", stop.deceleration_m_s2, "m/s2"),
        Row("a lost robot: way to the stop from that speed", stop.distance_m, "m"),
    ]


def _worst_ms(found: dict[str, Any]) -> list[str]:
    return [f"{found[f'{what}_worst_us'] / 1000:.2f}" for what in ("reply", "period")]


def _histogram(below_us: dict[str, int], edges_us: Sequence[int]) -> str:
    """The loop's fine classes added up: how many lie below each edge and not below the one before, and the rest."""
    cells, before = [], 0
    for edge in edges_us:
        up_to = sum(count for us, count in below_us.items() if int(us) <= edge)
        cells.append(f"<{edge / 1000:.2g} ms: {up_to - before}")
        before = up_to
    return ", ".join([*cells, f"more: {sum(below_us.values()) - before}"])
