"""Logs whose signals lie in several files or have several clocks, joined to sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...results import ArgumentError, Work
from ...results.disk import path_of
from ...results.trajectory import Trajectory
from ...results.trajectory_files import PathLike
from ...results.work import Progress, silent
from ..alignment.delay_study import RELATED
from ..log import Column, LogError, Session, session_of
from ..recording import matching, read_recording
from .joined_clocks import JoinedClocks, join
from .options import AlignBy, EvenGrid

JOINED = "joined"  # key of the provenance: sentences about the clocks


def read_joined(
    paths: Sequence[PathLike],
    columns: Mapping[str, Column],
    *,
    time: Column | None,
    sample_time: float | None,
    jitter: float,
    grid: EvenGrid | None,
    align_by: Sequence[AlignBy],
    curves: Mapping[str, Column],
    progress: Progress = silent,
    **more: Any,
) -> tuple[Session, ...]:
    """Read recordings with several files or clocks; arguments and errors as in `read_signals`."""
    for name in curves:
        if name in columns:
            raise ArgumentError(f"'{name}' is a signal of the log; rename the curve", "curves")
    sessions = []
    for files, declared in _recordings([path_of(p, "paths") for p in paths], {**columns, **curves}):
        recording = read_recording(
            files, declared, time=time, sample_time=sample_time, progress=progress, **more
        )  # fmt: skip
        joined = join(recording, grid, align_by, {}, Work(progress=progress))
        label = " + ".join(file.name for file in files)
        rows, notes = joined.rows.select(list(columns)), _notes(recording, joined, align_by)
        for k in range(int(joined.stretch[-1]) + 1):
            part = joined.stretch == k
            stretch = Trajectory(
                rows.time[part], {n: rows[n][part] for n in rows.names}, rows.units, title=rows.title,
                provenance={**(joined.rows.provenance if grid else {}), JOINED: notes}, synthetic=rows.synthetic,
            )  # fmt: skip
            name = f"{label} from {stretch.time[0]:.6g} s" if joined.stretch[-1] else label
            if grid is None:
                sessions.append(session_of(stretch, name, jitter=jitter, sample_time=sample_time))
            else:
                sessions.append(Session(name, stretch, joined.step))
    return tuple(sessions)


def _recordings(paths: Sequence[Path], columns: Mapping[str, Column]) -> list[tuple[list[Path], dict[str, Column]]]:
    """Return the files of each recording, with its columns. Raises LogError if the files are not as many for each."""
    patterns = list(dict.fromkeys(c.file for c in columns.values() if c.file))
    groups = {pattern: matching(paths, pattern) for pattern in patterns}
    rest = [p for p in paths if not any(p in group for group in groups.values())]
    if not patterns:
        return [([path], dict(columns)) for path in paths]
    counts = {pattern: len(group) for pattern, group in groups.items()}
    if any(c.file == "" for c in columns.values()) and rest:
        counts["the other signals"] = max(len(rest), 1) if max(counts.values()) > 1 else 1
    if min(counts.values()) == 0 or len(set(counts.values())) > 1:
        numbers = ", ".join(f"{count} for {name}" for name, count in counts.items())
        names = ", ".join(path.name for path in paths) or "none"
        raise LogError(
            f"a recording needs one file for each pattern of a signal; found {numbers}, in the files {names}"
        )
    recordings = []
    for k in range(counts[patterns[0]]):
        own = {pattern: group[k] for pattern, group in groups.items()}
        files = [*own.values(), *(rest if counts[patterns[0]] == 1 else rest[k : k + 1])]
        declared = {n: c._replace(file=str(own[c.file])) if c.file else c for n, c in columns.items()}
        recordings.append(([p for p in paths if p in files], declared))
    return recordings


def _notes(recording: Mapping[str, Trajectory], joined: JoinedClocks, align_by: Sequence[AlignBy]) -> list[str]:
    """Return a sentence about each clock other than the reference, with its alignment or overlap."""
    notes, reference = list[str](), joined.reference
    clock_of = {name: clock for clock, rows in recording.items() for name in rows.names}
    pairs = {clock_of[pair.other]: pair for pair in align_by}
    for clock, rows in recording.items():
        if clock == reference:
            continue
        names = ", ".join(rows.names)
        if clock in joined.fits:
            fit, pair = joined.fits[clock], pairs[clock]
            low = f"; expected at least {100 * RELATED:.0f} %: the two hardly show the same motion" * (
                fit.explained < RELATED
            )
            notes.append(
                f"the clock of '{clock}' ({names}) is aligned with '{reference}' by {pair.other} and {pair.reference}: "
                f"{fit.message}; the common curve explains {100 * fit.explained:.4g} %{low}"
            )
            notes += [f"{clock}: {note}" for note in fit.notes]
            continue
        first = recording[reference].time
        span = min(first[-1], rows.time[-1]) - max(first[0], rows.time[0])
        notes.append(
            f"'{clock}' ({names}) is joined with '{reference}' as if their times had one origin; they overlap for "
            f"{span:.6g} s of {np.ptp(first):.6g} s"
        )
    return notes
