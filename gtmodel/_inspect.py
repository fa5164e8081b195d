"""``gtmodel inspect``: inspect a log file and write the result."""

from __future__ import annotations

import re
import time
from dataclasses import fields as fields_of
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
_KEY = re.compile(  # in the sentences of the readers; here it is an option
    rf'\b(?P<set>set )?(?P<key>{"|".join(field.name for field in fields_of(LogForm))}) = "?(?P<value>[\w.+-]+)"?'
)


def run(file: str, fields: dict[str, Any], job: Context, *, out: Path | None = None, plot: bool = False) -> Finished:
    """Run `gtmodel.measurements.inspect` on a file and write the result into `out`, if there is one.

    Args:
        fields: fields of `LogForm` that the command line sets.

    Raises InputError with one sentence.
    """
    path = Path(file)
    if not path.exists():
        raise InputError(f"there is no file '{file}'")
    try:
        form = LogForm(**fields)
    except ArgumentError as error:
        raise InputError(f"--{error.argument.replace('_', '-')} {error.message}") from error
    if out is None:
        return _inspected(path, form, job)
    with output.held(out, job) as folder:
        finished = _inspected(path, form, job)
        files = written.files_of(finished.outcome, as_json.result(path.name, KIND, finished.outcome))
        faults = pictured(finished.outcome, files) if plot else []
        inputs = {"log": str(path), **fields}
        try:
            with output.about_out():
                paths = written.put(folder, files, lambda files: record(inputs, finished.wall_s, files))
        except InputError as error:
            return Finished(finished.outcome, finished.wall_s, unwritten=str(error))
        return Finished(finished.outcome, finished.wall_s, paths, unwritten="; ".join(faults))


def _option(key: re.Match[str]) -> str:
    return f"{'give ' if key['set'] else ''}--{key['key'].replace('_', '-')} {key['value']}"


def _inspected(path: Path, form: LogForm, job: Context) -> Finished:
    try:
        with job.under_way():
            outcome = inspect(path, form, **job.work())
    except ArgumentError as error:
        # the command puts the file name in front
        message = error.message.removeprefix(shown(path))
        message = message.lstrip(": ") or error.message
        raise InputError(_KEY.sub(_option, message)) from error
    return Finished(outcome, time.monotonic() - job.began)
