"""Input of an identification: its arguments, checked, and recordings, measured or synthetic, with their signals
corrected for delays, scales and offsets."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmodel.measurements import ESTIMATE, Corrections, Session, cutoff_for

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..measurements import Signal, session_of
from ..results import ArgumentError, Trajectory, TrajectoryError, Work, naming
from ..results.suspicion import EVERY
from ..robots import actuator_closed_loop
from .gains import by_data_sheet, check_payloads
from .options import Fitting, Processing, SyntheticLog
from .regressor import ParameterError, Regressor, among, scalar_parameters
from .rows import rows_of, with_offsets
from .simulated_log import LogSimulator, Sensors, Tracking, reference_motion


@dataclass(frozen=True, eq=False)
class Request:
    """Free parameters, options, the regressor of free and watched parameters, numbers to compare with."""

    robot: Model
    free: Sequence[str]
    how: Fitting
    processing: Processing
    regressor: Regressor
    published: Mapping[str, float]
    title: str
    work: Work

    @property
    def nonnegative(self) -> bool | list[str]:
        """Parameters that must not be negative; base parameters may be."""
        if self.how.inertias is None or self.how.nonnegative is not True:
            return self.how.nonnegative
        return [n for n in self.regressor.names if n not in self.regressor.base]

    @property
    def names(self) -> tuple[str, str]:
        """Names of the known variable and of the efforts."""
        return self.how.known, self.how.targets


def request_of(
    robot: Model,
    free: Sequence[str],
    fitting: Fitting | None,
    processing: Processing | None,
    published: Mapping[str, float] | None,
    title: str,
    work: Work,
) -> Request:
    """From the arguments of a study. Raises ArgumentError."""
    how = fitting or Fitting()
    regressor = regressor_of(robot, free, how)
    for name in published or {}:
        with naming(f"published.{name}", ModelError):
            scalar_parameters(flat_of(robot), [name])
    work.progress("reading", 0.1)
    return Request(
        robot, free_of(regressor, free, how), how, processing or Processing(), regressor, published or {}, title, work
    )


def regressor_of(robot: Model, free: Sequence[str], how: Fitting) -> Regressor:
    """The regressor of free and watched parameters. Raises ArgumentError."""
    for argument, names in (("known", [how.known]), ("targets", [how.targets]), ("inputs", how.inputs)):
        for name in names:
            with naming(f"fitting.{argument}", ModelError):
                flat_of(robot).lookup(name)
    known = [how.known, *how.inputs]
    if how.inertias is not None and how.watch:
        raise ArgumentError("cannot be combined with inertias, which free all identifiable parameters", "fitting.watch")
    try:
        if how.inertias is not None:
            from .base_parameters import BaseRegressor  # here: only arms need it

            regressor = BaseRegressor(robot, free, known, how.targets)
        else:
            regressor = Regressor(robot, [*free, *how.watch], known, how.targets)
    except ParameterError as error:
        watched = {error.parameter, error.parameter.partition("[")[0]} & set(how.watch)
        raise ArgumentError(str(error), "fitting.watch" if watched else "free") from error
    except ModelError as error:
        raise ArgumentError(str(error), "free") from error
    if not isinstance(how.nonnegative, bool):
        with naming("fitting.nonnegative", ModelError):
            among(regressor.names, how.nonnegative)
    return regressor


def free_of(regressor: Regressor, free: Sequence[str], how: Fitting) -> Sequence[str]:
    """Names of the estimated parameters: those in `free`, and base parameters if inertias are identified."""
    return free if how.inertias is None else regressor.names


def corrected(
    corrections: Corrections,
    regressor: Regressor,
    processing: Processing,
    free: Sequence[str],
    known: str = "q",
    targets: str = "tau",
    offsets: bool = False,
) -> tuple[tuple[Session, ...], dict[str, float]]:
    """Estimate the free corrections of the signals; return the corrected sessions and the estimates by name [SI].

    Args:
        corrections: the signals of raw sessions, with the delays, scales and offsets to estimate.
        regressor, processing, known, targets: as for `rows_of`.
        free: parameters of the regressor that are fitted at the same time.
        offsets: whether the fit also has a free offset of the efforts for each session, see `with_offsets`.

    The corrections minimise the residual of the least-squares fit; variable projection eliminates the parameters of the
    fit. A delay is positive if the column is late [s]. Raises ModelError if the scale of the efforts is free: it cannot
    be distinguished from the masses.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> truth = gt.identify.LogSimulator(Axis(), q).truth
    >>> late = np.interp(time - 0.006, time, truth["tau"])  # the efforts come 6 ms late
    >>> log = gt.Trajectory(time, {"q": q, "tau": late}, {"q": "m", "tau": "N"})
    >>> Signal = gt.measurements.Signal
    >>> signals = {"q": Signal("q", "m"), "tau": Signal("tau", "N", delay="estimate")}
    >>> raw = gt.measurements.Corrections(signals, [gt.measurements.session_of(log)])
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> how = gt.identify.Processing(cutoff=8.0)
    >>> _, values = gt.identify.corrected(raw, regressor, how, ["m", "d", "c"])
    >>> {name: round(value, 3) for name, value in values.items()}
    {'tau.delay': 0.006}
    """
    if corrections.signals[targets].scale == ESTIMATE:
        raise ModelError(
            "the scale of the efforts cannot be distinguished from masses and friction; give it a number, or let "
            "gt.identify.study estimate it with a known payload"
        )
    if not corrections.free:
        return corrections.apply(), {}
    first = corrections.apply(corrections.start)
    cutoff = processing.cutoff or max(cutoff_for(s.trajectory[known], s.sample_time) for s in first)
    # keep all rows: the number of residuals must not depend on the corrections
    steady = replace(processing, cutoff=cutoff, position_step=0.0, mask_steps=0.0)
    fitted = among(regressor.names, free)
    fixed = [k for k in range(regressor.size) if k not in fitted]

    def residual(sessions: tuple[Session, ...]) -> np.ndarray:
        rows = rows_of(sessions, regressor, steady, known, targets, accept=EVERY)  # the fit itself checks the log
        A = rows.Y[:, :, fitted].reshape(-1, len(fitted))
        if offsets:
            A = np.hstack([A, with_offsets(rows, targets).Y[:, :, regressor.size :].reshape(len(A), -1)])
        b = (rows.effort - rows.y0 - rows.Y[:, :, fixed] @ rows.nominal[fixed]).reshape(-1)
        return b - A @ np.linalg.lstsq(A, b, rcond=None)[0]

    values = corrections.estimate(residual)
    return corrections.apply(values), corrections.named(values)


Array = np.ndarray
Log = Session | Trajectory | Sequence[Session | Trajectory]


@dataclass
class Recordings:
    """Recordings to fit and to hold out, estimated corrections, and the truth of a synthetic plant."""

    fitted: tuple[Session, ...]
    held_out: tuple[Session, ...] = ()
    corrections: dict[str, float] = field(default_factory=dict)
    # estimated offsets of the efforts are parameters of the fit, by "session" or for "all"
    offsets: str | None = None
    gains: bool = False  # whether the fit has a free scale of each effort
    truth: dict[str, float] = field(default_factory=dict)
    simulator: LogSimulator | None = None
    sensors: Sensors = field(default_factory=Sensors)


def sessions_of(log: Log, argument: str) -> tuple[Session, ...]:
    """One or several recordings as sessions. Raises ArgumentError for `argument`."""
    # a session is a tuple itself
    several = [log] if isinstance(log, (Session, Trajectory)) else list(log)
    with naming(argument, TrajectoryError):
        return tuple(r if isinstance(r, Session) else session_of(r, f"recording {n}") for n, r in enumerate(several, 1))


def measured(
    request: Request, raw: tuple[Session, ...], others: tuple[Session, ...], signals: Mapping[str, Signal] | None
) -> Recordings:
    """Recordings with corrected signals; without `signals` they hold the quantities already.

    Raises ArgumentError if a quantity is missing or has the wrong width, and if a correction is not determined.
    """
    if not raw:
        raise ArgumentError("is empty; expected at least one recording", "log")
    regressor, (known, targets) = request.regressor, request.names
    shapes = {s.name: s.shape for s in regressor.inputs}
    expected = [(known, shapes[known], "known"), (targets, regressor.outputs[0].shape, "targets")]
    for name, shape, what in expected + [(name, shapes[name], "inputs") for name in request.how.inputs]:
        missing = next((s.name for s in (*raw, *others) if name not in s.trajectory), None)
        if missing is not None:
            raise ArgumentError(f"'{missing}' has no signal '{name}'; use the names of the robot", "log")
        width = raw[0].trajectory[name].shape[1:]
        if what == "inputs" and width == (1,) and shape == ():  # one column
            continue
        if width != shape:
            raise ArgumentError(
                f"has {width[0] if width else 1} columns; '{name}' of the robot has {shape[0] if shape else 1}",
                f"log.{what}",
            )
    check_payloads(request.how, bool(regressor.base), len(raw), len(others))
    if signals is None:
        return Recordings(raw, others)
    table, gains = by_data_sheet(signals, targets, any(request.how.payloads or ()))
    effort, offsets = table[targets], None
    if effort.offset == ESTIMATE:
        offsets = "session" if "offset" in effort.per_session and len(raw) > 1 else "all"
        if offsets == "session" and others:
            raise _by_session("offset", targets)
        table[targets] = dataclasses.replace(effort, offset=0.0)
    with naming("log", TrajectoryError, ModelError):
        fitted, values = corrected(
            Corrections(table, raw), regressor, request.processing, request.free, known, targets, offsets is not None
        )
        return Recordings(fitted, _held_out(table, others, values) if others else (), values, offsets, gains)


def _held_out(signals: dict[str, Signal], others: tuple[Session, ...], values: dict[str, float]) -> tuple[Session, ...]:
    """Held-out recordings with the corrections that all sessions share. Raises ArgumentError for one by session."""
    corrections = Corrections(signals, others)
    estimates = [values.get(f.name) for f in corrections.free]
    for f, value in zip(corrections.free, estimates, strict=True):
        if value is None or f.session is not None:
            raise _by_session(f.what, f.signal)
    return corrections.apply([v for v in estimates if v is not None])


def _by_session(what: str, signal: str) -> ArgumentError:
    return ArgumentError(
        f"{what} of {signal} differs by session and has no value for another recording; take it out of per_session, "
        "or give it a number",
        "held_out",
    )


def synthetic_recordings(request: Request, plant: Model, s: SyntheticLog, motion: Array | None) -> Recordings:
    """A log of the plant to fit, and one of another motion to hold out. Raises ArgumentError."""
    if request.how.inputs:
        raise ArgumentError("is for measured logs; a synthetic log has only the motion", "fitting.inputs")
    if request.how.payloads is not None:
        raise ArgumentError("is for measured logs", "fitting.payloads")
    noise = tuple(s.effort_noise) if isinstance(s.effort_noise, list) else float(s.effort_noise)
    count = len(request.regressor.columns)
    if isinstance(noise, tuple) and len(noise) != count:
        raise ArgumentError(f"has {len(noise)} numbers; expected one, or {count}", "synthetic.effort_noise")
    sensors = Sensors(s.position_step, noise, s.effort_colour, s.effort_step)
    tracking = Tracking(**actuator_closed_loop()) if s.tracking == "dressler_2012" else None
    simulators, logs = [], []
    for k, rows in enumerate((motion, None)):
        reference = reference_motion(request.how.known, s, plant, s.motion_seed + k, rows)
        if tracking is not None and reference.shape[1:] != (3,):
            raise ArgumentError('is for three carts; use "exact" for this robot', "synthetic.tracking")
        with naming("synthetic", ModelError, ValueError):
            simulators.append(LogSimulator(plant, reference, s.sample_time, *request.names, tracking))
        logs.append(Session(f"synthetic log {k + 1}", simulators[k].draw(s.seed + k, sensors), s.sample_time))
    values = {q.name: q.value for q in flat_of(plant).parameters}
    truth = request.regressor.numbers_of(values)
    return Recordings((logs[0],), (logs[1],), truth=truth, simulator=simulators[0], sensors=sensors)
