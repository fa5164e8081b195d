"""What the runs of the loop say, as rows of a table for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..results import Row

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
