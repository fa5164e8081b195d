"""simulate() of a model with events or sampled blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...compiler.analysis.switching import with_switching_signs
from ...compiler.causal import flat_of
from ...lang.model import Model
from ...results.check import Check
from ...results.status import SolveStatus
from ..advance import Ended
from ..arguments import by_name, longest_step, names, output_step
from ..discontinuities import refuse_discontinuous_inputs
from ..prepare import OUTPUT_STEPS, output_rows, read_model, refuse_settings, watched_grid
from ..resolution import resolution, unresolved
from ..result import Progress, Simulation
from ..systems import IntegratorSettings
from ..turnover import balance, unbalanced
from .integration import HybridIntegration
from .modes import SimulatedModes, discrete_starts

# of the energy that moved: what an impact takes, by its formula and by the stored energies before and after it
DECLARED_LOSS = 1e-9


def simulate_events(
    model: Model,
    final_time: float,
    inputs: Mapping[str, Any] | None,
    parameters: Mapping[str, Any] | None,
    start: Mapping[str, Any] | None,
    start_time: float,
    step: float | None,
    max_step: float | None,
    outputs: Sequence[str] | str,
    prefer: Sequence[str] | str,
    tolerance: float,
    method: str,
    progress: Progress | None,
) -> Simulation:
    """As `simulate`, of a model that has events; never raises NotSimulated."""
    refuse_settings(tolerance, method)
    step = output_step(step, final_time - start_time)
    max_step = longest_step(max_step, final_time - start_time)
    inputs, start, parameters = by_name("inputs", inputs), by_name("start", start), by_name("parameters", parameters)
    outputs, prefer = names("outputs", outputs), names("prefer", prefer)
    flat = with_switching_signs(flat_of(model))
    assert flat.events is not None
    started, start = discrete_starts(flat, start)
    first = {place: float(flat.parameters[place].value) for place in flat.events.discrete}
    flat, now, given = read_model(model, inputs, parameters, first | started)
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    modes = SimulatedModes(flat, now, given, outputs, preferred)
    settings = IntegratorSettings(tolerance, method, np.isfinite(max_step))
    ready = modes.start(start, start_time, settings, final_time)
    refuse_discontinuous_inputs(given, ready.ready.system.plan.inputs, start_time, final_time)
    rows = output_rows(start_time, final_time, step)
    grid = watched_grid(rows, min(max_step, (final_time - start_time) / OUTPUT_STEPS))
    integration = HybridIntegration(ready, modes, rows, grid)
    status, message = SolveStatus.SOLVED, "simulated"
    try:
        integration.run(progress)
    except Ended as error:
        status, message = error.status, str(error)
    residual, broken = integration.finish()
    if broken is not None and status is SolveStatus.SOLVED:
        status, message = SolveStatus.FAILED, broken
    if (n := len(integration.events)) and status.ok:
        message += f"; {n} event{'s' * (n > 1)}"
    if n := len(integration.switches):
        message += f"; states switched {n} time{'s' * (n > 1)}"
    trajectory, energy_error, moved = ready.ready.recorder.trajectory()
    checks = balance(energy_error, moved) | resolution(integration.largest, tolerance)
    if integration.declares_loss:
        scale = max(moved, integration.largest_energy)
        share = integration.energy_error / scale if scale > 0 else integration.energy_error
        checks["declared_loss"] = Check(share, DECLARED_LOSS, "mend the formula of gt.energy_loss")
    sentences = [s for s in (unbalanced(checks, moved), unresolved(checks)) if s]
    if "declared_loss" in checks and not checks["declared_loss"].passed:
        sentences.append(
            f"an event takes another energy than its gt.energy_loss says, by {integration.energy_error:.3g} J"
        )
    if status.ok and sentences:
        status, message = SolveStatus.CHECK_FAILED, "; ".join([message, *sentences])
    return Simulation(
        status,
        message,
        trajectory,
        energy_error,
        residual,
        integration.system.states,
        integration.switches,
        ready.ready.chosen,
        checks,
        integration.events,
        {b.name: b.trajectory for b in integration.blocks if b.count},
        integration.accumulation,
    )
