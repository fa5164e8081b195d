"""simulate(): a consistent start, an error-controlled integrator, states that switch where they would fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..compiler.causal import flat_of
from ..compiler.consistency.initial import Initial, initial_point, start_values
from ..compiler.flat import FlatModel
from ..compiler.other_values import values_by_place, with_values
from ..lang.model import Model
from ..lang.slips import named
from ..lang.source import ModelError
from ..results.status import SolveStatus
from .advance import Ended, Integration
from .arguments import by_name, longest_step, names, number, output_step, span
from .discontinuities import refuse_discontinuities, refuse_discontinuous_inputs
from .inputs import SimulationInputs, read_inputs
from .record import Recorded, Recorder
from .resolution import resolution, unresolved
from .result import NotSimulated, Progress, Simulation
from .small import FINER, FINEST, small, small_states
from .systems import IntegratorSettings, SimulatedSystem, Systems
from .turnover import balance, unbalanced

OUTPUT_STEPS = 500
ROUND_OFF = 1e-9  # a chosen start value below so many nominals is reported as zero


@named
def simulate(
    model: Model,
    final_time: float,
    *,
    start_time: float = 0.0,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    step: float | None = None,
    max_step: float | None = None,
    outputs: Sequence[str] | str = (),
    prefer: Sequence[str] | str = (),
    tolerance: float = 1e-9,
    method: Literal["bdf", "adams"] = "bdf",
    progress: Progress | None = None,
    throw: bool = True,
) -> Simulation:
    """Simulate a model from start_time to final_time [s].

    Args:
        inputs: known variables by name: a number or array, a function of time, (times, values), a Trajectory, or
            (one of the last two, "linear" | "previous" | "cubic"); see `read_inputs`.
        start: prescribed start values by name, e.g. {"T": [...], "der(T)": 0}; fixed start attributes are
            prescribed too, other start attributes are guesses. States that are free after that start as near to
            zero as they can.
        parameters: values of parameters by name, e.g. {"m_p": 40.0}, instead of the model's own. Runs that name the
            same parameters share all that is worked out, whatever the values: a sweep costs what its integrations
            cost, while each `model.with_(m_p=...)` is a model of its own and is compiled. The named parameters stay
            symbols in the equations, so that results agree with those of `with_` within the tolerance, not bit for bit.
        step: interval [s] of the recorded rows; default a 500th of the run. The integrator chooses its own steps.
        max_step: longest internal step [s]. Short pulses of functions of time, in inputs and in the model's equations,
            are found without it, however short they are, where they leave a straight line by more than a
            ten-thousandth of the function's range; it is for what comes out of nothing in another way.
        outputs: further names to record, e.g. "arm[0].rod.tension".
        prefer: names to keep as states as long as they are good for it.
        tolerance: relative and absolute tolerance of the integrator, in nominals.
        method: "bdf" for anything, "adams" for smooth motion at tight tolerances; models with Newton unknowns
            are integrated by BDF.
        progress: called with the time reached; returning True stops the run, keeping what there is.
        throw: raise NotSimulated for a run that ends early; False: return what was reached, with its status.

    Returns a `Simulation`: `trajectory["x"]` has a row for each of `trajectory.time`, in SI units.

    Where the model declares its energies, their balance is checked: a run that reaches its end with an error of more
    than a ten-thousandth of the energy that moved has the status CHECK_FAILED, and holds everything. The same status
    has a run whose states all stay below a thousand times the tolerance, in nominals: that motion is smaller than its
    own error. Where only some of them do, a second run at a hundredth of the tolerance measures their errors; above a
    hundredth of the largest value of one the status is CHECK_FAILED too.

    Raises ModelError for a wrong model, input or start, and NotSimulated for a run that ends early, unless throw is
    False.

    >>> class Motor(gt.Model):  # a coil: L di/dt + R i = u
    ...     L = gt.parameter(0.02, unit="V.s/A")
    ...     R = gt.parameter(2.0, unit="V/A")
    ...     i = gt.variable(unit="A", start=0.0, fixed=True)
    ...     u = gt.input(unit="V")
    ...     def equations(self):
    ...         yield self.L * gt.der(self.i) + self.R * self.i == self.u
    >>> run = gt.simulate(Motor(), 0.02, inputs={"u": 24.0}, step=0.01)
    >>> run.trajectory.time.tolist()
    [0.0, 0.01, 0.02]
    >>> run.trajectory["i"].round(3).tolist()  # 12 A (1 - exp(-t / 0.01 s))
    [0.0, 7.585, 10.376]

    A sweep over a parameter:

    >>> runs = [gt.simulate(Motor(), 0.02, inputs={"u": 24.0}, parameters={"R": R}) for R in (1.0, 2.0, 3.0)]
    >>> [float(run.trajectory["i"][-1].round(2)) for run in runs]
    [15.17, 10.38, 7.6]
    """
    start_time, final_time = span(final_time, start_time)
    step = output_step(step, final_time - start_time)
    max_step = longest_step(max_step, final_time - start_time)
    bounded = np.isfinite(max_step)

    def prepared(tolerance: float) -> Ready:
        return prepare(model, inputs, start, start_time, outputs, prefer, tolerance, method, bounded, parameters)

    if flat_of(model).events is not None:
        from .hybrid.run import simulate_events

        given = start, start_time, step, max_step, outputs, prefer, tolerance, method
        simulation = simulate_events(model, final_time, inputs, parameters, *given, progress)
        if throw and not simulation.status.converged:
            raise NotSimulated(simulation)
        return simulation
    ready = prepared(tolerance)
    refuse_discontinuous_inputs(ready.inputs, ready.system.plan.inputs, start_time, final_time)
    rows = output_rows(start_time, final_time, step)
    # roots and states are watched from one time to the next: as often as rows are recorded by default
    watching = bool(ready.system.roots) or ready.systems.selection.has_choice
    watched = (final_time - start_time) / OUTPUT_STEPS if watching else np.inf
    grid = watched_grid(rows, min(max_step, watched))
    pace = ready.systems.pace(ready.inputs, start_time, final_time)
    integration = Integration(ready, rows, grid, pace)
    status, message = SolveStatus.SOLVED, "simulated"
    try:
        integration.run(progress)
    except Ended as error:
        status, message = error.status, str(error)
    broken = integration.audit.verdict()
    if broken is not None and status is SolveStatus.SOLVED:
        status, message = SolveStatus.FAILED, broken
    if integration.switches:
        n = len(integration.switches)
        message += f"; states switched {n} time{'s' * (n > 1)}"
    trajectory, energy_error, moved = ready.recorder.trajectory()
    checks = balance(energy_error, moved) | resolution(integration.largest, tolerance)
    said = ""
    if status.ok and FINER * tolerance >= FINEST and (pairs := small(integration.history, tolerance)):
        finer = Integration(prepared(FINER * tolerance), rows, grid, pace)
        # a run that ends early shows nothing
        with suppress(Ended):
            finer.run(None if progress is None else lambda _: progress(final_time))
            of_small, said = small_states(pairs, integration.history, finer.history, ready.name_of)
            checks |= of_small
    if status.ok and (sentences := [s for s in (unbalanced(checks, moved), unresolved(checks), said) if s]):
        status, message = SolveStatus.CHECK_FAILED, "; ".join([message, *sentences])
    simulation = Simulation(
        status,
        message,
        trajectory,
        energy_error,
        integration.audit.residual,
        integration.system.states,
        integration.switches,
        ready.chosen,
        checks,
    )
    if throw and not status.converged:
        raise NotSimulated(simulation)
    return simulation


@dataclass(frozen=True, eq=False)
class Ready:
    """A simulation before its first step: a consistent point and the system chosen there."""

    systems: Systems
    settings: IntegratorSettings
    inputs: SimulationInputs
    recorder: Recorder
    initial: Initial
    system: SimulatedSystem
    chosen: dict[str, float]

    def name_of(self, pair: tuple[int, int]) -> str:
        """Of a state."""
        return self.system.name_of(pair)


def prepare(
    model: Model,
    inputs: Mapping[str, Any] | None,
    start: Mapping[str, Any] | None,
    start_time: float,
    outputs: Sequence[str] | str,
    prefer: Sequence[str] | str,
    tolerance: float,
    method: str,
    bounded: bool = False,
    parameters: Mapping[str, Any] | None = None,
) -> Ready:
    """Everything that happens before the first step; arguments and errors as for `simulate`."""
    refuse_settings(tolerance, method)
    inputs, start, parameters = by_name("inputs", inputs), by_name("start", start), by_name("parameters", parameters)
    outputs, prefer = names("outputs", outputs), names("prefer", prefer)
    flat, now, given = read_model(model, inputs, parameters)
    recorded, settings = Recorded.of(flat, outputs), IntegratorSettings(tolerance, method, bounded)
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    return prepare_in(flat, now, given, recorded, Recorder(recorded), start, start_time, preferred, settings)


def refuse_settings(tolerance: Any, method: Any) -> None:
    """Raises ModelError for a tolerance or a method that is none."""
    if not 1e-14 <= number("tolerance", tolerance) <= 0.1:
        raise ModelError(f"the tolerance must lie between 1e-14 and 0.1; found {tolerance:g}")
    if method not in ("bdf", "adams"):
        raise ModelError(f"there is no integration method '{method}'; it is 'bdf' or 'adams'")


def read_model(
    model: Model, inputs: Mapping[str, Any], parameters: Mapping[str, Any], further: Mapping[int, float] | None = None
) -> tuple[FlatModel, FlatModel, SimulationInputs]:
    """A flat model, the same with the numbers of a run, and its inputs; `further`: numbers of parameters that vary by
    their places. Raises ModelError for what is wrong in any of these."""
    flat = flat_of(model)
    if not flat.variables:
        raise ModelError(f"{flat.title} declares no variable; there is nothing to simulate")
    refuse_discontinuities(flat)
    varied = values_by_place(flat, parameters) | dict(further or {})
    return flat, with_values(flat, varied), read_inputs(flat, inputs, varied)


def prepare_in(
    flat: FlatModel,
    now: FlatModel,
    given: SimulationInputs,
    recorded: Recorded,
    recorder: Recorder,
    start: Mapping[str, Any],
    start_time: float,
    preferred: Sequence[int],
    settings: IntegratorSettings,
) -> Ready:
    """A simulation of a flat model before its first step; `now`: with the numbers of this run."""
    systems = Systems.kept(flat, given, recorded, preferred, now)
    held, guess = start_values(replace(systems.plan, flat=now), start, given.known)
    prescribed = set(held)
    known = set(given.known)
    pairs = [p for p in systems.plan.pairs if p[0] in known]
    values = dict(zip(pairs, given.values(pairs, start_time), strict=True))
    for pair, value in values.items():
        if not np.isfinite(value):
            raise ModelError(
                f"input '{flat.symbol_name(*pair)}' has no finite value at the start, {start_time:g} s; mend the "
                "input, or start where it is defined"
            )
    held |= values
    initial = initial_point(systems.plan, held, guess, start_time, systems.parameters, systems.samples)
    system = systems.at(initial.w, start_time, settings)
    if system is None:
        raise ModelError(f"{flat.title}: the start is a singular pose, where no choice of states describes the motion")
    x = system.reduced.from_point(initial.w)[0]
    x = np.where(np.abs(x) > ROUND_OFF * system.stepper.x_scale, x, 0.0)
    states = zip(system.plan.states, system.states, x.tolist(), strict=True)
    chosen = {name: value for pair, name, value in states if pair in initial.free - prescribed}
    return Ready(systems, settings, given, recorder, initial, system, chosen)


def output_rows(start: float, end: float, step: float | None) -> np.ndarray:
    """Times to record; the end is one of them."""
    step = (end - start) / OUTPUT_STEPS if step is None else step
    count = max(1, round((end - start) / step))
    if abs(count * step - (end - start)) <= 1e-9 * (end - start):
        return np.linspace(start, end, count + 1)
    count = int((end - start) / step)
    return np.append(start + step * np.arange(count + 1), end)


def watched_grid(rows: np.ndarray, max_step: float) -> np.ndarray:
    """Rows, and times between them that are nowhere further apart than max_step."""
    parts = int(np.ceil(np.max(np.diff(rows)) / max_step - 1e-9))
    if parts <= 1:
        return rows
    shares = np.arange(parts) / parts
    return np.append((rows[:-1, None] + shares * np.diff(rows)[:, None]).reshape(-1), rows[-1])
