"""One run of a problem, from the loaded file to the written folder."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gtmodel.results import ArgumentError, SolveStatus, Study
from gtmodel.results.work import Interrupted
from gtmodel.results.written import for_machines

from . import output, start as earlier
from .arguments import key_of
from .base import Context, Generating, InputError
from .call import Call
from .load import Loaded, load
from .noted import noted

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
    """What a library refuses, as an InputError at the key of the file."""
    try:
        yield
    except ArgumentError as error:
        renamed = getattr(loaded.kind, "ARGUMENTS", {})
        if of_problem := getattr(loaded.kind, "arguments", None):
            renamed = of_problem(loaded.problem)
        raise InputError(error.message, key_of(loaded.kind.Schema, error.argument, renamed)) from error


def solve(
    loaded: Loaded, context: Context, *, out: Path | None = None, plot: bool = False, write_failed: bool = False
) -> Finished:
    """Solve a problem; write the result where `out` is given. Raises InputError, before the work where it can.

    Files for a machine are written only of a result that may be used, or, marked in their first line, with
    `write_failed`.
    """
    if out is None:
        return Finished(noted(answer(loaded, context), context), time.monotonic() - context.began)
    with output.held(out, context) as folder:
        outcome = noted(answer(loaded, context), context)
        wall_s = time.monotonic() - context.began
        outcome = for_machines(outcome, _FAILED if write_failed else "", _FAILED)
        try:
            files = output.write(folder, loaded, context, outcome, wall_s=wall_s, plot=plot)
        except output.NotDrawn as error:
            return Finished(outcome, wall_s, error.files, unwritten=str(error))
        except InputError as error:
            # the work is done: a full disk must not cost its result
            files = output.elsewhere(loaded, context, outcome, wall_s=wall_s)
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
