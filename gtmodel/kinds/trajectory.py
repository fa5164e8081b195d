"""Kind "trajectory": time- or energy-optimal motion of a robot from one TCP position to another."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import compile_causal, flat_of
from gtmodel.optimize import Solution
from gtmodel.optimize.overshoot import control_curves
from gtmodel.optimize.resimulate import Resimulation, resimulate
from gtmodel.results import SolveStatus, Status, Trajectory

from .base import Check, Context, InputError, Outcome, Row
from .motion import along_guideways, line_guess, link_names
from .motion_search import Search, motion_of
from .trajectory_keys import TrajectoryProblem

NAME = "trajectory"

VALUES = {
    "final_time_s": "final time of the collocation optimum, control as [mesh] says",
    "energy": "sum over motors of int (F / force_unit_N)^2 dt of that optimum [s]",
    "saturation": "share of the time in which each motor is within 1 % of its limit",
    "end_error_m": "distance to the goal after re-simulating that optimum's force",
    "peak_force_between_nodes_N": "largest force of that optimum between its collocation points",
    "exported_final_time_s": "final time of the exported motion, whose force is constant on each element",
    "exported_energy": "its energy [s]",
    "exported_end_error_m": "distance to the goal after re-simulating the exported force",
    "exported_peak_force_N": "largest exported force: within the limit at every instant",
    "exported_defect": "largest difference between collocated and re-simulated states at an element edge [m, m/s]",
    "exported_link_along_guideway_m": "least component of any link along its guideway; 0 at the edge of reach",
}

# the printed accuracy of these robots is a fraction of a millimetre; an input that misses by more is no plan
END_ERROR_BOUND_M = 5e-3
FORCE_TOLERANCE = 1e-9  # relative: the exported force keeps its limit at every instant
SATURATED = 0.99

Schema = TrajectoryProblem


def solve(problem: Schema, context: Context) -> Outcome:
    """Optimise, re-simulate, and make the exported motion whose force is bounded at every instant."""
    robot = problem.model(context)
    start, goal = np.array(problem.start.tcp_m), np.array(problem.goal.tcp_m)
    _check_problem(problem, robot, start, goal)
    inverse_dynamics = compile_causal(robot, known="T", targets="tau")
    guess = _guess(context) or line_guess(inverse_dynamics, start, goal, problem.limits.force_N)
    search = Search(problem, context, robot, guess)
    solution = search.optimum()
    if not solution.status.ok:
        return _failed(problem, solution)
    tried = resimulate(solution)
    exported, exported_tried = solution, tried
    if problem.mesh.control != "constant":
        exported = search.exportable(solution)
        if not exported.status.ok:
            return _failed(problem, exported, "the optimum was found, but not the exportable motion: ")
        exported_tried = resimulate(exported)
    return _outcome(problem, goal, solution, tried, exported, exported_tried)


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: states, controls, bounds, and the certificate of the inverse dynamics."""
    from gtmodel.optimize.problem import build

    robot = problem.model(context)
    start, goal = np.array(problem.start.tcp_m), np.array(problem.goal.tcp_m)
    _check_problem(problem, robot, start, goal)
    built = build(motion_of(problem, robot))
    head = [
        f"{problem.title or 'motion'}: {built.formulation} form, {problem.mesh.elements} elements x "
        f"{problem.mesh.points} Radau points",
        f"  states: {', '.join(built.state_names)}",
        f"  controls: {', '.join(built.control_names)} within {problem.limits.force_N:g} N",
        f"  free: {', '.join(built.free_names)}",
    ]
    return "\n".join(head) + "\n" + compile_causal(robot, known="T", targets="tau").explain()


def _check_problem(problem: Schema, robot: gt.Model, start: np.ndarray, goal: np.ndarray) -> None:
    flat = flat_of(robot)
    for name in ("T", "tau"):
        if flat.groups.get(name, ((), []))[0] != (3,):
            raise InputError(f"the robot must declare '{name}' as a vector of 3; it has {flat.top()}", "robot")
    joints = link_names(robot)
    coordinates = joints or ["q" if "q" in flat.groups else "tau"]
    inverse = compile_causal(robot, known="T", targets=coordinates)
    zero = [np.zeros(3)] * (len(inverse.inputs) - 1)
    for key, point in (("start.tcp_m", start), ("goal.tcp_m", goal)):
        *found, status = inverse(point, *zero)
        shown = ", ".join(f"{x:g}" for x in point)
        if status is not Status.OK:
            raise InputError(f"the pose ({shown}) m cannot be reached: {inverse.diagnose(point, *zero)}", key)
        along = along_guideways(robot, point, found) if joints else np.zeros(0)
        least = problem.limits.link_along_guideway_m
        if np.any(along < least):
            k = int(np.argmin(along))
            raise InputError(
                f"the pose ({shown}) m lies at the edge of reach: {joints[k].removesuffix('.rod.a.r')} stands "
                f"{along[k]:.4g} m along its guideway, less than limits.link_along_guideway_m = {least:g}",
                key,
            )
    if np.array_equal(start, goal):
        raise InputError("the goal equals the start; give another goal", "goal.tcp_m")
    if problem.cost.time == 0.0 and problem.cost.energy == 0.0:
        raise InputError("both weights are zero, so nothing is minimised; give cost.time or cost.energy", "cost")


def _guess(context: Context) -> Trajectory | None:
    """An earlier result's motion under the names of the optimisation."""
    earlier = context.guess()
    if earlier is None:
        return None
    names = {"T": "robot.T", "der(T)": "der(robot.T)", "tau": "robot.tau"}
    values = {new: earlier[old] for old, new in names.items() if old in earlier}
    return Trajectory(earlier.time, values, {new: earlier.unit(old) for old, new in names.items() if old in earlier})


def _renamed(trajectory: Trajectory, title: str) -> Trajectory:
    """The robot's own names: robot.T becomes T."""
    values, units = {}, {}
    for name in trajectory.names:
        short = name.replace("robot.", "")
        values[short], units[short] = trajectory[name], trajectory.unit(name)
    return Trajectory(trajectory.time, values, units, title=title)


def _failed(problem: Schema, solution: Solution, lead: str = "") -> Outcome:
    return Outcome(
        status=solution.status,
        message=lead + solution.message,
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


def _outcome(
    problem: Schema,
    goal: np.ndarray,
    solution: Solution,
    tried: Resimulation,
    exported: Solution,
    exported_tried: Resimulation,
) -> Outcome:
    limit, unit = problem.limits.force_N, problem.cost.force_unit_N
    final = exported_tried.trajectory
    if final is None or tried.trajectory is None:
        bad = exported_tried if final is None else tried
        return _failed(problem, exported, f"the optimum cannot be re-simulated: {bad.message}; ")
    end_error = float(np.linalg.norm(tried.trajectory["robot.T"][-1] - goal))
    exported_end_error = float(np.linalg.norm(final["robot.T"][-1] - goal))
    peak, exported_peak = (max(map(abs, sum(run.control_range.values(), ()))) for run in (tried, exported_tried))
    values = {
        "final_time_s": solution.final_time,
        "energy": _energy(solution, unit),
        "saturation": _saturation(solution, limit),
        "end_error_m": end_error,
        "peak_force_between_nodes_N": peak,
        "exported_final_time_s": exported.final_time,
        "exported_energy": _energy(exported, unit),
        "exported_end_error_m": exported_end_error,
        "exported_peak_force_N": exported_peak,
        "exported_defect": exported_tried.defect,
        "exported_link_along_guideway_m": float(np.min(final["along_guideway"])) if "along_guideway" in final else None,
    }
    bound = limit * (1 + FORCE_TOLERANCE)
    checks: dict[str, Any] = {
        "constraint_violation": max(solution.checks["constraint_violation"], exported.checks["constraint_violation"],
                                    key=lambda c: c.value),
        "end_error_m": Check(end_error, END_ERROR_BOUND_M, end_error <= END_ERROR_BOUND_M),
        "exported_end_error_m": Check(exported_end_error, END_ERROR_BOUND_M, exported_end_error <= END_ERROR_BOUND_M),
        "exported_peak_force_N": Check(exported_peak, bound, exported_peak <= bound),
    }  # fmt: skip
    trajectory = _renamed(final, problem.title or "optimal motion")
    curves = control_curves(solution.nlp, solution.x) if problem.mesh.control == "polynomial" else None
    return Outcome(
        status=SolveStatus.SOLVED,
        message=_message(problem, checks),
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks,
        values=values,
        trajectory=trajectory,
        rows=_rows(problem, values, solution),
        figures={"motion": lambda: _figure(problem, trajectory, curves)},
    )


def _message(problem: Schema, checks: dict[str, Any]) -> str:
    failed = [name for name, check in checks.items() if not check.passed]
    if failed:
        return f"solved, but {' and '.join(failed)} exceed their bounds; use more mesh.elements"
    return "solved and re-simulated"


def _rows(problem: Schema, values: dict[str, Any], solution: Solution) -> list[Row]:
    rows = [
        Row("final time", values["final_time_s"], "s"),
        Row("cost", solution.objective, ""),
        Row("energy", values["energy"], "s"),
        *(Row(f"motor {i + 1} at its limit", 100 * x, "% of the time") for i, x in enumerate(values["saturation"])),
        Row("end error, re-simulated", 1e3 * values["end_error_m"], "mm"),
    ]
    if problem.mesh.control != "constant":
        rows.append(Row("largest force between the nodes", values["peak_force_between_nodes_N"], "N"))
    return [
        *rows,
        Row("exported: final time", values["exported_final_time_s"], "s"),
        Row("exported: end error, re-simulated", 1e3 * values["exported_end_error_m"], "mm"),
        Row("exported: largest force at any instant", values["exported_peak_force_N"], "N"),
    ]


def _figure(problem: Schema, trajectory: Trajectory, curves: tuple[np.ndarray, np.ndarray] | None) -> Any:
    from gtmodel.plot.motion import motion_figure

    return motion_figure(trajectory, curves, force_limit=problem.limits.force_N)
