"""Study of a filter: a process with sensors over a log or synthetic readings, with estimates and a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Unpack

import numpy as np

from ..measurements.inspection.data_tests import Data, tested
from ..results import ArgumentError, SolveStatus, Work
from ..results.refusal import naming
from ..results.suspicion import suspicion_checks
from ..results.trajectory import Trajectory
from ..results.work import Interrupted, WorkOptions, study_function
from .belief import InitialState, Readings, instants, readings_of
from .consistency import consistency
from .family.by_name import make
from .filtered import Filtered
from .options import DrawnReadings, FilterName, FilterStart, FilterStudy
from .smoother import Smoothed, smooth
from .synthetic import draw
from .system import System

MOST_INSTANTS = 2_000_000  # of synthetic readings


@study_function
def filter_study(
    system: System,
    start: FilterStart,
    log: Mapping[str, Readings] | DrawnReadings,
    filter: FilterName = "ekf",
    *,
    inputs: Trajectory | None = None,
    smoothing: bool = False,
    **work_options: Unpack[WorkOptions],
) -> FilterStudy:
    """Filter a log: states with standard deviations, and whether the innovations are consistent with them.

    Args:
        system: process and sensors.
        start: initial estimate of the states at the first reading.
        log: sensor -> readings; or synthetic readings of a motion that the process draws from its own noise: then the
            truth is known, and the study compares the true errors with the filter's deviations.
        filter: "kf", "ekf", "iekf", "ukf", "particle" or "steady", see `make`.
        inputs: known inputs of the process over the whole time.
        smoothing: whether to smooth the states over the whole log too (Rauch, Tung and Striebel).
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for a start, a log or a filter that does not fit the system.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> start = gt.filtering.FilterStart(deviation={"x": 1.0})
    >>> study = gt.filtering.filter_study(system, start, gt.filtering.DrawnReadings(duration=100.0, step=0.1))
    >>> print(study.verdict)
    innovations agree with the filter: 1.004 within 0.8594 to 1.154, white, with zero mean
    """
    work = Work(**work_options)
    if smoothing and filter == "particle":
        raise ArgumentError("particles cannot be smoothed; leave smoothing out, or use another filter", "smoothing")
    initial = InitialState(dict(start.mean), dict(start.deviation))
    synthetic, truth = "", None
    if isinstance(log, DrawnReadings):
        work.step("drawing readings", 0.02)
        synthetic = f"readings of a motion drawn from the process noise, seed {log.seed}"
        log, truth = _drawn(system, initial, log, inputs)
    readings = readings_of(system, log)
    work.step("filtering", 0.1)
    run = make(filter, system).run(
        readings, initial, inputs=inputs, truth=truth, keep=smoothing, progress=work.fractions("filtering")
    )
    answer = partial(_answer, readings, filter, synthetic, work.title)
    if not len(run.time):
        if run.status is SolveStatus.INTERRUPTED:
            raise Interrupted("stopped before the first readings were filtered")
        return FilterStudy(status=run.status, message=run.message, title=work.title, filter=filter, synthetic=synthetic)
    work.keep(partial(answer, run, None))
    smoothed = None
    if smoothing and run.status.ok and not work.interrupted():
        work.step("smoothing", 0.7)
        smoothed = smooth(run)
    return answer(run, smoothed)


def _drawn(
    system: System, initial: InitialState, options: DrawnReadings, inputs: Trajectory | None
) -> tuple[dict[str, Readings], dict[str, np.ndarray]]:
    """Synthetic readings, and true states at the instants at which they were taken."""
    if options.duration < options.step or options.duration > MOST_INSTANTS * options.step:
        raise ArgumentError(
            f"expected 1 to {MOST_INSTANTS:,} steps of {options.step:g} s; found {options.duration / options.step:.3g}",
            "log.duration",
        )
    if system.dynamics.inputs and inputs is None:
        raise ArgumentError(f"the process has known inputs, {', '.join(system.dynamics.inputs)}; give them", "inputs")
    time = options.step * np.arange(int(np.floor(options.duration / options.step + 1e-9)) + 1)
    with naming({"time": "log.step"}):
        drawn = draw(system, initial, time, seed=options.seed, inputs=inputs)
    moments = np.array([moment.time for moment in instants(system, drawn.log)])
    rows = np.clip(np.rint(moments / options.step).astype(int), 0, len(time) - 1)
    return drawn.log, {name: values[:, rows] for name, values in drawn.truth.items()}


def _answer(
    readings: Mapping[str, Readings], filter: str, synthetic: str, title: str, run: Filtered, smoothed: Smoothed | None
) -> FilterStudy:
    """Study of the instants filtered so far."""
    test = consistency(run) if run.status.ok else None
    checks, doubts = suspicion_checks(tested(*(
        Data({name: r.values}, [name], "reading", recordings=[(name, r.time)]) for name, r in readings.items()
    )))  # fmt: skip
    errors = _errors(run)
    unit = {part.name: part.error_unit for part in run.system.space.parts}
    return FilterStudy(
        status=run.status, message=run.message, title=title, checks=checks, notes=[*run.notes, *doubts],
        trajectory=_trajectory(run, smoothed, synthetic, title), filter=filter, synthetic=synthetic,
        readings={name: len(r) for name, r in readings.items()},
        left_out={name: int(n.sum()) for name, n in run.gated.items() if n.sum()},
        nis=None if test is None else test.nis, nis_band=() if test is None else tuple(test.band),
        nis_numbers=None if test is None else test.expected, verdict="" if test is None else test.message,
        final={name: np.atleast_1d(run[name][-1]).tolist() for name in unit},
        final_deviation={name: np.atleast_1d(run.deviation[name][-1]).tolist() for name in unit},
        rms_error=errors, smoothed_rms_error=_errors(smoothed),
        rms_deviation={name: _rms(run.deviation[name]) for name in errors},
        units={name: text for name, text in unit.items() if text not in ("1", "?")},
        figures={
            "estimates": partial(_estimates_figure, run, smoothed, unit, title),
            **({"errors": partial(_errors_figure, run, smoothed, unit, title)} if errors else {}),
            "innovations": partial(innovations_picture, run, title),
        },
    )  # fmt: skip


def _errors(estimates: Filtered | Smoothed | None) -> dict[str, list[float]]:
    if estimates is None or estimates.errors is None:
        return {}
    return {name: _rms(error) for name, error in estimates.error.items()}


def _rms(errors: np.ndarray) -> list[float]:
    """Root mean square over the instants, per component."""
    return np.sqrt(np.mean(np.square(_columns(errors)), axis=0)).tolist()


def _trajectory(run: Filtered, smoothed: Smoothed | None, synthetic: str, title: str) -> Trajectory:
    filtered = run.trajectory()
    values = {name: filtered[name] for name in filtered.names}
    units = dict(filtered.units)
    if smoothed is not None:
        rows = smoothed.trajectory()
        for part in run.system.space.parts:
            values[f"{part.name}.smoothed"], units[f"{part.name}.smoothed"] = rows[part.name], units[part.name]
    return Trajectory(filtered.time, values, units, title=title, synthetic=synthetic or None)


def _estimates_figure(run: Filtered, smoothed: Smoothed | None, units: Mapping[str, str], title: str) -> Any:
    from ..plot.filters import estimates_figure

    means, finer = ({} if one is None else {n: _columns(one[n]) for n in units} for one in (run, smoothed))
    deviations = {name: _columns(run.deviation[name]) for name in units}
    return estimates_figure(run.time, means, deviations, finer, units, title=title)


def _errors_figure(run: Filtered, smoothed: Smoothed | None, units: Mapping[str, str], title: str) -> Any:
    from ..plot.filters import estimates_figure

    errors, finer = ({} if one is None else {n: _columns(one.error[n]) for n in units} for one in (run, smoothed))
    deviations = {name: _columns(run.deviation[name]) for name in units}
    return estimates_figure(run.time, errors, deviations, finer, units, errors=True, title=title)


def _columns(values: np.ndarray) -> np.ndarray:
    return values.reshape(len(values), -1)


def innovations_picture(run: Filtered, title: str) -> Any:
    """Normalised innovations of a single run, and their squares with the band of a consistent filter."""
    from ..inference.chance import chi_squared_ends
    from ..plot.filters import innovations_figure

    white = {name: values[:, 0] for name, values in run.innovations.items()}
    return innovations_figure(run.time, white, run.nis[:, 0], run.count[:, 0], chi_squared_ends, title=title)
