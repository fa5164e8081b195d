"""The pictures of a calibration plan, one for each step that was done."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .steps import PlanState

Figures = dict[str, Callable[[], Any]]


def pictures(plan: PlanState) -> Figures:
    """Name -> function that draws it, in the order of the steps."""
    drawn: Figures = {}
    if plan.candidates is None:
        return drawn
    stages = plan.candidates.stages
    T = plan.candidates.T[:, :3]
    first = {"workspace": T[stages["workspace"]]}
    drawn["1_workspace"] = partial(_space, plan, first, "workspace of the a-priori parameters", boxes=False)
    if "safety" in stages:
        second = {
            "left for calibration": T[stages["safety"]],
            "reached, but not safe": T[stages["workspace"] & ~stages["safety"]],
        }
        drawn["2_obstacles_and_safety"] = partial(_space, plan, second, "what obstacles and safety zones leave")
    if "safety distance" in stages or (plan.candidates.complete and "device" in stages):
        last = next(reversed(stages.values()))
        third = {
            "measurable": last,
            "seen, too near the edge": stages["device"] & ~last,
            "not seen": stages["safety"] & ~stages["device"],
        }
        layers = {name: T[m] for name, m in third.items()}
        drawn["3_device"] = partial(_space, plan, layers, "what the device measures", device=True)
    if len(plan.poses):
        fourth = {
            name: P[:, :3]
            for name, P in (("candidates", plan.pool), ("calibrate", plan.poses), ("held out", plan.held_out))
        }
        drawn["4_poses"] = partial(_space, plan, fourth, "poses to measure", device=True)
    if plan.curve is not None and plan.curve.points:
        drawn["5_number_of_poses"] = partial(_curve, plan)
    if plan.chosen is not None and not plan.unpredicted:
        drawn["6_parameters"] = partial(_parameters, plan)
        drawn["7_predicted_error"] = partial(_errors, plan)
    return drawn


def _space(
    plan: PlanState, layers: dict[str, np.ndarray], step: str, *, boxes: bool = True, device: bool = False
) -> Any:
    from ...plot.calibration_plan import room_figure

    task, home = plan.task, plan.robot.home
    return room_figure(
        (home.a[0], home.b[0], home.T[0], plan.robot.directions),
        layers,
        room=(np.array(task.room.low), np.array(task.room.high)),
        boxes=[(np.array(b.low), np.array(b.high)) for b in task.obstacles] if boxes else [],
        device=plan.measuring.at if device else None,
        again="points with several turns" if len(plan.turns) > 1 else "of them more than once",
        title=_titled(plan, step),
    )


def _titled(plan: PlanState, what: str) -> str:
    return f"{plan.task.title or 'calibration plan'}: {what}"


def _curve(plan: PlanState) -> Any:
    from ...plot.calibration_plan import curve_figure

    assert plan.curve is not None
    return curve_figure(
        plan.curve.points, plan.grids, plan.task.criteria.accuracy, title=_titled(plan, "error by number of poses")
    )


def _parameters(plan: PlanState) -> Any:
    from ...plot.calibration_plan import parameters_figure

    assert plan.chosen is not None
    std = np.array(list(plan.chosen.std().values()))
    own = np.sqrt(np.mean(plan.errors**2, axis=0)) if len(plan.errors) else None
    title = _titled(plan, "predicted parameters")
    return parameters_figure(plan.chosen.names, std, own, units=plan.units, runs=len(plan.errors), title=title)


def _errors(plan: PlanState) -> Any:
    from ...plot.calibration_plan import predicted_figure

    simulated = plan.each_simulated() if len(plan.errors) else None
    return predicted_figure(
        plan.evaluation[:, :3],
        plan.each_predicted(),
        simulated,
        runs=len(plan.errors),
        title=_titled(plan, "predicted error by place"),
    )
