"""Input of an identification: its arguments, checked, and recordings, measured or synthetic, with their signals
corrected for delays, scales and offsets."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmodel.measurements import ESTIMATE, Corrections, Session

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..measurements import Signal, session_of
from ..results import ArgumentError, Trajectory, TrajectoryError, Work, naming
from ..robots import actuator_closed_loop
from .alignment import CorrectionModel, aligned
from .gains import by_data_sheet, check_payloads
from .options import Fitting, Processing, SyntheticLog
from .regressor import ParameterError, Regressor, among, scalar_parameters
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


Array = np.ndarray
Log = Session | Trajectory | Sequence[Session | Trajectory]


@dataclass
class Recordings:
    """Recordings to fit and to hold out, estimated corrections, and the truth of a synthetic plant."""

    fitted: tuple[Session, ...]
    held_out: tuple[Session, ...] = ()
    corrections: dict[str, float] = field(default_factory=dict)
    # how the rows of either depend on the estimated corrections, with their values
    alignments: tuple[tuple[CorrectionModel, Array], ...] = ()
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
    check_payloads(request.how, bool(request.regressor.base), len(raw), len(others))
    estimated = signals is not None and signals[targets].offset == ESTIMATE
    if request.how.drift and not (estimated and not others):
        lack = "needs estimated offsets of the efforts" if not estimated else "belongs to one recording"
        todo = 'set offset = "estimate" of the efforts' if not estimated else "leave out held_out"
        raise ArgumentError(f"{lack}; {todo}, or drift = false", "fitting.drift")
    if signals is None:
        return Recordings(raw, others)
    table, gains = by_data_sheet(signals, targets, any(request.how.payloads or ()))
    effort, offsets = table[targets], None
    if effort.offset == ESTIMATE:
        offsets = "session" if "offset" in effort.per_session and len(raw) > 1 else "all"
        if offsets == "session" and others:
            raise _by_session("offset", targets)
        table[targets] = dataclasses.replace(effort, offset=0.0)
    work = request.work

    def progress(share: float) -> bool:
        work.progress("estimating " + ", ".join(dict.fromkeys(f.what for f in corrections.free)), share)
        return work.interrupted()

    with naming("log", TrajectoryError, ModelError):
        corrections = Corrections(table, raw)
        alignment, values = aligned(
            corrections, regressor, request.processing, request.free, known, targets, offsets is not None, progress
        )
        alignments, fitted, unseen = [(alignment, values)], alignment.sessions(values), ()
        if others:
            alignments.append(_held_out(alignment, others, corrections.named(values)))
            unseen = alignments[1][0].sessions(alignments[1][1])
        return Recordings(
            fitted, unseen, corrections.named(values), tuple(alignments) if corrections.free else (), offsets, gains
        )


def _held_out(
    alignment: CorrectionModel, others: tuple[Session, ...], values: dict[str, float]
) -> tuple[CorrectionModel, Array]:
    """Held-out recordings with the corrections that all sessions share. Raises ArgumentError for one by session."""
    corrections = Corrections(alignment.corrections.signals, others)
    for f in corrections.free:
        if f.name not in values or f.session is not None:
            raise _by_session(f.what, f.signal)
    return replace(alignment, corrections=corrections), np.array([values[f.name] for f in corrections.free])


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
