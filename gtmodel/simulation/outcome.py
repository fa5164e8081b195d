"""What every simulation does with its integration: run it, judge it, and say so."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from ..lang.source import ModelError
from ..results.status import SolveStatus
from .advance import Ended, Integration
from .resolution import resolution, unresolved
from .result import Progress, Simulation
from .small import FINER, FINEST, small, small_states
from .turnover import balance, unbalanced


def outcome(at_tolerance: Callable[[float], Integration], tolerance: float, progress: Progress | None) -> Simulation:
    """The result of a simulation. at_tolerance: makes it, before its first step; a second one at a finer tolerance
    is made where states stay small, see `small`."""
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
        raise ModelError(f"the simulation ends before it begins: {message}; are all start values numbers?")
    trajectory, energy_error, moved = integration.recorder.trajectory()
    checks = balance(energy_error, moved) | resolution(integration.largest, tolerance)
    sentences = [unbalanced(checks, moved), unresolved(checks)]
    own, said = integration.own_checks(moved)
    checks |= own
    sentences += said
    if status.ok and FINER * tolerance >= FINEST and (pairs := small(integration.history, tolerance)):
        # a run that ends early shows nothing
        with suppress(Ended, ModelError):
            finer = at_tolerance(FINER * tolerance)
            finer.run(None if progress is None else lambda _: progress(integration.end))
            of_small, sentence = small_states(pairs, integration.history, finer.history, integration.ready.name_of)
            checks |= of_small
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
