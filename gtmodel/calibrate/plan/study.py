"""The plan study: select poses for a device, predict and simulate the calibration, approve it, write files for the
shop floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ... import view
from ...kinematics.workspace import Beam, Bodies, Box
from ...lang import Model
from ...motion import reference
from ...results import Check, SolveStatus, Work, at_most
from ...results.check import failed_of
from ...results.options import Long, Within
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ..options import Choice
from ..positioning import Point
from .device import measuring
from .options import (
    AnyDevice,
    Criteria,
    Evaluation,
    PlanLimits,
    PlanSimulation,
    PlanStudy,
    PosesToMeasure,
    Room,
    Safety,
    Task,
)
from .steps import (
    PlanState,
    Stop,
    Stopped,
    draw_curve,
    find_candidates,
    prepare_information,
    refuse_number,
    select,
    simulate,
    stages_of,
    turns_of,
)

Array = np.ndarray
FIT, HELD_OUT = "calibrate", "verify"


def in_order(poses: Array, held_out: Array, seed: int) -> tuple[Array, list[str]]:
    """All points (n, 3) in random order, which separates drift from geometry, and the purpose of each."""
    T = np.vstack([poses, held_out])
    purpose = [FIT] * len(poses) + [HELD_OUT] * len(held_out)
    order = np.random.default_rng(np.random.SeedSequence([seed, 1])).permutation(len(T))
    return T[order], [purpose[k] for k in order]


def poses_csv(T: Array, q: Array, purpose: list[str], title: str) -> str:
    """One row per pose, in measuring order."""
    carts, axes = 1e3 * q[:, :3], np.degrees(q[:, 3:])
    columns: dict[str, Any] = {f"q[{k}] [mm]": x for k, x in enumerate(carts.T)}
    columns |= {f"q[{k}] [deg]": x for k, x in enumerate(axes.T, 3)}
    columns |= {f"T[{k}] [mm]": x for k, x in enumerate(1e3 * T[:, :3].T)}
    quaternions = {f"e[{k}]": x for k, x in enumerate(T[:, 3:].T)}
    forms = dict.fromkeys(columns, ".4f") | dict.fromkeys(quaternions, ".9f")
    notes = ["commanded poses of a calibration plan; nothing here is measured", *([f"title: {title}"] if title else [])]
    return csv_text({"pose": range(1, len(T) + 1), "purpose": purpose} | columns | quaternions, forms, notes)


def rapid_program(T: Array, q: Array, title: str, settle: float) -> str:
    """A RAPID module that moves to each pose, stops, waits and counts. Text only: tested against no controller."""
    rotary = ", d, e, f the rotary axes in degrees" if q.shape[1] == 6 else ""
    return reference.module(
        "GtCalibration",
        [
            title or "calibration poses",
            "Written by gtmodel; tested against no controller. Check workspace, work object and tool first.",
            "The robot is not calibrated yet: keep the speed low and a hand on the stop.",
            f"Positions in mm; external axes a, b, c are the carts in mm{rotary}.",
        ],
        [
            f"LOCAL CONST num GtCount := {len(T)};",
            f"LOCAL CONST num GtSettle := {reference.number_text(settle)};",
            "PERS num GtPose := 0;",
        ],
        "GtPoses",
        reference.robtargets(T, q),
        [
            "PROC GtMeasure(PERS tooldata tool, PERS wobjdata wobj)",
            "  FOR i FROM 1 TO GtCount DO",
            "    MoveJ GtPoses{i}, v200, fine, tool \\WObj:=wobj;",
            "    GtPose := i;",
            "    WaitTime \\InPos, GtSettle;",
            "  ENDFOR",
            "  GtPose := 0;",
            "ENDPROC",
        ],
    )


Figures = dict[str, Callable[[], Any]]


def pictures(plan: PlanState) -> Figures:
    """Name -> function that draws the picture, in the order of the steps."""
    figures: Figures = {}
    if plan.candidates is None:
        return figures
    stages = plan.candidates.stages
    T = plan.candidates.T[:, :3]
    first = {"workspace": T[stages["workspace"]]}
    figures["1_workspace"] = partial(_space, plan, first, "workspace of the nominal parameters", boxes=False)
    if "safety" in stages:
        second = {
            "left for calibration": T[stages["safety"]],
            "reachable, but not safe": T[stages["workspace"] & ~stages["safety"]],
        }
        figures["2_obstacles_and_safety"] = partial(_space, plan, second, "workspace with obstacles and safety zones")
    if "safety distance" in stages or (plan.candidates.complete and "device" in stages):
        last = next(reversed(stages.values()))
        third = {
            "measurable": last,
            "seen, but too near the edge": stages["device"] & ~last,
            "not seen": stages["safety"] & ~stages["device"],
        }
        layers = {name: T[m] for name, m in third.items()}
        figures["3_device"] = partial(_space, plan, layers, "points that the device measures", device=True)
    if len(plan.poses):
        fourth = {
            name: P[:, :3]
            for name, P in (("candidates", plan.pool), ("calibrate", plan.poses), ("held out", plan.held_out))
        }
        figures["4_poses"] = partial(_space, plan, fourth, "poses to measure", device=True)
    if plan.curve is not None and plan.curve.points:
        figures["5_number_of_poses"] = partial(_curve, plan)
    if plan.chosen is not None and not plan.unpredicted:
        figures["6_parameters"] = partial(_parameters, plan)
        figures["7_predicted_error"] = partial(_errors, plan)
    return figures


def _space(
    plan: PlanState, layers: dict[str, np.ndarray], step: str, *, boxes: bool = True, device: bool = False
) -> Any:
    from ...plot.calibration import room_figure

    task, home = plan.task, plan.robot.home
    return room_figure(
        (home.a[0], home.b[0], home.T[0], plan.robot.directions),
        layers,
        room=(np.array(task.room.low), np.array(task.room.high)),
        boxes=[(np.array(b.low), np.array(b.high)) for b in task.obstacles] if boxes else [],
        device=plan.measuring.at if device else None,
        again="points with several orientations" if len(plan.turns) > 1 else "chosen more than once",
        title=_titled(plan, step),
    )


def _titled(plan: PlanState, what: str) -> str:
    return f"{plan.task.title or 'calibration plan'}: {what}"


def _curve(plan: PlanState) -> Any:
    from ...plot.calibration import curve_figure

    assert plan.curve is not None
    return curve_figure(
        plan.curve.points, plan.grids, plan.task.criteria.accuracy, title=_titled(plan, "error against number of poses")
    )


def _parameters(plan: PlanState) -> Any:
    from ...plot.calibration import parameters_figure

    assert plan.chosen is not None
    std = np.array(list(plan.chosen.std().values()))
    simulated = np.sqrt(np.mean(plan.errors**2, axis=0)) if len(plan.errors) else None
    title = _titled(plan, "predicted parameters")
    return parameters_figure(plan.chosen.names, std, simulated, units=plan.units, runs=len(plan.errors), title=title)


def _errors(plan: PlanState) -> Any:
    from ...plot.calibration import predicted_figure

    simulated = plan.each_simulated() if len(plan.errors) else None
    return predicted_figure(
        plan.evaluation[:, :3],
        plan.each_predicted(),
        simulated,
        runs=len(plan.errors),
        title=_titled(plan, "predicted error by place"),
    )


# allowed difference of simulated and predicted error in standard deviations: exceeded by chance in 1 of 16,000 plans
AGREEMENT = 4.0


def checks_of(plan: PlanState) -> dict[str, Check]:
    """The criteria of a plan with selected poses."""
    assert plan.identifiability is not None and plan.chosen is not None
    criteria, identifiability = plan.task.criteria, plan.identifiability
    # combinations that move no tool centre point are a choice of coordinates, such as a frame in an F1's joint plate
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
    """The verdict, and advice if checks failed."""
    n = len(plan.poses)
    if plan.unpredicted:
        return f"not approved: {plan.unpredicted}"
    if not failed:
        return f"approved: {n} poses and {len(plan.held_out)} held-out poses meet all criteria"
    hint = "use more poses (poses.most), a larger room or a better device"
    if plan.enough is not None and plan.enough > plan.task.poses.most:
        hint = f"about {plan.enough} poses would reach the accuracy; increase poses.most"
    if "simulations_lost" in failed:
        hint = f"{plan.lost} of {plan.task.simulation.runs} simulations did not converge; free fewer parameters"
        hint += " or measure more of the pose, such as its orientation" if plan.measuring.latent else ""
    return f"not approved with {n} poses: {', '.join(failed)}; {hint}"


@study_function
def plan_study(
    robot: Model,
    device: AnyDevice,
    room: Room,
    *,
    choice: Choice | None = None,
    home: Annotated[Sequence[float] | None, Long(3)] = None,
    limits: PlanLimits | None = None,
    bodies: Bodies | None = None,
    obstacles: Sequence[Box] = (),
    beams: Sequence[Beam] = (),
    safety: Safety | None = None,
    actuator_noise: Annotated[float | None, Within(least=0.0)] = None,
    axis_noise: Annotated[float | None, Within(above=0.0)] = None,
    poses: PosesToMeasure | None = None,
    curve: Annotated[Sequence[int] | None, Within(above=0)] = None,
    evaluation: Evaluation | None = None,
    simulation: PlanSimulation | None = None,
    criteria: Criteria | None = None,
    **work_options: Unpack[WorkOptions],
) -> PlanStudy:
    """Select poses for a calibration and predict its accuracy (Dressler 2012, Fig. 5.21).

    Args:
        robot: the model with its nominal parameters.
        device: a Tracker, PatternCamera, Wire or Gauge.
        room: the box in which poses are selected.
        choice: parameters to calibrate; all if left out.
        home: (3,) pose of the cone axes [m]; the robot's home if left out.
        limits, bodies, obstacles, beams: limits of the poses; obstacles also block the view of the device.
        safety: distances kept because the robot is not yet calibrated.
        actuator_noise: repeatability of the carts [m], default 13e-6; axis_noise: of an F1's rotary axes [rad],
            default 20e-6.
        poses: number of poses and selection method; more are added while the criteria are not met.
        curve: numbers of poses for the curve of predicted errors and for the sufficient number; () for no curve.
        evaluation: where the robot must be accurate; by default everywhere it reaches without safety distances.
        simulation: simulated calibrations with the device's noise.
        criteria: criteria that the plan must meet.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    If interrupted, the study holds the finished steps. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.calibrate.plan import PosesToMeasure, Room, PlanSimulation, Tracker
    >>> s = gt.calibrate.plan_study(
    ...     gt.robots.gantry_tau("l1_tape"), Tracker([1.0, -4.5, 0.8]), Room([0.8, -1, 0.4], [2, 0, 1.4], step=0.25),
    ...     poses=PosesToMeasure(12, held_out=0, starts=1), curve=(), simulation=PlanSimulation(runs=0),
    ... )
    >>> (s.poses, s.rank, s.parameters)
    (12, 21, 21)
    """
    work = Work(**work_options)
    options: dict[str, Any] = {
        "choice": choice, "home": home, "limits": limits, "bodies": bodies, "obstacles": obstacles, "beams": beams,
        "safety": safety, "actuator_noise": actuator_noise, "axis_noise": axis_noise, "poses": poses, "curve": curve,
        "evaluation": evaluation, "simulation": simulation, "criteria": criteria, "title": work.title,
    }  # fmt: skip
    task = Task(robot, device, room, **{name: value for name, value in options.items() if value is not None})
    plan = PlanState(task, turns_of(task), measuring(task))

    def stop_at(stage: str, fraction: float) -> bool:
        work.progress(stage, fraction)
        return work.interrupted()

    try:
        find_candidates(plan, stop_at)
        prepare_information(plan)
        refuse_number(plan)  # before the long steps
        if not plan.unpredicted:
            draw_curve(plan, stop_at)
        _until_approved(plan, stop_at)
    except Stopped:
        if plan.candidates is None:
            return PlanStudy(status=SolveStatus.INTERRUPTED, title=work.title)
        return PlanStudy(
            status=SolveStatus.INTERRUPTED, title=work.title, **_known(plan), verdict="stopped before the end",
            figures=pictures(plan),
        )  # fmt: skip
    return _study_of(plan)


def _until_approved(plan: PlanState, stop: Stop) -> None:
    """Add poses while the criteria are not met."""
    options = plan.task.poses
    number = options.number
    while True:
        select(plan, number, stop)
        if not plan.unpredicted and plan.task.simulation.runs and not failed_of(checks_of(plan)):
            simulate(plan, stop)
        following = min(number + options.more, options.most)
        # more poses do not help if the device measures too little
        if not failed_of(checks_of(plan)) or plan.unpredicted or following <= number:
            return
        number = following


def _known(plan: PlanState) -> dict[str, Any]:
    """The quantities of the finished steps."""
    assert plan.candidates is not None
    counts, identifiability, info = plan.candidates.counts, plan.identifiability, plan.chosen
    e = plan.target.errors(info) if info and not plan.unpredicted else None
    runs = plan.each_simulated() if e is not None and len(plan.errors) else None
    quantities: dict[str, Any] = {
        "stages": counts,
        "workspace_left": counts[next(reversed(counts))] / max(1, counts["workspace"]),
        "poses": len(plan.poses),
        "held_out": len(plan.held_out),
        "rounds": plan.rounds,
        "simulated_error": None if runs is None else float(np.sqrt(np.mean(runs**2))),
        "simulations_lost": plan.lost,
        "curve": _points(() if plan.curve is None else plan.curve.points),
        "grid_curve": _points(plan.grids),
        "enough_poses": plan.enough,
        "assumptions": [
            *stages_of(plan.task, plan.turns[0], plan.measuring)["device"].assumptions,
            "predicted and simulated errors come only from the device's noise: errors of the model itself add to them",
        ],
    }
    if identifiability is not None:
        quantities |= {f"o{k}": getattr(identifiability.indices, f"o{k}") for k in range(1, 6)}
        quantities |= {
            "rank": identifiability.rank,
            "determined_no_better": len(identifiability.near),
            "condition": identifiability.condition,
            "identifiability": identifiability.notes,
        }
    if info is not None:
        std = {name: s if np.isfinite(s) else None for name, s in info.std().items()}
        quantities |= {"parameters": len(info.names), "parameter_std": std}
    if e is not None:
        worst = plan.evaluation[int(np.argmax(e.each)), :3]
        quantities |= {"predicted_error": e.rms, "predicted_greatest": e.greatest, "worst_place": worst}
    return quantities


def _points(points: Sequence[Point]) -> list[dict[str, float]]:
    return [{"poses": p.poses, "predicted_error_m": p.rms, "greatest_m": p.greatest} for p in points]


def _in_space(plan: PlanState, T: np.ndarray, purpose: Sequence[str]) -> view.RobotScene:
    """The robot, the poses by purpose, the device, obstacles, and predicted errors over the room."""
    task, info = plan.task, plan.chosen
    bodies = [*view.groups(T[:, :3], [f"pose to {word}" for word in purpose])]
    bodies += [obstacle.body() for obstacle in (*task.obstacles, *task.beams)]
    place = getattr(task.device, "at", None)
    bodies += [] if place is None else [view.dots([place], marker="square", name="device", colour="#000000")]
    drawn, note = [], ""
    if info is not None and not plan.unpredicted:
        drawn, note = view.ellipsoids(plan.evaluation[:, :3], plan.target.errors(info).covariance)
    return view.around(task.robot, [*bodies, *drawn], title=task.title, note=note)


def _study_of(plan: PlanState) -> PlanStudy:
    checks, title = checks_of(plan), plan.task.title
    failed = failed_of(checks)
    verdict = verdict_of(plan, list(failed))
    T, purpose = in_order(plan.poses, plan.held_out, plan.task.poses.seed)
    q, e, _ = plan.measuring.placed(T)
    targets = T if e is None else np.hstack([T[:, :3], e])
    return PlanStudy(
        status=SolveStatus.SOLVED,
        message=verdict,
        title=title,
        checks={name: replace(c, advice=verdict) if name in failed else c for name, c in checks.items()},
        **_known(plan),
        approved=not failed,
        verdict=verdict,
        commanded=T,
        purpose=purpose,
        actuators=q,
        figures=pictures(plan),
        scenes={"poses": partial(_in_space, plan, T, purpose)},
        files={
            "poses.csv": poses_csv(T, q, purpose, title),
            "poses.mod": rapid_program(targets, q, title, plan.task.poses.settle),
        },
        machine_files=("poses.csv", "poses.mod"),
    )
