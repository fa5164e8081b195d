"""The motion study (time- or energy-optimal between two poses, free or along a path), and tables of several motions."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from .. import view
from ..lang import Model
from ..optimize.judgement.resimulate import control_curves
from ..optimize.multistart import SAME_COST
from ..results import ArgumentError, SolveStatus, Trajectory, Work, at_most
from ..results.check import failed_of
from ..results.options import Long
from ..results.work import WorkOptions, study_function
from ..workers.mapped import mapped
from .constraints import clearances
from .finer_mesh import how, refinement_note
from .motion_result import (
    MotionFailure,
    MotionOutcome,
    energy_of,
    margins_of,
    on_finer_meshes,
    on_this_mesh,
    short_names,
)
from .options import Cost, End, Export, Limits, MotionMesh, MotionProblem, Shape, Solver, Starts
from .path_parametrization import NotReached
from .planning import MotionPlan, plan_of
from .reference import at_rest, rapid_text, reference_text
from .results import MotionStudy, MotionTable, TableRow
from .search import REPEATED, MotionSearch


@study_function
def study(
    robot: Model,
    start: Annotated[Sequence[float] | End, Long(3)],
    goal: Annotated[Sequence[float] | End, Long(3)],
    *,
    limits: Limits,
    path: Shape | None = None,
    cost: Cost | None = None,
    mesh: MotionMesh | None = None,
    starts: Starts | None = None,
    solver: Solver | None = None,
    export: Export | None = None,
    earlier: Trajectory | None = None,
    **work_options: Unpack[WorkOptions],
) -> MotionStudy:
    """Compute the optimal motion of a robot between two poses, re-simulate it, and bound its force at every instant.

    Args:
        robot: declares T, the tool centre point (3,) [m], and tau, the motor forces (3,) [N].
        start, goal: tool centre points (3,) [m] at rest, or `End` for other end conditions.
        limits: forces, speeds, strokes, joint cones, obstacles.
        path: `Line`, `Polyline`, `Arc`, `Spline` or `Taught`; None: a free motion.
        cost: weights of time and energy; default time only.
        mesh, starts, solver: options of the search. The mesh is refined if that can make a failed check pass.
        export: sampling of reference.csv and motion.mod.
        earlier: the trajectory of an earlier study, used as the guess.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted study contains the best iterate as its trajectory and only a final time. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import Limits, MotionMesh, study
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = study(robot, [0.0, -0.9, 0.1], [0.2, -0.9, 0.2], limits=Limits(force=700.0), mesh=MotionMesh(elements=10))
    >>> round(s.exported_final_time, 2)  # [s]
    0.31
    """
    work = Work(**work_options)
    problem = MotionProblem(
        robot=robot, start=start if isinstance(start, End) else End(list(start)),
        goal=goal if isinstance(goal, End) else End(list(goal)), limits=limits, path=path, cost=cost or Cost(),
        mesh=mesh or MotionMesh(), starts=starts or Starts(), solver=solver or Solver(), export=export or Export(),
        title=work.title,
    )  # fmt: skip
    return solved(problem, work, earlier)


def solved(
    problem: MotionProblem, work: Work, earlier: Trajectory | None = None, number: int | None = None
) -> MotionStudy:
    """Optimise, re-simulate and export a motion; refine the mesh if a check fails.

    number: of this motion in a table. Raises ArgumentError.
    """
    work.progress("equations")
    plan = plan_of(problem, earlier)
    work.progress("first guess")
    search = plan.search(work)
    solution = search.optimum()
    if not solution.status.converged:
        stopped = solution.status is SolveStatus.INTERRUPTED
        return _failed(search, MotionFailure(solution, solution.message + ("" if stopped else plan.likely_cause())))
    reached, starts = search.reached, plan.further_starts()
    reached.add(solution.objective)
    best = min([solution, *search.from_starts(starts)], key=lambda s: s.objective)
    if best.objective < solution.objective * (1 - SAME_COST):
        solution = best
    notes = [reached.message(solution.objective)]
    if search.started < len(starts) and not work.interrupted():
        repeated = reached.repeated >= REPEATED
        why = f"because {reached.repeated} found no new optimum" if repeated else "to keep solver.max_iterations"
        notes.append(f"{len(starts) - search.started} of {len(starts)} further starts skipped {why}")
    outcome = on_this_mesh(plan, search, solution, reached.different)
    if isinstance(outcome, MotionFailure):
        return _failed(search, outcome)
    failed = failed_of(outcome.checks)
    outcome, trouble = on_finer_meshes(outcome, search)
    if trouble:
        notes.append(trouble)
    finer = refinement_note(problem.mesh.elements, outcome.plan.problem.mesh.elements, failed)
    return _study_of(problem, outcome, search.iterations, finer, notes, number)


def _failed(search: MotionSearch, failure: MotionFailure) -> MotionStudy:
    problem, solution = search.problem, failure.solution
    return MotionStudy(
        status=SolveStatus.FAILED if solution.status.converged else solution.status,
        message=failure.message,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=search.iterations,
        checks={name: solution.checks[name] for name in ("constraint_violation",)},
        asked=problem,
        final_time=solution.free.get("final_time"),
        trajectory=short_names(solution.trajectory, f"{problem.title} (not solved: {solution.status.value})".strip()),
    )


def _study_of(
    original: MotionProblem,
    outcome: MotionOutcome,
    iterations: int,
    finer: str,
    sentences: list[str],
    number: int | None,
) -> MotionStudy:
    """finer: sentence on a refined mesh. more: further sentences of the message."""
    plan, solution, exported = outcome.plan, outcome.solution, outcome.exported
    problem = plan.problem
    run = exported.trajectory
    trajectory = short_names(run, problem.title or "optimal motion")
    curves = None
    if problem.mesh.control == "polynomial" and not plan.restricted:
        curves = control_curves(solution.nlp, solution.x)
    files, checks = {}, outcome.checks
    try:
        reference, targets = (
            at_rest(plan.robot, plan.guard, exported.final_time, step, exported.moving)
            for step in (problem.export.sample, problem.export.target)
        )
        files = {
            "reference.csv": reference_text(reference, problem.title),
            "motion.mod": rapid_text(plan.robot, targets, problem.title, number),
        }
    except NotReached as missed:
        unreachable = at_most(missed.samples, 0, "the motion leaves the reach between its rows: use more mesh.elements")
        checks = {**checks, "reference_samples_out_of_reach": unreachable}
    force = problem.limits.force
    return MotionStudy(
        status=SolveStatus.SOLVED,
        message="; ".join(
            x for x in (f"{how(solution)} and re-simulated{finer}", *sentences, solution.reservation) if x
        ),
        objective=solution.objective,
        iterations=iterations,
        checks=checks,
        trajectory=trajectory,
        asked=original,
        final_time=solution.final_time,
        energy=energy_of(solution, problem.cost.force_unit),
        saturation=outcome.saturation,
        optima=outcome.optima,
        end_error=outcome.checks["end_error_m"].value,
        peak_force_between_nodes=outcome.peak,
        elements=problem.mesh.elements,
        attempt_iterations=solution.iterations,
        path_length=plan.path.length if plan.path is not None else None,
        cross_check_time=outcome.second,
        exported_final_time=exported.final_time,
        exported_energy=exported.energy,
        exported_end_error=exported.end_error,
        exported_peak_force=exported.peak,
        exported_defect=exported.defect,
        exported_link_along_guideway=float(np.min(run["along_guideway"])) if "along_guideway" in run else None,
        exported_margins=margins_of(plan, exported),
        exported_clearance=clearances(problem.limits.obstacles, run["T"], plan.links(run)),
        figures={"motion": partial(_figure, plan, trajectory, curves)},
        scenes={"motion": partial(view.scene, plan.robot, trajectory, limits={"tau": (-force, force)})},
        files=files,
        machine_files=("reference.csv", "motion.mod"),
    )


def _figure(plan: MotionPlan, trajectory: Trajectory, curves: tuple[np.ndarray, np.ndarray] | None) -> Any:
    from ..plot.motion import motion_figure

    obstacles = [(np.array(o.center), np.array(o.size)) for o in plan.problem.limits.obstacles]
    path = None if plan.path is None else plan.path(np.linspace(0.0, 1.0, 201))[0]
    return motion_figure(
        trajectory, curves, force_limit=plan.problem.limits.force, obstacles=obstacles, path=path,
        constant=not plan.restricted,
    )  # fmt: skip


MEASURED = ("final_time_s", "energy", "saturation", "optima", "exported_final_time_s", "exported_peak_force_N")


@study_function
def table_study(
    rows: Sequence[TableRow],
    **work_options: Unpack[WorkOptions],
) -> MotionTable:
    """Compute several optimal motions in order; stop at the first that is not solved.

    Args:
        rows: at least two; the first is compared with the last.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError before the first row is solved.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import Cost, End, Limits, MotionMesh, MotionProblem, TableRow, table_study
    >>> ends = {"start": End([0.0, -0.9, 0.1]), "goal": End([0.2, -0.9, 0.2])}
    >>> robot, mesh = gt.robots.gantry_tau("l1_tape"), MotionMesh(elements=10)
    >>> common = {"robot": robot, "limits": Limits(force=700.0), "mesh": mesh}
    >>> fastest, efficient = (MotionProblem(**ends, **common, cost=Cost(energy=w)) for w in (0.0, 1e-5))
    >>> table_study([TableRow("time-optimal", fastest), TableRow("energy-efficient", efficient)]).saving > 0
    True
    """
    if len(rows) < 2:
        raise ArgumentError(f"expected at least two rows; found {len(rows)}", "rows")
    work = Work(**work_options)
    for n, row in enumerate(rows):
        try:
            plan_of(row.problem)
        except ArgumentError as error:
            where = f"rows[{n}].problem.{error.argument}" if error.argument else f"rows[{n}]"
            raise ArgumentError(error.message, where) from error
    studies: list[MotionStudy] = []

    def here(item: tuple[int, TableRow, float | None]) -> MotionStudy:
        n, row, _ = item
        work.progress(f"row {n} of {len(rows)}: {row.name}", (n - 1) / len(rows), None)
        return solved(row.problem, work, number=n)

    items = ((n, row, work.seconds_left()) for n, row in enumerate(rows, 1))
    with closing(mapped(_row_solved, items, here=here, waiting=work.interrupted)) as solutions:
        for study in solutions:
            studies.append(study)
            if not study.status.converged:
                break
    if len(studies) < len(rows) and (not studies or studies[-1].status.converged):  # the workers were stopped
        stopped = SolveStatus.INTERRUPTED
        studies.append(MotionStudy(status=stopped, message=stopped.message, asked=rows[len(studies)].problem))
    return _table_of(rows, studies, work.title)


def _row_solved(item: tuple[int, TableRow, float | None]) -> MotionStudy:
    n, row, seconds_left = item
    return solved(row.problem, Work(max_seconds=seconds_left), number=n)


def _table_of(rows: Sequence[TableRow], studies: list[MotionStudy], title: str) -> MotionTable:
    first, last = studies[0], studies[-1]
    entries = []
    for row, s in zip(rows, studies, strict=False):
        values = {key: s.values.get(key) for key in MEASURED}
        entries.append({"name": row.name, "cost": s.objective, "iterations": s.attempt_iterations, **values})
    if first.final_time is None or last.final_time is None or first.energy is None or last.energy is None:
        return MotionTable(
            status=last.status,
            message=f"row {len(studies)}, {rows[len(studies) - 1].name}: {last.message}",
            title=title, asked=rows, motions=studies, entries=entries, trajectory=last.trajectory,
        )  # fmt: skip
    checks = {}
    for n, (row, s) in enumerate(zip(rows, studies, strict=True), 1):
        checks |= {f"row_{n}_{name}": check for name, check in s.checks.items()}
        if row.most_iterations is not None:
            checks[f"row_{n}_iterations"] = at_most(s.attempt_iterations or 0, float(row.most_iterations))
    runs = [(row.name, s.trajectory) for row, s in zip(rows, studies, strict=True) if s.trajectory is not None]
    differing = [f"row {n}: {s.message}" for n, s in enumerate(studies, 1) if s.message != first.message]
    return MotionTable(
        status=SolveStatus.SOLVED,
        message="; ".join([f"{len(studies)} rows: {first.message}", *differing]),
        title=title,
        objective=first.objective,
        iterations=sum(s.iterations or 0 for s in studies),
        checks=checks,
        trajectory=first.trajectory,
        asked=rows,
        motions=studies,
        entries=entries,
        saving=1 - first.final_time / last.final_time,
        energy_ratio=first.energy / last.energy,
        figures={
            "paths": partial(_paths, runs),
            "forces": partial(_forces, runs, rows[0].problem.limits.force),
        },
        scenes=first.scenes,
        files={f"row_{n}_{name}": content for n, s in enumerate(studies, 1) for name, content in s.files.items()},
        machine_files=[f"row_{n}_{name}" for n, s in enumerate(studies, 1) for name in s.machine_files],
    )


def _paths(runs: list[tuple[str, Trajectory]]) -> Any:
    from ..plot.motion import space_figure

    return space_figure(runs)


def _forces(runs: list[tuple[str, Trajectory]], limit: float) -> Any:
    from ..plot.motion import force_figure

    return force_figure(runs, force_limit=limit)
