"""An earlier ``result.json`` to start a solve from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gtmodel.results import Trajectory, TrajectoryError
from gtmodel.results.reading import document

from .base import InputError


def read(path: Path, kind: str) -> Mapping[str, Any]:
    """Return the data of a result.json, or of the result.json in a folder. Raises InputError for any other file."""
    file = path / "result.json" if path.is_dir() else path
    if not file.is_file():
        raise InputError(f"--start {path}: there is no such file; name the result.json of an earlier --out")
    try:
        data = document(file.read_bytes())
        stored_kind = data["kind"]
    except OSError as error:
        raise InputError(f"--start {path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--start {path} is not a result.json of gtmodel") from None
    if stored_kind != kind:
        raise InputError(f"--start {path} is a result of kind '{stored_kind}'; this problem is of kind '{kind}'")
    stored = data.get("trajectory")
    try:
        if stored is not None:
            Trajectory(stored["time_s"], stored["values"], stored["units"])
    except (TrajectoryError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"--start {path}: its trajectory cannot be read: {error}") from None
    return data
