"""The shipped calibration problems as dictionaries, and measurement files changed by hand."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from gtmodel.kinds import calibration
from gtmodel.problem_files import Context, Outcome
from gtmodel.problem_files.load import validate
from tests.support.commands import CLONE

PROBLEMS = CLONE / "problems"


def keys(name: str, **changes: Any) -> dict[str, Any]:
    """Of problems/NAME.toml, top-level keys replaced."""
    return {**tomllib.loads((PROBLEMS / f"{name}.toml").read_text()), **changes}


def solved(problem: dict[str, Any], folder: Path = PROBLEMS) -> Outcome:
    return calibration.solve(validate(calibration.Schema, problem), Context(folder=folder))


@cache
def shipped(robot: str) -> Outcome:
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
