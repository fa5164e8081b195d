"""The shipped calibration problems as dictionaries, and measurement files changed by hand."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from gtmodel.calibrate import CalibrationStudy
from gtmodel.kinds.calibration import kind
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import Loaded, validate
from gtmodel.problem_files.run import answer
from tests.support.commands import CLONE

PROBLEMS = CLONE / "problems"


def keys(name: str, **changes: Any) -> dict[str, Any]:
    """Of problems/NAME.toml, top-level keys replaced."""
    return {**tomllib.loads((PROBLEMS / f"{name}.toml").read_text()), **changes}


def solved(problem: dict[str, Any], folder: Path = PROBLEMS) -> CalibrationStudy:
    loaded = Loaded(folder / "problem.toml", b"", (), kind, validate(kind.Schema, problem), False)  # type: ignore[arg-type]
    return answer(loaded, Context(folder=folder))  # type: ignore[return-value]


@cache
def shipped(robot: str) -> CalibrationStudy:
    """The outcome of problems/calibrate_ROBOT.toml."""
    return solved(keys(f"calibrate_{robot}"))


def with_signals(problem: dict[str, Any], file: str = "poses.csv", **signals: dict[str, Any]) -> dict[str, Any]:
    """The problem with keys of its signals replaced, reading `file`."""
    changed = copy.deepcopy(problem)
    changed["measurements"]["file"] = file
    for name, replaced in signals.items():
        changed["measurements"]["signals"][name].update(replaced)
    return changed


def data(robot: str) -> tuple[list[str], list[list[str]]]:
    """Comments and header without units, and the rows as cells, of the shipped file."""
    lines = (PROBLEMS / "data" / f"{robot}_synthetic.csv").read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    names = ",".join(cell.partition(" ")[0] for cell in lines[len(head)].split(","))
    return [*head, names], [line.split(",") for line in lines[len(head) + 1 :]]


def written(
    folder: Path, robot: str, change: Callable[[list[str]], list[str]] = list, rows: slice = slice(None)
) -> Path:
    """poses.csv in the folder: the shipped poses, each row changed, columns without units in the header."""
    head, cells = data(robot)
    path = folder / "poses.csv"
    path.write_text("\n".join([*head, *(",".join(change(row)) for row in cells[rows])]) + "\n")
    return path
