"""Simulations of models with events or sampled blocks, before their first step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...compiler.analysis.switching import with_switching_signs
from ...compiler.causal import flat_of
from ...lang.model import Model
from ..arguments import by_name, longest_step, names, output_step
from ..discontinuities import refuse_discontinuous_inputs
from ..prepare import OUTPUT_STEPS, output_rows, read_model, refuse_settings, watched_grid
from ..systems import IntegratorSettings
from .integration import HybridIntegration
from .modes import SimulatedModes, discrete_starts


def with_events(
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
) -> HybridIntegration:
    """A simulation of a model that has events, before its first step; arguments and errors as for `simulate`."""
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
    return HybridIntegration(ready, modes, rows, grid)
