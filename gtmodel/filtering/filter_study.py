"""Study of a filter: a process with sensors over a log or synthetic readings, with estimates and a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np

from ..measurements.inspection.data_tests import Data, tested
from ..results import ArgumentError, SolveStatus, Work
from ..results.disk import MadeFiles
from ..results.refusal import naming
from ..results.suspicion import suspicion_checks
from ..results.table import csv_text
from ..results.trajectory import Trajectory
from ..results.work import Interrupted, WorkOptions, study_function
from .belief import InitialState, Readings, instants, readings_of
from .consistency import consistency
from .family.by_name import make
from .faults import find_faults
from .filtered import Filtered
from .noise_estimate import NoiseEstimate, estimate_noise
from .options import DrawnReadings, FilterName, FilterStart, FilterStudy, Numbers
from .resting import RestingLog
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
    estimate: Sequence[str] = (),
    rest: RestingLog | tuple[float, float] | None = None,
    faults: Mapping[str, Numbers] = MappingProxyType({}),
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
        estimate: noise to estimate, "SENSOR.deviation" and "NOISE.density"; the values that `system` declares are then
            not used. Deviations come from `rest`, if given; all others by maximum likelihood of the innovations.
        rest: a log at rest, or a stretch of the log in which all states are constant, from and to [s]; also for a start
            from rest.
        faults: suspects and their largest plausible sizes, as in `find_faults`, which tests each alone.
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
    noise = NoiseEstimate(system, initial, readings)
    if estimate or start.from_rest:
        work.step("estimating noise", 0.05)
        if truth is not None and start.from_rest:
            raise ArgumentError("synthetic readings have no rest; give the start", "start.from_rest")
        noise = estimate_noise(
            system, readings, initial, estimate, rest=rest, from_rest=start.from_rest, inputs=inputs,
            progress=work.fractions("estimating noise"),
        )  # fmt: skip
        system, initial, readings = noise.system, noise.initial, noise.readings
    work.step("filtering", 0.1)
    run = make(filter, system).run(
        readings, initial, inputs=inputs, truth=truth, keep=smoothing, progress=work.fractions("filtering")
    )
    answer = partial(_answer, readings, filter, synthetic, work.title, noise)
    if not len(run.time):
        if run.status is SolveStatus.INTERRUPTED:
            raise Interrupted("stopped before the first readings were filtered")
        return FilterStudy(status=run.status, message=run.message, title=work.title, filter=filter, synthetic=synthetic)
    work.keep(partial(answer, run, None))
    smoothed = None
    if smoothing and run.status.ok and not work.interrupted():
        work.step("smoothing", 0.7)
        smoothed = smooth(run)
    study = answer(run, smoothed)
    if faults and run.status.ok and not work.interrupted():
        work.step("searching for faults", 0.8)
        with naming({"suspects": "faults"}):
            search = find_faults(
                system.process, [*system.sensors.values()], readings, initial, faults, inputs=inputs,
                progress=work.fractions("searching for faults"),
            )  # fmt: skip
        study = study.with_(
            faults=search.message, fault_sizes={s.name: s.value.tolist() for s in search.suspects},
            fault_deviations={s.name: s.deviation.tolist() for s in search.suspects},
            fault_p={s.name: s.p for s in search.suspects},
        )  # fmt: skip
    return study


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
    readings: Mapping[str, Readings],
    filter: str,
    synthetic: str,
    title: str,
    noise: NoiseEstimate,
    run: Filtered,
    smoothed: Smoothed | None,
) -> FilterStudy:
    """Study of the instants filtered so far."""
    test = consistency(run) if run.status.ok else None
    checks, doubts = suspicion_checks(tested(*(
        Data({name: r.values}, [name], "reading", recordings=[(name, r.time)]) for name, r in readings.items()
    )))  # fmt: skip
    errors = _errors(run)
    unit = {part.name: part.error_unit for part in run.system.space.parts}
    space, begin = run.system.space, noise.initial.belief(run.system, 0.0)
    starts, widths = space.values(begin.x[0]), space.errors(np.sqrt(np.einsum("ii->i", begin.P[0])))
    return FilterStudy(
        status=run.status, message=run.message, title=title, checks=checks, notes=[*noise.notes, *run.notes, *doubts],
        trajectory=_trajectory(run, smoothed, synthetic, title), filter=filter, synthetic=synthetic,
        readings={name: len(r) for name, r in readings.items()},
        left_out={name: int(n.sum()) for name, n in run.gated.items() if n.sum()},
        nis=None if test is None else test.nis, nis_band=() if test is None else tuple(test.band),
        nis_numbers=None if test is None else test.expected, verdict="" if test is None else test.message,
        final={name: np.atleast_1d(run[name][-1]).tolist() for name in unit},
        final_deviation={name: np.atleast_1d(run.deviation[name][-1]).tolist() for name in unit},
        rms_error=errors, smoothed_rms_error=_errors(smoothed),
        rms_deviation={name: _rms(run.deviation[name]) for name in errors},
        noise=noise.values, noise_low=noise.low, noise_high=noise.high, noise_source=noise.sources,
        noise_undetermined=noise.undetermined,
        start={name: np.atleast_1d(v).tolist() for name, v in starts.items()},
        start_deviation={name: np.atleast_1d(v).tolist() for name, v in widths.items()},
        files=MadeFiles({"innovations.csv": partial(_innovations, run, synthetic)}),
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


def _innovations(run: Filtered, synthetic: str) -> str:
    """Innovations with their deviations, in the units of the readings, as a CSV table; empty without a reading."""
    columns: dict[str, np.ndarray] = {"time_s": run.time}
    for name, white in run.innovations.items():
        spread = run.innovation_deviations[name][:, 0]
        for c in range(white.shape[2]):
            label = name if white.shape[2] == 1 else f"{name}[{c}]"
            columns[f"{label}.innovation"] = white[:, 0, c] * spread[:, c]
            columns[f"{label}.deviation"] = np.where(np.isfinite(white[:, 0, c]), spread[:, c], np.nan)
    columns |= {"nis": run.nis[:, 0], "count": run.count[:, 0].astype(float)}
    return csv_text(columns, digits=12, notes=[f"synthetic: {synthetic}"] if synthetic else [])


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
