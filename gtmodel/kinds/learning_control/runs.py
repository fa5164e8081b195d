"""Recordings of a robot on one clock."""

from __future__ import annotations

from collections.abc import Sequence

from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.log_keys import RecordingFiles
from gtmodel.results import Trajectory

from .keys import RunSignals


def recorded(
    log: RecordingFiles, signals: RunSignals, files: Sequence[str], key: str, context: Context, synthetic: str
) -> Trajectory:
    """The signals of a recording on one clock, from these files. Raises InputError."""
    given = {name: getattr(signals, name) for name in type(signals).model_fields}
    columns = {name: section.recorded() for name, section in given.items() if section is not None}
    recording = log.model_copy(update={"files": list(files)}).recording(columns, context, key)
    by_name = {name: t for t in recording.values() for name in t.names}
    clock = by_name["reference"]
    if any(t is not clock for t in by_name.values()):
        raise InputError("has signals with clocks of their own; resample them on one (kind resampling)", key)
    return Trajectory(
        clock.time, {name: clock[name] for name in columns}, {name: clock.unit(name) for name in columns},
        synthetic=synthetic or clock.synthetic,
    )  # fmt: skip
