"""What an identification works on: the model and its regressor, recordings measured or made up."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gtmodel.compiler.causal import flat_of
from gtmodel.identify import (
    LogSimulator,
    Processing,
    Regressor,
    Sensors,
    Tracking,
    corrected,
)
from gtmodel.identify.parameter_names import among
from gtmodel.lang import Model, ModelError
from gtmodel.measurements import ESTIMATE, Corrections, Session, Signal
from gtmodel.problem_files import python_models, robots
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.log_keys import MeasuredSignal
from gtmodel.results import TrajectoryError
from gtmodel.robots import actuator_closed_loop, catalogue
from gtmodel.robots.by_direction import VARIANTS, inertia_variant

from .identification_keys import Log, Schema, Synthetic
from .identification_motion import reference_motion


@dataclass
class Recordings:
    """Recordings to fit and to hold out, corrections found on the way, and for made-up ones the plant's truth."""

    fitted: tuple[Session, ...]
    held_out: tuple[Session, ...] = ()
    corrections: dict[str, float] = field(default_factory=dict)
    # of the efforts, if they are to be estimated: parameters of the fit, by "session" or for "all"
    offsets: str | None = None
    truth: dict[str, float] = field(default_factory=dict)
    simulator: LogSimulator | None = None
    sensors: Sensors = field(default_factory=Sensors)


def model_of(problem: Schema, context: Context) -> tuple[Model, list[str]]:
    """The model to be fitted, and the names of what is free. Raises InputError."""
    if problem.variant is None:
        if not problem.free:
            raise InputError("is missing; name the parameters to be estimated, or a variant", "free")
        return _robot(problem, context, problem.parameters), list(problem.free)
    _check_variant(problem)
    scale = problem.friction.velocity_scale_m_s
    more: dict[str, Any] = {} if scale is None else {"velocity_scale": scale}
    try:
        variant = inertia_variant(
            problem.variant, problem.robot, problem.friction.smoothing or "sign", **more, **problem.parameters
        )
    except ModelError as error:
        raise InputError(str(error), "parameters" if problem.parameters else "variant") from error
    return variant.robot, list(problem.free or variant.free)


def _check_variant(problem: Schema) -> None:
    entry = catalogue.entries().get(problem.robot)
    if problem.variant not in VARIANTS:
        raise InputError(f"there is no variant '{problem.variant}'; there are {', '.join(VARIANTS)}", "variant")
    if entry is None or entry.family != "three_link":
        raise InputError(f"applies to three-link robots of the catalogue; '{problem.robot}' is none", "variant")
    for key in ("inertia", "payload_kg"):
        if getattr(problem, key) is not None:
            raise InputError("a variant says which masses there are; leave one of the two out", key)
    if problem.friction.smoothing == "piecewise_linear":
        raise InputError('a variant takes "sign" or "tanh"', "friction.smoothing")


def _robot(problem: Schema, context: Context, parameters: dict[str, Any]) -> Model:
    in_python = python_models.is_reference(problem.robot)
    smoothing = problem.friction.smoothing or (None if in_python else "sign")
    return robots.resolve(
        problem.robot,
        context,
        parameters=parameters,
        inertia=problem.inertia,
        smoothing=smoothing,
        velocity_scale=problem.friction.velocity_scale_m_s,
        payload=problem.payload_kg,
    )


def regressor_of(problem: Schema, model: Model, free: Sequence[str]) -> Regressor:
    """The regressor of what is free and what is watched. Raises InputError."""
    flat = flat_of(model)
    for key in ("known", "targets"):
        try:
            flat.lookup(getattr(problem, key))
        except ModelError as error:
            raise InputError(str(error), key) from error
    try:
        return Regressor(model, [*free, *problem.watch], problem.known, problem.targets)
    except ModelError as error:
        at = "watch" if any(f"'{n}" in str(error) for n in problem.watch) else "free" if problem.free else "variant"
        raise InputError(str(error), at) from error


def processing_of(problem: Schema) -> Processing:
    """The filter as the file has it."""
    f = problem.filter
    return Processing(f.cutoff_Hz, f.order, f.every, f.position_step, f.mask_steps)


def recordings(problem: Schema, context: Context, regressor: Regressor, free: Sequence[str]) -> Recordings:
    """Measured or made-up recordings. Raises InputError."""
    if (problem.log is None) == (problem.synthetic is None):
        found = "both" if problem.log else "none of them"
        raise InputError(f"expected one of [log] and [synthetic]; found {found}", "log")
    if problem.log is not None:
        return _measured(problem, problem.log, context, regressor, free)
    assert problem.synthetic is not None
    return _made_up(problem, problem.synthetic, context, regressor)


def _measured(problem: Schema, log: Log, context: Context, regressor: Regressor, free: Sequence[str]) -> Recordings:
    known = next(s for s in regressor.inputs if s.name == problem.known)
    target = regressor.outputs[0]
    signals = {
        problem.known: _signal(log.position, known.unit, "log.position"),
        problem.targets: _signal(log.effort, target.unit, "log.effort"),
    }
    if problem.closed_loop is not None:
        signals |= problem.closed_loop.signals(context)
    raw = log.sessions(signals, context)
    others = log.sessions(signals, context, files=log.held_out, key="log.held_out") if log.held_out else ()
    for name, shape, key in ((problem.known, known.shape, "position"), (problem.targets, target.shape, "effort")):
        width = raw[0].trajectory[name].shape[1:]
        if width != shape:
            raise InputError(
                f"has {width[0] if width else 1} columns; '{name}' of the robot has {shape[0] if shape else 1}",
                f"log.{key}.column",
            )
    try:
        offsets = None
        if log.effort.offset == ESTIMATE:
            offsets = "session" if "offset" in log.effort.per_session and len(raw) > 1 else "all"
            if offsets == "session" and others:
                raise _by_session("offset", problem.targets)
            signals[problem.targets] = dataclasses.replace(signals[problem.targets], offset=0.0)
        fitted, values = corrected(
            Corrections(signals, raw),
            regressor,
            processing_of(problem),
            free,
            problem.known,
            problem.targets,
            offsets=offsets is not None,
        )
        held_out = _held_out(signals, others, values) if others else ()
        return Recordings(fitted, held_out, values, offsets)
    except (TrajectoryError, ModelError) as error:
        raise InputError(str(error), "log") from error


def _held_out(signals: dict[str, Signal], others: tuple[Session, ...], values: dict[str, float]) -> tuple[Session, ...]:
    """Held-out recordings, corrected by what holds for all sessions; what differs by session cannot be known there."""
    corrections = Corrections(signals, others)
    wanted = [values.get(f.name) for f in corrections.free]
    for f, value in zip(corrections.free, wanted, strict=True):
        if value is None or f.session is not None:
            raise _by_session(f.what, f.signal)
    return corrections.apply([v for v in wanted if v is not None])


def _by_session(what: str, signal: str) -> InputError:
    return InputError(
        f"{what} of {signal} differs by session and cannot be carried to another recording; take it out of "
        "per_session, or give it a number",
        "log.held_out",
    )


def _signal(measured: MeasuredSignal, unit: str, key: str) -> Signal:
    try:
        return dataclasses.replace(measured.signal(f"{key}._"), quantity_unit=unit)
    except TrajectoryError as error:
        raise InputError(str(error), key) from error
    except InputError as error:
        raise InputError(error.sentence, key) from error


def _made_up(problem: Schema, s: Synthetic, context: Context, regressor: Regressor) -> Recordings:
    plain = problem.model_copy(update={"variant": None})
    plant = _robot(plain, context, {**problem.parameters, **s.parameters})
    noise = tuple(s.effort_noise) if isinstance(s.effort_noise, list) else float(s.effort_noise)
    wanted = len(regressor.columns)
    if isinstance(noise, tuple) and len(noise) != wanted:
        raise InputError(f"has {len(noise)} numbers; expected one, or {wanted}", "synthetic.effort_noise")
    sensors = Sensors(s.position_step, noise, s.effort_colour, s.effort_step)
    simulators = []
    for seed in (s.motion_seed, s.motion_seed + 1):
        of_file = s.reference_file is not None and seed == s.motion_seed
        reference = reference_motion(problem.known, s, plant, None if of_file else seed, context)
        tracking = None
        if s.tracking == "dressler_2012":
            tracking = Tracking(**actuator_closed_loop())
            if reference.shape[1:] != (3,):
                raise InputError('is for three carts; take "exact" for this robot', "synthetic.tracking")
        try:
            simulators.append(LogSimulator(plant, reference, s.sample_time_s, problem.known, problem.targets, tracking))
        except (ModelError, ValueError) as error:
            raise InputError(str(error), "synthetic") from error
    logs = [
        Session(f"synthetic log {k + 1}", simulator.draw(s.seed + k, sensors), s.sample_time_s)
        for k, simulator in enumerate(simulators)
    ]
    flat = flat_of(plant)
    values = {q.name: q.value for q in flat.parameters}
    truth = {n: values[n] for n in regressor.names if n in values}
    return Recordings((logs[0],), (logs[1],), truth=truth, simulator=simulators[0], sensors=sensors)


def scalars_of(regressor: Regressor, names: Sequence[str]) -> list[str]:
    """Scalar names of what is free, in the regressor's order."""
    return [regressor.names[k] for k in among(regressor.names, names)]
