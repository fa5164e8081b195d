"""One run of a problem, from the loaded file to the written folder."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from gtmodel.results.trajectory_files import csv_bytes

from . import output
from . import start as earlier
from .base import TRAJECTORY, Context, InputError, Outcome
from .load import Loaded
from .noted import noted
from .verdict import marked, told


@dataclass(frozen=True)
class Finished:
    """An outcome, the wall time [s] that it took, the files written, and what kept others from it, in a sentence."""

    outcome: Outcome
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


def solve(
    loaded: Loaded, context: Context, *, out: Path | None = None, plot: bool = False, write_failed: bool = False
) -> Finished:
    """Solve a problem; write the result where `out` is given. Raises InputError, before the work where it can.

    Files for a machine are written only of a result that may be used, or, marked in their first line, with
    `write_failed`.
    """
    if out is None:
        return Finished(noted(loaded.kind.solve(loaded.problem, context), context), time.monotonic() - context.began)
    with output.held(out, context) as folder:
        outcome = noted(loaded.kind.solve(loaded.problem, context), context)
        wall_s = time.monotonic() - context.began
        outcome = _for_machines(outcome, write_failed)
        try:
            files = output.write(folder, loaded, context, outcome, wall_s=wall_s, plot=plot)
        except output.NotDrawn as error:
            return Finished(outcome, wall_s, error.files, unwritten=str(error))
        except InputError as error:
            # the work is done: a full disk must not cost its result
            files = output.elsewhere(loaded, context, outcome, wall_s=wall_s)
            told = f"; the result was written into {files[0].parent} instead" if files else ""
            return Finished(outcome, wall_s, files, unwritten=f"{error}{told}")
    return Finished(outcome, wall_s, files)


def _for_machines(outcome: Outcome, write_failed: bool) -> Outcome:
    """The outcome with its files for machines left out, or marked, where it must not be relied on."""
    if outcome.status.ok:
        return outcome
    whole = dict(outcome.files)
    if outcome.trajectory is not None and TRAJECTORY in outcome.machine_files:
        whole[TRAJECTORY] = csv_bytes(outcome.trajectory)
    kept = [name for name in outcome.machine_files if name in whole]
    if not kept:
        return outcome
    message = told(outcome)
    files = {name: content for name, content in outcome.files.items() if name not in kept}
    if not write_failed:
        names = " and ".join(sorted(kept)) if len(kept) < 3 else f"{len(kept)} files for machines"
        message += f"; {names} {'is' if len(kept) == 1 else 'are'} not written; --write-failed writes all, marked"
        return replace(outcome, files=files, message=message)
    for name in kept:
        content = whole[name]
        files[name] = marked(name, content.encode() if isinstance(content, str) else content, message)
    return replace(outcome, files=files)


def generate(loaded: Loaded, context: Context, out: Path, *, verify: bool, write_failed: bool = False) -> Finished:
    """Generate the code of a problem of kind codegen; with `verify` and without `write_failed` only code that passed
    all checks is written. Raises InputError for another kind."""
    if loaded.problem.kind != "codegen":
        raise InputError(f"is '{loaded.problem.kind}', which gives no code; use gtmodel solve", "kind")
    from . import codegen

    assert isinstance(loaded.problem, codegen.Schema)
    outcome = codegen.write(loaded.problem, context, out, verify=verify, write_failed=write_failed)
    return Finished(noted(outcome, context), time.monotonic() - context.began)


def explain(loaded: Loaded, context: Context) -> str:
    """What the kind says about a problem; its checked keys where it says nothing."""
    told = getattr(loaded.kind, "explain", None)
    if told is not None:
        return str(told(loaded.problem, context))
    import tomli_w

    return tomli_w.dumps(loaded.problem.model_dump(mode="json", exclude_none=True)).rstrip()
