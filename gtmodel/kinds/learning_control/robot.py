"""The robot of a problem of learning control: by parameters, from a log, from a model, or from printed numbers."""

from __future__ import annotations

import numpy as np

from gtmodel.control.learning import LearningRobot, ModelledRobot, identified_axis, lag_robot, linear_axis
from gtmodel.lang import ModelError
from gtmodel.problem_files import python_models
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.from_options import options_of
from gtmodel.results import ArgumentError

from .keys import LearnedPlantSection, Schema
from .runs import recorded

PERIOD = 0.004  # s, of plants that are not of a log
EVEN = 0.01  # of a period


def robot_of(problem: Schema, context: Context) -> LearningRobot | ModelledRobot:
    """What [robot] or [plant] says. Raises InputError."""
    section = problem.plant
    if section is None:
        return options_of(problem, "robot")["robot"]
    if "robot" in problem.model_fields_set:
        raise InputError("is the robot by a log, a model or numbers; leave [robot] out", "plant")
    ways = [name for name in ("files", "model", "b") if getattr(section, name)]
    if len(ways) != 1:
        raise InputError(
            f"expected one of files, model and b with a; found {' and '.join(ways) or 'none of them'}", "plant"
        )
    try:
        if ways == ["files"]:
            return _of_a_log(section, context)
        if ways == ["model"]:
            return _of_a_model(section, context)
        return lag_robot(section.b, section.a, section.delay_samples or 0, section.sample_time_s or PERIOD)
    except ArgumentError as error:
        raise InputError(error.message, f"plant.{error.argument}" if error.argument == "a" else "plant") from error


def _of_a_log(section: LearnedPlantSection, context: Context) -> ModelledRobot:
    if section.signals is None:
        raise InputError("is missing; name the columns of reference and motor", "plant.signals")
    log = recorded(section, section.signals, section.files, "plant", context, section.synthetic)
    steps = np.diff(log.time)
    period = section.sample_time_s or float(np.median(steps))
    if np.any(np.abs(steps - period) > EVEN * period):
        raise InputError(f"has rows that are not {1e3 * period:g} ms apart; resample it (kind resampling)", "plant")
    columns = {name: np.asarray(log[name], float).reshape(len(log), -1) for name in log.names}
    u = columns.pop("reference") + columns.pop("input", 0.0)
    for name, values in columns.items():
        if values.shape != u.shape:
            raise InputError(
                f"has {values.shape[1]} columns; the reference {u.shape[1]}, one for each axis", f"plant.signals.{name}"
            )
    return ModelledRobot(
        [
            identified_axis(
                u[:, k], {name: values[:, k] for name, values in columns.items()}, period, section.order,
                section.delay_samples,
            )
            for k in range(u.shape[1])
        ]
    )  # fmt: skip


def _of_a_model(section: LearnedPlantSection, context: Context) -> ModelledRobot:
    assert section.model is not None
    model = python_models.resolve(section.model, context, "plant.model", section.parameters)
    named = {"motor": section.motor, "tool": section.tool, "acceleration": section.acceleration}
    for name, variables in {"reference": section.reference, **named}.items():
        if (len(variables) != len(section.reference) and (variables or name == "motor")) or not section.reference:
            raise InputError(
                f"names {len(variables)} variables; expected one for each axis, as reference names them",
                f"plant.{name}",
            )
    period, made = section.sample_time_s or PERIOD, []
    for k, reference in enumerate(section.reference):
        signals = {name: variables[k] for name, variables in named.items() if variables}
        try:
            made.append(linear_axis(model, reference, signals, period, section.delay_samples or 0))
        except ModelError as error:
            raise InputError(str(error), "plant.model") from error
    return ModelledRobot(made)
