"""Kind "axis_trajectory": time- or energy-optimal motion of the F1, free between positions of its axes or on a path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtmodel.compiler.causal import compile_causal
from gtmodel.motion.finer_mesh import elements_after, how, refined, told
from gtmodel.motion.found import MARGIN_TOLERANCE
from gtmodel.motion.guard import clearance
from gtmodel.optimize import Mesh, Solution, SolverOptions
from gtmodel.optimize import solve as collocate
from gtmodel.optimize.judgement.resimulate import SUBSTEPS, resimulate
from gtmodel.problem_files.base import TRAJECTORY, Context, Outcome, Row, at_most
from gtmodel.problem_files.path_keys import PATH_ARGUMENTS
from gtmodel.results import SolveStatus, Status, Trajectory
from gtmodel.results.check import failed_of

from .axis_free_run import free_run
from .axis_keys import AxisTrajectoryProblem as Schema
from .axis_motion import CARTS, AxisPlan
from .axis_planning import LINKS, plan_of

NAME = "axis_trajectory"
ARGUMENTS = PATH_ARGUMENTS

VALUES = {
    "final_time_s": "final time of the optimum",
    "elements": "elements of the mesh: those of the file, or more where a check failed on them",
    "energy": "sum over motors of int (tau / limit)^2 dt [s]",
    "saturation": "share of the time in which each motor is within 1 % of its limit",
    "peak_share": "largest force over its limit at any instant of the re-simulated motion, of each motor",
    "tcp_m": "tool centre point at start and goal",
    "turned_deg": "angle between the plate's orientations at start and goal",
    "end_error_m": "distance of the tool centre point from the goal when all six axes are free and get the forces",
    "end_error_deg": "angle of the plate from that at the goal, then",
    "uncoupled_deg": "largest |q4 + q5| on that way; null with six degrees of freedom",
    "pose_apart_m": "largest distance of the optimum's tool centre points from the forward kinematics of its axes",
    "defect": "largest difference of re-simulated and collocated states at an element's edge, in nominals",
    "path_length_m": "length of the path to follow; null for a free motion",
    "path_error_m": "largest distance of the tool centre point from the path at its s; null for a free motion",
    "second_road_time_s": "final time along the path with squared speeds as unknowns; null if free or with a jerk",
    "margins": "least margin to each further limit, by key: in m for positions, else a share of the limit",
    "clearance_m": "least distance of tool centre point and links from each obstacle",
}

SATURATED = 0.99
MENDED = ("peak_share", "end_error_m", "end_error_deg", "excess", "roads_apart")  # by a finer mesh
ROADS_AGREE = 0.02  # relative: of the final time along a path; accelerations linear on 20 elements cannot jump
# forces are bounded at collocation points and are no polynomials: between the points they pass by less than that
PEAK_SHARE = 1.01
# the printed accuracy of the F1 is a quarter of a millimetre
END_ERROR_M = 2.5e-4
FINER = "use more mesh.elements or mesh.control = linear"
END_ERROR_DEG = 0.05
POSE_APART_M = 1e-6  # Newton and collocation solve the same equations
PATH_M = 1e-6  # round-off of the same equations


@dataclass(frozen=True)
class _Found:
    """What was found on one mesh; iterations: of all meshes up to this one."""

    plan: AxisPlan
    solution: Solution
    outcome: Outcome

    @property
    def checks(self) -> Mapping[str, Any]:
        return self.outcome.checks


def solve(problem: Schema, context: Context) -> Outcome:
    """Optimise, re-simulate, and let the forces move the robot with all six axes free; on a finer mesh where a check
    fails that it can mend."""
    plan = plan_of(problem, context)
    given = _on_this_mesh(plan, None, context)
    iterations = given.outcome.iterations or 0

    def again(before: _Found, finer: Schema) -> _Found | str:
        nonlocal iterations
        after = _on_this_mesh(replace(plan, problem=finer), before.solution, context)
        iterations += after.outcome.iterations or 0
        if after.outcome.status.converged:
            return after
        return f"on {finer.mesh.elements} elements: {after.outcome.message}"

    found, trouble = refined(given, _finer, again, context.interrupted)
    outcome, used = found.outcome, found.plan.problem.mesh.elements
    message, rows = outcome.message, outcome.rows
    if found is not given:
        end = "" if outcome.status.ok else ";"
        message += end + told(problem.mesh.elements, used, failed_of(given.checks))
        rows = [*rows, Row("elements of the mesh, refined", used)]
    message = "; ".join(filter(None, [message, trouble]))
    return outcome.with_(iterations=iterations, message=message, rows=rows)


def _finer(found: _Found) -> Schema | None:
    """The problem on a finer mesh where a check failed that it can mend."""
    if not found.outcome.status.converged:
        return None
    problem = found.plan.problem
    elements = elements_after(problem.mesh.elements, problem.mesh.most_elements, found.checks, MENDED)
    if elements is None:
        return None
    return problem.model_copy(update={"mesh": problem.mesh.model_copy(update={"elements": elements})})


def _on_this_mesh(plan: AxisPlan, guess: Solution | None, context: Context) -> _Found:
    """The optimum on the plan's mesh and the outcome of it."""
    solution = _optimum(plan, guess, context)
    return _Found(plan, solution, _judged(plan, solution, context))


def _judged(plan: AxisPlan, solution: Solution, context: Context) -> Outcome:
    problem = plan.problem
    if not solution.status.converged:
        return _failed(problem, solution, "")
    tried = resimulate(solution)
    if tried.trajectory is None:
        return _failed(problem, solution, f"the optimum cannot be re-simulated: {tried.message}; ")
    trajectory, apart = _placed(plan, tried.trajectory)
    if trajectory is None:
        lead = "forward kinematics from the home pose does not follow the optimum's axes; "
        return _failed(problem, solution, lead)
    return _outcome(plan, solution, trajectory, apart, tried.defect, context)


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: states, controls, unknowns without a closed form, bounds."""
    from gtmodel.optimize.formulation.problem import build

    plan = plan_of(problem, context)
    built = build(plan.optimization(), problem.solver.formulation)
    limits, low, high = problem.limits, *plan.strokes
    further = list(dict.fromkeys(m.key for m in plan.guard.margins))
    strokes = [f"q{k + 1} {_shown(k, low[k])} to {_shown(k, high[k])}" for k in range(len(low))
               if np.isfinite(low[k]) or np.isfinite(high[k])]  # fmt: skip
    return "\n".join(
        [
            f"{problem.title or 'motion'}: {built.formulation} form, {problem.mesh.elements} elements x "
            f"{problem.mesh.points} Radau points, {problem.degrees_of_freedom} degrees of freedom",
            f"  states: {', '.join(built.state_names)}",
            f"  controls: {', '.join(built.control_names)}; forces within {limits.force_N:g} N, torques within "
            f"{limits.torque_Nm:g} N.m",
            f"  unknown at each point: {', '.join(built.point_names)}",
            f"  free: {', '.join(built.free_names)}",
            *(
                [f"  along: {problem.path.shape} of {plan.course.path.length:.4g} m"]
                if problem.path and plan.course
                else []
            ),
            *([f"  strokes: {'; '.join(strokes)}"] if strokes else []),
            *([f"  further limits: {', '.join(further)}"] if further else []),
        ]
    )


def _shown(k: int, x: float) -> str:
    return f"{x:g} m" if k < CARTS else f"{np.degrees(x):g} deg"


def _optimum(plan: AxisPlan, guess: Solution | None, context: Context) -> Solution:
    def progress(iteration: int, objective: float, violation: float) -> bool:
        numbers = {"iteration": iteration, "objective": objective, "violation": violation}
        context.progress("optimising", None, numbers)
        return context.interrupted()

    mesh, solver = plan.problem.mesh, plan.problem.solver
    return collocate(
        plan.optimization(),
        Mesh(mesh.elements, mesh.points, control=mesh.control),
        guess=guess or plan.guess(),
        # the kind judges the motion by its re-simulation
        solver=SolverOptions(**solver.model_dump(), max_seconds=context.seconds_left(), error_bound=None),
        progress=progress,
        throw=False,
    )


def _failed(problem: Schema, solution: Solution, lead: str) -> Outcome:
    title = f"{problem.title} (not solved: {solution.status.value})".strip()
    status = SolveStatus.FAILED if solution.status.converged else solution.status
    return Outcome(
        status=status,
        message=lead + solution.message,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=solution.iterations,
        checks=solution.checks,
        values={"final_time_s": solution.free.get("final_time")},
        trajectory=_renamed(solution.trajectory, title),
        machine_files=(TRAJECTORY,),
    )


def _renamed(run: Trajectory, title: str) -> Trajectory:
    """The robot's own names: robot.q becomes q; q and tau have one unit for carts, another for rotary axes."""
    names = ("q", "der(q)", "der(q,2)", "T", "e", "tau")
    own = {name: name.replace("q", "robot.q") if "q" in name else f"robot.{name}" for name in names}
    if "s" in run and np.ndim(run["s"]) == 1:  # along a path
        own["s"] = "s"
    own["margin"] = "margin"
    values = {name: run[old] for name, old in own.items() if old in run}
    return Trajectory(run.time, values, {"T": "m", "e": "1"}, title=title)


def _placed(plan: AxisPlan, run: Trajectory) -> tuple[Trajectory | None, float]:
    """The re-simulated motion of the axes with poses by Newton and forces by inverse dynamics, None where these fail,
    and how far the optimum's tool centre points are from those poses [m]."""
    trajectory = _renamed(run, plan.problem.title or "optimal motion")
    names = ("q", "der(q)", "der(q,2)")
    if plan.course is not None:
        held = plan.held(run)
        trajectory = trajectory.with_values({name: held[name] for name in names})
    q, v, a = (trajectory[name] for name in names)
    T, e, placed = plan.poses(q)
    tau, moved = plan.inverse(q, v, a)
    if np.any(placed != Status.OK) or np.any(moved != Status.OK):
        return None, np.inf
    apart = np.linalg.norm(T - trajectory["T"], axis=1)[1:]  # at the start the re-simulation's is a step late
    return trajectory.with_values({"T": T, "e": e, "tau": tau}), float(np.max(apart))


def _energy(plan: AxisPlan, solution: Solution) -> float:
    """By the quadrature of the collocation points [s]."""
    mesh = solution.nlp.mesh
    weights = np.outer(mesh.h, mesh.table.weights).reshape(-1) * solution.final_time
    tau = solution.trajectory["robot.tau"][1 : 1 + len(weights)]
    return float(weights @ np.sum((tau / plan.limits) ** 2, axis=1))


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two orientations by their unit quaternions."""
    nearer = min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
    return float(np.degrees(4 * np.arcsin(min(1.0, nearer / 2))))


def _outcome(
    plan: AxisPlan, solution: Solution, trajectory: Trajectory, pose_apart: float, defect: float, context: Context
) -> Outcome:
    problem = plan.problem
    context.progress("moving all six axes by the forces", None, {})
    free = free_run(plan.robot, trajectory, SUBSTEPS, context.interrupted)
    (T0, T1, T), (e0, e1, e), status = plan.poses(np.array([plan.start, plan.goal, free.q]))
    reached = not free.message and status[2] == Status.OK
    share = np.abs(trajectory["tau"]) / plan.limits
    end_m = float(np.linalg.norm(T - T1)) if reached else np.inf
    end_deg = _angle_deg(e, e1) if reached else np.inf
    five = problem.degrees_of_freedom == 5
    values = {
        "final_time_s": solution.final_time,
        "elements": problem.mesh.elements,
        "energy": _energy(plan, solution),
        "saturation": np.mean(share[1:] >= SATURATED, axis=0).tolist(),  # rows are equally spaced
        "peak_share": np.max(share, axis=0).tolist(),
        "tcp_m": [T0.tolist(), T1.tolist()],
        "turned_deg": _angle_deg(e0, e1),
        "end_error_m": end_m if reached else None,
        "end_error_deg": end_deg if reached else None,
        "uncoupled_deg": float(np.degrees(free.uncoupled)) if five and reached else None,
        "pose_apart_m": pose_apart,
        "defect": defect,
        **_along(plan, trajectory, context),
        # at the start what is no state is extrapolated
        "margins": plan.guard.least(trajectory["margin"][1:]) if plan.guard.margins else {},
        "clearance_m": _clearances(plan, trajectory),
    }
    peak = max(values["peak_share"])
    bounds = {
        "peak_share": (peak, PEAK_SHARE),
        "end_error_m": (end_m, END_ERROR_M),
        "end_error_deg": (end_deg, END_ERROR_DEG),
        "pose_apart_m": (pose_apart, POSE_APART_M),
    }
    if plan.course is not None:
        bounds["path_error_m"] = (values["path_error_m"], PATH_M)
    if values["margins"]:
        bounds["excess"] = (max(0.0, -min(values["margins"].values())), MARGIN_TOLERANCE)
    if values["second_road_time_s"] is not None and problem.cost.energy == 0.0:
        bounds["roads_apart"] = (abs(values["second_road_time_s"] / solution.final_time - 1), ROADS_AGREE)
    checks: dict[str, Any] = {"constraint_violation": solution.checks["constraint_violation"]}
    trouble = f"the forces could not be tried on all six axes: {free.message}" if free.message else FINER
    checks |= {n: at_most(x, bound, trouble) for n, (x, bound) in bounds.items()}
    return Outcome(
        status=SolveStatus.SOLVED,
        message="; ".join(
            filter(None, [f"{how(solution)}, re-simulated, and tried on all six axes", solution.reservation])
        ),
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks,
        values=values,
        trajectory=trajectory,
        rows=_rows(values, solution),
        figures={"motion": lambda: _figure(plan, trajectory)},
        machine_files=(TRAJECTORY,),
    )


def _along(plan: AxisPlan, run: Trajectory, context: Context) -> dict[str, float | None]:
    """How the path was followed, and how long it takes by the other road."""
    path, second = plan.problem.path, None
    if path is None or plan.course is None:
        return {"path_length_m": None, "path_error_m": None, "second_road_time_s": None}
    off = np.linalg.norm(run["T"] - plan.course.path(np.clip(run["s"], 0.0, 1.0))[0], axis=1)
    if plan.order == 2:
        context.progress("squared speeds", None, {})
        motion = plan.by_squared_speeds(path.intervals)
        second = motion.final_time if motion.status.ok else None
    return {"path_length_m": plan.course.path.length, "path_error_m": float(np.max(off)), "second_road_time_s": second}


def _clearances(plan: AxisPlan, run: Trajectory) -> list[float]:
    """Distances [m] of tool centre point and links from each obstacle."""
    obstacles = plan.problem.limits.obstacles
    if not obstacles:
        return []
    names = [f"{part}[{k}].{end}.r" for part, k in LINKS for end in "ab"]
    *joints, _ = compile_causal(plan.robot, known="q", targets=names)(run["q"])
    found = []
    for obstacle in obstacles:
        box = np.array(obstacle.center_m), np.array(obstacle.size_m)
        links = [clearance(a, b, *box) for a, b in zip(joints[::2], joints[1::2], strict=True)]
        found.append(min(clearance(run["T"], run["T"], *box, 1), *links))
    return found


def _rows(values: dict[str, Any], solution: Solution) -> list[Row]:
    rows = [
        Row("final time", values["final_time_s"], "s"),
        Row("cost", solution.objective, ""),
        Row("energy", values["energy"], "s"),
        Row("plate turned by", values["turned_deg"], "deg"),
    ]
    rows += [Row(f"motor {k + 1} at its limit", 100 * x, "% of the time") for k, x in enumerate(values["saturation"])]
    rows.append(Row("largest force at any instant", 100 * max(values["peak_share"]), "% of its limit"))
    if values["end_error_m"] is not None:
        rows += [
            Row("all six axes free: end error", 1e3 * values["end_error_m"], "mm"),
            Row("all six axes free: end error", values["end_error_deg"], "deg"),
        ]
    if values["path_length_m"] is not None:
        rows.append(Row("length of the path", values["path_length_m"], "m"))
    if values["second_road_time_s"] is not None:
        rows.append(Row("final time by squared speeds", values["second_road_time_s"], "s"))
    rows += [Row(f"margin to {key}", x, "") for key, x in values["margins"].items()]
    rows += [Row(f"distance from obstacle {n}", 1e3 * x, "mm") for n, x in enumerate(values["clearance_m"])]
    if values["uncoupled_deg"] is not None:
        rows.append(Row("all six axes free: largest |q4 + q5|", values["uncoupled_deg"], "deg"))
    return rows


def _figure(plan: AxisPlan, trajectory: Trajectory) -> Any:
    from gtmodel.plot.axis_motion import axis_motion_figure

    limits = plan.problem.limits
    path = None if plan.course is None else plan.course.path(np.linspace(0.0, 1.0, 201))[0]
    return axis_motion_figure(trajectory, force_limit=limits.force_N, torque_limit=limits.torque_Nm, path=path)
