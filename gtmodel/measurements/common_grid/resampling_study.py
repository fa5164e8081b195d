"""The resampling study: puts the signals of one recording, from several clocks, on one even grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np

from ...results import SolveStatus, Work, at_least
from ...results.estimate import Estimate
from ...results.interpolation import said
from ...results.suspicion import suspicion_checks
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from ...results.work import WorkOptions, study_function
from ..alignment.align import Alignment
from ..alignment.delay_study import RELATED
from ..inspection.data_tests import Data, tested
from ..log import left_out
from ..resampling import Resampled
from ..sampling import SamplingReport, sampling_of
from .joined_clocks import SESSION, ClockRows, JoinedClocks, join
from .options import AlignBy, EvenGrid, ResamplingStudy

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
    joined = join(clocks, grid, align_by, delays or {}, work)
    return _study(clocks, joined, grid, work.title)


def _study(
    clocks: Mapping[str, Trajectory], joined: JoinedClocks, grid: EvenGrid, title: str
) -> ResamplingStudy:  # fmt: skip
    rows, reference, parts, fits, even = joined.rows, joined.reference, joined.parts, joined.fits, joined.even
    step = joined.step
    order = [reference, *(clock for clock in clocks if clock != reference)]
    sampling = {clock: sampling_of(clocks[clock].time) for clock in order}
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
        rows_left_out=[sum(left_out([clocks[c]]).values()) for c in order],
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


def _signals(title: str, parts: Sequence[ClockRows], rows: Trajectory, stretch: np.ndarray) -> Any:
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
