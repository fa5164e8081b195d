"""Logs whose signals lie in several files or have several clocks, joined to sessions."""

from __future__ import annotations

import re
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
from ..log import ORIGIN, SHORT, Column, LogError, Session, left_out, session_of
from ..recording import read_recording
from ..resampling import at_time
from ..streams.form import matching
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
        rows, notes = _stacked(joined.rows, columns), _notes(recording, joined, align_by)
        dropped = left_out([joined.rows, *recording.values()])
        if short := sum(one.sessions[0].trajectory.provenance.get(SHORT, 0) for one in joined.even):
            dropped[SHORT] = dropped.get(SHORT, 0) + short
        for k in range(int(joined.stretch[-1]) + 1):
            part = joined.stretch == k
            stretch = Trajectory(
                rows.time[part], {n: rows[n][part] for n in rows.names}, rows.units, title=rows.title,
                provenance={
                    **(joined.rows.provenance if grid else {}), JOINED: notes,
                    **({} if k else dropped),
                },
                synthetic=rows.synthetic,
            )  # fmt: skip
            name = f"{label} from {at_time(stretch.time[0])}" if joined.stretch[-1] else label
            if grid is None:
                even = session_of(stretch, name, jitter=jitter, sample_time=sample_time)
                sessions.append(even._replace(stretch=k))
            else:
                sessions.append(Session(name, stretch, joined.step, k))
    return tuple(sessions)


def _stacked(rows: Trajectory, columns: Mapping[str, Column]) -> Trajectory:
    """Return the declared signals; a vector whose components have clocks of their own was read one by one."""
    values, units = dict[str, np.ndarray](), dict[str, str]()
    for name in columns:
        parts = (
            [name]
            if name in rows
            else [part for part in rows.names if re.fullmatch(rf"{re.escape(name)}\[\d+\]", part)]
        )
        values[name] = rows[name] if parts == [name] else np.column_stack([rows[part] for part in parts])
        each = {rows.unit(part) for part in parts}
        units[name] = each.pop() if len(each) == 1 else "1"
    return Trajectory(rows.time, values, units, title=rows.title, synthetic=rows.synthetic)


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
    notes, reference, loose = list[str](), joined.reference, dict[str, list[str]]()
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
        known = all(ORIGIN in recording[c].provenance for c in (clock, reference))
        how = "by the known origins of their times" if known else "as if their times had one origin"
        loose.setdefault(how, []).append(clock)
    first = recording[reference].time
    for how, clocks in loose.items():
        names = ", ".join(f"'{clock}' ({', '.join(recording[clock].names)})" for clock in clocks)
        times = [recording[clock].time for clock in clocks]
        span = min(first[-1], *(t[-1] for t in times)) - max(first[0], *(t[0] for t in times))
        verb = "is" if len(clocks) == 1 else "are"
        notes.append(
            f"{names} {verb} joined with '{reference}' {how}; they overlap for {span:.6g} s of {np.ptp(first):.6g} s"
        )
    return notes
