"""Kind "trajectory": time- or energy-optimal motion of a robot between two TCP positions, free or along a path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtmodel.compiler.causal import compile_causal
from gtmodel.motion.finer_mesh import elements_after, how, refined, told
from gtmodel.motion.follow import sampled
from gtmodel.motion.guard import clearance
from gtmodel.motion.reference import at_rest, between_rows, csv_text, rapid_text
from gtmodel.optimize import Solution
from gtmodel.optimize.judgement.overshoot import control_curves
from gtmodel.optimize.judgement.resimulate import Resimulation, resimulate
from gtmodel.problem_files.base import Context, Outcome, at_most
from gtmodel.problem_files.path_keys import PATH_ARGUMENTS
from gtmodel.results import SolveStatus, Trajectory
from gtmodel.results.check import failed_of

from .motion_planning import Plan, plan_of
from .motion_search import Search, motion_of
from .trajectory_keys import TrajectoryProblem as Schema
from .trajectory_rows import rows_of

NAME = "trajectory"
ARGUMENTS = PATH_ARGUMENTS

VALUES = {
    "final_time_s": "final time of the collocation optimum, control as [mesh] says; the motion's is the exported one",
    "energy": "sum over motors of int (F / force_unit_N)^2 dt of that optimum [s]",
    "saturation": "share of the time in which each motor is within 1 % of its limit",
    "optima": "costs of the different optima that the starts ended in, best first",
    "end_error_m": "distance to the goal after re-simulating that optimum's force",
    "peak_force_between_nodes_N": "largest force of that optimum between its collocation points",
    "elements": "elements of the mesh: those of the file, or more where a check failed on them",
    "attempt_iterations": "iterations of the attempt that ended in that optimum; those of all are `iterations`",
    "path_length_m": "length of the path to follow; null for a free motion",
    "second_road_time_s": "final time along the path with squared speeds as unknowns; null without a path",
    "exported_final_time_s": "final time of the exported motion, which keeps its force limit at every instant",
    "exported_energy": "its energy [s]",
    "exported_end_error_m": "distance to the goal after re-simulating the exported force",
    "exported_peak_force_N": "largest exported force: within the limit at every instant",
    "exported_defect": "largest difference between collocated and re-simulated states at an element edge [m, m/s]",
    "exported_link_along_guideway_m": "least component of any link along its guideway; 0 at the edge of reach",
    "exported_margins": "least margin to each further limit, by key: in m for positions, else a share of the limit",
    "exported_clearance_m": "least distance of tool centre point and links from each obstacle",
}

# the printed accuracy of these robots is a fraction of a millimetre; an input that misses by more is no plan
END_ERROR_BOUND_M = 5e-3
FINER = "use more mesh.elements"
FORCE_TOLERANCE = 1e-9  # relative: the exported force keeps its limit at every instant
MARGIN_TOLERANCE = 0.01  # further limits hold at collocation points; between them a jump of the force shows
SATURATED = 0.99
SAME_OPTIMUM = 1e-5  # relative: costs nearer than that are one optimum
ROADS_AGREE = 1e-3  # relative: of the final time along a path, by collocation and by squared speeds
MOST_INTERVALS = 3200
SECOND_ROAD_INTERVALS = 400  # 5e-7 of the time on a line


@dataclass(frozen=True, kw_only=True)
class Exported:
    """The motion that is exported, its cost, and what a re-simulation of its force found."""

    trajectory: Trajectory
    moving: Any
    final_time: float
    energy: float
    end_error: float
    peak: float
    defect: float


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was found on one mesh: the collocation optimum, the exported motion, and the checks of both."""

    plan: Plan
    solution: Solution
    tried: Resimulation
    exported: Exported
    second: float | None
    optima: list[float]
    checks: dict[str, Any]


def solve(problem: Schema, context: Context) -> Outcome:
    """Optimise, re-simulate, and make the exported motion whose force is bounded at every instant; on a finer mesh
    where a check fails that it can mend."""
    plan = plan_of(problem, context)
    search = plan.search(context)
    solution = search.optimum()
    if not solution.status.converged:
        stopped = solution.status is SolveStatus.INTERRUPTED
        return _failed(search, solution, hint="" if stopped else plan.hint())
    guesses = plan.further_guesses()
    others = search.from_starts(guesses)
    optima = _different([solution, *others])
    best = min([solution, *others], key=lambda s: s.objective)
    if best.objective < solution.objective * (1 - SAME_OPTIMUM):
        solution = best
    found = _on_this_mesh(plan, search, solution, optima)
    if isinstance(found, Outcome):
        return found
    notes = []
    if search.started < len(guesses) and not context.interrupted():
        notes.append(f"{len(guesses) - search.started} of {len(guesses)} further starts left out, for "
                     "solver.max_iterations")  # fmt: skip
    failed = failed_of(found.checks)
    found, trouble = _refined(found, search)
    if trouble:
        notes.append(trouble)
    return _outcome(found, search, told(problem.mesh.elements, found.plan.problem.mesh.elements, failed), notes)


def _refined(found: Found, search: Search) -> tuple[Found, str]:
    """What is found on finer meshes, with the iterations of the search counted on."""

    def again(before: Found, problem: Schema) -> Found | str:
        search.go_on(problem, before.solution)
        solution = search.optimum()
        on = f"on {problem.mesh.elements} elements"
        if not solution.status.converged:
            return f"{on}: {solution.message}"
        after = _on_this_mesh(replace(before.plan, problem=problem), search, solution, before.optima)
        return f"{on}: {after.message}" if isinstance(after, Outcome) else after

    return refined(found, _finer, again, search.context.interrupted)


def _finer(found: Found) -> Schema | None:
    """The problem on a finer mesh, or on more intervals of its path, where a check failed; None where none can help."""
    problem, checks = found.plan.problem, found.checks
    followed = found.second is not None
    mended = [name for name in checks if name != "constraint_violation" and not (followed and "exported" in name)]
    mesh, finer = problem.mesh, None
    elements = elements_after(mesh.elements, mesh.most_elements, checks, mended)
    if elements is not None:
        finer = problem.model_copy(update={"mesh": mesh.model_copy(update={"elements": elements})})
    if followed and problem.path is not None and any("exported" in name for name in failed_of(checks)):
        intervals = min(2 * problem.path.intervals, MOST_INTERVALS)
        if intervals > problem.path.intervals:
            path = problem.path.model_copy(update={"intervals": intervals})
            return (finer or problem).model_copy(update={"path": path})
    return finer


def _on_this_mesh(plan: Plan, search: Search, solution: Solution, optima: list[float]) -> Found | Outcome:
    """The optimum re-simulated, and the exported motion; an outcome where there is none."""
    tried = resimulate(solution)
    if tried.trajectory is None:
        return _failed(search, solution, f"the optimum cannot be re-simulated: {tried.message}; ")
    second = None
    if plan.path is not None and not plan.smooth:
        motion, second = plan.followed(search.context), plan.second_road(SECOND_ROAD_INTERVALS)
        search.iterations += motion.iterations
        if not motion.status.converged:
            return _failed(
                search, solution, f"the optimum was found, but not the exportable motion: {motion.message}; "
            )
        exported = _followed(plan, motion)
    else:
        constant, run = search.exportable_tried(solution, tried)
        if not constant.status.converged:
            return _failed(search, constant, "the optimum was found, but not the exportable motion: ")
        if run.trajectory is None:
            return _failed(search, constant, f"the exported motion cannot be re-simulated: {run.message}; ")
        exported = _resimulated(plan, constant, run)
    checks = _checks(plan, solution, tried, exported, second)
    return Found(
        plan=plan, solution=solution, tried=tried, exported=exported, second=second, optima=optima, checks=checks
    )


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: states, controls, bounds, and the certificate of the inverse dynamics."""
    from gtmodel.optimize.formulation.problem import build

    plan = plan_of(problem, context)
    built = build(motion_of(problem, plan.robot, guard=plan.guard, path=plan.path))
    head = [
        f"{problem.title or 'motion'}: {built.formulation} form, {problem.mesh.elements} elements x "
        f"{problem.mesh.points} Radau points",
        f"  states: {', '.join(built.state_names)}",
        f"  controls: {', '.join(built.control_names)} within {problem.limits.force_N:g} N"
        if not plan.restricted
        else f"  controls: {', '.join(built.control_names)}; forces within {problem.limits.force_N:g} N",
        f"  free: {', '.join(built.free_names)}",
    ]
    if plan.path is not None:
        head.append(f"  along: {problem.path.shape if problem.path else ''} of {plan.path.length:.4g} m")
    if plan.guard.margins:
        head.append(f"  further limits: {', '.join(dict.fromkeys(m.key for m in plan.guard.margins))}")
    return "\n".join(head) + "\n" + compile_causal(plan.robot, known="T", targets="tau").explain()


def _different(solutions: list[Solution]) -> list[float]:
    found: list[float] = []
    for cost in sorted(s.objective for s in solutions):
        if not found or cost > found[-1] * (1 + SAME_OPTIMUM):
            found.append(cost)
    return found


def _renamed(trajectory: Trajectory, title: str) -> Trajectory:
    """The robot's own names: robot.T becomes T."""
    values, units = {}, {}
    for name in trajectory.names:
        short = name.replace("robot.", "")
        values[short], units[short] = trajectory[name], trajectory.unit(name)
    return Trajectory(trajectory.time, values, units, title=title)


def _failed(search: Search, solution: Solution, lead: str = "", hint: str = "") -> Outcome:
    problem = search.problem
    return Outcome(
        status=SolveStatus.FAILED if solution.status.converged else solution.status,
        message=lead + solution.message + hint,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=search.iterations,
        checks={name: solution.checks[name] for name in ("constraint_violation",)},
        values={"final_time_s": solution.free.get("final_time")},
        trajectory=_renamed(solution.trajectory, f"{problem.title} (not solved: {solution.status.value})".strip()),
    )


def _energy(solution: Solution, unit: float) -> float:
    """sum int (F / unit)^2 dt by the quadrature of the collocation points [s]."""
    tau, weights = _at_points(solution)
    return float(np.sum(weights[:, None] * (tau / unit) ** 2))


def _at_points(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Forces at all collocation points and their quadrature weights [s]."""
    mesh = solution.nlp.mesh
    weights = np.outer(mesh.h, mesh.table.weights).reshape(-1) * solution.final_time
    return solution.trajectory["robot.tau"][1 : 1 + len(weights)], weights


def _saturation(solution: Solution, limit: float) -> list[float]:
    tau, weights = _at_points(solution)
    return (weights @ (np.abs(tau) >= SATURATED * limit) / weights.sum()).tolist()


def _resimulated(plan: Plan, exported: Solution, run: Resimulation) -> Exported:
    assert run.trajectory is not None
    trajectory = _renamed(run.trajectory, "")
    if plan.path is not None:
        s, v, a = (trajectory[name] for name in ("s", "der(s)", "der(s,2)"))
        margins = {"margin": trajectory["margin"]} if "margin" in trajectory else {}
        trajectory = plan.follower.along(trajectory.time, s, v, a).with_values(margins)  # they may need the jerk
    else:
        T, v, a = (trajectory[name] for name in ("T", "der(T)", "der(T,2)"))
        carts = sampled(plan.robot, trajectory.time, T, v, a, plan.task)["der(q)"]
        trajectory = trajectory.with_values({"der(q)": carts}, {"der(q)": "m/s"})
    peak = float(np.max(np.abs(trajectory["tau"])))
    if not plan.restricted:
        peak = max(peak, _peak(run))
    return Exported(
        trajectory=trajectory,
        moving=between_rows(plan.robot, plan.task, trajectory),
        final_time=exported.final_time,
        energy=_energy(exported, plan.problem.cost.force_unit_N),
        end_error=_distance(trajectory["T"][-1], plan.goal),
        peak=peak,
        defect=run.defect,
    )


def _followed(plan: Plan, motion: Any) -> Exported:
    follower = plan.follower
    trajectory = follower.trajectory(motion)
    end = follower.integrated_end(motion)
    return Exported(
        trajectory=trajectory,
        moving=lambda times: follower.sample(motion, times),
        final_time=motion.final_time,
        energy=motion.energy,
        end_error=_distance(end, plan.goal),
        peak=float(np.max(np.abs(trajectory["tau"]))),
        defect=_distance(end, trajectory["T"][-1]),
    )


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b))


def _peak(run: Resimulation) -> float:
    return max(map(abs, sum((r for name, r in run.control_range.items() if "tau" in name), ())))


def _clearances(plan: Plan, run: Trajectory) -> list[float]:
    found = []
    for obstacle in plan.problem.limits.obstacles:
        center, size = np.array(obstacle.center_m), np.array(obstacle.size_m)
        distances = [clearance(run["T"], run["T"], center, size, 1)]
        distances += [clearance(a, b, center, size) for a, b in plan.links(run)]
        found.append(min(distances))
    return found


def _checks(
    plan: Plan, solution: Solution, tried: Resimulation, exported: Exported, second: float | None
) -> dict[str, Any]:
    assert tried.trajectory is not None
    problem = plan.problem
    end_error = _distance(tried.trajectory["robot.T"][-1], plan.goal)
    checks: dict[str, Any] = {
        "constraint_violation": solution.checks["constraint_violation"],
        "end_error_m": at_most(end_error, END_ERROR_BOUND_M, FINER),
        "exported_end_error_m": at_most(exported.end_error, END_ERROR_BOUND_M, FINER),
        "exported_peak_force_N": at_most(exported.peak, problem.limits.force_N * (1 + FORCE_TOLERANCE), FINER),
    }
    if margins := _margins(plan, exported):
        checks["exported_excess"] = at_most(max(0.0, -min(margins.values())), MARGIN_TOLERANCE, FINER)
    if second is not None and problem.cost.energy == 0.0:
        checks["roads_apart"] = at_most(abs(second / solution.final_time - 1), ROADS_AGREE, FINER)
    return checks


def _margins(plan: Plan, exported: Exported) -> dict[str, float]:
    return plan.guard.least(exported.trajectory["margin"]) if plan.guard.margins else {}


def _outcome(found: Found, search: Search, finer: str, notes: list[str]) -> Outcome:
    """finer: what is to be said of a refined mesh. notes: further sentences of the message."""
    plan, solution, tried, exported = found.plan, found.solution, found.tried, found.exported
    problem = plan.problem
    limit, unit = problem.limits.force_N, problem.cost.force_unit_N
    assert tried.trajectory is not None
    run = exported.trajectory
    peak = float(np.max(np.abs(tried.trajectory["robot.tau"]))) if plan.restricted else _peak(tried)
    values = {
        "final_time_s": solution.final_time,
        "energy": _energy(solution, unit),
        "saturation": _saturation(solution, limit),
        "optima": found.optima,
        "end_error_m": found.checks["end_error_m"].value,
        "peak_force_between_nodes_N": peak,
        "elements": problem.mesh.elements,
        "attempt_iterations": solution.iterations,
        "path_length_m": plan.path.length if plan.path is not None else None,
        "second_road_time_s": found.second,
        "exported_final_time_s": exported.final_time,
        "exported_energy": exported.energy,
        "exported_end_error_m": exported.end_error,
        "exported_peak_force_N": exported.peak,
        "exported_defect": exported.defect,
        "exported_link_along_guideway_m": float(np.min(run["along_guideway"])) if "along_guideway" in run else None,
        "exported_margins": _margins(plan, exported),
        "exported_clearance_m": _clearances(plan, run),
    }
    trajectory = _renamed(run, problem.title or "optimal motion")
    curves = None
    if problem.mesh.control == "polynomial" and not plan.restricted:
        curves = control_curves(solution.nlp, solution.x)
    reference, targets = (
        at_rest(plan.robot, plan.task, exported.final_time, step, exported.moving)
        for step in (problem.export.sample_s, problem.export.target_s)
    )
    return Outcome(
        status=SolveStatus.SOLVED,
        message="; ".join(filter(None, [f"{how(solution)} and re-simulated{finer}", *notes, solution.reservation])),
        objective=solution.objective,
        iterations=search.iterations,
        checks=found.checks,
        values=values,
        trajectory=trajectory,
        rows=rows_of(plan, values, solution.objective, finer),
        figures={"motion": lambda: _figure(plan, trajectory, curves)},
        files={
            "reference.csv": csv_text(reference, problem.title),
            "motion.mod": rapid_text(targets, problem.title),
        },
        machine_files=("reference.csv", "motion.mod"),
    )


def _figure(plan: Plan, trajectory: Trajectory, curves: tuple[np.ndarray, np.ndarray] | None) -> Any:
    from gtmodel.plot.motion import motion_figure

    obstacles = [(np.array(o.center_m), np.array(o.size_m)) for o in plan.problem.limits.obstacles]
    path = None if plan.path is None else plan.path(np.linspace(0.0, 1.0, 201))[0]
    return motion_figure(
        trajectory, curves, force_limit=plan.problem.limits.force_N, obstacles=obstacles, path=path,
        constant=not plan.restricted,
    )  # fmt: skip
