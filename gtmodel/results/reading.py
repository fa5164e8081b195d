"""Reading a written study: the contents of result.json under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .check import Check
from .disk import path_of
from .quantity import split
from .read_bounds import json_of
from .refusal import ArgumentError
from .status import SolveStatus
from .study import Study
from .trajectory import Trajectory, TrajectoryError


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Stored(Study):
    """A study read from its folder. `values` are as written; each value is also an attribute, under its name with or
    without the unit."""

    stored: Mapping[str, Any] = field(default_factory=dict)

    @property
    def values(self) -> Mapping[str, Any]:
        return self.stored

    @property
    def rows(self) -> list[Any]:
        return []

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_") and name != "stored":
            for key, value in self.stored.items():
                if name in (key, split(key)[0]):
                    return value
        raise AttributeError(f"this study has no '{name}'")


def read(folder: str | Path) -> Stored:
    """Read the study in a folder that `Study.write` or ``--out`` wrote, or in a result.json.

    Status, checks and trajectory are as written, and quantities are attributes again. Raises ArgumentError if it is not
    a result of gtmodel.

    >>> import tempfile
    >>> solved = {"residual": gt.results.at_most(1e-9, 1e-6)}
    >>> study = gt.results.Study(status=gt.SolveStatus.SOLVED, checks=solved)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     written = study.write(place + "/out")
    ...     again = gt.results.read(place + "/out")
    >>> again.status.ok, again.checks["residual"].value
    (True, 1e-09)
    """
    path = path_of(folder, "folder")
    file = path / "result.json" if path.is_dir() else path
    try:
        data = document(file.read_bytes())
        stored = data.get("trajectory")
        trajectory = None if stored is None else Trajectory(stored["time_s"], stored["values"], stored["units"])
        return Stored(
            status=SolveStatus(data["status"]),
            message=_kind(data["message"], str),
            objective=_number(data["objective"]),
            iterations=_number(data["iterations"], int),
            checks={name: _check(c) for name, c in data["checks"].items()},
            trajectory=trajectory,
            notes=[_kind(note, str) for note in _kind(data["values"].get("notes", []), list)],
            stored=data["values"],
        )
    except OSError as error:
        raise ArgumentError(f"{file} cannot be read: {error.strerror}", "folder") from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, TrajectoryError) as error:
        why = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise ArgumentError(
            f"{file} is not a result.json of gtmodel: {why}; expected a file that `gtmodel solve --out` wrote", "folder"
        ) from error


def document(content: bytes) -> Mapping[str, Any]:
    """Parse a JSON object. Raises TypeError or ValueError for anything else, and if it is nested too deep."""
    return _kind(json_of(content), dict)


def _check(data: Mapping[str, Any]) -> Check:
    value = _number(data["value"])
    return Check(float("nan") if value is None else value, _number(data["bound"]), judged=_kind(data["passed"], bool))


def _kind(value: Any, kind: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError(f"expected {kind.__name__}; found {type(value).__name__}")
    return value


def _number(value: Any, kind: Any = (int, float)) -> Any:
    """A number or None; refuse a text, a Boolean or a number too large for a double."""
    if isinstance(value, bool):
        raise TypeError("expected a number; found a Boolean")
    if value is not None:
        float(_kind(value, kind))
    return value
