"""The folder of a result: what a problem was, beside the study itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gtmodel.results import ArgumentError, Study, written
from gtmodel.results.as_json import result
from gtmodel.results.folder import Held
from gtmodel.results.written import pictured, record, sha256, sha256_of_file

from .base import Context, InputError
from .load import Loaded


class NotDrawn(InputError):
    """A picture could not be drawn; `files` are those written all the same."""

    def __init__(self, sentence: str, files: list[Path]) -> None:
        super().__init__(sentence)
        self.files = files


@contextmanager
def said_of_out() -> Iterator[None]:
    """What is wrong with the folder, as an InputError about --out."""
    try:
        yield
    except ArgumentError as error:
        raise InputError(f"--out {error.message}" if error.argument == "folder" else str(error)) from error


@contextmanager
def held(folder: Path, context: Context) -> Iterator[Held]:
    """The folder for this run alone, tried before the work; see `results.written.held`. Raises InputError."""
    with said_of_out(), written.held(folder, context.notice) as mine:
        yield mine


def write(
    folder: Path | Held, loaded: Loaded, context: Context, outcome: Study, *, wall_s: float, plot: bool
) -> list[Path]:
    """Write a study with its run.toml, all files or none; returns the files written.

    result.json, trajectory.csv where there is a trajectory (marked where it must not be relied on), the study's own
    files, pictures when `plot` is set, and run.toml. Files of an earlier result in the folder are replaced or removed.

    Raises InputError where the folder is foreign or cannot be written; NotDrawn when all is written but a picture.
    """
    if isinstance(folder, Path):
        with held(folder, context) as mine:
            return write(mine, loaded, context, outcome, wall_s=wall_s, plot=plot)
    files = written.files_of(outcome, result(loaded.name, loaded.problem.kind, outcome))
    if "flat" in context.inputs:  # what another flattener made of a Modelica text: errors name its lines
        files["flat.mo"] = context.inputs["flat"].read_bytes()
    faults = pictured(outcome, files) if plot else []
    with said_of_out():
        paths = written.put(folder, files, lambda files: _run(loaded, context, wall_s, files))
    if faults:
        raise NotDrawn(faults[0], paths)
    return paths


def elsewhere(loaded: Loaded, context: Context, outcome: Study, *, wall_s: float) -> list[Path]:
    """Write an outcome, without pictures, into a new folder among the temporary ones; no files where that fails."""
    try:
        place = Path(tempfile.mkdtemp(prefix=f"{loaded.path.stem}-"))
    except OSError:
        return []
    try:
        return write(place, loaded, context, outcome, wall_s=wall_s, plot=False)
    except InputError:
        place.rmdir()
        return []


def _run(loaded: Loaded, context: Context, wall_s: float, files: Mapping[str, bytes]) -> bytes:
    inputs: dict[str, Any] = {"problem": str(loaded.path), "problemsha256": sha256(loaded.content)}
    if loaded.settings:
        inputs["set"] = list(loaded.settings)
    if context.max_seconds is not None:
        inputs["max_seconds"] = context.max_seconds
    for name, path in context.inputs.items():
        inputs[name] = str(path)
        inputs[f"{name}sha256"] = sha256_of_file(path)
    return record(inputs, wall_s, files, {"problem": loaded.problem.model_dump(mode="json", exclude_none=True)})
