"""The identification study: masses and friction of a robot from its measured motion and efforts, with values, checks,
table, plots and the file of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Unpack

import numpy as np
import tomli_w

from ..inference.residuals import draw_residuals
from ..lang import Model, ModelError
from ..measurements import Session, Signal
from ..measurements.log import left_out as left_out_rows
from ..results import ArgumentError, SolveStatus, Trajectory, TrajectoryError, Work, naming
from ..results.work import CREW, WorkOptions, study_function
from ..robots import SerialArm
from .bodies import bodies_of
from .checks import HalfCutoff, half_cutoff, judged
from .closed_loop import ClosedLoopRun, follow, within_bound
from .gains import fit_with_gains, with_gains, with_payloads
from .identification_result import IdentificationStudy
from .inertia import Identification, Validation, identify
from .options import ClosedLoop, Fitting, Processing, SyntheticLog
from .recordings import Log, Recordings, Request, measured, request_of, sessions_of, synthetic_recordings
from .regressor import among
from .repeated_fits import (
    BySession,
    LeftOutInTurn,
    Repeated,
    between_sessions,
    leave_out_in_turn,
    repeat_identification,
)
from .rows import Rows, cutoff_of, rows_of, with_offsets


def assembled_study(
    request: Request,
    data: Recordings,
    identification: Identification,
    validation: Validation | None,
    *,
    half: HalfCutoff | None = None,
    repeated: Repeated | None = None,
    loop: ClosedLoop | None = None,
    runs: Sequence[ClosedLoopRun] = (),
    recordings: BySession | None = None,
    left_out: LeftOutInTurn | None = None,
) -> IdentificationStudy:
    """The result of a fit."""
    e, rows, title, parameters = identification.estimate, identification.rows, request.title, identification.numbers
    compared = {name: number for name, number in request.published.items() if name in parameters}
    checks, suspicions = judged(request, data, identification, validation, repeated, half)
    bodies = bodies_of(request, identification)
    full_title = (title or "identification") + (" (synthetic)" if rows.synthetic else "")
    stopped = repeated is not None and repeated.runs.interrupted
    coverage = None
    if repeated is not None:
        c = repeated.coverage
        hits = {n: int(h) for n, h in zip(c.names, c.hits, strict=True)}
        coverage = {"runs": c.runs, "hits": hits, "pooled": c.pooled, "band": list(c.band)}
    return IdentificationStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message=f"{len(e.names)} parameters from {len(rows)} rows",
        title=title,
        objective=float(np.sum((identification.residuals / identification.noise) ** 2)),
        checks=checks | bodies.checks | within_bound(loop, runs),
        parameters=parameters,
        units={n: u for n, u in zip(rows.names, rows.units, strict=True) if n in (*e.names, *e.held)},
        intervals={n: list(e.interval(n)) for n in e.names},
        at_bound=list(e.held),
        corrections=data.corrections | {n: e.value(n) for n in rows.signed},
        estimate=e,
        confidence=identification.confidence,
        noise=identification.noise,
        residual_share=np.sqrt(np.mean(identification.residuals**2, axis=0)) / np.sqrt(np.mean(rows.effort**2, axis=0)),
        held_out_rms=None if validation is None else validation.rms,
        held_out_share=None if validation is None else validation.relative,
        left_out_in_turn=None if left_out is None else left_out.rms,
        row_count=len(rows),
        dropped_share=rows.dropped,
        rows_left_out=sum(left_out_rows(s.trajectory for s in (*data.fitted, *data.held_out)).values()),
        cutoff=rows.cutoff_Hz,
        condition=identification.identifiability.condition,
        left_out={", ".join(t.names): t.p for t in identification.left_out},
        delay=None if identification.delay is None else [identification.delay.seconds, identification.delay.std],
        by_recording=None if recordings is None else recordings.intervals,
        between_recordings=None if recordings is None or recordings.apart is None else recordings.apart.spread,
        truth=data.truth or None,
        coverage=coverage,
        notes=[
            rows.filter_sentence,
            *suspicions,
            *identification.notes,
            *([recordings.apart.message] if recordings is not None and recordings.apart is not None else []),
            *bodies.notes,
        ],
        synthetic=rows.synthetic,
        published={name: parameters[name] / number - 1 for name, number in compared.items() if number}
        if compared
        else None,
        **bodies.values,
        **_of_runs(runs),
        fit=identification,
        numbers=compared,
        closed_loop=runs,
        trajectory=_trajectory(identification, request.how.targets, full_title),
        figures=_figures(identification, validation, full_title, runs, title),
        files={"parameters.toml": _file(identification, full_title), **bodies.files},
        machine_files=("parameters.toml", *bodies.files),
    )


def _of_runs(runs: Sequence[ClosedLoopRun]) -> dict[str, Any]:
    words = ("rms", "maximum", "relative", "effort")
    return {f"closed_loop_{word}": [getattr(run, word) for run in runs] or None for word in words}


def _trajectory(identification: Identification, name: str, title: str) -> Trajectory:
    """Measured and modelled efforts of the first recording."""
    rows = identification.rows
    end = rows.starts[1] if len(rows.starts) > 1 else len(rows)
    part = slice(0, end)
    signals = {f"{name}.measured": rows.effort[part], f"{name}.modelled": identification.modelled()[part]}
    units = dict.fromkeys(signals, rows.effort_unit)
    return Trajectory(rows.time[part], signals, units, title=title, synthetic=rows.synthetic)


def _file(identification: Identification, title: str) -> str:
    """parameters.toml: estimates by name with unit and interval."""
    e = identification.estimate
    table: dict[str, Any] = {"title": title}
    if identification.rows.synthetic:
        table["synthetic"] = identification.rows.synthetic
    for n, unit in zip(identification.rows.names, identification.rows.units, strict=True):
        if n in e.names or n in e.held:
            entry: dict[str, Any] = {"value": e.value(n), "unit": unit}
            entry |= {"at_bound": True} if n in e.held else {"interval_95": list(e.interval(n))}
            table[n] = entry
    return tomli_w.dumps(table)


def _figures(
    identification: Identification, validation: Validation | None, title: str, runs: Sequence[ClosedLoopRun], plain: str
) -> dict[str, Any]:
    rows, fit = identification.rows, identification.modelled()

    def efforts(measured: Rows, modelled: np.ndarray, title: str) -> Any:
        from ..plot.identification import efforts_figure

        return efforts_figure(measured.time, measured.effort, modelled, rows.targets, rows.common_unit, title)

    def residuals() -> Any:
        each = list((rows.effort - fit).T)
        units, times = [rows.common_unit] * len(each), [rows.time] * len(each)
        return draw_residuals(each, rows.targets, units, f"{title}: residuals", times, "time [s]")

    def friction() -> Any:
        from ..plot.identification import friction_figure

        law = rows.Y[:, :, friction_columns] @ identification.parameters[friction_columns]
        rate = {"N": "m/s", "SI": "SI"}.get(rows.common_unit, "rad/s")
        return friction_figure(
            rows.velocity, rows.effort - fit + law, law, rows.targets, (rate, rows.common_unit), title
        )

    def closed_loop() -> Any:
        from ..plot.signals import closed_loop_figure

        caption = f"{plain or 'identification'}: closed loop simulated from the reference"
        return closed_loop_figure([(run.name, run.trajectory) for run in runs], title=caption)

    figures: dict[str, Any] = {"efforts": partial(efforts, rows, fit, title), "residuals": residuals}
    if validation is not None:
        unseen = validation.rows
        figures["held_out"] = partial(efforts, unseen, unseen.effort - validation.errors, f"{title}, held out")
    friction_columns = [k for k, n in enumerate(rows.names) if any(word in n for word in ("coulomb", "viscous"))]
    if friction_columns and rows.velocity.shape[1] == len(rows.targets):
        figures["friction"] = friction
    if runs:
        figures["closed_loop"] = closed_loop
    return figures


Array = np.ndarray


@study_function
def study(
    robot: Model,
    log: Log,
    free: Sequence[str],
    *,
    held_out: Log = (),
    signals: Mapping[str, Signal] | None = None,
    fitting: Fitting | None = None,
    processing: Processing | None = None,
    published: Mapping[str, float] | None = None,
    closed_loop: ClosedLoop | None = None,
    **work_options: Unpack[WorkOptions],
) -> IdentificationStudy:
    """Identify masses and friction, or other parameters in which the efforts are linear, from a measured motion.

    Args:
        robot: the model; friction depends on the sign of the velocity, or on a smooth approximation.
        log: one or several recordings, each a Session or a Trajectory, evenly sampled, with the measured position and
            efforts under the model's names, in SI.
        free: parameters to estimate, arrays by name.
        held_out: recordings of other motions, for validation only.
        signals: how position and efforts follow from the columns of the log, by name, with known or estimated delays,
            scales and offsets. If left out, the log holds position and efforts themselves.
        fitting: names of the measured variables, fixed parameters to watch, bounds, intervals.
        processing: filter and selection of rows.
        published: numbers to compare with, by parameter [SI].
        closed_loop: the controlled model, to simulate with the estimates.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError if the arguments do not fit the robot or each other, if the log cannot be used, and if the
    motion does not determine the parameters.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> s = gt.identify.study(Axis(), log, ["m", "d", "c"])
    >>> s.status.ok, {name: round(value, 1) for name, value in s.parameters.items()}
    (True, {'m': 2.0, 'd': 5.0, 'c': 3.0})
    """
    work = Work(**work_options)
    request = request_of(robot, free, fitting, processing, published, work.title, work)
    data = measured(request, sessions_of(log, "log"), sessions_of(held_out, "held_out"), signals)
    _check_inputs(closed_loop, data)
    if work.interrupted():
        return _stopped(work.title)
    identification, validation, half = _fitted(request, data, "log")
    runs: list[ClosedLoopRun] = []
    if closed_loop is not None:
        runs = follow(closed_loop, identification.numbers, data.fitted + data.held_out, *request.names, work)
    return assembled_study(
        request, data, identification, validation, half=half, loop=closed_loop, runs=runs,
        recordings=_each(request, data, identification, validation), left_out=_in_turn(request, identification),
    )  # fmt: skip


@study_function
def synthetic_study(
    robot: Model,
    synthetic: SyntheticLog,
    free: Sequence[str],
    *,
    plant: Model | None = None,
    motion: Array | None = None,
    fitting: Fitting | None = None,
    processing: Processing | None = None,
    published: Mapping[str, float] | None = None,
    **work_options: Unpack[WorkOptions],
) -> IdentificationStudy:
    """Identify parameters from a synthetic log as `study` does; compare them with the truth, and with `runs` count how
    often their intervals contain it.

    Args:
        robot: the model that is fitted.
        synthetic: motion, sensors and noise.
        free, fitting, processing, published: as for `study`.
        plant: the model that makes the log, if it is not `robot`.
        motion: (n, ...) of the reference variable at the sample times, such as an excitation, instead of sines; the
            held-out motion still consists of sines.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted Monte Carlo keeps the finished runs. Raises ArgumentError as `study` does, and if the motion leaves
    the workspace of the robot.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> options = gt.identify.SyntheticLog(
    ...     duration=8.0, reference="q", centre=[0.0], half_range=0.2, tracking="exact", effort_noise=0.5
    ... )
    >>> s = gt.identify.synthetic_study(Axis(), options, ["m", "d", "c"])
    >>> s.truth, round(s.parameters["m"], 1)
    ({'m': 2.0, 'd': 5.0, 'c': 3.0}, 2.0)
    """
    work = Work(**work_options)
    request = request_of(robot, free, fitting, processing, published, work.title, work)
    data = synthetic_recordings(request, plant or robot, synthetic, motion)
    if work.interrupted():
        return _stopped(work.title)
    identification, validation, half = _fitted(request, data, "synthetic")
    return assembled_study(
        request, data, identification, validation, half=half, repeated=_repeated(request, data, synthetic),
        left_out=_in_turn(request, identification),
    )  # fmt: skip


def _each(
    request: Request, data: Recordings, identification: Identification, validation: Validation | None
) -> BySession | None:
    """Estimates from each recording alone, held-out ones included."""
    if len(data.fitted) + len(data.held_out) < 2:
        return None
    request.work.progress("fitting each recording", 0.7)
    others = () if validation is None else zip(data.held_out, map(validation.rows.part, range(len(data.held_out))),
                                               strict=True)  # fmt: skip
    return between_sessions(
        identification, data.fitted, list(others), nonnegative=request.nonnegative, confidence=request.how.confidence
    )


def _in_turn(request: Request, identification: Identification) -> LeftOutInTurn | None:
    how = request.how
    if how.folds is None:
        return None
    request.work.progress("cross-validating", 0.8)
    with naming("fitting.folds", ModelError):
        return leave_out_in_turn(
            identification, how.folds, nonnegative=request.nonnegative, confidence=how.confidence
        )  # fmt: skip


def _stopped(title: str) -> IdentificationStudy:
    return IdentificationStudy(status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=title)


def _check_inputs(loop: ClosedLoop | None, data: Recordings) -> None:
    for name in [] if loop is None else loop.inputs:
        for session in (*data.fitted, *data.held_out):
            if name not in session.trajectory:
                raise ArgumentError(f"'{session.name}' has no signal '{name}'", "closed_loop.inputs")


def _fitted(
    request: Request, data: Recordings, place: str
) -> tuple[Identification, Validation | None, HalfCutoff | None]:
    request.work.progress("fitting", 0.3)
    how, processing = request.how, request.processing

    def rows_from(sessions: Sequence[Session], selection: Processing, masses: Sequence[float]) -> Rows:
        rows = rows_of(sessions, request.regressor, selection, *request.names, accept=how.accept)
        if not any(masses):
            return rows
        assert isinstance(request.robot, SerialArm)
        return with_payloads(rows, request.robot, request.regressor, masses, how.payload_centre)

    def prepared(rows: Rows, point: tuple[np.ndarray, np.ndarray] | None, per_session: bool) -> Rows:
        if point is not None:
            rows = with_gains(rows, how.targets, *point, free=data.gains)
        if data.offsets is None:
            return rows
        return with_offsets(rows, how.targets, per_session=per_session, drift=how.drift)

    def fit_once(rows: Rows) -> Identification:
        return identify(rows, [*request.free, *rows.signed], nonnegative=request.nonnegative, confidence=how.confidence)

    def fit(rows: Rows) -> Identification:
        if not data.alignments:
            return fit_once(rows)
        (alignment, values), first = data.alignments[0], fit_once(rows).parameters
        return fit_once(alignment.with_columns(rows, values, first[: request.regressor.size]))

    count, masses, per_session = len(data.fitted), how.payloads or [], data.offsets == "session"

    def fit_whole(rows: Rows) -> tuple[Identification, tuple[np.ndarray, np.ndarray] | None]:
        loaded = any(masses[:count])
        if data.gains:
            # of an arm only a payload is known well enough: its friction, even if fixed, is no measure of its gains
            known = loaded if request.regressor.base else bool(np.any(rows.y0))
            return fit_with_gains(rows, lambda r, at: prepared(r, at, per_session), fit, known=known)
        identification = fit(prepared(rows, None, per_session))
        if not loaded:
            return identification, None
        # the payload shows errors of the fixed gains: test for them
        point = identification.parameters[: len(rows.names)], np.ones(len(rows.targets))
        return fit(prepared(rows, point, per_session)), point

    def compared_cutoffs(rows: Rows, identification: Identification) -> HalfCutoff | None:
        lower = replace(processing, cutoff=rows.cutoff_Hz / 2, every=None)
        try:
            half, _ = fit_whole(rows_from(data.fitted, lower, masses[:count]))
            usual = cutoff_of(data.fitted, how.known)
        except (ModelError, TrajectoryError):  # too short for it
            return None
        return half_cutoff(identification, half, usual if usual < 0.8 * rows.cutoff_Hz else rows.cutoff_Hz / 2)

    with naming(place, ModelError, TrajectoryError):
        rows = rows_from(data.fitted, processing, masses[:count])
        identification, point = fit_whole(rows)
        half = compared_cutoffs(rows, identification)
        if not data.held_out:
            return identification, None, half
        fixed = replace(processing, cutoff=rows.cutoff_Hz, every=rows.every)
        unseen = prepared(rows_from(data.held_out, fixed, masses[count:]), point, False)
        if data.alignments:
            alignment, values = data.alignments[1]
            unseen = alignment.with_columns(unseen, values, identification.parameters[: request.regressor.size])
        return identification, identification.validate(unseen), half


def _repeated(request: Request, data: Recordings, s: SyntheticLog) -> Repeated | None:
    if s.runs == 0 or data.simulator is None:
        return None
    regressor, work = request.regressor, request.work
    with naming("synthetic.runs", RuntimeError, ValueError):
        return repeat_identification(
            data.simulator,
            regressor,
            {regressor.names[k]: data.truth[regressor.names[k]] for k in among(regressor.names, request.free)},
            data.sensors,
            s.runs,
            s.seed,
            free=request.free,
            processing=request.processing,
            confidence=request.how.confidence,
            processes=s.processes if CREW.get() is None else None,
            progress=lambda done, runs: work.progress("repeating", done / runs, {"runs": float(done)}),
            interrupted=work.interrupted,
        )
