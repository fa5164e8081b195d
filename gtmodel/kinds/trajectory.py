"""Kind "trajectory": time- or energy-optimal motion of a robot between two TCP positions, free or along a path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmodel.compiler.causal import compile_causal
from gtmodel.optimize import Solution
from gtmodel.optimize.overshoot import control_curves
from gtmodel.optimize.resimulate import Resimulation, resimulate
from gtmodel.results import SolveStatus, Trajectory

from .base import Context, Outcome, Row, at_most
from .motion_follow import sampled
from .motion_limits import clearance
from .motion_planning import Plan, plan_of
from .motion_reference import at_rest, between_rows, csv_text, rapid_text
from .motion_search import motion_of
from .trajectory_keys import TrajectoryProblem as Schema

NAME = "trajectory"

VALUES = {
    "final_time_s": "final time of the collocation optimum, control as [mesh] says",
    "energy": "sum over motors of int (F / force_unit_N)^2 dt of that optimum [s]",
    "saturation": "share of the time in which each motor is within 1 % of its limit",
    "optima": "costs of the different optima that the starts ended in, best first",
    "end_error_m": "distance to the goal after re-simulating that optimum's force",
    "peak_force_between_nodes_N": "largest force of that optimum between its collocation points",
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


def solve(problem: Schema, context: Context) -> Outcome:
    """Optimise, re-simulate, and make the exported motion whose force is bounded at every instant."""
    plan = plan_of(problem, context)
    search = plan.search(context)
    solution = search.optimum()
    if not solution.status.ok:
        stopped = solution.status is SolveStatus.INTERRUPTED
        return _failed(problem, solution, hint="" if stopped else plan.hint())
    others = search.from_starts(plan.further_guesses())
    optima = _different([solution, *others])
    best = min([solution, *others], key=lambda s: s.objective)
    if best.objective < solution.objective * (1 - SAME_OPTIMUM):
        solution = best
    tried = resimulate(solution)
    if tried.trajectory is None:
        return _failed(problem, solution, f"the optimum cannot be re-simulated: {tried.message}; ")
    second = None
    if plan.path is not None and not plan.smooth:
        motion, second = plan.followed(context), plan.second_road(SECOND_ROAD_INTERVALS)
        if not motion.status.ok:
            return _failed(
                problem, solution, f"the optimum was found, but not the exportable motion: {motion.message}; "
            )
        exported = _followed(plan, motion)
    else:
        constant, run = search.exportable_tried(solution, tried)
        if not constant.status.ok:
            return _failed(problem, constant, "the optimum was found, but not the exportable motion: ")
        if run.trajectory is None:
            return _failed(problem, constant, f"the exported motion cannot be re-simulated: {run.message}; ")
        exported = _resimulated(plan, constant, run)
    return _outcome(plan, solution, tried, exported, optima, second)


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: states, controls, bounds, and the certificate of the inverse dynamics."""
    from gtmodel.optimize.problem import build

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


def _failed(problem: Schema, solution: Solution, lead: str = "", hint: str = "") -> Outcome:
    return Outcome(
        status=solution.status,
        message=lead + solution.message + hint,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=solution.iterations,
        checks=solution.checks,
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


def _outcome(
    plan: Plan,
    solution: Solution,
    tried: Resimulation,
    exported: Exported,
    optima: list[float],
    second: float | None,
) -> Outcome:
    problem = plan.problem
    limit, unit = problem.limits.force_N, problem.cost.force_unit_N
    assert tried.trajectory is not None
    run = exported.trajectory
    end_error = _distance(tried.trajectory["robot.T"][-1], plan.goal)
    peak = float(np.max(np.abs(tried.trajectory["robot.tau"]))) if plan.restricted else _peak(tried)
    margins = plan.guard.least(run["margin"]) if plan.guard.margins else {}
    values = {
        "final_time_s": solution.final_time,
        "energy": _energy(solution, unit),
        "saturation": _saturation(solution, limit),
        "optima": optima,
        "end_error_m": end_error,
        "peak_force_between_nodes_N": peak,
        "path_length_m": plan.path.length if plan.path is not None else None,
        "second_road_time_s": second,
        "exported_final_time_s": exported.final_time,
        "exported_energy": exported.energy,
        "exported_end_error_m": exported.end_error,
        "exported_peak_force_N": exported.peak,
        "exported_defect": exported.defect,
        "exported_link_along_guideway_m": float(np.min(run["along_guideway"])) if "along_guideway" in run else None,
        "exported_margins": margins,
        "exported_clearance_m": _clearances(plan, run),
    }
    bound = limit * (1 + FORCE_TOLERANCE)
    checks: dict[str, Any] = {
        "constraint_violation": solution.checks["constraint_violation"],
        "end_error_m": at_most(end_error, END_ERROR_BOUND_M, FINER),
        "exported_end_error_m": at_most(exported.end_error, END_ERROR_BOUND_M, FINER),
        "exported_peak_force_N": at_most(exported.peak, bound, FINER),
    }
    if margins:
        worst = max(0.0, -min(margins.values()))
        checks["exported_excess"] = at_most(worst, MARGIN_TOLERANCE, FINER)
    if second is not None and problem.cost.energy == 0.0:
        apart = abs(second / solution.final_time - 1)
        checks["roads_apart"] = at_most(apart, ROADS_AGREE, FINER)
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
        message="solved and re-simulated",
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks,
        values=values,
        trajectory=trajectory,
        rows=_rows(plan, values, solution),
        figures={"motion": lambda: _figure(plan, trajectory, curves)},
        files={
            "reference.csv": csv_text(reference, problem.title),
            "motion.mod": rapid_text(targets, problem.title),
        },
        machine_files=("reference.csv", "motion.mod"),
    )


def _rows(plan: Plan, values: dict[str, Any], solution: Solution) -> list[Row]:
    problem = plan.problem
    rows = [
        Row("final time", values["final_time_s"], "s"),
        Row("cost", solution.objective, ""),
        Row("energy", values["energy"], "s"),
        *(Row(f"motor {i + 1} at its limit", 100 * x, "% of the time") for i, x in enumerate(values["saturation"])),
        Row("end error, re-simulated", 1e3 * values["end_error_m"], "mm"),
    ]
    if problem.starts.count:
        rows += [Row(f"optimum {n}: cost", cost, "") for n, cost in enumerate(values["optima"], 1)]
    if values["second_road_time_s"] is not None:
        rows.append(Row("final time by squared speeds", values["second_road_time_s"], "s"))
    if problem.mesh.control != "constant":
        rows.append(Row("largest force between the nodes", values["peak_force_between_nodes_N"], "N"))
    rows += [
        Row("exported: final time", values["exported_final_time_s"], "s"),
        Row("exported: end error, re-simulated", 1e3 * values["exported_end_error_m"], "mm"),
        Row("exported: largest force at any instant", values["exported_peak_force_N"], "N"),
    ]
    rows += [Row(f"exported: margin to {key}", x, "") for key, x in values["exported_margins"].items()]
    rows += [Row(f"exported: distance from obstacle {n}", 1e3 * x, "mm")
             for n, x in enumerate(values["exported_clearance_m"])]  # fmt: skip
    return rows


def _figure(plan: Plan, trajectory: Trajectory, curves: tuple[np.ndarray, np.ndarray] | None) -> Any:
    from gtmodel.plot.motion import motion_figure

    obstacles = [(np.array(o.center_m), np.array(o.size_m)) for o in plan.problem.limits.obstacles]
    path = None if plan.path is None else plan.path(np.linspace(0.0, 1.0, 201))[0]
    return motion_figure(
        trajectory, curves, force_limit=plan.problem.limits.force_N, obstacles=obstacles, path=path,
        constant=not plan.restricted,
    )  # fmt: skip
