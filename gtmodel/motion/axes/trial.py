"""The optimum on one mesh, re-simulated, and its forces applied to the F1 with all six axes free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from ...compiler.causal import compile_causal
from ...geometry.quaternions import angle_between
from ...optimize import Mesh as CollocationMesh, Solution, SolverOptions, solve as collocate
from ...optimize.judgement.resimulate import SUBSTEPS, resimulate
from ...results import Check, SolveStatus, Status, Trajectory, Work, at_most
from ...results.quantity import converted
from ...results.trajectory_files import TRAJECTORY
from ..constraints import MARGIN_TOLERANCE, clearances
from ..finer_mesh import how
from ..motion_result import SATURATED, at_points
from .free_run import INTERRUPTED, free_run
from .options import AxisMesh
from .plan import AxisPlan
from .planning import LINKS
from .result import AxisStudy

MENDED = ("peak_share", "end_error_m", "end_error_deg", "excess", "cross_check_difference")  # by a finer mesh
CROSS_CHECK_TOLERANCE = (
    0.02  # relative: of the final time along a path; accelerations linear on 20 elements cannot jump
)
# forces are bounded at collocation points and are no polynomials: between the points they pass by less than that
PEAK_SHARE = 1.01
# the printed accuracy of the F1 is a quarter of a millimetre
END_ERROR_M = 2.5e-4
FINER = "use more mesh.elements"
END_ERROR_DEG = 0.05
POSE_APART_M = 1e-6  # Newton and collocation solve the same equations
PATH_M = 1e-6  # round-off of the same equations


@dataclass(frozen=True)
class AxisOutcome:
    """What came of one mesh."""

    mesh: AxisMesh
    solution: Solution
    study: AxisStudy

    @property
    def checks(self) -> Mapping[str, Check]:
        return self.study.checks


def on_this_mesh(plan: AxisPlan, mesh: AxisMesh, guess: Solution | None, work: Work) -> AxisOutcome:
    """The optimum on a mesh and what comes of it."""
    solution = collocate(
        plan.optimization,
        CollocationMesh(mesh.elements, mesh.points, control=mesh.control),
        guess=guess or plan.guess(),
        # the study judges the motion by its re-simulation
        solver=SolverOptions(**asdict(plan.problem.solver), max_seconds=work.seconds_left(), error_bound=None),
        progress=work.iterations("optimising"),
        throw=False,
    )
    return AxisOutcome(mesh, solution, _judged(plan, mesh, solution, work))


def _judged(plan: AxisPlan, mesh: AxisMesh, solution: Solution, work: Work) -> AxisStudy:
    if not solution.status.converged:
        return _failed(plan, solution, "")
    tried = resimulate(solution)
    if tried.trajectory is None:
        return _failed(plan, solution, f"the optimum cannot be re-simulated: {tried.message}; ")
    trajectory, apart = _placed(plan, tried.trajectory)
    if trajectory is None:
        lead = "forward kinematics from the home pose does not follow the optimum's axes; "
        return _failed(plan, solution, lead)
    return _tried(plan, mesh, solution, trajectory, apart, tried.defect, work)


def _failed(plan: AxisPlan, solution: Solution, lead: str) -> AxisStudy:
    title = plan.problem.title
    return AxisStudy(
        status=SolveStatus.FAILED if solution.status.converged else solution.status,
        message=lead + solution.message,
        title=title,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=solution.iterations,
        checks=solution.checks,
        final_time=solution.free.get("final_time") if solution.iterations else None,  # the guess's is no result
        trajectory=_renamed(solution.trajectory, f"{title} (not solved: {solution.status.value})".strip()),
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
    tau, weights = at_points(solution)
    return float(weights @ np.sum((tau / plan.motors) ** 2, axis=1))


def _tried(
    plan: AxisPlan, mesh: AxisMesh, solution: Solution, trajectory: Trajectory, pose_apart: float, defect: float,
    work: Work,
) -> AxisStudy:  # fmt: skip
    problem = plan.problem
    work.progress("moving all six axes by the forces", None, {})
    free = free_run(plan.robot, trajectory, SUBSTEPS, work.interrupted)
    (T0, T1, T), (e0, e1, e), status = plan.poses(np.array([plan.start, plan.goal, free.q]))
    reached = not free.message and status[2] == Status.OK
    share = np.abs(trajectory["tau"]) / plan.motors
    end, angle = (float(np.linalg.norm(T - T1)), float(angle_between(e, e1))) if reached else (np.inf, np.inf)
    # at the start what is no state is extrapolated
    margins = plan.guard.least(trajectory["margin"][1:]) if plan.guard.margins else {}
    followed = _along(plan, trajectory, work)
    peaks = np.max(share, axis=0).tolist()
    bounds = {
        "peak_share": (max(peaks), PEAK_SHARE),
        "end_error_m": (end, END_ERROR_M),
        "end_error_deg": (converted(angle, "rad", "deg"), END_ERROR_DEG),
        "pose_apart_m": (pose_apart, POSE_APART_M),
    }
    stopped = free.message == INTERRUPTED
    if stopped:  # what was not reached is not judged
        bounds = {name: bound for name, bound in bounds.items() if np.isfinite(bound[0])}
    if followed:
        bounds["path_error_m"] = (followed["path_error"], PATH_M)
    if margins:
        bounds["excess"] = (max(0.0, -min(margins.values())), MARGIN_TOLERANCE)
    if followed.get("cross_check_time") is not None and problem.cost.energy == 0.0:
        bounds["cross_check_difference"] = (
            abs(followed["cross_check_time"] / solution.final_time - 1),
            CROSS_CHECK_TOLERANCE,
        )
    trouble = f"the forces could not be tried on all six axes: {free.message}" if free.message else FINER
    if not free.message and mesh.control != "linear":
        trouble += ' or mesh.control = "linear"'
    checks: dict[str, Any] = {"constraint_violation": solution.checks["constraint_violation"]}
    tried = "stopped before the forces were tried" if stopped else "tried"
    said = f"{how(solution)}, re-simulated, and {tried} on all six axes"
    return AxisStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message="; ".join(filter(None, [said, solution.reservation])),
        title=problem.title,
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks | {n: at_most(x, bound, trouble) for n, (x, bound) in bounds.items()},
        final_time=solution.final_time,
        elements=mesh.elements,
        energy=_energy(plan, solution),
        saturation=np.mean(share[1:] >= SATURATED, axis=0).tolist(),  # rows are equally spaced
        peak_share=peaks,
        tcp=np.array([T0, T1]),
        turned=float(angle_between(e0, e1)),
        end_error=end if reached else None,
        end_angle=angle if reached else None,
        uncoupled=free.uncoupled if problem.degrees_of_freedom == 5 and reached else None,
        pose_apart=pose_apart,
        defect=defect,
        **followed,
        margins=margins,
        clearance=_clearances(plan, trajectory),
        trajectory=trajectory,
        figures={"motion": partial(_figure, plan, trajectory)},
        machine_files=(TRAJECTORY,),
    )


def _along(plan: AxisPlan, run: Trajectory, work: Work) -> dict[str, Any]:
    """How the path was followed, and its time by squared speeds as a cross-check; empty for a free motion."""
    path, second = plan.problem.path, None
    if path is None or plan.course is None:
        return {}
    off = np.linalg.norm(run["T"] - plan.course.path(np.clip(run["s"], 0.0, 1.0))[0], axis=1)
    if plan.order == 2:
        work.progress("squared speeds", None, {})
        motion = plan.by_squared_speeds(path.intervals)
        second = motion.final_time if motion.status.ok else None
    return {"path_length": plan.course.path.length, "path_error": float(np.max(off)), "cross_check_time": second}


def _clearances(plan: AxisPlan, run: Trajectory) -> list[float]:
    """Distances [m] of tool centre point and links from each obstacle."""
    obstacles = plan.problem.limits.obstacles
    if not obstacles:
        return []
    names = [f"{part}[{k}].{end}.r" for part, k in LINKS for end in "ab"]
    *joints, _ = compile_causal(plan.robot, known="q", targets=names)(run["q"])
    return clearances(obstacles, run["T"], list(zip(joints[::2], joints[1::2], strict=True)))


def _figure(plan: AxisPlan, trajectory: Trajectory) -> Any:
    from ...plot.motion import axis_motion_figure

    limits = plan.problem.limits
    path = None if plan.course is None else plan.course.path(np.linspace(0.0, 1.0, 201))[0]
    return axis_motion_figure(trajectory, force_limit=limits.force, torque_limit=limits.torque, path=path)
