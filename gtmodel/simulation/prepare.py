"""Preparation of a simulation up to its first step: consistent start and system; and a text that explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..compiler.analysis.switching import with_switching_signs
from ..compiler.causal import compile_causal, flat_of
from ..compiler.consistency.initial import Initial, initial_point, start_values
from ..compiler.flat import FlatModel
from ..compiler.flat_cache import values_by_place, with_values
from ..lang.model import Model
from ..lang.source import ModelError
from .inputs import SimulationInputs, read_inputs
from .options import by_name, names, number
from .record import Recorded, Recorder, Wanted
from .systems import IntegratorSettings, SimulatedSystem, Systems

OUTPUT_STEPS = 500
ROUND_OFF = 1e-9  # in nominals: smaller chosen start values are reported as zero


@dataclass(frozen=True, eq=False)
class Ready:
    """A simulation before its first step: consistent point, and the system chosen there."""

    systems: Systems
    settings: IntegratorSettings
    inputs: SimulationInputs
    recorder: Recorder
    initial: Initial
    system: SimulatedSystem
    chosen: dict[str, float]

    def name_of(self, pair: tuple[int, int]) -> str:
        """Return the name of a state."""
        return self.system.name_of(pair)


def prepare(
    model: Model,
    inputs: Mapping[str, Any] | None,
    start: Mapping[str, Any] | None,
    start_time: float,
    wanted: Wanted,
    prefer: Sequence[str] | str,
    tolerance: float,
    method: str,
    bounded: bool = False,
    parameters: Mapping[str, Any] | None = None,
) -> Ready:
    """Prepare a simulation up to its first step; arguments and errors as for `simulate`."""
    refuse_settings(tolerance, method)
    inputs, start, parameters = by_name("inputs", inputs), by_name("start", start), by_name("parameters", parameters)
    prefer = names("prefer", prefer)
    flat, now, known = read_model(model, inputs, parameters)
    recorded, settings = Recorded.of(flat, wanted), IntegratorSettings(tolerance, method, bounded)
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    return prepare_in(flat, now, known, recorded, Recorder(recorded), start, start_time, preferred, settings)


def refuse_settings(tolerance: Any, method: Any) -> None:
    """Raises ModelError for an invalid tolerance or method."""
    if not 1e-14 <= number("tolerance", tolerance) <= 0.1:
        raise ModelError(f"the tolerance must be between 1e-14 and 0.1; found {tolerance:g}")
    if method not in ("bdf", "adams"):
        raise ModelError(f"there is no integration method '{method}'; use 'bdf' or 'adams'")


def read_model(
    model: Model, inputs: Mapping[str, Any], parameters: Mapping[str, Any], further: Mapping[int, float] | None = None
) -> tuple[FlatModel, FlatModel, SimulationInputs]:
    """Return the flat model, the flat model with the values of a run, and its inputs. `further`: values of varied
    parameters by place. Raises ModelError for an error in any of these."""
    flat = with_switching_signs(flat_of(model))
    if not flat.variables:
        raise ModelError(f"{flat.title} declares no variable; there is nothing to simulate")
    varied = values_by_place(flat, parameters) | dict(further or {})
    return flat, with_values(flat, varied), read_inputs(flat, inputs, varied)


def prepare_in(
    flat: FlatModel,
    now: FlatModel,
    inputs: SimulationInputs,
    recorded: Recorded,
    recorder: Recorder,
    start: Mapping[str, Any],
    start_time: float,
    preferred: Sequence[int],
    settings: IntegratorSettings,
) -> Ready:
    """Prepare the simulation of a flat model up to its first step; `now`: the model with the values of this run."""
    systems = Systems.kept(flat, inputs, recorded, preferred, now)
    held, guess = start_values(replace(systems.plan, flat=now), start, inputs.known)
    prescribed = set(held)
    known = set(inputs.known)
    pairs = [p for p in systems.plan.pairs if p[0] in known]
    values = dict(zip(pairs, inputs.values(pairs, start_time), strict=True))
    for pair, value in values.items():
        if not np.isfinite(value):
            raise ModelError(
                f"input '{flat.symbol_name(*pair)}' has no finite value at the start, {start_time:g} s; correct the "
                "input, or start at a time where it is defined"
            )
    held |= values
    initial = initial_point(systems.plan, held, guess, start_time, systems.parameters, systems.samples)
    system = systems.at(initial.w, start_time, settings)
    if system is None:
        raise ModelError(f"{flat.title}: the start is a singular pose, where no choice of states is valid")
    x = system.reduced.from_point(initial.w)[0]
    x = np.where(np.abs(x) > ROUND_OFF * system.stepper.x_scale, x, 0.0)
    states = zip(system.plan.states, system.states, x.tolist(), strict=True)
    chosen = {name: value for pair, name, value in states if pair in initial.free - prescribed}
    return Ready(systems, settings, inputs, recorder, initial, system, chosen)


def output_rows(start: float, end: float, step: float | None) -> np.ndarray:
    """Return the times to record, including the end."""
    step = (end - start) / OUTPUT_STEPS if step is None else step
    count = max(1, round((end - start) / step))
    if abs(count * step - (end - start)) <= 1e-9 * (end - start):
        return np.linspace(start, end, count + 1)
    count = int((end - start) / step)
    return np.append(start + step * np.arange(count + 1), end)


def watched_grid(rows: np.ndarray, max_step: float) -> np.ndarray:
    """Return the rows with additional times between them, at most max_step apart."""
    parts = int(np.ceil(np.max(np.diff(rows)) / max_step - 1e-9))
    if parts <= 1:
        return rows
    shares = np.arange(parts) / parts
    return np.append((rows[:-1, None] + shares * np.diff(rows)[:, None]).reshape(-1), rows[-1])


def explain_simulation(
    model: Model,
    *,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    start_time: float = 0.0,
    prefer: Sequence[str] | str = (),
    tolerance: float = 1e-9,
    method: str = "bdf",
    full: bool = True,
) -> str:
    """Explain how `simulate` runs a model: its states, their start values, and how their rates are computed.

    Arguments and errors as for `simulate`. full: with every block of equations. Returns a text.

    >>> class Ball(gt.Model):
    ...     height = gt.variable(unit="m", start=2.0, fixed=True)
    ...     speed = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.height) == self.speed
    ...         yield gt.der(self.speed) == -self.g
    >>> text = gt.simulation.explain_simulation(Ball())
    >>> "height" in text
    True
    """
    ready = prepare(model, inputs, start, start_time, Wanted(), prefer, tolerance, method, parameters=parameters)
    plan, flat, system = ready.systems.plan, ready.systems.flat, ready.system
    x, z = system.reduced.from_point(ready.initial.w)
    known = [flat.variables[i].name for i in ready.inputs.known]
    integrator = f"IDAS, with {z.size} Newton unknowns" if z.size else f"CVODES ({method})"
    lines = [
        f"{flat.title}: simulation by {integrator}, tolerance {tolerance:g}",
        f"  prescribed: {', '.join(known) or 'nothing'}",
        f"  index {plan.structure.index}; {plan.structure.degrees_of_freedom} degrees of freedom",
        "  start:" if x.size else "  no states: all variables follow from the prescribed ones",
    ]
    for name, value in zip(system.states, x.tolist(), strict=True):
        origin = "chosen by the initialisation" if name in ready.chosen else "prescribed or computed"
        lines.append(f"    {name} = {ready.chosen.get(name, value):.6g}  {origin}")
    terms: dict[str, list[str]] = {}
    for e in flat.energies:
        terms.setdefault(e.kind, []).append(e.component or flat.title)
    lines += [f"  energy {kind}: {', '.join(dict.fromkeys(names))}" for kind, names in terms.items()]
    text = "\n".join(lines)
    if not x.size:
        return text
    rates = [flat.symbol_name(i, k + 1) for i, k in system.plan.states]
    states = list(dict.fromkeys(flat.variables[i].name for i, _ in system.plan.states))
    return text + "\n" + compile_causal(flat, known, rates, states).explain(full)
