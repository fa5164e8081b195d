"""Kind "identification": masses and friction of a robot from its measured motion and forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.compiler.causal import flat_of
from gtmodel.identify import read_motion, study, synthetic_study
from gtmodel.identify.recordings import free_of, regressor_of
from gtmodel.identify.regressor import among
from gtmodel.lang import Model, ModelError
from gtmodel.measurements import Signal
from gtmodel.problem_files.base import Call, Context, InputError

from .keys import IdentificationLogSection, Schema, SyntheticLogSection

ARGUMENTS = {
    "fitting": "",
    "processing": "filter",
    "log.known": "log.position.column",
    "log.targets": "log.effort.column",
    "fitting.inputs": "log.inputs",
    "held_out": "log.held_out",
    "motion": "synthetic.reference_file",
}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the logs or of a synthetic log."""
    model, free = problem.fitted(context)
    common: dict[str, Any] = {
        "fitting": problem.fitting(),
        "processing": problem.filter.options(),
        "published": problem.published,
        "title": problem.title or f"identification of {problem.robot}",
    }
    if (problem.log is None) == (problem.synthetic is None):
        present = "both" if problem.log else "neither"
        raise InputError(f"expected one of [log] and [synthetic]; found {present}", "log")
    if problem.synthetic is not None:
        if problem.closed_loop is not None:
            raise InputError("needs measured motion; give a [log]", "closed_loop")
        s = problem.synthetic
        plant = problem.with_parameters({**problem.parameters, **s.parameters}, context)
        return Call(synthetic_study, model, s.options(), free, plant=plant, motion=_motion(s, plant, context), **common)
    log, loop = problem.log, problem.closed_loop
    assert log is not None
    signals = _signals(problem, log, model, context)
    called = {"position": problem.fitting().known, "effort": problem.fitting().targets}
    held_out = (
        log.sessions(signals, context, files=log.held_out, key="log.held_out", called=called) if log.held_out else ()
    )
    return Call(
        study, model, log.sessions(signals, context, called=called), free, held_out=held_out, signals=signals,
        closed_loop=None if loop is None else loop.loop(problem.parameters, context), **common,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the free and fixed parameters and the regressor."""
    model, free = problem.fitted(context)
    regressor = regressor_of(model, free, problem.fitting())
    free_indices = among(regressor.names, free_of(regressor, free, problem.fitting()))
    lines = [f"{problem.title or 'identification'}: {', '.join(regressor.columns)} linear in"]
    for k, (name, value, unit) in enumerate(zip(regressor.names, regressor.nominal, regressor.units, strict=True)):
        role = "free" if k in free_indices else "watched"
        lines.append(f"  {name} [{unit}], {role}, nominal {value:g}")
    lines.append(f"from {', '.join(s.name for s in regressor.inputs)}; all other parameters are fixed")
    return "\n".join(lines)


def _motion(s: SyntheticLogSection, plant: Model, context: Context) -> np.ndarray | None:
    if s.reference_file is None:
        return None
    path = context.file(s.reference_file, "synthetic.reference_file")
    return read_motion(path, plant, s.options())


def _signals(problem: Schema, log: IdentificationLogSection, model: Model, context: Context) -> dict[str, Signal]:
    flat, signals, fitting = flat_of(model), {}, problem.fitting()
    sections = [
        ("known", fitting.known, log.position, "log.position"),
        ("targets", fitting.targets, log.effort, "log.effort"),
    ]
    sections += [(f"log.inputs.{name}", name, signal, f"log.inputs.{name}") for name, signal in log.inputs.items()]
    for key, name, measured, place in sections:
        try:
            _, indices, order = flat.lookup(name)
        except ModelError as error:
            raise InputError(str(error), key) from error
        signals[name] = measured.signal(place, flat.unit_of(indices[0], order))
        if (
            key == "targets"
            and measured.gear_ratio is not None
            and not signals[name].conversion.is_effort(signals[name].units)
        ):
            raise InputError(
                f"is missing: a gear ratio multiplies forces and torques, and the model declares no unit of '{name}'; "
                'give the unit after all factors, such as "N.m", or one for each component',
                f"{place}.quantity_unit",
            )
    return signals | ({} if problem.closed_loop is None else problem.closed_loop.signals(context))
