"""``gtmodel inspect``: from a log file to the study and its folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from gtmodel.measurements import LogForm, inspect
from gtmodel.measurements.streams.form import shown
from gtmodel.problem_files import run as output
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.run import Finished
from gtmodel.results import ArgumentError, as_json, written
from gtmodel.results.written import pictured, record

KIND = "inspect"


def run(file: str, asked: dict[str, Any], job: Context, *, out: Path | None = None, plot: bool = False) -> Finished:
    """`gtmodel.measurements.inspect` of a file, written into `out` where it is given.

    Args:
        asked: fields of `LogForm` that the command gives.

    Raises InputError, one sentence.
    """
    path = Path(file)
    if not path.exists():
        raise InputError(f"there is no file '{file}'")
    try:
        form = LogForm(**asked)
    except ArgumentError as error:
        raise InputError(f"--{error.argument.replace('_', '-')} {error.message}") from error
    if out is None:
        return _inspected(path, form, job)
    with output.held(out, job) as mine:
        done = _inspected(path, form, job)
        files = written.files_of(done.outcome, as_json.result(path.name, KIND, done.outcome))
        faults = pictured(done.outcome, files) if plot else []
        inputs = {"log": str(path), **asked}
        try:
            with output.said_of_out():
                paths = written.put(mine, files, lambda files: record(inputs, done.wall_s, files))
        except InputError as error:
            return Finished(done.outcome, done.wall_s, unwritten=str(error))
        return Finished(done.outcome, done.wall_s, paths, unwritten="; ".join(faults))


def _inspected(path: Path, form: LogForm, job: Context) -> Finished:
    try:
        with job.under_way():
            outcome = inspect(path, form, **job.work())
    except ArgumentError as error:
        # the command names the file itself
        said = error.message.removeprefix(shown(path))
        raise InputError(said.lstrip(": ") or error.message) from error
    return Finished(outcome, time.monotonic() - job.began)
