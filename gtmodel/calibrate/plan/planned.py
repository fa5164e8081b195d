"""The plan study: which poses to measure with which device, and what the calibration will then be worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from ...kinematics.workspace import Beam, Bodies, Box
from ...lang import Model
from ...results import SolveStatus, Work
from ...results.check import failed_of
from ...results.door import study_function
from ...results.options import Long, Within
from ...results.work import Progress, never, silent
from ..choice import Choice
from ..pose_numbers import Point
from .device import measuring
from .files import in_order, poses_csv, rapid_program
from .options import AnyDevice, Criteria, Evaluation, PlanLimits, PlanSimulation, PosesToMeasure, Room, Safety
from .pictures import pictures
from .result import PlanStudy
from .stages import stages_of
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
)
from .task import Task
from .turns import turns_of
from .verdict import checks_of, verdict_of


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
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> PlanStudy:
    """Which poses to measure for a calibration, and what it will then be worth (Dressler 2012, Fig. 5.21).

    Args:
        robot: with the parameters as they are thought to be.
        device: what measures: a Tracker, PatternCamera, Wire or Gauge.
        room: where poses are looked for.
        choice: which parameters are calibrated; all if left out.
        home: (3,) pose of the cone axes [m]; the robot's own if left out.
        limits, bodies, obstacles, beams: what poses must keep; obstacles also hide the robot from the device.
        safety: distances kept because the robot is not yet calibrated.
        actuator_noise: repeatability of the carts [m], 13e-6 if left out; axis_noise: of an F1's rotary axes [rad],
            20e-6 if left out.
        poses: how many, and how they are selected; more are added while the criteria are not met.
        curve: numbers of poses for the curve of predicted errors, with the number that suffices; () for none.
        evaluation: where the robot must be accurate; all that it reaches without safety distances if left out.
        simulation: simulated calibrations with the device's noise.
        criteria: what the plan must reach.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Interrupted, it holds the steps that are done. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.calibrate.plan import PosesToMeasure, Room, PlanSimulation, Tracker
    >>> s = gt.calibrate.plan_study(
    ...     gt.robots.gantry_tau("l1_tape"), Tracker([1.0, -4.5, 0.8]), Room([0.8, -1, 0.4], [2, 0, 1.4], step=0.25),
    ...     poses=PosesToMeasure(12, held_out=0, starts=1), curve=(), simulation=PlanSimulation(runs=0),
    ... )
    >>> (s.poses, s.rank, s.parameters)
    (12, 21, 21)
    """
    given: dict[str, Any] = {
        "choice": choice, "home": home, "limits": limits, "bodies": bodies, "obstacles": obstacles, "beams": beams,
        "safety": safety, "actuator_noise": actuator_noise, "axis_noise": axis_noise, "poses": poses, "curve": curve,
        "evaluation": evaluation, "simulation": simulation, "criteria": criteria, "title": title,
    }  # fmt: skip
    task = Task(robot, device, room, **{name: value for name, value in given.items() if value is not None})
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    plan = PlanState(task, turns_of(task), measuring(task))

    def asked(stage: str, fraction: float) -> bool:
        work.progress(stage, fraction)
        return work.interrupted()

    try:
        find_candidates(plan, asked)
        prepare_information(plan)
        refuse_number(plan)  # before the work
        if not plan.unpredicted:
            draw_curve(plan, asked)
        _until_approved(plan, asked)
    except Stopped:
        if plan.candidates is None:
            return PlanStudy(status=SolveStatus.INTERRUPTED, title=title)
        return PlanStudy(
            status=SolveStatus.INTERRUPTED, title=title, **_known(plan), verdict="stopped before the end",
            figures=pictures(plan),
        )  # fmt: skip
    return _study_of(plan)


def _until_approved(plan: PlanState, stop: Stop) -> None:
    """More poses while the criteria are not met."""
    asked = plan.task.poses
    number = asked.number
    while True:
        select(plan, number, stop)
        if not plan.unpredicted and plan.task.simulation.runs and not failed_of(checks_of(plan)):
            simulate(plan, stop)
        following = min(number + asked.more, asked.most)
        # more poses mend no device that sees too little
        if not failed_of(checks_of(plan)) or plan.unpredicted or following <= number:
            return
        number = following


def _known(plan: PlanState) -> dict[str, Any]:
    """The quantities of the steps that are done."""
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
            "predicted and simulated errors come from the device's noise alone: a model that does not fit adds its own",
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


def _study_of(plan: PlanState) -> PlanStudy:
    checks, title = checks_of(plan), plan.task.title
    failed = failed_of(checks)
    verdict = verdict_of(plan, list(failed))
    T, purpose = in_order(plan.poses, plan.held_out, plan.task.poses.seed)
    q, e, _ = plan.measuring.placed(T)
    turned = T if e is None else np.hstack([T[:, :3], e])
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
        files={
            "poses.csv": poses_csv(T, q, purpose, title),
            "poses.mod": rapid_program(turned, q, title, plan.task.poses.settle),
        },
        machine_files=("poses.csv", "poses.mod"),
    )
