"""Kind "calibration_plan": which poses to measure with which device, and what the calibration will then be worth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, at_most
from gtmodel.results import SolveStatus

from .calibration_plan_device import measuring
from .calibration_plan_files import in_order, poses_csv, rapid_program
from .calibration_plan_keys import Schema
from .calibration_plan_pictures import pictures
from .calibration_plan_stages import stages_of
from .calibration_plan_steps import (
    Plan,
    Stopped,
    draw_curve,
    find_candidates,
    prepare_information,
    select,
    simulate,
)
from .calibration_plan_turns import turns_of

NAME = "calibration_plan"

VALUES = {
    "approved": "whether all criteria are met",
    "verdict": "that in a sentence",
    "stages": "grid points left after each stage: workspace, obstacles, safety, device, safety distance",
    "workspace_left": "share of the workspace's points that are left for calibration",
    "poses": "number of poses to calibrate with",
    "held_out": "number of poses to judge the result by",
    "rounds": "numbers of poses that were tried",
    "parameters": "number of parameters to calibrate",
    "told": "how many combinations of them the poses tell",
    "told_no_better": "how many of these they tell no better than they were known",
    "condition": "condition number of the slopes, in expected errors per noise",
    "o1": "observability index O1, geometric mean of singular values by the root of the number of poses",
    "o2": "O2, least by greatest singular value",
    "o3": "O3, least singular value",
    "o4": "O4, noise amplification: least singular value squared by the greatest",
    "o5": "O5, 1 / sum of 1 / singular values",
    "identifiability": "what is told and what is not, in sentences",
    "parameter_std": "predicted standard deviation by parameter, SI; null where not told",
    "predicted_error_m": "predicted rms positioning error over the workspace after calibration, from noise alone",
    "predicted_greatest_m": "the same at the worst place",
    "worst_place_m": "where that is",
    "simulated_error_m": "rms positioning error of the simulated calibrations; synthetic",
    "simulations_lost": "simulated calibrations that did not end",
    "curve": "for selected poses: poses, predicted_error_m, greatest_m",
    "grid_curve": "the same for regular grids",
    "enough_poses": "least number of selected poses with the wanted accuracy; null if more than four times poses.most",
    "assumptions": "what was assumed, in sentences",
}

# standard deviations by which the simulated error may be off the predicted one: one in 16,000 plans by chance
AGREEMENT = 4.0


def solve(problem: Schema, context: Context) -> Outcome:
    """The steps of Fig. 5.21, with more poses while the criteria are not met."""
    if context.start is not None:
        raise InputError("--start: a plan is made from the beginning; leave it out")
    turns = turns_of(problem, problem.model(context))
    plan = Plan(problem, turns, measuring(problem, turns[0].robot.model))

    def stop(stage: str, fraction: float) -> bool:
        context.progress(stage, fraction)
        return context.interrupted()

    try:
        find_candidates(plan, stop)
        prepare_information(plan)
        if not plan.unpredicted:
            draw_curve(plan, stop)
        _until_approved(plan, stop)
    except Stopped:
        values = _values(plan, {}, "stopped before the end") if plan.found else {}
        return Outcome(
            status=SolveStatus.INTERRUPTED, message=SolveStatus.INTERRUPTED.sentence, values=values,
            figures=pictures(plan),
        )  # fmt: skip
    return _outcome(plan)


def explain(problem: Schema, context: Context) -> str:
    """The steps and what a point must pass."""
    turns = turns_of(problem, problem.model(context))
    device = measuring(problem, turns[0].robot.model)
    stages = stages_of(problem, turns[0], device)
    lines = [f"{problem.title or 'calibration plan'}: candidates every {problem.room.step_m:g} m, which must pass"]
    seen: list[str] = []
    for name, reach in stages.items():
        new = [limit.name for limit in reach.limits if limit.name not in seen]
        seen += new
        if name == "safety":
            s = problem.safety
            new = [f"the same, {s.cone_deg:g} deg, {s.stroke_m:g} m of stroke and {s.obstacles_m:g} m of air narrower"]
        lines.append(f"  {name}: {', '.join(['inverse kinematics'] * (name == 'workspace') + new) or 'nothing more'}")
    lines.append(f"  safety distance: {problem.safety.edge_m:g} m in 26 directions")
    p = problem.poses
    many = f"{p.number} to {p.most} poses by {p.method}, and {p.held_out} held out"
    lines.append(f"then {many}; {device.signal} is measured")
    return "\n".join([*lines, *(f"  {s}" for s in stages["device"].assumptions)])


def _until_approved(plan: Plan, stop: Any) -> None:
    keys = plan.problem.poses
    number = keys.number
    while True:
        select(plan, number, stop)
        if not plan.unpredicted and plan.problem.simulation.runs and not _failed(_checks(plan)):
            simulate(plan, stop)
        following = min(number + keys.more, keys.most)
        # more poses mend no device that sees too little
        if not _failed(_checks(plan)) or plan.unpredicted or following <= number:
            return
        number = following


def _checks(plan: Plan) -> dict[str, Check]:
    assert plan.told is not None and plan.chosen is not None
    keys, told = plan.problem.criteria, plan.told
    accuracy = 1e-3 * keys.accuracy_mm
    # what moves no tool centre point is a choice of coordinates, such as a frame inside an F1's joint plate
    untold = float(max(1, told.redundant)) if plan.unpredicted else 0.0
    checks = {"parameters_not_told": at_most(untold, 0.0)}
    if keys.condition is not None:
        checks["condition"] = at_most(told.condition, keys.condition)
    if keys.noise_amplification is not None:
        amplified, bound = 1 / told.indices.o4, 1 / keys.noise_amplification
        checks["inverse_of_o4"] = at_most(amplified, bound)
    if not plan.unpredicted:
        assert plan.target is not None
        rms = plan.target.errors(plan.chosen).rms
        checks["predicted_error_m"] = at_most(rms, accuracy)
        if len(plan.errors):
            simulated = float(np.sqrt(np.mean(plan.each_simulated() ** 2)))
            checks["simulated_error_m"] = at_most(simulated, accuracy)
            off = abs(simulated / rms - 1)
            chance = AGREEMENT * plan.target.spread(plan.chosen, len(plan.errors))
            checks["simulated_off_predicted"] = at_most(off, chance)
        if plan.problem.simulation.runs and (len(plan.errors) or plan.lost):
            checks["simulations_lost"] = at_most(float(plan.lost), 0.0)
    return checks


def _failed(checks: dict[str, Check]) -> list[str]:
    return [name for name, check in checks.items() if not check.passed]


def _values(plan: Plan, checks: dict[str, Check], verdict: str) -> dict[str, Any]:
    assert plan.found is not None
    counts = plan.found.counts
    told, info = plan.told, plan.chosen
    e = plan.target.errors(info) if plan.target and info and not plan.unpredicted else None
    runs = plan.each_simulated() if e is not None and len(plan.errors) else None
    stages = stages_of(plan.problem, plan.turns[0], plan.measuring)
    return {
        "approved": bool(checks) and not _failed(checks),
        "verdict": verdict,
        "stages": counts,
        "workspace_left": counts[next(reversed(counts))] / max(1, counts["workspace"]),
        "poses": len(plan.poses),
        "held_out": len(plan.held_out),
        "rounds": plan.rounds,
        "parameters": None if info is None else len(info.names),
        "told": None if told is None else told.rank,
        "told_no_better": None if told is None else len(told.near),
        "condition": None if told is None else told.condition,
        **{f"o{k}": None if told is None else getattr(told.indices, f"o{k}") for k in range(1, 6)},
        "identifiability": [] if told is None else told.sentences(),
        "parameter_std": {} if info is None else {n: s if np.isfinite(s) else None for n, s in info.std().items()},
        "predicted_error_m": None if e is None else e.rms,
        "predicted_greatest_m": None if e is None else e.greatest,
        "worst_place_m": None if e is None else plan.evaluation[int(np.argmax(e.each)), :3].tolist(),
        "simulated_error_m": None if runs is None else float(np.sqrt(np.mean(runs**2))),
        "simulations_lost": plan.lost,
        "curve": _points(() if plan.curve is None else plan.curve.points),
        "grid_curve": _points(plan.grids),
        "enough_poses": plan.enough,
        "assumptions": [
            *stages["device"].assumptions,
            "predicted and simulated errors come from the device's noise alone: a model that does not fit adds its own",
        ],
    }


def _points(points: Any) -> list[dict[str, float]]:
    return [{"poses": p.poses, "predicted_error_m": p.rms, "greatest_m": p.greatest} for p in points]


def _verdict(plan: Plan, failed: list[str]) -> str:
    n = len(plan.poses)
    if plan.unpredicted:
        return f"not approved: {plan.unpredicted}"
    if not failed:
        return f"approved: {n} poses and {len(plan.held_out)} held out meet all criteria"
    hint = "take more poses (poses.most), a larger room or a better device"
    if plan.enough is not None and plan.enough > plan.problem.poses.most:
        hint = f"some {plan.enough} poses would reach the accuracy; raise poses.most"
    if "simulations_lost" in failed:
        hint = f"{plan.lost} of {plan.problem.simulation.runs} simulations did not end; free fewer parameters"
        hint += " or measure more of the pose, such as its orientation" if plan.measuring.latent else ""
    return f"not approved with {n} poses: {', '.join(failed)}; {hint}"


def _outcome(plan: Plan) -> Outcome:
    checks = _checks(plan)
    verdict = _verdict(plan, _failed(checks))
    values = _values(plan, checks, verdict)
    checks = {name: check if check.passed else replace(check, advice=verdict) for name, check in checks.items()}
    T, purpose = in_order(plan.poses, plan.held_out, plan.problem.poses.seed)
    q, *_ = plan.measuring.placed(T)
    title = plan.problem.title
    return Outcome(
        status=SolveStatus.SOLVED,
        message=verdict,
        checks=checks,
        values=values,
        rows=_rows(plan, values),
        figures=pictures(plan),
        files={
            "poses.csv": poses_csv(T, q, purpose, title),
            "poses.mod": rapid_program(T, q, title, plan.problem.poses.settle_s),
        },
        machine_files=("poses.csv", "poses.mod"),
    )


def _rows(plan: Plan, values: dict[str, Any]) -> list[Row]:
    rows = [Row(f"points after {name}", count) for name, count in values["stages"].items()]
    rows += [
        Row("share of the workspace left", values["workspace_left"]),
        Row("poses to calibrate with", values["poses"]),
        Row("poses held out", values["held_out"]),
        Row("parameters told", _told(values)),
        Row("condition number", values["condition"]),
        *(Row(f"observability O{k}", values[f"o{k}"]) for k in range(1, 6)),
    ]
    if values["predicted_error_m"] is not None:
        rows += [
            Row("predicted rms error", 1e3 * values["predicted_error_m"], "mm"),
            Row("at the worst place", 1e3 * values["predicted_greatest_m"], "mm"),
        ]
    if values["simulated_error_m"] is not None:
        rows.append(Row("simulated rms error (synthetic)", 1e3 * values["simulated_error_m"], "mm"))
    if values["curve"]:
        enough = values["enough_poses"]
        rows.append(Row("poses that suffice", "more than looked at" if enough is None else enough))
    for curve, kind in (("curve", "selected"), ("grid_curve", "of a grid")):
        rows += [Row(f"error with {p['poses']} {kind}", 1e3 * p["predicted_error_m"], "mm") for p in values[curve]]
    if values["told"] != values["parameters"] or values["told_no_better"]:
        rows += [Row("not told", sentence) for sentence in values["identifiability"][1:]]
    return rows + [Row("assumed", sentence) for sentence in values["assumptions"]]


def _told(values: dict[str, Any]) -> str:
    weak = values["told_no_better"]
    said = f"{values['told'] - weak} of {values['parameters']}"
    return f"{said}, {weak} more no better than they were known" if weak else said
