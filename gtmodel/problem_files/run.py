"""One run of a problem, from the loaded file to the written folder of its result."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gtmodel.results import ArgumentError, SolveStatus, Study, written
from gtmodel.results.as_json import result
from gtmodel.results.folder import Held
from gtmodel.results.work import Interrupted
from gtmodel.results.written import for_machines, pictured, record, sha256, sha256_of_file

from . import start as earlier
from .base import Call, Context, Generating, InputError
from .from_options import key_of
from .load import Loaded, load
from .noted import noted


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


def in_folder(loaded: Loaded, context: Context, outcome: Study, *, wall_s: float) -> list[Path]:
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


_FAILED = "--write-failed"


@dataclass(frozen=True)
class Finished:
    """An outcome, the wall time [s] that it took, the files written, and what kept others from it, in a sentence."""

    outcome: Study
    wall_s: float
    files: list[Path] = field(default_factory=list)
    unwritten: str = ""


def context_of(loaded: Loaded, *, max_seconds: float | None = None, start: Path | None = None) -> Context:
    """A context for a loaded problem, with a time limit [s] and an earlier result to start from.

    Raises InputError for a limit that is not positive and for a start that is no result of this kind.
    """
    if max_seconds is not None and not 0 < max_seconds < math.inf:
        raise InputError(f"--max-seconds {max_seconds:g}: expected a positive time in s")
    context = Context(name=loaded.path.stem, folder=loaded.path.parent, max_seconds=max_seconds)
    if start is not None:
        context.start = earlier.read(start, loaded.problem.kind)
        context.inputs["start"] = start / "result.json" if start.is_dir() else start
    return context


def answer(loaded: Loaded, context: Context) -> Study:
    """What the kind gives back. Raises InputError, for an argument that a library refuses at its key."""
    if isinstance(loaded.kind, Generating):
        raise InputError("generates code and solves nothing; use gtmodel codegen PROBLEM.toml -o DIR", "kind")
    with keyed(loaded), context.under_way():
        try:
            return loaded.kind.call(loaded.problem, context)(**context.work())
        except Interrupted as stopped:  # outside of the study: while its arguments were made, or its page
            return Study(status=SolveStatus.INTERRUPTED, message=str(stopped))


def call_of(path: str | Path, settings: Iterable[str] = ()) -> Call:
    """The call that a problem file means. Raises InputError."""
    loaded = load(path, settings)
    with keyed(loaded):
        return loaded.kind.call(loaded.problem, context_of(loaded))


@contextmanager
def keyed(loaded: Loaded) -> Iterator[None]:
    """What a library refuses, as an InputError at the key and line of the file."""
    try:
        yield
    except InputError as error:
        raise loaded.placed(error) from error.__cause__
    except ArgumentError as error:
        renamed = getattr(loaded.kind, "ARGUMENTS", {})
        if of_problem := getattr(loaded.kind, "arguments", None):
            renamed = of_problem(loaded.problem)
        key = key_of(loaded.kind.Schema, error.argument, renamed)
        raise loaded.placed(InputError(error.message, key)) from error


def solve(
    loaded: Loaded, context: Context, *, out: Path | None = None, plot: bool = False, write_failed: bool = False
) -> Finished:
    """Solve a problem; write the result where `out` is given. Raises InputError, before the work where it can.

    Files for a machine are written only of a result that may be used, or, marked in their first line, with
    `write_failed`.
    """
    if out is None:
        return Finished(noted(answer(loaded, context), context), time.monotonic() - context.began)
    with held(out, context) as folder:
        outcome = noted(answer(loaded, context), context)
        wall_s = time.monotonic() - context.began
        outcome = for_machines(outcome, _FAILED if write_failed else "", _FAILED)
        try:
            files = write(folder, loaded, context, outcome, wall_s=wall_s, plot=plot)
        except NotDrawn as error:
            return Finished(outcome, wall_s, error.files, unwritten=str(error))
        except InputError as error:
            # the work is done: a full disk must not cost its result
            files = in_folder(loaded, context, outcome, wall_s=wall_s)
            elsewhere = f"; the result was written into {files[0].parent} instead" if files else ""
            return Finished(outcome, wall_s, files, unwritten=f"{error}{elsewhere}")
    return Finished(outcome, wall_s, files)


def generate(
    loaded: Loaded, context: Context, out: Path, *, verify: bool, write_failed: bool = False, fmu: str | None = None
) -> Finished:
    """Generate the code of a problem of a kind that gives some; with `verify` and without `write_failed` only code that
    passed all checks is written; `fmu`: units of that version instead. Raises InputError for another kind."""
    if not isinstance(loaded.kind, Generating):
        raise InputError(f"is '{loaded.problem.kind}', which gives no code; use gtmodel solve", "kind")
    with keyed(loaded), context.under_way():
        try:
            outcome = loaded.kind.write(loaded.problem, context, out, verify=verify, write_failed=write_failed, fmu=fmu)
        except Interrupted as stopped:
            outcome = Study(status=SolveStatus.INTERRUPTED, message=str(stopped))
    return Finished(noted(outcome, context), time.monotonic() - context.began)


def explain(loaded: Loaded, context: Context) -> str:
    """What the kind says about a problem; its checked keys where it says nothing."""
    own = getattr(loaded.kind, "explain", None)
    if own is not None:
        with keyed(loaded):
            return str(own(loaded.problem, context))
    import tomli_w

    return tomli_w.dumps(loaded.problem.model_dump(mode="json", exclude_none=True)).rstrip()
