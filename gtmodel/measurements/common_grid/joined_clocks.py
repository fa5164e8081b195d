"""Joining of the signals of one recording from several clocks: alignment, then the times that all signals share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...results import ArgumentError, Work
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from ..alignment.align import Alignment, align
from ..log import SHORT
from ..resampling import LEAST, Resampled, resample
from ..sampling import sampling_of
from .derived_curves import curves
from .options import AlignBy, EvenGrid

SESSION = "session"  # the signal that numbers the stretches between gaps


@dataclass(frozen=True, eq=False)
class JoinedClocks:
    """Signals of several clocks at their common times, on the clock `reference`.

    `rows`: all signals, and "session" if gaps split them; `stretch` numbers the stretches, from 0. `fits`: alignment of
    each aligned clock. `parts`: the rows before resampling, `even`: after it. `step`: the sample time [s].
    """

    rows: Trajectory
    stretch: np.ndarray
    reference: str
    fits: Mapping[str, Alignment]
    parts: Sequence[ClockRows]
    even: Sequence[Resampled]
    step: float


def join(
    clocks: Mapping[str, Trajectory], grid: EvenGrid | None, align_by: Sequence[AlignBy],
    delays: Mapping[str, float], work: Work,
) -> JoinedClocks:  # fmt: skip
    """Join signals of several clocks; arguments and errors as in `resampling_study`.

    grid: None for the rows of the reference clock, as they are; the other signals are interpolated there.
    """
    parts = _parts(clocks, dict(delays))
    reference = _reference(parts, align_by)
    work.step("aligning clocks", 0.05)
    fits = _aligned(parts, align_by, reference, work)
    parts = [part.on(fits.get(part.clock)) for part in parts]
    work.step("resampling", 0.8)
    at = clocks[reference].time if grid is None else None
    grid = grid or EvenGrid()
    step = grid.sample_time or sampling_of(clocks[reference].time).step
    if not step > 0:
        raise ArgumentError(f"'{reference}' has fewer than two different times; expected more", "recording")
    first = max(float(part.rows.time[0]) for part in parts)
    start = first if grid.start is None else grid.start
    if at is not None:
        _refuse_apart(parts)  # before rows of one clock are sought among those of another
    even = [_even(part, step, start, grid, at) for part in parts]
    if grid.start is None and grid.end is None:
        _refuse_apart(parts)
    rows, stretch = _joined(even, step, start, grid, work.title, at)
    return JoinedClocks(rows, stretch, reference, fits, parts, even, step)


@dataclass(frozen=True)
class ClockRows:
    """Signals of one clock with equal delays, which are removed."""

    clock: str
    rows: Trajectory

    def on(self, fit: Alignment | None) -> ClockRows:
        return self if fit is None else ClockRows(self.clock, fit.bring(self.rows))


def _parts(clocks: Mapping[str, Trajectory], delays: Mapping[str, float]) -> list[ClockRows]:
    if not clocks:
        raise ArgumentError("there is no signal", "recording")
    clock_of = dict[str, str]()
    for clock, trajectory in clocks.items():
        for name in trajectory.names:
            if name in clock_of:
                raise ArgumentError(
                    f"'{name}' is a signal of '{clock_of[name]}' and of '{clock}'; rename one of them", "recording"
                )
            clock_of[name] = clock
        if len(trajectory) < 2:
            raise ArgumentError(f"'{clock}' has one row; expected more", "recording")
    for name in delays:
        if name not in clock_of:
            raise ArgumentError(f"there is no signal '{name}'; there are {', '.join(clock_of)}", "delays")
    if SESSION in clock_of:
        raise ArgumentError(f"the name '{SESSION}' is reserved for the result; rename the signal", "recording")
    parts = []
    for clock, trajectory in clocks.items():
        late: dict[float, list[str]] = {}
        for name in trajectory.names:
            late.setdefault(float(delays.get(name, 0.0)), []).append(name)
        parts += [ClockRows(clock, _shifted(trajectory.select(names), -delay)) for delay, names in late.items()]
    return parts


def _shifted(trajectory: Trajectory, by: float) -> Trajectory:
    if not by:
        return trajectory
    values = {name: trajectory[name] for name in trajectory.names}
    return Trajectory(
        trajectory.time + by, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def _clock_of(parts: Sequence[ClockRows], name: str, place: str) -> ClockRows:
    for part in parts:
        if name in part.rows:
            return part
    names = ", ".join(n for part in parts for n in part.rows.names)
    raise ArgumentError(f"there is no signal '{name}'; there are {names}", place)


def _reference(parts: Sequence[ClockRows], align_by: Sequence[AlignBy]) -> str:
    """Return the reference clock: that of the first pair, else the first clock. Raises ArgumentError."""
    chosen, aligned = "", dict[str, str]()
    for n, pair in enumerate(align_by):
        first = _clock_of(parts, pair.reference, f"align_by[{n}].reference").clock
        other = _clock_of(parts, pair.other, f"align_by[{n}].other").clock
        chosen = chosen or first
        if first != chosen:
            raise ArgumentError(
                f"'{pair.reference}' has the clock '{first}', but the reference clock of earlier pairs is '{chosen}'; "
                "align all clocks with one reference",
                f"align_by[{n}].reference",
            )
        if other == chosen:
            raise ArgumentError(
                f"'{pair.other}' is on the reference clock '{chosen}'; use the kind delay to estimate a delay between "
                "signals of one clock",
                f"align_by[{n}].other",
            )
        if other in aligned:
            raise ArgumentError(
                f"'{aligned[other]}' aligns the clock '{other}' already; name one pair", f"align_by[{n}].other"
            )
        aligned[other] = pair.other
    return chosen or parts[0].clock


def _aligned(
    parts: Sequence[ClockRows], align_by: Sequence[AlignBy], reference: str, work: Work
) -> dict[str, Alignment]:
    fits = dict[str, Alignment]()
    for n, pair in enumerate(align_by):
        first, other = (_clock_of(parts, name, "") for name in (pair.reference, pair.other))
        work.step(f"aligning clock {other.clock} with {reference}", 0.1 + 0.6 * n / len(align_by))
        range_ = pair.offset_range
        try:
            one, two = curves(first.rows, other.rows, pair)
            fits[other.clock] = align(
                one, two, {pair.reference: pair.other},
                drift=pair.drift, scale=pair.scale, shift=pair.shift,
                within=None if range_ is None else (range_[0], range_[1]),
            )  # fmt: skip
        except ArgumentError as error:
            field = {"within": ".offset_range", "window": ".window"}.get(error.argument, "")
            raise ArgumentError(error.message, f"align_by[{n}]{field}") from error
    return fits


def _refuse_apart(parts: Sequence[ClockRows]) -> None:
    """Raise ArgumentError if two signals have no time in common."""
    late, early = max(parts, key=lambda p: p.rows.time[0]), min(parts, key=lambda p: p.rows.time[-1])
    if late.rows.time[0] > early.rows.time[-1]:
        spans = " and ".join(
            f"{', '.join(p.rows.names)} from {p.rows.time[0]:.6g} to {p.rows.time[-1]:.6g} s ('{p.clock}')"
            for p in (early, late)
        )
        raise ArgumentError(
            f"0 times are common to all signals; expected at least {LEAST}: {spans}; if the clocks have different "
            "origins, align them by two signals of one motion",
            "recording.time",
        )


def _even(part: ClockRows, step: float, start: float, grid: EvenGrid, at: Array | None) -> Resampled:
    try:
        return resample(
            part.rows, step, method=grid.method, longest_gap=grid.longest_gap, start=start, name=part.clock, at=at
        )  # fmt: skip
    except ArgumentError as error:
        place = {"sample_time": "grid.sample_time", "longest_gap": "grid.longest_gap"}.get(error.argument)
        raise ArgumentError(error.message, place or "grid") from error


def _joined(
    even: Sequence[Resampled], step: float, start: float, grid: EvenGrid, title: str, at: Array | None
) -> tuple[Trajectory, np.ndarray]:
    """Return all signals at their common times, and the stretch of each. Raises ArgumentError if there are too few."""
    times = [np.concatenate([s.trajectory.time for s in one.sessions]) for one in even]
    numbers = [_numbers(t, start, step) if at is None else np.searchsorted(at, t) for t in times]
    common = numbers[0]
    for more in numbers[1:]:
        common = np.intersect1d(common, more, assume_unique=True)
    if grid.start is not None:
        common = common[common >= 0]
    if grid.end is not None:
        common = common[common <= np.floor((grid.end - start) / step + 1e-9)]
    if len(common) < LEAST:
        spans = ", ".join(
            f"{', '.join(one.sessions[0].trajectory.names)} from {one.sessions[0].trajectory.time[0]:.6g} to "
            f"{one.sessions[-1].trajectory.time[-1]:.6g} s"
            for one in even
        )
        interval = "" if grid.start is None and grid.end is None else " between start and end of the grid"
        raise ArgumentError(
            f"{len(common)} times are common to all signals{interval}; expected at least {LEAST}: {spans}",
            "grid" if interval else "recording",
        )
    stretch = np.concatenate([[0], np.cumsum(np.diff(common) > 1)])
    long = np.bincount(stretch)[stretch] >= LEAST
    short = {SHORT: int(np.sum(~long))} if long.any() and not long.all() else {}
    if short:
        common, stretch = common[long], np.unique(stretch[long], return_inverse=True)[1]
    values, units = dict[str, Array](), dict[str, str]()
    for one, instants in zip(even, numbers, strict=True):
        rows = np.searchsorted(instants, common)
        for name in one.sessions[0].trajectory.names:
            values[name] = np.concatenate([s.trajectory[name] for s in one.sessions])[rows]
            units[name] = one.sessions[0].trajectory.unit(name)
    if stretch[-1]:
        values, units = {SESSION: stretch.astype(float), **values}, {SESSION: "1", **units}
    notes = list(dict.fromkeys(s.trajectory.synthetic for one in even for s in one.sessions if s.trajectory.synthetic))
    trajectory = Trajectory(
        start + step * common if at is None else at[common], values, units, title=title,
        provenance={"resampled": grid.method, "sample_time_s": step, **short}, synthetic="; ".join(notes) or None,
    )  # fmt: skip
    return trajectory, stretch


def _numbers(time: Array, start: float, step: float) -> np.ndarray:
    return np.round((time - start) / step).astype(np.int64)
