"""The resampling study: puts the signals of one recording, from several clocks, on one even grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack

import numpy as np

from ...results import ArgumentError, SolveStatus, Work, at_least
from ...results.estimate import Estimate
from ...results.interpolation import said
from ...results.suspicion import suspicion_checks
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from ...results.work import WorkOptions, study_function
from ..alignment.align import Alignment, align
from ..alignment.delay_study import RELATED
from ..inspection.data_tests import Data, tested
from ..log import LEFT_OUT
from ..resampling import Resampled, resample
from ..sampling import SamplingReport, sampling_of
from .options import AlignBy, EvenGrid, ResamplingStudy

SESSION = "session"  # the signal that numbers the stretches between gaps
FEWEST = 3  # rows on the grid
COARSER = 1.5  # median steps: a longer sample time of the grid causes aliasing


@study_function
def resampling_study(
    recording: Trajectory | Mapping[str, Trajectory],
    grid: EvenGrid | None = None,
    align_by: Sequence[AlignBy] = (),
    *,
    delays: Mapping[str, float] | None = None,
    **work_options: Unpack[WorkOptions],
) -> ResamplingStudy:
    """Resample the signals of one recording on one even grid, with interpolation errors and clock alignment.

    Args:
        recording: clock -> its signals, as `read_recording` returns them; a trajectory has one clock. Rows may be
            uneven and have gaps. No two clocks may share a signal name.
        grid: sample time, method, bridged gaps, time interval; see `EvenGrid`.
        align_by: for each other clock a pair of signals that aligns it with the reference clock. A clock without a pair
            is not shifted.
        delays: signal -> its delay [s], which is removed; `delay_study` estimates it.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The `trajectory` of the study holds the grid in SI units; its file, trajectory.csv, can be read as a log. If gaps
    split it, the signal "session" numbers the stretches. Intervals of offset and drift are those for white noise if the
    residuals of the alignment pass a whiteness test, otherwise those of Newey and West. Raises ArgumentError for wrong
    names, for signals that do not agree, and if the signals have no times in common.

    >>> first, late = gt.measurements.made_pair(gt.measurements.SyntheticDelay(delay=0.5, jitter=0.3))
    >>> late = gt.Trajectory(late.time, {"tracker": late["q"]}, {"tracker": "rad"}, synthetic=late.synthetic)
    >>> by = gt.measurements.AlignBy("q", "tracker")
    >>> grid = gt.measurements.EvenGrid(sample_time=0.01)
    >>> study = gt.measurements.resampling_study({"robot": first, "tracker": late}, grid, [by])
    >>> round(study.offset["tracker"], 3), study.trajectory.names  # s
    (-0.5, ('q', 'tracker'))
    """
    work = Work(**work_options)
    grid = grid or EvenGrid()
    clocks = {"log": recording} if isinstance(recording, Trajectory) else dict(recording)
    parts = _parts(clocks, dict(delays or {}))
    reference = _reference(parts, align_by)
    work.step("aligning clocks", 0.05)
    fits = _aligned(parts, align_by, reference, work)
    parts = [part.on(fits.get(part.clock)) for part in parts]
    work.step("resampling", 0.8)
    step = grid.sample_time or sampling_of(clocks[reference].time).step
    if not step > 0:
        raise ArgumentError(f"'{reference}' has fewer than two different times; expected more", "recording")
    first = max(float(part.rows.time[0]) for part in parts)
    start = first if grid.start is None else grid.start
    even = [_even(part, step, start, grid) for part in parts]
    joined = _joined(even, step, start, grid, work.title)
    return _study(clocks, reference, parts, fits, even, joined, step, grid, work.title)


@dataclass(frozen=True)
class _Part:
    """Signals of one clock with equal delays, which are removed."""

    clock: str
    rows: Trajectory

    def on(self, fit: Alignment | None) -> _Part:
        return self if fit is None else _Part(self.clock, fit.bring(self.rows))


@dataclass(frozen=True)
class _Joined:
    """All signals on the grid; `stretch` numbers the stretches between gaps, from 0."""

    rows: Trajectory
    stretch: np.ndarray


def _parts(clocks: Mapping[str, Trajectory], delays: Mapping[str, float]) -> list[_Part]:
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
        parts += [_Part(clock, _shifted(trajectory.select(names), -delay)) for delay, names in late.items()]
    return parts


def _shifted(trajectory: Trajectory, by: float) -> Trajectory:
    if not by:
        return trajectory
    values = {name: trajectory[name] for name in trajectory.names}
    return Trajectory(
        trajectory.time + by, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def _clock_of(parts: Sequence[_Part], name: str, place: str) -> _Part:
    for part in parts:
        if name in part.rows:
            return part
    names = ", ".join(n for part in parts for n in part.rows.names)
    raise ArgumentError(f"there is no signal '{name}'; there are {names}", place)


def _reference(parts: Sequence[_Part], align_by: Sequence[AlignBy]) -> str:
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


def _aligned(parts: Sequence[_Part], align_by: Sequence[AlignBy], reference: str, work: Work) -> dict[str, Alignment]:
    fits = dict[str, Alignment]()
    for n, pair in enumerate(align_by):
        first, other = (_clock_of(parts, name, "") for name in (pair.reference, pair.other))
        work.step(f"aligning clock {other.clock} with {reference}", 0.1 + 0.6 * n / len(align_by))
        range_ = pair.offset_range
        try:
            fits[other.clock] = align(
                first.rows.select([pair.reference]), other.rows.select([pair.other]), {pair.reference: pair.other},
                drift=pair.drift, scale=pair.scale, shift=pair.shift,
                within=None if range_ is None else (range_[0], range_[1]),
            )  # fmt: skip
        except ArgumentError as error:
            field = ".offset_range" if error.argument == "within" else ""
            raise ArgumentError(error.message, f"align_by[{n}]{field}") from error
    return fits


def _even(part: _Part, step: float, start: float, grid: EvenGrid) -> Resampled:
    try:
        return resample(
            part.rows, step, method=grid.method, longest_gap=grid.longest_gap, start=start, name=part.clock
        )  # fmt: skip
    except ArgumentError as error:
        place = {"sample_time": "grid.sample_time", "longest_gap": "grid.longest_gap"}.get(error.argument)
        raise ArgumentError(error.message, place or "grid") from error


def _joined(even: Sequence[Resampled], step: float, start: float, grid: EvenGrid, title: str) -> _Joined:
    """Return all signals at their common times. Raises ArgumentError if there are too few."""
    numbers = [np.concatenate([_numbers(s.trajectory.time, start, step) for s in one.sessions]) for one in even]
    common = numbers[0]
    for more in numbers[1:]:
        common = np.intersect1d(common, more, assume_unique=True)
    if grid.start is not None:
        common = common[common >= 0]
    if grid.end is not None:
        common = common[common <= np.floor((grid.end - start) / step + 1e-9)]
    if len(common) < FEWEST:
        spans = ", ".join(
            f"{', '.join(one.sessions[0].trajectory.names)} from {one.sessions[0].trajectory.time[0]:.6g} to "
            f"{one.sessions[-1].trajectory.time[-1]:.6g} s"
            for one in even
        )
        interval = "" if grid.start is None and grid.end is None else " between start and end of the grid"
        raise ArgumentError(
            f"{len(common)} times are common to all signals{interval}; expected at least {FEWEST}: {spans}",
            "grid" if interval else "recording",
        )
    values, units = dict[str, Array](), dict[str, str]()
    for one, instants in zip(even, numbers, strict=True):
        rows = np.searchsorted(instants, common)
        for name in one.sessions[0].trajectory.names:
            values[name] = np.concatenate([s.trajectory[name] for s in one.sessions])[rows]
            units[name] = one.sessions[0].trajectory.unit(name)
    stretch = np.concatenate([[0], np.cumsum(np.diff(common) > 1)])
    if stretch[-1]:
        values, units = {SESSION: stretch.astype(float), **values}, {SESSION: "1", **units}
    notes = list(dict.fromkeys(s.trajectory.synthetic for one in even for s in one.sessions if s.trajectory.synthetic))
    trajectory = Trajectory(
        start + step * common, values, units, title=title,
        provenance={"resampled": grid.method, "sample_time_s": step}, synthetic="; ".join(notes) or None,
    )  # fmt: skip
    return _Joined(trajectory, stretch)


def _numbers(time: Array, start: float, step: float) -> np.ndarray:
    return np.round((time - start) / step).astype(np.int64)


def _study(
    clocks: Mapping[str, Trajectory], reference: str, parts: Sequence[_Part], fits: Mapping[str, Alignment],
    even: Sequence[Resampled], joined: _Joined, step: float, grid: EvenGrid, title: str,
) -> ResamplingStudy:  # fmt: skip
    order = [reference, *(clock for clock in clocks if clock != reference)]
    sampling = {clock: sampling_of(clocks[clock].time) for clock in order}
    rows = joined.rows
    error = {name: one.error[name] for one in even for name in one.error}
    checks = {}
    if fits:
        checks["explained"] = at_least(
            min(fit.explained for fit in fits.values()), RELATED,
            "look at the residuals in the picture: the two signals do not describe the same motion",
        )  # fmt: skip
    data = [Data({n: t[n] for n in t.names}, recordings=[(clock, t.time)]) for clock, t in clocks.items()]
    doubtful, sentences = suspicion_checks(tested(*data))
    checks |= doubtful
    drifting = {clock: fit for clock, fit in fits.items() if "drift" in fit.estimate.names}
    text = title or "resampling"
    figures = {
        "signals": partial(_signals, text, parts, rows, joined.stretch),
        "steps": partial(_steps, text, {c: clocks[c].time for c in order}, rows.synthetic),
    }
    if fits:
        figures["alignment"] = partial(_residuals, text, fits, rows.synthetic)
    names = [n for n in rows.names if n != SESSION]
    return ResamplingStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(rows)} rows of {len(names)} signal{'s' if len(names) > 1 else ''} every {1e3 * step:.6g} ms by "
        f"{grid.method} interpolation",
        title=text, checks=checks, notes=[*_notes(clocks, reference, fits, sampling, even, step), *sentences],
        estimate=_estimate(fits), trajectory=rows, figures=figures,
        clocks=order, rows_read=[len(clocks[c]) for c in order],
        rows_left_out=[sum(clocks[c].provenance.get(why, 0) for why in LEFT_OUT) for c in order],
        rate=[sampling[c].rate for c in order], jitter=[sampling[c].jitter for c in order],
        gaps=[len(sampling[c].gaps) for c in order],
        longest_gap=[float(np.max(np.diff(clocks[c].time))) for c in order],
        missing=[sampling[c].missing for c in order],
        sample_time=step, rows_written=len(rows), stretches=int(joined.stretch[-1]) + 1, method=grid.method,
        units={n: rows.unit(n) for n in names}, error={n: error[n].tolist() for n in names},
        length={n: float(np.median(np.linalg.norm(rows[n], axis=1))) for n in names if rows[n].ndim > 1},
        offset={c: fit.offset for c, fit in fits.items()},
        offset_interval={c: list(fit.interval("offset")) for c, fit in fits.items()},
        drift={c: fit.drift for c, fit in drifting.items()},
        drift_interval={c: list(fit.interval("drift")) for c, fit in drifting.items()},
        explained={c: fit.explained for c, fit in fits.items()},
        coloured={c: fit.coloured for c, fit in fits.items()}, synthetic=rows.synthetic,
    )  # fmt: skip


def _estimate(fits: Mapping[str, Alignment]) -> Estimate | None:
    """Return offsets and drifts of all aligned clocks."""
    if not fits:
        return None
    import scipy

    names, values, units, blocks = list[str](), list[float](), list[str](), list[Array]()
    for clock, fit in fits.items():
        estimated = [n for n in ("offset", "drift") if n in fit.estimate.names]
        places = [fit.estimate.names.index(n) for n in estimated]
        names += [f"{n} of {clock}" for n in estimated]
        values += fit.estimate.values[places].tolist()
        units += [fit.estimate.units[p] for p in places]
        blocks.append(fit.estimate.covariance[np.ix_(places, places)])
    return Estimate(
        tuple(names), np.array(values), scipy.linalg.block_diag(*blocks),
        min(fit.estimate.degrees_of_freedom for fit in fits.values()), 1.0, False,
        np.concatenate([fit.estimate.residuals for fit in fits.values()]), (), units=tuple(units),
    )  # fmt: skip


def _notes(
    clocks: Mapping[str, Trajectory], reference: str, fits: Mapping[str, Alignment],
    sampling: Mapping[str, SamplingReport], even: Sequence[Resampled], step: float,
) -> list[str]:  # fmt: skip
    notes = [f"{clock}: {note}" for clock, fit in fits.items() for note in fit.notes]
    loose = [clock for clock in clocks if clock != reference and clock not in fits]
    if loose:
        names = " and ".join(f"'{clock}'" for clock in loose)
        notes.append(f"the times of {names} are not aligned; name a pair of signals to align them with '{reference}'")
    for clock, report in sampling.items():
        if step > COARSER * report.step:
            notes.append(
                f"'{clock}' has a row every {1e3 * report.step:.4g} ms; nothing is filtered, so frequencies above "
                f"{0.5 / step:.4g} Hz are aliased"
            )
    for one in even:
        notes += said(one.natures)
        if one.bridged:
            names = ", ".join(one.sessions[0].trajectory.names)
            notes.append(f"{names}: {sum(g.missing for g in one.bridged)} missing rows are interpolated")
    return list(dict.fromkeys(notes))


def _named(title: str, synthetic: str | None) -> str:
    return f"{title} (synthetic)" if synthetic and "synthetic" not in title.lower() else title


def _signals(title: str, parts: Sequence[_Part], rows: Trajectory, stretch: np.ndarray) -> Any:
    from ...plot.log import resampled_figure

    raw = {name: part.rows.select([name]) for part in parts for name in part.rows.names}
    return resampled_figure(raw, rows, stretch, title=_named(title, rows.synthetic))


def _steps(title: str, times: Mapping[str, Array], synthetic: str | None) -> Any:
    from ...plot.log import steps_figure

    return steps_figure(times, title=_named(title, synthetic))


def _residuals(title: str, fits: Mapping[str, Alignment], synthetic: str | None) -> Any:
    from ...plot.log import delay_figure

    return delay_figure(
        [(clock, *next(iter(f.residuals.values())), f.unit, -f.offset) for clock, f in fits.items()],
        title=_named(title, synthetic),
    )  # fmt: skip
