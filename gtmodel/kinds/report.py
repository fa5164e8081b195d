"""An outcome as JSON data: what ``--json`` prints and ``result.json`` holds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gtmodel.results import SolveStatus, Study, Trajectory


def summary(problem: str, kind: str | None, outcome: Study, wall_s: float) -> dict[str, Any]:
    """The object that ``--json`` prints: the keys of the contract, in its order."""
    return {**_facts(problem, kind, outcome), "wall_s": round(wall_s, 3), **_numbers(outcome)}


def result(problem: str, kind: str, outcome: Study) -> bytes:
    """``result.json``: the same bytes for the same input, and all that a later solve needs to start from it."""
    trajectory = outcome.trajectory
    stored = {"trajectory": _series(trajectory)} if trajectory is not None else {}
    data = {**_facts(problem, kind, outcome), **_numbers(outcome), **stored}
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def refused(problem: str, kind: str | None, sentence: str, status: SolveStatus, wall_s: float) -> dict[str, Any]:
    """What ``--json`` prints for a run that never came to an outcome."""
    return summary(problem, kind, Study(status=status, message=sentence), wall_s)


def line(data: Mapping[str, Any]) -> str:
    """One JSON object on one line."""
    return json.dumps(plain(data), ensure_ascii=False, allow_nan=False)


def _facts(problem: str, kind: str | None, outcome: Study) -> dict[str, Any]:
    return {
        "problem": problem,
        "kind": kind,
        "status": outcome.status.value,
        "message": outcome.message or outcome.status.sentence,
        "objective": plain(outcome.objective),
        "iterations": plain(outcome.iterations),
    }


def _numbers(outcome: Study) -> dict[str, Any]:
    checks = {
        name: {"value": plain(c.value), "bound": plain(c.bound), "passed": bool(c.passed)}
        for name, c in outcome.checks.items()
    }
    return {"checks": checks, "values": plain(outcome.values)}


def _series(trajectory: Trajectory) -> dict[str, Any]:
    return {
        "time_s": plain(trajectory.time),
        "units": trajectory.units,
        "values": {name: plain(trajectory[name]) for name in trajectory.names},
    }


def plain(value: Any) -> Any:
    """A value as JSON data: arrays become lists, a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
