"""The folder of a result. What gtmodel wrote it may replace; what a person wrote or changed it never touches."""

from __future__ import annotations

import hashlib
import io
import os
import platform
import tempfile
import tomllib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tomli_w

from . import report
from .base import Context, InputError, Outcome
from .load import Loaded

RUN = "run.toml"
_OURS = "gtmodel"
_PACKAGES = ("casadi", "numpy", "scipy", "pydantic")
_DPI = 150


def refuse_foreign(folder: Path) -> None:
    """Raises InputError unless the folder is new, empty, or holds an earlier result just as it was written."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"--out {folder} is a file; name a folder")
    if not any(folder.iterdir()):
        return
    written = _written(folder)
    if written is None:
        raise InputError(f"--out {folder} holds files that gtmodel did not write; name a new folder or empty this one")
    for name, digest in written.items():
        path = folder / name
        if path.is_file() and _sha256(path.read_bytes()) != digest:
            raise InputError(f"{path} was changed after gtmodel wrote it; move it away or name another folder")


def _written(folder: Path) -> dict[str, str] | None:
    """File names and hashes of an earlier result; None when there is none in the folder."""
    try:
        run = tomllib.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return None
    files = run.get("files")
    if run.get("program") != _OURS or not isinstance(files, dict):
        return None
    return {name: str(digest) for name, digest in files.items() if name == Path(name).name}


def write(folder: Path, loaded: Loaded, context: Context, outcome: Outcome, *, wall_s: float, plot: bool) -> list[Path]:
    """Write an outcome with its run.toml; returns the files written.

    result.json, trajectory.csv where there is a trajectory, the kind's own files, pictures when `plot` is
    set, and run.toml. Files of an earlier result in the folder are replaced or removed.

    Raises InputError as `refuse_foreign` does, or where the folder cannot be written.
    """
    files = {"result.json": report.result(loaded.name, loaded.problem.kind, outcome)}
    if outcome.trajectory is not None:
        files["trajectory.csv"] = _csv(outcome)
    for name, content in outcome.files.items():
        files[name] = content.encode() if isinstance(content, str) else content
    if plot:
        for name, draw in outcome.figures.items():
            files[name if name.endswith(".png") else f"{name}.png"] = png(draw)
    refuse_foreign(folder)
    earlier = (_written(folder) or {}) if folder.is_dir() else {}
    for name in files:
        if name not in earlier and (folder / name).exists():
            raise InputError(f"{folder / name} was not written by gtmodel; move it away or name another folder")
    run = _run(loaded, context, wall_s, files)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in earlier:
            (folder / name).unlink(missing_ok=True)
        # first, so that after a crash the folder is known as ours
        (folder / RUN).write_bytes(run)
        for name, content in files.items():
            (folder / name).write_bytes(content)
    except OSError as error:
        raise InputError(f"--out {folder} cannot be written: {error.strerror}") from error
    return [folder / name for name in [*files, RUN]]


def _run(loaded: Loaded, context: Context, wall_s: float, files: Mapping[str, bytes]) -> bytes:
    inputs: dict[str, Any] = {"problem": str(loaded.path), "problem_sha256": _sha256(loaded.content)}
    if loaded.settings:
        inputs["set"] = list(loaded.settings)
    if context.max_seconds is not None:
        inputs["max_seconds"] = context.max_seconds
    for name, path in context.inputs.items():
        inputs[name] = str(path)
        inputs[f"{name}_sha256"] = _sha256(path.read_bytes()) if path.is_file() else ""
    run = {
        "program": _OURS,
        "wall_s": wall_s,
        "input": inputs,
        "versions": versions(),
        "files": {name: _sha256(content) for name, content in files.items()},
        "problem": loaded.problem.model_dump(mode="json", exclude_none=True),
    }
    note = "# How this folder was made. gtmodel replaces the files listed here, as long as nobody changed them.\n"
    return (note + tomli_w.dumps(run)).encode()


def versions() -> dict[str, str]:
    """Versions of gtmodel, of Python and of the packages that numbers depend on."""
    from gtmodel import __version__

    found = {_OURS: __version__, "python": platform.python_version(), "platform": platform.platform()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not found"
    return found


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _csv(outcome: Outcome) -> bytes:
    assert outcome.trajectory is not None
    with tempfile.TemporaryDirectory() as scratch:
        path = os.path.join(scratch, "trajectory.csv")
        outcome.trajectory.to_csv(path)
        return Path(path).read_bytes()


def png(draw: Any) -> bytes:
    """A picture as a file, the same bytes for the same picture."""
    buffer = io.BytesIO()
    # matplotlib's own version stays out of the file: same input, same bytes
    draw().savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return buffer.getvalue()
