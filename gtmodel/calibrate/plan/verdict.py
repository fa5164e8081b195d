"""Whether a plan may be measured: its criteria as checks, and the verdict in a sentence."""

from __future__ import annotations

import numpy as np

from ...results import Check, at_most
from .steps import PlanState

# standard deviations by which the simulated error may be off the predicted one: one in 16,000 plans by chance
AGREEMENT = 4.0


def checks_of(plan: PlanState) -> dict[str, Check]:
    """The criteria of a plan with selected poses."""
    assert plan.identifiability is not None and plan.chosen is not None
    criteria, identifiability = plan.task.criteria, plan.identifiability
    # what moves no tool centre point is a choice of coordinates, such as a frame inside an F1's joint plate
    undetermined = float(max(1, identifiability.redundant)) if plan.unpredicted else 0.0
    checks = {"parameters_undetermined": at_most(undetermined, 0.0)}
    if criteria.condition is not None:
        checks["condition"] = at_most(identifiability.condition, criteria.condition)
    if criteria.noise_amplification is not None:
        checks["inverse_of_o4"] = at_most(1 / identifiability.indices.o4, 1 / criteria.noise_amplification)
    if plan.unpredicted:
        return checks
    rms = plan.target.errors(plan.chosen).rms
    checks["predicted_error_m"] = at_most(rms, criteria.accuracy)
    if len(plan.errors):
        simulated = float(np.sqrt(np.mean(plan.each_simulated() ** 2)))
        chance = AGREEMENT * plan.target.spread(plan.chosen, len(plan.errors))
        checks["simulated_error_m"] = at_most(simulated, criteria.accuracy)
        checks["simulated_off_predicted"] = at_most(abs(simulated / rms - 1), chance)
    if plan.task.simulation.runs and (len(plan.errors) or plan.lost):
        checks["simulations_lost"] = at_most(float(plan.lost), 0.0)
    return checks


def verdict_of(plan: PlanState, failed: list[str]) -> str:
    """The verdict, and what a person does where checks failed."""
    n = len(plan.poses)
    if plan.unpredicted:
        return f"not approved: {plan.unpredicted}"
    if not failed:
        return f"approved: {n} poses and {len(plan.held_out)} held out meet all criteria"
    hint = "take more poses (poses.most), a larger room or a better device"
    if plan.enough is not None and plan.enough > plan.task.poses.most:
        hint = f"some {plan.enough} poses would reach the accuracy; raise poses.most"
    if "simulations_lost" in failed:
        hint = f"{plan.lost} of {plan.task.simulation.runs} simulations did not end; free fewer parameters"
        hint += " or measure more of the pose, such as its orientation" if plan.measuring.latent else ""
    return f"not approved with {n} poses: {', '.join(failed)}; {hint}"
