"""The motion study: time- or energy-optimal between two poses, free or along a path, for a controller to run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from ..lang import Model
from ..optimize import Solution
from ..optimize.judgement.overshoot import control_curves
from ..results import Quantity, Row, SolveStatus, Study, Trajectory, Work
from ..results.check import failed_of
from ..results.door import study_function
from ..results.options import Long
from ..results.work import Progress, never, silent
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
from .options import Cost, End, Export, Limits, MotionMesh, Shape, Solver, Starts
from .planning import MotionPlan, plan_of
from .problem import MotionProblem
from .reference import at_rest, rapid_text, reference_text
from .search import MotionSearch

SAME_OPTIMUM = 1e-5  # relative: costs nearer than that are one optimum


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MotionStudy(Study):
    """An optimal motion; where none was solved, all values but the final time are None.

    The trajectory and the files are those of the exported motion, whose motor forces keep their limit at every instant;
    the optimum itself keeps it at the collocation points only. asked: the problem, with its mesh as it was given.
    """

    asked: MotionProblem
    final_time: Annotated[
        float | None,
        Quantity(
            "s", "final time of the collocation optimum, control as [mesh] says; the motion's is the exported one"
        ),
    ] = None
    energy: Annotated[
        float | None, Quantity("", "sum over motors of int (F / force_unit_N)^2 dt of that optimum [s]")
    ] = None
    saturation: Annotated[
        Sequence[float] | None, Quantity("", "share of the time in which each motor is within 1 % of its limit")
    ] = None
    optima: Annotated[
        Sequence[float] | None, Quantity("", "costs of the different optima that the starts ended in, best first")
    ] = None
    end_error: Annotated[
        float | None, Quantity("m", "distance to the goal after re-simulating that optimum's force")
    ] = None
    peak_force_between_nodes: Annotated[
        float | None, Quantity("N", "largest force of that optimum between its collocation points")
    ] = None
    elements: Annotated[
        int | None, Quantity("", "elements of the mesh: those of the file, or more where a check failed on them")
    ] = None
    attempt_iterations: Annotated[
        int | None,
        Quantity("", "iterations of the attempt that ended in that optimum; those of all are `iterations`"),
    ] = None
    path_length: Annotated[
        float | None, Quantity("m", "length of the path to follow; null for a free motion")
    ] = None  # fmt: skip
    cross_check_time: Annotated[
        float | None,
        Quantity("s", "final time along the path with squared speeds as unknowns; null without a path"),
    ] = None
    exported_final_time: Annotated[
        float | None,
        Quantity("s", "final time of the exported motion, which keeps its force limit at every instant"),
    ] = None
    exported_energy: Annotated[float | None, Quantity("", "its energy [s]")] = None
    exported_end_error: Annotated[
        float | None, Quantity("m", "distance to the goal after re-simulating the exported force")
    ] = None
    exported_peak_force: Annotated[
        float | None, Quantity("N", "largest exported force: within the limit at every instant")
    ] = None
    exported_defect: Annotated[
        float | None,
        Quantity("", "largest difference between collocated and re-simulated states at an element edge [m, m/s]"),
    ] = None
    exported_link_along_guideway: Annotated[
        float | None, Quantity("m", "least component of any link along its guideway; 0 at the edge of reach")
    ] = None
    exported_margins: Annotated[
        Mapping[str, float] | None,
        Quantity("", "least margin to each further limit, by key: in m for positions, else a share of the limit"),
    ] = None
    exported_clearance: Annotated[
        Sequence[float] | None,
        Quantity("m", "least distance of tool centre point and links from each obstacle"),
    ] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people: the exported motion first, then the optimum that it comes from."""
        if self.exported_final_time is None:
            return [Row("final time", self.final_time, "s")]
        rows = [
            Row("final time", self.exported_final_time, "s"),
            Row("energy", self.exported_energy, "s"),
            Row("end error, re-simulated", _scaled(1e3, self.exported_end_error), "mm"),
            Row("largest force at any instant", self.exported_peak_force, "N"),
        ]
        rows += [Row(f"margin to {key}", x) for key, x in (self.exported_margins or {}).items()]
        rows += [Row(f"distance from obstacle {n}", 1e3 * x, "mm") for n, x in enumerate(self.exported_clearance or ())]
        rows += [
            Row("optimum: final time", self.final_time, "s"),
            Row("optimum: cost", self.objective),
            Row("optimum: energy", self.energy, "s"),
            *(
                Row(f"optimum: motor {i + 1} at its limit", 100 * x, "% of the time")
                for i, x in enumerate(self.saturation or ())
            ),
            Row("optimum: end error, re-simulated", _scaled(1e3, self.end_error), "mm"),
        ]
        if self.asked.starts.count:
            rows += [Row(f"optimum {n}: cost", cost) for n, cost in enumerate(self.optima or (), 1)]
        if self.cross_check_time is not None:
            rows.append(Row("optimum: final time by squared speeds", self.cross_check_time, "s"))
        if self.asked.mesh.control != "constant":
            rows.append(Row("optimum: largest force between its points", self.peak_force_between_nodes, "N"))
        if self.elements != self.asked.mesh.elements:
            rows.append(Row("elements of the mesh, refined", self.elements))
        return rows


def _scaled(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value


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
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> MotionStudy:
    """The optimal motion of a robot between two poses, its force re-simulated and bounded at every instant.

    Args:
        robot: declares T, the tool centre point (3,) [m], and tau, the motor forces (3,) [N].
        start, goal: tool centre points (3,) [m], reached at rest; `End` says otherwise.
        limits: what the motion must keep: forces, speeds, strokes, cones of joints, obstacles.
        path: `Line`, `Polyline`, `Arc`, `Spline` or `Taught`; the motion is free if left out.
        cost: weights of time and energy; time alone if left out.
        mesh, starts, solver: how it is searched. Where a check fails that a finer mesh can mend, one is taken.
        export: intervals of reference.csv and motion.mod.
        earlier: the trajectory of an earlier study to start from.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Interrupted, it holds the best iterate as its trajectory, and no values but a final time. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import Limits, MotionMesh, study
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = study(robot, [0.0, -0.9, 0.1], [0.2, -0.9, 0.2], limits=Limits(force=700.0), mesh=MotionMesh(elements=10))
    >>> round(s.exported_final_time, 2)  # [s]
    0.31
    """
    problem = MotionProblem(
        robot=robot, start=start if isinstance(start, End) else End(list(start)),
        goal=goal if isinstance(goal, End) else End(list(goal)), limits=limits, path=path, cost=cost or Cost(),
        mesh=mesh or MotionMesh(), starts=starts or Starts(), solver=solver or Solver(), export=export or Export(),
        title=title,
    )  # fmt: skip
    return solved(problem, Work(progress=progress, max_seconds=max_seconds, stop=stop), earlier)


def solved(problem: MotionProblem, work: Work, earlier: Trajectory | None = None) -> MotionStudy:
    """Optimise, re-simulate, and make the exported motion whose force is bounded at every instant; on a finer mesh
    where a check fails that it can mend. Raises ArgumentError."""
    plan = plan_of(problem, earlier)
    search = plan.search(work)
    solution = search.optimum()
    if not solution.status.converged:
        stopped = solution.status is SolveStatus.INTERRUPTED
        return _failed(search, MotionFailure(solution, solution.message + ("" if stopped else plan.likely_cause())))
    guesses = plan.further_guesses()
    others = search.from_starts(guesses)
    optima = _different([solution, *others])
    best = min([solution, *others], key=lambda s: s.objective)
    if best.objective < solution.objective * (1 - SAME_OPTIMUM):
        solution = best
    outcome = on_this_mesh(plan, search, solution, optima)
    if isinstance(outcome, MotionFailure):
        return _failed(search, outcome)
    notes = []
    if search.started < len(guesses) and not work.interrupted():
        left_out = len(guesses) - search.started
        notes.append(f"{left_out} of {len(guesses)} further starts left out, for solver.max_iterations")
    failed = failed_of(outcome.checks)
    outcome, trouble = on_finer_meshes(outcome, search)
    if trouble:
        notes.append(trouble)
    finer = refinement_note(problem.mesh.elements, outcome.plan.problem.mesh.elements, failed)
    return _study_of(problem, outcome, search.iterations, finer, notes)


def _different(solutions: list[Solution]) -> list[float]:
    costs: list[float] = []
    for cost in sorted(s.objective for s in solutions):
        if not costs or cost > costs[-1] * (1 + SAME_OPTIMUM):
            costs.append(cost)
    return costs


def _failed(search: MotionSearch, missed: MotionFailure) -> MotionStudy:
    problem, solution = search.problem, missed.solution
    return MotionStudy(
        status=SolveStatus.FAILED if solution.status.converged else solution.status,
        message=missed.message,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=search.iterations,
        checks={name: solution.checks[name] for name in ("constraint_violation",)},
        asked=problem,
        final_time=solution.free.get("final_time"),
        trajectory=short_names(solution.trajectory, f"{problem.title} (not solved: {solution.status.value})".strip()),
    )


def _study_of(
    asked: MotionProblem, outcome: MotionOutcome, iterations: int, finer: str, more: list[str]
) -> MotionStudy:
    """finer: what is to be said of a refined mesh. more: further sentences of the message."""
    plan, solution, exported = outcome.plan, outcome.solution, outcome.exported
    problem = plan.problem
    run = exported.trajectory
    trajectory = short_names(run, problem.title or "optimal motion")
    curves = None
    if problem.mesh.control == "polynomial" and not plan.restricted:
        curves = control_curves(solution.nlp, solution.x)
    reference, targets = (
        at_rest(plan.robot, plan.guard, exported.final_time, step, exported.moving)
        for step in (problem.export.sample, problem.export.target)
    )
    return MotionStudy(
        status=SolveStatus.SOLVED,
        message="; ".join(filter(None, [f"{how(solution)} and re-simulated{finer}", *more, solution.reservation])),
        objective=solution.objective,
        iterations=iterations,
        checks=outcome.checks,
        trajectory=trajectory,
        asked=asked,
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
        files={
            "reference.csv": reference_text(reference, problem.title),
            "motion.mod": rapid_text(targets, problem.title),
        },
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
