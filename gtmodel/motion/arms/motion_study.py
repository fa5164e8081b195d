"""The study of an arm's motion: optimise all segments at once, re-simulate them, check limits, poses and distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack, cast

import numpy as np

from ... import view
from ...compiler.causal import compile_causal
from ...kinematics.clearance import Clearance
from ...kinematics.clearance.distances import RESOLUTION_M
from ...lang import Model
from ...optimize import Mesh as CollocationMesh, Phases, Solution, SolverOptions, solve, solve_phases
from ...optimize.judgement.resimulate import Resimulation, resimulate
from ...results import Check, SolveStatus, Trajectory, Work, at_least, at_most
from ...results.interpolation import CubicHermite
from ...results.trajectory_files import TRAJECTORY, csv_bytes
from ...results.work import WorkOptions, study_function
from ..axes.options import AxisCost, AxisMesh
from ..finer_mesh import FINER, PEAK_SHARE, OnMesh, study_on_meshes
from ..motion_result import short_names
from ..options import Solver
from ..reference import grid
from .options import ArmLimits, ArmPose, ArmStudy, Waypoint
from .task import AHEAD_M, ArmTask, task_of

Array = np.ndarray
LITTLE_EFFORT = AxisCost(energy=0.05)  # without it many motions are equally fast
ROUNDS = 5  # of adding pairs that came too near
MISSED = 1e-3  # rad and m, of the re-simulated motion, whose input is not fed back
MENDED = ("peak_speed", "peak_effort", "missed", "clearance_short")
NAMES = ("q", "der(q)", "der(q,2)", "tau", "T")


@dataclass(frozen=True)
class Segments:
    """The solutions of the segments, the pairs that were constraints, and the iterations so far."""

    solutions: list[Solution]
    active: list[int]
    spent: int


def optimised(
    task: ArmTask, active: Sequence[int], mesh: AxisMesh, guess: Sequence[Trajectory], solver: Solver, work: Work,
    spent: int,
) -> list[Solution]:  # fmt: skip
    """Return the solutions of all segments, solved as one problem, from a guess for each."""
    segments = {str(k): task.segment(k, active, run) for k, run in enumerate(guess)}
    grid = CollocationMesh(mesh.elements, mesh.points, control=mesh.control)
    options = SolverOptions(
        error_bound=None,  # the study judges the motion by its re-simulation
        tolerance=solver.tolerance, formulation=solver.formulation, barrier=cast(Any, solver.barrier),
        max_iterations=max(1, solver.max_iterations - spent), max_seconds=work.seconds_left(),
    )  # fmt: skip
    report = work.iterations("optimising")
    if len(segments) == 1:
        return [solve(segments["0"], grid, guess=guess[0], solver=options, progress=report, throw=False)]
    by_name = dict(zip(segments, guess, strict=True))
    phases = solve_phases(Phases(segments), grid, guess=by_name, solver=options, progress=report, throw=False)
    return list(phases.phases.values())


def on_this_mesh(
    task: ArmTask, solver: Solver, work: Work, mesh: AxisMesh, before: OnMesh | None
) -> OnMesh:  # fmt: skip
    """Optimise on a mesh, adding pairs that come too near, and evaluate the result."""
    if before is None:
        guess = task.guess()
        active, begun = _ahead(task, guess), 0
    else:
        guess, active, begun = _with_planes(task, before.kept.solutions), before.kept.active, before.kept.spent
    solutions, spent = list[Solution](), begun
    for _ in range(ROUNDS):
        solutions = optimised(task, active, mesh, guess, solver, work, spent)
        spent += solutions[0].iterations
        if not solutions[0].status.converged or task.near is None:
            break
        distances = np.vstack([task.near.distances(s.trajectory["robot.q"]) for s in solutions])
        near = np.flatnonzero(distances.min(axis=0, initial=np.inf) < task.required)
        added = sorted(set(near.tolist()) - set(active))
        if not added or work.interrupted():
            break
        active, guess = sorted({*active, *added}), _with_planes(task, solutions)
    study = _evaluated(task, mesh, solutions, active, work.title)
    return OnMesh(mesh, study.with_(iterations=spent - begun), Segments(solutions, active, spent))


def _ahead(task: ArmTask, guess: Sequence[Trajectory]) -> list[int]:
    """Return the pairs that come near along a guess."""
    if task.near is None or task.clearance is None:
        return []
    distances = np.vstack([task.near.distances(run["robot.q"]) for run in guess])
    return np.flatnonzero(distances.min(axis=0, initial=np.inf) < task.clearance.distance + AHEAD_M).tolist()


def _with_planes(task: ArmTask, solutions: Sequence[Solution]) -> list[Trajectory]:
    """Return the motions of solutions as guesses, with planes between all pairs."""
    runs = [s.trajectory for s in solutions]
    kept = ("robot.q", "der(robot.q)", "der(robot.q,2)")
    return [
        Trajectory(run.time, {n: run[n] for n in kept if n in run} | task.planes(run["robot.q"]), {}) for run in runs
    ]


def _evaluated(
    task: ArmTask, mesh: AxisMesh, solutions: Sequence[Solution], active: Sequence[int], title: str
) -> ArmStudy:
    first = solutions[0]
    if not first.status.converged:
        message = first.message
        if active and task.near is not None and first.status is not SolveStatus.INTERRUPTED:
            pairs = ", ".join("-".join(task.near.names[p]) for p in active[:4])
            message += (
                f"; distances of {pairs} are constraints, and the straight motion between the poses may pass on the "
                "wrong side: add waypoints around the obstacle"
            )
        best = _joined([s.trajectory for s in solutions], f"{title} (not solved: {first.status.value})".strip())
        return ArmStudy(
            status=first.status, message=message, title=title, trajectory=best, machine_files=(TRAJECTORY,)
        )  # fmt: skip
    runs: list[Resimulation] = [resimulate(s) for s in solutions]
    failed = next((r.message for r in runs if r.trajectory is None), "")
    parts = [s.trajectory if r.trajectory is None else r.trajectory for s, r in zip(solutions, runs, strict=True)]
    run = _joined(parts, title or "optimal motion of an arm")
    pose = compile_causal(task.robot, known="q", targets=["T", "R"])
    places = [0, *np.cumsum([len(x) - 1 for x in parts]).tolist()]
    q = run["q"]
    T, R, _ = pose(q[places])
    missed = max(s.missed(q[n], T[k], R[k]) for k, (s, n) in enumerate(zip(task.poses, places, strict=True)))
    speeds = np.max(np.abs(run["der(q)"]), axis=0) / task.speed
    efforts = np.max(np.abs(run["tau"]), axis=0) / task.effort
    checks: dict[str, Check] = {
        "constraint_violation": max((s.checks["constraint_violation"] for s in solutions), key=lambda c: c.value),
        "peak_speed": at_most(float(np.max(speeds)), PEAK_SHARE, FINER),
        "peak_effort": at_most(float(np.max(efforts)), PEAK_SHARE, FINER),
        "missed": at_most(missed, MISSED, f"the re-simulated motion misses a pose: {FINER}"),
    }
    distances: dict[str, Any] = {}
    least = None if task.near is None else task.near.least_along(run.time, q, run["der(q)"])
    if task.near is not None and task.clearance is not None and least is not None:
        distances = {
            "clearance": least.distance, "nearest": least.pair, "nearest_time": least.time,
            "pairs": len(task.near.pairs), "constrained": ["-".join(task.near.names[p]) for p in active],
        }  # fmt: skip
        short = max(0.0, task.clearance.distance - least.distance)
        checks["clearance_short"] = at_most(short, RESOLUTION_M, f"{least} at {least.time:.4g} s: {FINER}")
    if failed:
        checks["resimulated"] = at_least(0.0, 1.0, failed)
    return ArmStudy(
        status=SolveStatus.SOLVED,
        message=f"{first.message}{f'; not re-simulated: {failed}' if failed else ' and re-simulated'}",
        title=title,
        objective=float(sum(s.objective for s in solutions)),
        checks=checks,
        final_time=float(run.time[-1]),
        passed=run.time[places[1:-1]],
        elements=mesh.elements,
        peak_speed=speeds.tolist(),
        peak_effort=efforts.tolist(),
        missed=missed,
        defect=max(r.defect for r in runs),
        **distances,
        trajectory=run,
        figures={"motion": partial(_figure, task, run, places)},
        scenes={"motion": partial(view.scene, task.robot, run)},
        files={REFERENCE: reference_csv(task, run)},
        machine_files=(TRAJECTORY, REFERENCE),
    )


def _joined(runs: Sequence[Trajectory], title: str) -> Trajectory:
    """Return the motions of all segments as one, with one row where two meet: that of the earlier one."""
    parts = [short_names(run, title) for run in runs]
    rows = [slice(0 if k == 0 else 1, None) for k in range(len(parts))]
    values = {name: np.concatenate([part[name][new] for part, new in zip(parts, rows, strict=True)]) for name in NAMES}
    time = np.concatenate([part.time[new] for part, new in zip(parts, rows, strict=True)])
    return Trajectory(time, values, {name: parts[0].unit(name) for name in NAMES}, title=title)


REFERENCE, SAMPLE_S = "reference.csv", 0.004  # of a controller


def reference_csv(task: ArmTask, run: Trajectory) -> bytes:
    """Return q, der(q), der(q,2) and T every 4 ms as the text of a CSV file; the motion ends at rest in its last row,
    up to a cycle after its final time."""
    times = grid(float(run.time[-1]), SAMPLE_S)
    at = np.minimum(times, run.time[-1])
    q, v, a = run["q"], run["der(q)"], run["der(q,2)"]
    rows = {
        "q": CubicHermite(run.time, q, v)(at), "der(q)": CubicHermite(run.time, v, a)(at),
        "der(q,2)": np.stack([np.interp(at, run.time, column) for column in a.T], axis=1),
    }  # fmt: skip
    rows["T"] = compile_causal(task.robot, known="q", targets="T")(rows["q"])[0]
    return csv_bytes(Trajectory(times, rows, {name: run.unit(name) for name in rows}, title=run.title))


def _figure(task: ArmTask, run: Trajectory, places: list[int]) -> Any:
    from ...plot.motion import arm_motion_figure

    distances = None
    if task.near is not None and task.clearance is not None and task.near.pairs:
        rows = task.near.distances(run["q"])
        lowest = np.argsort(rows.min(axis=0))[:5]
        distances = {" - ".join(task.near.names[k]): rows[:, k] for k in lowest}
    shapes = [] if task.near is None else _drawn(task, run, places)
    return arm_motion_figure(
        run, speed=task.speed, effort=task.effort, passed=run.time[places].tolist(), distances=distances,
        required=None if task.clearance is None else task.clearance.distance, shapes=shapes,
    )  # fmt: skip


def _drawn(task: ArmTask, run: Trajectory, places: list[int]) -> list[tuple[str, Array, float]]:
    """Return the bodies to draw, the links at each pose of the task: kind, points in the world and radius."""
    assert task.near is not None
    placed = task.near.placed(run["q"][places])
    return [
        ("obstacle" if body.frame is None else "link", p, body.radius)
        for body, points in zip(task.near.bodies, placed, strict=True) if body.normal is None
        for p in (points if body.frame is not None else points[:1])
    ]  # fmt: skip


@study_function
def arm_study(
    robot: Model,
    start: ArmPose,
    goal: ArmPose,
    *,
    waypoints: Sequence[Waypoint] = (),
    limits: ArmLimits | None = None,
    clearance: Clearance | None = None,
    cost: AxisCost | None = None,
    mesh: AxisMesh | None = None,
    solver: Solver | None = None,
    **work_options: Unpack[WorkOptions],
) -> ArmStudy:
    """Compute the optimal motion of a serial arm from rest to rest through waypoints, with distances kept.

    Args:
        robot: a serial arm, such as from a URDF, whose limits of position, speed and effort hold. Limits of speed and
            effort that are infinite are left out.
        start, goal: joints, or the tool centre point with or without an orientation.
        waypoints: poses passed in this order, at free times; those with `stop` at rest.
        limits: shares of the arm's limits, and accelerations.
        clearance: required distance of links from each other and from obstacles; None: no distance counts. Pairs that
            come near along the guess are constraints of the optimisation; others are added if they come too near.
        cost: weights of time and effort; by default 1 and 0.05, because without effort many motions are equally fast.
        mesh: elements of each segment; refined if that can make a failed check pass.
        solver: tolerance, iterations, barrier strategy.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The guess moves straight in joint space from pose to pose. A way around an obstacle is found if the straight motion
    does not pass through its middle; otherwise say the side by a waypoint. Raises ArgumentError.

    >>> arm = gt.robots.serial_arm(a=[0.4, 0.3], alpha=0.0, m=[4.0, 2.0], c=[[-0.2, 0, 0], [-0.15, 0, 0]])
    >>> limits = gt.motion.ArmLimits(joint_speed=[3.0, 3.0], joint_effort=[60.0, 30.0])
    >>> start, goal = gt.motion.ArmPose(q=[0.0, 0.5]), gt.motion.ArmPose(q=[1.0, 0.2])
    >>> s = gt.motion.arm_study(arm, start, goal, limits=limits)
    >>> s.status.ok, round(s.final_time, 2)  # [s]
    (True, 0.36)
    """
    work = Work(**work_options)
    mesh, solver = mesh or AxisMesh(), solver or Solver()
    work.step("equations")
    task = task_of(robot, start, goal, waypoints, limits or ArmLimits(), cost or LITTLE_EFFORT, clearance)
    work.step("transcribing")
    study = study_on_meshes(partial(on_this_mesh, task, solver, work), mesh, MENDED, work.interrupted)
    return study.with_(notes=[*task.robot.structure.notes, *study.notes])
