"""The shipped calibrations as calls on objects, and their measurement files changed by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import gtmodel as gt
from gtmodel.calibrate import (
    CalibrationStudy,
    Fit,
    Measured,
    MeasuredPoses,
    MeasuredSignal,
    Synthetic,
    read_poses,
    study,
)
from tests.support.commands import CLONE

PROBLEMS = CLONE / "problems"
ROBOTS = {"l1": "l1_tape", "f1": "f1"}
POSITION = MeasuredSignal("T", "mm")
MEASURED = {
    "l1": Measured({"q": MeasuredSignal("q", "mm"), "T": POSITION}),
    "f1": Measured(
        {"q": MeasuredSignal("q", ["mm"] * 3 + ["deg"] * 3), "T": POSITION, "e": MeasuredSignal("e", "1")},
        orientation="e",
    ),
}
FITS = {
    "l1": {"variant": "modified", "accuracy": 3e-4},
    "f1": {"variant": "f1_unit", "accuracy": 4e-4, "sizes": dict.fromkeys(("A0", "A", "B", "L", "r3"), 0.01)},
}

# of problems/simulate_l1.toml, from which the shipped file is
L1 = Synthetic(
    seed=1, low=[0.4, -1.4, -0.4], high=[2.4, -0.4, 0.9], counts=[12, 5, 7], poses=200, point_error=5e-3,
    scale_error=3e-4, along=[56e-6, 57e-6, 41e-6], across=[143e-6, 37e-6, 101e-6], load=70e-6,
)  # fmt: skip


@cache
def robot(name: str) -> Any:
    """l1 or f1 as known before its calibration."""
    return gt.robots.make(ROBOTS[name])


def path_of(name: str) -> Path:
    return PROBLEMS / "data" / f"{name}_synthetic.csv"


def measured(name: str, *, signals: dict[str, dict[str, Any]] | None = None, **changes: Any) -> Measured:
    """How the shipped file is read, fields of its signals and its own replaced."""
    known = dict(MEASURED[name].signals)
    for signal, fields in (signals or {}).items():
        known[signal] = replace(known[signal], **fields)
    return replace(MEASURED[name], signals=known, **changes)


def fit(name: str, **changes: Any) -> Fit:
    """As of problems/calibrate_NAME.toml, without the sensitivity unless it is asked for."""
    return Fit(**{**FITS[name], "sensitivity_step": 0.0, **changes})


def solved(
    name: str,
    at: Path | MeasuredPoses | None = None,
    *,
    how: Measured | None = None,
    held_out: int | Path = 2,
    **changes: Any,
) -> CalibrationStudy:
    """The study of the shipped robot on a file, its own if left out, or on poses."""
    if isinstance(at, MeasuredPoses):
        poses = at
    else:
        other = held_out if isinstance(held_out, Path) else None
        poses = read_poses(at or path_of(name), how or MEASURED[name], other)
    every = 2 if isinstance(held_out, Path) else held_out
    return study(robot(name), poses, fit(name, **changes), held_out=every)


@cache
def shipped(name: str) -> CalibrationStudy:
    """What the shipped file gives."""
    return solved(name)


def data(name: str) -> tuple[list[str], list[list[str]]]:
    """Comments and header without units, and the rows as cells, of the shipped file."""
    lines = path_of(name).read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    names = ",".join(cell.partition(" ")[0] for cell in lines[len(head)].split(","))
    return [*head, names], [line.split(",") for line in lines[len(head) + 1 :]]


def file_of(path: Path, head: list[str], rows: list[list[str]]) -> Path:
    """A file of these lines."""
    path.write_text("\n".join([*head, *map(",".join, rows)]) + "\n")
    return path


def written(
    folder: Path, name: str, change: Callable[[list[str]], list[str]] = list, rows: slice = slice(None)
) -> Path:
    """poses.csv in the folder: the shipped poses, each row changed, columns without units in the header."""
    head, cells = data(name)
    return file_of(folder / "poses.csv", head, [change(row) for row in cells[rows]])
