"""What an identification works on: recordings measured, with their corrections, or synthetic, with their truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..measurements import ESTIMATE, Corrections, Session, Signal, session_of
from ..results import ArgumentError, Trajectory, TrajectoryError, naming
from ..robots import actuator_closed_loop
from .asked import Asked
from .corrected import corrected
from .options import SyntheticLog
from .reference_motion import reference_motion
from .simulated_log import LogSimulator, Sensors
from .tracking import Tracking

Array = np.ndarray
Log = Session | Trajectory | Sequence[Session | Trajectory]


@dataclass
class Recordings:
    """Recordings to fit and to hold out, corrections found on the way, and for synthetic ones the plant's truth."""

    fitted: tuple[Session, ...]
    held_out: tuple[Session, ...] = ()
    corrections: dict[str, float] = field(default_factory=dict)
    # of the efforts, if they are to be estimated: parameters of the fit, by "session" or for "all"
    offsets: str | None = None
    truth: dict[str, float] = field(default_factory=dict)
    simulator: LogSimulator | None = None
    sensors: Sensors = field(default_factory=Sensors)


def sessions_of(log: Log, argument: str) -> tuple[Session, ...]:
    """One recording or several, as sessions. Raises ArgumentError with that argument."""
    # a session is a tuple itself
    several = [log] if isinstance(log, (Session, Trajectory)) else list(log)
    with naming(argument, TrajectoryError):
        return tuple(
            one if isinstance(one, Session) else session_of(one, f"recording {n}") for n, one in enumerate(several, 1)
        )


def measured(
    asked: Asked, raw: tuple[Session, ...], others: tuple[Session, ...], signals: Mapping[str, Signal] | None
) -> Recordings:
    """Recordings with their columns corrected; those without signals hold the quantities already.

    Raises ArgumentError for a quantity that is missing or of another width, and corrections that are undetermined.
    """
    if not raw:
        raise ArgumentError("is empty; expected a recording or more", "log")
    regressor, (known, targets) = asked.regressor, asked.names
    shapes = {s.name: s.shape for s in regressor.inputs}
    wanted = [(known, shapes[known], "known"), (targets, regressor.outputs[0].shape, "targets")]
    for name, shape, what in wanted + [(name, shapes[name], "inputs") for name in asked.how.inputs]:
        missing = next((s.name for s in (*raw, *others) if name not in s.trajectory), None)
        if missing is not None:
            raise ArgumentError(f"'{missing}' holds no '{name}'; name its signals as the robot does", "log")
        width = raw[0].trajectory[name].shape[1:]
        if what == "inputs" and width == (1,) and shape == ():  # one column
            continue
        if width != shape:
            raise ArgumentError(
                f"has {width[0] if width else 1} columns; '{name}' of the robot has {shape[0] if shape else 1}",
                f"log.{what}",
            )
    if signals is None:
        return Recordings(raw, others)
    given = dict(signals)
    effort, offsets = given[targets], None
    if effort.offset == ESTIMATE:
        offsets = "session" if "offset" in effort.per_session and len(raw) > 1 else "all"
        if offsets == "session" and others:
            raise _by_session("offset", targets)
        given[targets] = dataclasses.replace(effort, offset=0.0)
    with naming("log", TrajectoryError, ModelError):
        fitted, values = corrected(
            Corrections(given, raw), regressor, asked.processing, asked.free, known, targets, offsets is not None
        )
        return Recordings(fitted, _held_out(given, others, values) if others else (), values, offsets)


def _held_out(signals: dict[str, Signal], others: tuple[Session, ...], values: dict[str, float]) -> tuple[Session, ...]:
    """Held-out recordings, corrected by what holds for all sessions; what differs by session cannot be known there."""
    corrections = Corrections(signals, others)
    wanted = [values.get(f.name) for f in corrections.free]
    for f, value in zip(corrections.free, wanted, strict=True):
        if value is None or f.session is not None:
            raise _by_session(f.what, f.signal)
    return corrections.apply([v for v in wanted if v is not None])


def _by_session(what: str, signal: str) -> ArgumentError:
    return ArgumentError(
        f"{what} of {signal} differs by session and cannot be carried to another recording; take it out of "
        "per_session, or give it a number",
        "held_out",
    )


def synthetic_recordings(asked: Asked, plant: Model, s: SyntheticLog, motion: Array | None) -> Recordings:
    """A log of the plant to fit and one of another motion to hold out. Raises ArgumentError."""
    if asked.how.inputs:
        raise ArgumentError("is for measured logs; a synthetic one has the motion alone", "fitting.inputs")
    noise = tuple(s.effort_noise) if isinstance(s.effort_noise, list) else float(s.effort_noise)
    wanted = len(asked.regressor.columns)
    if isinstance(noise, tuple) and len(noise) != wanted:
        raise ArgumentError(f"has {len(noise)} numbers; expected one, or {wanted}", "synthetic.effort_noise")
    sensors = Sensors(s.position_step, noise, s.effort_colour, s.effort_step)
    tracking = Tracking(**actuator_closed_loop()) if s.tracking == "dressler_2012" else None
    simulators, logs = [], []
    for k, given in enumerate((motion, None)):
        reference = reference_motion(asked.how.known, s, plant, s.motion_seed + k, given)
        if tracking is not None and reference.shape[1:] != (3,):
            raise ArgumentError('is for three carts; take "exact" for this robot', "synthetic.tracking")
        with naming("synthetic", ModelError, ValueError):
            simulators.append(LogSimulator(plant, reference, s.sample_time, *asked.names, tracking))
        logs.append(Session(f"synthetic log {k + 1}", simulators[k].draw(s.seed + k, sensors), s.sample_time))
    values = {q.name: q.value for q in flat_of(plant).parameters}
    truth = asked.regressor.numbers_of(values)
    return Recordings((logs[0],), (logs[1],), truth=truth, simulator=simulators[0], sensors=sensors)
