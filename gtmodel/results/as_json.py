"""A study as JSON data, for ``--json`` and ``result.json``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .study import Study
    from .trajectory import Trajectory


def summary(problem: str, kind: str | None, study: Study, wall_s: float) -> dict[str, Any]:
    """Return the object that ``--json`` prints, with the documented keys in their order."""
    return {**_facts(problem, kind, study), "wall_s": round(wall_s, 3), **_numbers(study)}


def result(problem: str, kind: str | None, study: Study) -> bytes:
    """Return ``result.json``: identical for identical input, and sufficient to start a later solve."""
    trajectory = study.trajectory
    stored = {"trajectory": _series(trajectory)} if trajectory is not None else {}
    data = {**_facts(problem, kind, study), **_numbers(study), **stored}
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def line(data: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """Return a JSON object on one line; `ascii_only` escapes other characters, as "\\u00b0"."""
    return json.dumps(plain(data), ensure_ascii=ascii_only, allow_nan=False)


def _facts(problem: str, kind: str | None, study: Study) -> dict[str, Any]:
    return {
        "problem": problem,
        "kind": kind,
        "status": study.status.value,
        "message": study.message,
        "objective": plain(study.objective),
        "iterations": plain(study.iterations),
    }


def _numbers(study: Study) -> dict[str, Any]:
    checks = {
        name: {"value": plain(c.value), "bound": plain(c.bound), "passed": bool(c.passed)}
        for name, c in study.checks.items()
    }
    return {"checks": checks, "values": plain(study.values)}


def _series(trajectory: Trajectory) -> dict[str, Any]:
    return {
        "time_s": plain(trajectory.time),
        "units": trajectory.units,
        "values": {name: plain(trajectory[name]) for name in trajectory.names},
    }


def plain(value: Any) -> Any:
    """Return a value as JSON data: arrays become lists, infinite numbers and NaN become null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    np = sys.modules.get("numpy")  # without NumPy there are no NumPy values
    if np is not None and isinstance(value, np.ndarray):
        clean = value.dtype.kind == "f" and bool(np.isfinite(value).all())
        return value.tolist() if clean else plain(value.tolist())
    if np is not None and isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
