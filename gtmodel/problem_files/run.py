"""Run of a problem, from the loaded file to the written folder of its result."""

from __future__ import annotations

import json
import math
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from gtmodel.results import ArgumentError, SolveStatus, Study, written
from gtmodel.results.as_json import result
from gtmodel.results.folder import Held
from gtmodel.results.work import Interrupted
from gtmodel.results.written import for_machines, pictured, record, scenes_of, sha256, sha256_of_file

from .base import Call, Context, Generating, InputError, earlier_result
from .from_options import key_of
from .load import Loaded, dotted, load
from .noted import noted
from .python_models import describe


class NotDrawn(InputError):
    """A picture could not be drawn; `files` are the files that were written nevertheless."""

    def __init__(self, sentence: str, files: list[Path]) -> None:
        super().__init__(sentence)
        self.files = files


@contextmanager
def about_out() -> Iterator[None]:
    """Turn errors about the folder into InputError about --out."""
    try:
        yield
    except ArgumentError as error:
        raise InputError(f"--out {error.message}" if error.argument == "folder" else str(error)) from error


@contextmanager
def held(folder: Path, context: Context) -> Iterator[Held]:
    """Lock the folder for this run, before the work; see `results.written.held`. Raises InputError."""
    with about_out(), written.held(folder, context.notice) as target:
        yield target


def write(
    folder: Path | Held, loaded: Loaded, context: Context, outcome: Study, *, wall_s: float, plot: bool,
    report: bool = False,
) -> list[Path]:  # fmt: skip
    """Write a study with its run.toml, all files or none, and return their paths.

    The files are result.json, trajectory.csv if there is one (marked if it must not be used), the study's own files,
    pictures and scenes with `plot`, report.html with `report`, and run.toml. They replace those of an earlier result.

    Raises InputError if the folder belongs to something else or cannot be written; NotDrawn if only a picture failed.
    """
    if isinstance(folder, Path):
        with held(folder, context) as target:
            return write(target, loaded, context, outcome, wall_s=wall_s, plot=plot, report=report)
    files = written.files_of(outcome, result(loaded.name, loaded.problem.kind, outcome))
    if "flat" in context.inputs:  # the output of another flattener: errors name its lines
        files["flat.mo"] = context.inputs["flat"].read_bytes()
    faults = pictured(outcome, files) if plot else []
    faults += written.reported(outcome, files) if report else []
    with about_out():
        paths = written.put(folder, files, lambda files: _run(loaded, context, wall_s, outcome, files))
    if faults:
        raise NotDrawn(faults[0], paths)
    return paths


def in_folder(loaded: Loaded, context: Context, outcome: Study, *, wall_s: float) -> list[Path]:
    """Write an outcome without pictures into a new temporary folder; return no files if that fails."""
    try:
        place = Path(tempfile.mkdtemp(prefix=f"{loaded.path.stem}-"))
    except OSError:
        return []
    try:
        return write(place, loaded, context, outcome, wall_s=wall_s, plot=False)
    except InputError:
        place.rmdir()
        return []


def _run(loaded: Loaded, context: Context, wall_s: float, study: Study, files: Mapping[str, bytes]) -> bytes:
    inputs: dict[str, Any] = {"problem": str(loaded.path), "problemsha256": sha256(loaded.content)}
    if loaded.settings:
        inputs["set"] = list(loaded.settings)
    if context.max_seconds is not None:
        inputs["max_seconds"] = context.max_seconds
    for name, path in context.inputs.items():
        inputs |= {name: str(path), f"{name}sha256": sha256_of_file(path)}
    asked = {"scenes": scenes_of(study), "problem": loaded.problem.model_dump(mode="json", exclude_none=True)}
    return record(inputs, wall_s, files, asked)


@dataclass(frozen=True)
class Finished:
    """An outcome, its wall time [s], the files written, and a sentence why other files were not written."""

    outcome: Study
    wall_s: float
    files: list[Path] = field(default_factory=list)
    unwritten: str = ""


def context_of(loaded: Loaded, *, max_seconds: float | None = None, start: Path | None = None) -> Context:
    """Return a context for a loaded problem, with a time limit [s] and an earlier result to start from.

    Raises InputError for a limit that is not positive and for a start that is not a result of this kind.
    """
    if max_seconds is not None and not 0 < max_seconds < math.inf:
        raise InputError(f"--max-seconds {max_seconds:g}: expected a positive time in s")
    context = Context(name=loaded.path.stem, folder=loaded.path.parent, max_seconds=max_seconds)
    if start is not None:
        context.start = earlier_result(start, loaded.problem.kind)
        context.inputs["start"] = start / "result.json" if start.is_dir() else start
    return context


def answer(loaded: Loaded, context: Context) -> Study:
    """Run the study and return its result. Raises InputError, with the key of an argument that the library refuses."""
    if isinstance(loaded.kind, Generating):
        raise InputError("generates code and solves nothing; use gtmodel codegen PROBLEM.toml -o DIR", "kind")
    with keyed(loaded), context.under_way():
        try:
            return loaded.kind.call(loaded.problem, context)(**context.work())
        except Interrupted as stopped:  # outside the study: while its arguments or its report were computed
            return Study(status=SolveStatus.INTERRUPTED, message=str(stopped))


def call_of(path: str | Path, settings: Iterable[str] = ()) -> Call:
    """Return the call that a problem file describes; its study has the notes too. Raises InputError."""
    loaded = load(path, settings)
    context = context_of(loaded)
    with keyed(loaded):
        call = loaded.kind.call(loaded.problem, context)
    finish = call.finish
    call.rows_of = partial(rows_of, loaded, call, (*call.arguments, *call.options.values()))
    about = partial(about_problem, loaded, context)
    return call.then(lambda study: noted(study if finish is None else finish(study), context).with_(about=about))


def about_problem(loaded: Loaded, context: Context, options: Sequence[str] = ()) -> Any:
    """Return what a report says about a problem; see `_report.asked`."""
    return import_module("gtmodel._report").asked(loaded, context, options)  # by name: for a report alone


@contextmanager
def keyed(loaded: Loaded) -> Iterator[None]:
    """Turn errors about arguments into InputError with the key and line of the file."""
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


def rows_of(loaded: Loaded, call: Call, given: tuple[Any, ...]) -> ProblemRows:
    """Return the problem for a sweep. Raises InputError if the call's arguments, first `given`, were changed."""
    now = (*call.arguments, *call.options.values())
    if len(now) != len(given) or any(a is not b for a, b in zip(now, given, strict=True)):
        raise InputError("its arguments were changed after gt.load; a sweep reads the file: set its keys in gt.load")
    return ProblemRows(str(loaded.path.absolute()), loaded.settings, sha256(loaded.content))


@dataclass(frozen=True)
class ProblemRows:
    """A problem to be run for rows of keys, in any process that sees its file: path, settings and hash of the file."""

    path: str
    settings: tuple[str, ...]
    content: str

    @property
    def identity(self) -> str:
        """All that a result depends on, besides the keys of a row and the files that it reads."""
        return json.dumps([self.content, self.settings])

    def settings_of(self, keys: Mapping[str, Any]) -> tuple[str, ...]:
        """Return the settings of a row."""
        return (*self.settings, *(f"{key}={json.dumps(value)}" for key, value in keys.items()))

    def run(self, keys: Mapping[str, Any], folder: Path | None) -> tuple[Study, Mapping[str, Path]]:
        """Solve with these keys, write into a folder if there is one; return the result and the files that were read.
        A problem that is refused is a result with the status BAD_INPUT."""
        name = Path(self.path).name
        try:
            loaded = load(self.path, self.settings_of(keys))
            if sha256(loaded.content) != self.content:
                raise InputError("was changed after the sweep began; start the sweep again", file=name)
            context = context_of(loaded)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # those that matter show in the status
                return solve(loaded, context, out=folder).outcome, context.inputs
        except Exception as error:
            status, sentence = describe(error)
            if status is not SolveStatus.BAD_INPUT:
                raise
            return Study(status=status, message=sentence.replace(self.path, name)), {}


def solve(
    loaded: Loaded, context: Context, *, out: Path | None = None, plot: bool = False, write_failed: bool = False,
    about: Callable[[], Any] | None = None,
) -> Finished:  # fmt: skip
    """Solve a problem and write the result into `out`, if there is one. Raises InputError, if possible before the work.

    Files for a machine are written only if the result may be used, or with `write_failed`, marked in their first line.
    about: for report.html, see `Study.about`.
    """
    if out is None:
        return Finished(noted(answer(loaded, context), context), time.monotonic() - context.began)
    with held(out, context) as folder:
        outcome = noted(answer(loaded, context), context).with_(about=about)
        wall_s = time.monotonic() - context.began
        outcome = for_machines(outcome, "--write-failed" if write_failed else "", "--write-failed")
        try:
            files = write(folder, loaded, context, outcome, wall_s=wall_s, plot=plot, report=about is not None)
        except NotDrawn as error:
            return Finished(outcome, wall_s, error.files, unwritten=str(error))
        except InputError as error:
            # a full disk must not lose the result
            files = in_folder(loaded, context, outcome, wall_s=wall_s)
            elsewhere = f"; the result was written into {files[0].parent} instead" if files else ""
            return Finished(outcome, wall_s, files, unwritten=f"{error}{elsewhere}")
    return Finished(outcome, wall_s, files)


def generate(
    loaded: Loaded, context: Context, out: Path, *, verify: bool, write_failed: bool = False, fmu: str | None = None,
    costs: bool = False, certify: bool = False,
) -> Finished:  # fmt: skip
    """Generate the code of a problem. With `verify` and without `write_failed`, write it only if it passed all checks.

    fmu: write units of that version instead. costs: with `verify`, measure the code. certify: prove it too. Raises
    InputError for other kinds.
    """
    if not isinstance(loaded.kind, Generating):
        raise InputError(f"is '{loaded.problem.kind}', which generates no code; use gtmodel solve", "kind")
    with keyed(loaded), context.under_way():
        try:
            how = {"verify": verify, "write_failed": write_failed, "fmu": fmu, "costs": costs, "certify": certify}
            outcome = loaded.kind.write(loaded.problem, context, out, **how)
        except Interrupted as stopped:
            outcome = Study(status=SolveStatus.INTERRUPTED, message=str(stopped))
    return Finished(noted(outcome, context), time.monotonic() - context.began)


def explain(loaded: Loaded, context: Context) -> str:
    """Return the kind's explanation of a problem; its title and one key per line if the kind has none."""
    explanation = getattr(loaded.kind, "explain", None)
    if explanation is not None:
        with keyed(loaded):
            return str(explanation(loaded.problem, context))
    keys = loaded.problem.model_dump(mode="json", exclude_none=True, exclude={"kind", "title"})
    return "\n".join([loaded.problem.heading, *(f"  {key} = {value}" for key, value in leaves(keys))])


def leaves(value: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str, str]]:
    """Yield dotted keys with their values as JSON; nothing for an empty table."""
    if isinstance(value, list) and any(isinstance(entry, Mapping) for entry in value):
        value = dict(enumerate(value))
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from leaves(inner, (*place, name))
    else:
        yield dotted(place), json.dumps(value, ensure_ascii=False)
