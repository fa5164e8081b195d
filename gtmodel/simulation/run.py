"""simulate(): consistent start, error-controlled integration with switching states, and checks of the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal

import numpy as np

from ..compiler.analysis.switching import with_switching_signs
from ..compiler.causal import flat_of
from ..compiler.flat_cache import with_tunable
from ..lang.model import Model
from ..lang.slips import named
from ..lang.source import ModelError
from ..results.status import SolveStatus
from .advance import Ended, Integration, refuse_discontinuous_inputs
from .hybrid.integration import HybridIntegration
from .hybrid.modes import SimulatedModes, discrete_starts
from .judgement import FINER, FINEST, resolution, small, small_states, unresolved
from .options import NotSimulated, Progress, Simulation, by_name, longest_step, names, output_step, span
from .prepare import OUTPUT_STEPS, output_rows, prepare, read_model, refuse_settings, watched_grid
from .record import Wanted, balance, unbalanced
from .systems import IntegratorSettings


def with_events(
    model: Model,
    final_time: float,
    inputs: Mapping[str, Any] | None,
    parameters: Mapping[str, Any] | None,
    start: Mapping[str, Any] | None,
    start_time: float,
    step: float | None,
    max_step: float | None,
    wanted: Wanted,
    prefer: Sequence[str] | str,
    tolerance: float,
    method: str,
) -> HybridIntegration:
    """Prepare the simulation of a model with events up to its first step; arguments and errors as for `simulate`."""
    refuse_settings(tolerance, method)
    step = output_step(step, final_time - start_time)
    max_step = longest_step(max_step, final_time - start_time)
    inputs, start, parameters = by_name("inputs", inputs), by_name("start", start), by_name("parameters", parameters)
    prefer = names("prefer", prefer)
    flat = with_switching_signs(flat_of(model))
    assert flat.events is not None
    discrete, start = discrete_starts(flat, start)
    declared = {place: float(flat.parameters[place].value) for place in flat.events.discrete}
    flat, now, known = read_model(model, inputs, parameters, declared | discrete)
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    modes = SimulatedModes(flat, now, known, wanted, preferred)
    settings = IntegratorSettings(tolerance, method, np.isfinite(max_step))
    ready = modes.start(start, start_time, settings, final_time)
    refuse_discontinuous_inputs(known, ready.ready.system.plan.inputs, start_time, final_time)
    rows = output_rows(start_time, final_time, step)
    grid = watched_grid(rows, min(max_step, (final_time - start_time) / OUTPUT_STEPS))
    return HybridIntegration(ready, modes, rows, grid)


def outcome(at_tolerance: Callable[[float], Integration], tolerance: float, progress: Progress | None) -> Simulation:
    """Run a simulation and return its result. at_tolerance: prepares it up to its first step. If states stay small, a
    second run at a finer tolerance measures their errors; see `small`."""
    integration = at_tolerance(tolerance)
    status, message = SolveStatus.SOLVED, "simulated"
    try:
        integration.run(progress)
    except Ended as error:
        status, message = error.status, str(error)
    residual, broken = integration.finish()
    if broken is not None and status is SolveStatus.SOLVED:
        status, message = SolveStatus.FAILED, broken
    message = "; ".join([message, *integration.happened(status)])
    if integration.recorder.empty:
        raise ModelError(f"the simulation fails at its start: {message}; check that all start values are finite")
    trajectory, energy_error, moved = integration.recorder.trajectory()
    checks = balance(energy_error, moved) | resolution(integration.largest, tolerance)
    sentences = [unbalanced(checks, moved), unresolved(checks)]
    further, failures = integration.own_checks(moved)
    checks |= further
    sentences += failures
    if status.ok and FINER * tolerance >= FINEST and (pairs := small(integration.history, tolerance)):
        with suppress(Ended, ModelError):  # no check from a second run that ends early
            finer = at_tolerance(FINER * tolerance)
            finer.run(None if progress is None else lambda _: progress(integration.end))
            result, sentence = small_states(pairs, integration.history, finer.history, integration.ready.name_of)
            checks |= result
            sentences.append(sentence)
    if status.ok and any(sentences):
        status, message = SolveStatus.CHECK_FAILED, "; ".join([message, *filter(None, sentences)])
    return Simulation(
        status,
        message,
        trajectory,
        energy_error,
        residual,
        integration.system.states,
        integration.switches,
        integration.ready.chosen,
        checks,
        **integration.of_events(),
    )


@named
def simulate(
    model: Model,
    final_time: float,
    *,
    start_time: float = 0.0,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    tunable: Sequence[str] | str = (),
    step: float | None = None,
    max_step: float | None = None,
    outputs: Sequence[str] | str = (),
    keep: Sequence[str] | str | None = None,
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
        start: prescribed start values by name, e.g. {"T": [...], "der(T)": 0}. Fixed start attributes are also
            prescribed; other start attributes are guesses. States that are still free start as close to zero as
            possible.
        parameters: values of parameters by name, e.g. {"m_p": 40.0}, instead of the model's values. Runs that name the
            same parameters share all preparation: a sweep only costs its integrations. The named parameters stay
            symbols in the equations, so results agree with those of `with_` within the tolerance, not bit for bit.
        tunable: names of parameters for which the same holds with the values that the model was given. Without it each
            `model.with_(m_p=...)` is compiled again.
        step: interval [s] of the recorded rows; default a 500th of the run. The integrator chooses its own steps.
        max_step: longest internal step [s]. It is not needed for short pulses of functions of time in inputs and
            equations: these are found at any length if they deviate from a straight line by more than a ten-thousandth
            of the function's range. Use it for other sudden changes.
        outputs: further names to record, e.g. "arm[0].rod.tension".
        keep: names to record instead of the usual ones, e.g. ["T", "der(q)"]; outputs and energies are recorded too. A
            long run of a model with many variables takes less memory and time; its motion and checks are the same.
        prefer: names to keep as states as long as they are well conditioned.
        tolerance: relative and absolute tolerance of the integrator, in nominals.
        method: "bdf" for all models, "adams" for smooth motion at tight tolerances; models with Newton unknowns are
            always integrated with BDF.
        progress: called with the time reached; if it returns True, the run stops and keeps its rows.
        throw: raise NotSimulated if the run ends early; False: return the incomplete run with its status.

    Returns a `Simulation`: `trajectory["x"]` has a row for each of `trajectory.time`, in SI units.

    If the model declares its energies, their balance is checked: a run with an error above a ten-thousandth of the
    exchanged energy has the status CHECK_FAILED, and a complete result. A run whose states all stay below a thousand
    times the tolerance, in nominals, has the same status, because the absolute tolerance is too coarse for such a
    motion. If only some states stay so small, a second run at a hundredth of the tolerance measures their errors; the
    status is CHECK_FAILED if an error exceeds a hundredth of the state's largest value.

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
    wanted = Wanted.of(outputs, keep)
    step = output_step(step, final_time - start_time)
    max_step = longest_step(max_step, final_time - start_time)
    if tunable:
        model, own = with_tunable(model, names("tunable", tunable))
        parameters = own | dict(by_name("parameters", parameters))
    if with_switching_signs(flat_of(model)).events is not None:

        def at_tolerance(tolerance: float) -> Integration:
            options = start, start_time, step, max_step, wanted, prefer, tolerance, method
            return with_events(model, final_time, inputs, parameters, *options)

    else:

        def at_tolerance(tolerance: float) -> Integration:
            bounded = bool(np.isfinite(max_step))
            ready = prepare(model, inputs, start, start_time, wanted, prefer, tolerance, method, bounded, parameters)
            refuse_discontinuous_inputs(ready.inputs, ready.system.plan.inputs, start_time, final_time)
            rows = output_rows(start_time, final_time, step)
            # roots and states are monitored at least as often as rows are recorded by default
            watching = bool(ready.system.roots) or ready.systems.selection.has_choice
            watched = (final_time - start_time) / OUTPUT_STEPS if watching else np.inf
            pace = ready.systems.pace(ready.inputs, start_time, final_time)
            return Integration(ready, rows, watched_grid(rows, min(max_step, watched)), pace)

    simulation = outcome(at_tolerance, tolerance, progress)
    if throw and not simulation.status.converged:
        raise NotSimulated(simulation)
    return simulation
