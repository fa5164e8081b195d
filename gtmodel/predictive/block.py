"""A predictive controller as a sampled block of a model, and a plant with this block as a closed loop."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from .._lazy import hint
from ..cgen.steps.function import StepMember
from ..lang.declare import discrete, input, output, part
from ..lang.events import SampledBlock, terminate, when
from ..lang.functions import der
from ..lang.model import Model, dependent
from ..results.agreement import described
from ..results.refusal import ArgumentError
from ..results.status import Status

if TYPE_CHECKING:
    from .controller import Controller
else:
    Controller = hint("gtmodel.predictive.controller", "Controller")


GAVE_UP = (
    "the predictive controller has no solution or no usable reading: the state is far beyond a soft limit (raise "
    "max_iterations), a reading jumps for more cycles than patience, or the model has left its domain"
)


def _plain(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).strip("_")


def block_of(law: Controller) -> type[SampledBlock]:
    """The class of `Controller.block`; the state of a cycle is one vector."""
    if law.servo is not None:
        raise ArgumentError(
            "a block gives the inputs of the plant, but this controller commands a servo: make it without one, or run "
            "it by gt.loop.study", "servo",
        )  # fmt: skip
    states = law.program.statement.states if law.program.observer is None else []
    readings = {s.name: _plain(s.name) for s in states} or {k.name: _plain(k.name) for k in law.readings}
    goals = {k.name.removesuffix(".goal"): _plain(k.name) for k in law.goals}
    shown = [
        *law.commands,
        *law.shown,
        *[k for k in law.outputs if k.name in ("failed", "lost", "iterations", "clipped")],
    ]
    begun = law.begin()
    memory = _flat(law, begun.state)

    members = [StepMember(k.name, unit=k.unit) for k in states] or law.readings
    declared: dict[str, Any] = {_plain(k.name): input(k.size, unit=_unit(k.unit)) for k in (*members, *law.goals)}
    for k in shown:
        declared[_output(law, k)] = output(0.0 if k.size is None else np.zeros(k.size), unit=_unit(k.unit))
    declared["memory"] = discrete(memory)

    def step(self: Any, inputs: Any, state: Any) -> dict[str, Any]:
        run = law.begin()
        _unflat(law, np.asarray(state.memory, float), run.state)
        result = run.step(
            {name: getattr(inputs, key) for name, key in readings.items()},
            {name: getattr(inputs, key) for name, key in goals.items()},
        )
        if result.status != Status.OK:
            return {"failed": -1.0}
        values = {_output(law, k): result.values[k.name] if k.size else float(result.values[k.name][0]) for k in shown}
        return values | {"memory": _flat(law, run.state)}

    return type("PredictiveLaw", (SampledBlock,), declared | {"step": step})


def _unit(text: str) -> str | None:
    return None if text == "?" else text


def _output(law: Controller, k: StepMember) -> str:
    """Name of an output; a further one may be measured too."""
    return _plain(f"next_{k.name}" if k in law.shown else k.name)


def _flat(law: Controller, state: np.ndarray) -> np.ndarray:
    return np.concatenate([np.asarray(state[k.identifier], float).reshape(-1) for k in law.state])


def _unflat(law: Controller, memory: np.ndarray, state: np.ndarray) -> None:
    first = 0
    for k in law.state:
        state[k.identifier] = memory[first : first + k.count].reshape(state[k.identifier].shape)
        first += k.count


_DERIVATIVE = re.compile(r"der\((?P<inner>.+?)(?:,\s*(?P<order>\d+))?\)")


def _variable(model: Model, name: str) -> Any:
    """Expression of a variable by its name, such as der(arm[0].q,2)."""
    derivative = _DERIVATIVE.fullmatch(name)
    if derivative:
        return der(_variable(model, derivative["inner"]), int(derivative["order"] or 1))
    value: Any = model
    for word in name.split("."):
        attribute, *places = word.replace("]", "").split("[")
        value = getattr(value, attribute)
        for place in places:
            value = value[tuple(int(k) for k in place.split(","))] if "," in place else value[int(place)]
    return value


def closed_loop(law: Controller, plant: Model) -> Model:
    """See `Controller.around`."""
    if not isinstance(plant, Model):
        raise ArgumentError(f"expected a configured model; found {described(plant)}", "plant")
    horizon = law.program.horizon
    if horizon.preview and law.goals:
        raise ArgumentError("expected a controller without preview; use block() in a model of your own", "preview")
    states = law.program.statement.states if law.program.observer is None else []
    readings = [s.name for s in states] or [k.name for k in law.readings]

    def equations(self: Any) -> Any:
        for k in law.commands:
            yield _variable(self.plant, k.name) == getattr(self.law, _plain(k.name))
        for name in readings:
            yield getattr(self.law, _plain(name)) == _variable(self.plant, name)
        yield when(self.law.failed < 0, terminate(GAVE_UP, failed=True))

    declared: dict[str, Any] = {
        "plant": part(dependent(plant, *[k.name for k in law.commands])),
        "law": part(block_of(law), period=law.period, delay=horizon.delay * law.period),
        "equations": equations,
    }
    return type("PredictiveLoop", (Model,), declared)()
