"""The study of a motion of six axes: optimise, re-simulate, apply the forces to all axes free, refine the mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal, Unpack

import numpy as np
import scipy

from ... import view
from ...compiler.causal import compile_causal
from ...geometry.quaternions import angle_between
from ...lang import Model
from ...optimize import Mesh as CollocationMesh, Solution, SolverOptions, solve as collocate
from ...optimize.judgement.resimulate import SUBSTEPS, resimulate
from ...results import SolveStatus, Status, Trajectory, Work, at_most
from ...results.quantity import converted
from ...results.trajectory_files import TRAJECTORY
from ...results.work import WorkOptions, study_function
from ..constraints import MARGIN_TOLERANCE, clearances
from ..finer_mesh import FINER, PEAK_SHARE, OnMesh, how, study_on_meshes
from ..motion_result import SATURATED, energy_of
from ..options import AxisLimits, Shape
from ..path_parametrization import FollowedBranch
from .options import AxisCost, AxisEnd, AxisMesh, AxisSolver, AxisStudy, ToolCourse
from .plan import AxisPlan, AxisProblem
from .planning import LINKS, plan_of

Array = np.ndarray
TOLERANCE = 1e-8  # relative and absolute, far below the error of the sampled forces
AXES = 6
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class FreeRun:
    """Axes (6,) [m, rad] and their velocities at the end, and the largest |q4 + q5| [rad]; message: why it failed."""

    q: Array
    velocity: Array
    uncoupled: float
    message: str = ""


def free_run(
    robot: Model, run: Trajectory, rows_per_element: int, interrupted: Callable[[], bool] = lambda: False
) -> FreeRun:
    """Integrate the forward dynamics of all six axes under the forces `tau` of a motion, element by element.

    The coupling q4 = -q5 is not imposed. On each element the force is a cubic spline through its rows: the start, then
    `rows_per_element` equally spaced rows per element. The row at an element's left edge belongs to the previous
    element, so that a force may jump there.

    >>> class SixSprings(gt.Model):
    ...     q = gt.variable(6)
    ...     tau = gt.input(6)
    ...
    ...     def equations(self):
    ...         yield gt.der(self.q, 2) == self.tau - self.q - 2 * gt.der(self.q)
    >>> t = np.linspace(0.0, 1.0, 5)
    >>> run = gt.Trajectory(t, {"q": np.zeros((5, 6)), "der(q)": np.zeros((5, 6)), "tau": np.ones((5, 6))}, {})
    >>> gt.motion.axes.free_run(SixSprings(), run, rows_per_element=4).q.round(4)  # 1 - 2 / e
    array([0.2642, 0.2642, 0.2642, 0.2642, 0.2642, 0.2642])
    """
    forward = FollowedBranch(compile_causal(robot, known="tau", targets="der(q,2)", prefer="q"))
    y = np.concatenate([run["q"][0], run["der(q)"][0]])
    worst, times = abs(y[3] + y[4]), list[float]()
    for first in range(0, len(run) - 1, rows_per_element):
        rows = slice(first + 1, first + rows_per_element + 1)
        force = scipy.interpolate.CubicSpline(run.time[rows], run["tau"][rows])
        trouble: list[str] = []

        def rates(
            t: float, y: Array, force: scipy.interpolate.CubicSpline = force, trouble: list[str] = trouble
        ) -> Array:
            a = forward(y[:AXES], y[AXES:], force(t))
            if not np.all(np.isfinite(a)) and not trouble:
                trouble.append(_dynamics_failed(t, int(forward.f(y[:AXES], y[AXES:], force(t))[-1])))
            return np.concatenate([y[AXES:], a])

        span = (run.time[first], run.time[first + rows_per_element])
        with np.errstate(invalid="ignore"):  # failed rows are NaN and reported below
            result = scipy.integrate.solve_ivp(rates, span, y, method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
        for t, row in zip(result.t, result.y.T, strict=True):
            forward.kept(row[:AXES], row[AXES:], force(t))
        times += result.t.tolist()
        if interrupted():
            trouble.append(INTERRUPTED)
        if trouble or not result.success:
            return FreeRun(y[:AXES], y[AXES:], np.inf, (trouble or [str(result.message)])[0])
        y = result.y[:, -1]
        worst = max(worst, float(np.max(np.abs(result.y[3] + result.y[4]))))
    statuses = forward.statuses()
    bad = np.flatnonzero(statuses != Status.OK)
    if bad.size:
        return FreeRun(y[:AXES], y[AXES:], np.inf, _dynamics_failed(times[bad[0]], int(statuses[bad[0]])))
    return FreeRun(y[:AXES], y[AXES:], float(worst))


def _dynamics_failed(t: float, status: int) -> str:
    return f"the forward dynamics fail at {t:.4g} s: {Status(int(status)).name.lower()}"


MENDED = ("peak_share", "end_error_m", "end_error_deg", "excess", "cross_check_difference")  # by a finer mesh
CROSS_CHECK_TOLERANCE = (
    0.02  # relative, of the final time along a path: accelerations linear on 20 elements cannot jump
)
# the published accuracy of the F1 is a quarter of a millimetre
END_ERROR_M = 2.5e-4
END_ERROR_DEG = 0.05
POSE_APART_M = 1e-6  # Newton and collocation solve the same equations
PATH_M = 1e-6  # rounding of the same equations


def on_this_mesh(plan: AxisPlan, work: Work, mesh: AxisMesh, before: OnMesh | None) -> OnMesh:
    """Optimise on a mesh and evaluate the result."""
    solution = collocate(
        plan.optimization,
        CollocationMesh(mesh.elements, mesh.points, control=mesh.control),
        guess=plan.guess() if before is None else before.kept,
        # the study judges the motion by its re-simulation
        solver=SolverOptions(**asdict(plan.problem.solver), max_seconds=work.seconds_left(), error_bound=None),
        progress=work.iterations("optimising"),
        throw=False,
    )
    return OnMesh(mesh, _judged(plan, mesh, solution, work), solution)


def _judged(plan: AxisPlan, mesh: AxisMesh, solution: Solution, work: Work) -> AxisStudy:
    if not solution.status.converged:
        return _failed(plan, solution, "")
    run = resimulate(solution)
    if run.trajectory is None:
        return _failed(plan, solution, f"the optimum cannot be re-simulated: {run.message}; ")
    trajectory, pose_error = _placed(plan, run.trajectory)
    if trajectory is None:
        lead = "the forward kinematics from the home pose cannot follow the optimum's axes; "
        return _failed(plan, solution, lead)
    return _evaluated(plan, mesh, solution, trajectory, pose_error, run.defect, work)


def _failed(plan: AxisPlan, solution: Solution, lead: str) -> AxisStudy:
    title = plan.problem.title
    return AxisStudy(
        status=SolveStatus.FAILED if solution.status.converged else solution.status,
        message=lead + solution.message,
        title=title,
        objective=solution.objective if np.isfinite(solution.objective) else None,
        iterations=solution.iterations,
        checks=solution.checks,
        final_time=solution.free.get("final_time") if solution.iterations else None,  # not the guess
        trajectory=_renamed(solution.trajectory, f"{title} (not solved: {solution.status.value})".strip()),
        machine_files=(TRAJECTORY,),
    )


def _renamed(run: Trajectory, title: str) -> Trajectory:
    """Remove the prefix from the robot's names; q and tau have no unit, since carts and rotary axes differ."""
    names = ("q", "der(q)", "der(q,2)", "T", "e", "tau")
    sources = {name: name.replace("q", "robot.q") if "q" in name else f"robot.{name}" for name in names}
    if "s" in run and np.ndim(run["s"]) == 1:  # along a path
        sources["s"] = "s"
    sources["margin"] = "margin"
    values = {name: run[old] for name, old in sources.items() if old in run}
    return Trajectory(run.time, values, {"T": "m", "e": "1"}, title=title)


def _placed(plan: AxisPlan, run: Trajectory) -> tuple[Trajectory | None, float]:
    """Return the re-simulated motion with poses by Newton's method and forces by inverse dynamics (None if these fail),
    and the largest distance [m] of the optimum's tool centre points from these poses."""
    trajectory = _renamed(run, plan.problem.title or "optimal motion")
    names = ("q", "der(q)", "der(q,2)")
    if plan.course is not None:
        axes = plan.held(run)
        trajectory = trajectory.with_values({name: axes[name] for name in names})
    q, v, a = (trajectory[name] for name in names)
    T, e, pose_status = plan.poses(q)
    tau, force_status = plan.inverse(q, v, a)
    if np.any(pose_status != Status.OK) or np.any(force_status != Status.OK):
        return None, np.inf
    distance = np.linalg.norm(T - trajectory["T"], axis=1)[1:]  # the re-simulation's T at the start is a step late
    return trajectory.with_values({"T": T, "e": e, "tau": tau}), float(np.max(distance))


def _evaluated(
    plan: AxisPlan, mesh: AxisMesh, solution: Solution, trajectory: Trajectory, pose_apart: float, defect: float,
    work: Work,
) -> AxisStudy:  # fmt: skip
    problem = plan.problem
    work.progress("simulating all six axes", None, {})
    free = free_run(plan.robot, trajectory, SUBSTEPS, work.interrupted)
    (T0, T1, T), (e0, e1, e), status = plan.poses(np.array([plan.start, plan.goal, free.q]))
    complete = not free.message and status[2] == Status.OK
    share = np.abs(trajectory["tau"]) / plan.motors
    end, angle = (float(np.linalg.norm(T - T1)), float(angle_between(e, e1))) if complete else (np.inf, np.inf)
    # at the start, quantities that are not states are extrapolated
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
    if stopped:  # values that were not computed are not checked
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
    trouble = f"the forces could not be applied to all six axes: {free.message}" if free.message else FINER
    if not free.message and mesh.control != "linear":
        trouble += ' or mesh.control = "linear"'
    checks: dict[str, Any] = {"constraint_violation": solution.checks["constraint_violation"]}
    verified = "stopped before it was simulated" if stopped else "simulated"
    message = f"{how(solution)}, re-simulated, and {verified} with all six axes free"
    return AxisStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message="; ".join(filter(None, [message, solution.reservation])),
        title=problem.title,
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks | {n: at_most(x, bound, trouble) for n, (x, bound) in bounds.items()},
        final_time=solution.final_time,
        elements=mesh.elements,
        energy=energy_of(solution, plan.motors),
        saturation=np.mean(share[1:] >= SATURATED, axis=0).tolist(),  # rows are equally spaced
        peak_share=peaks,
        tcp=np.array([T0, T1]),
        turned=float(angle_between(e0, e1)),
        end_error=end if complete else None,
        end_angle=angle if complete else None,
        uncoupled=free.uncoupled if problem.degrees_of_freedom == 5 and complete else None,
        pose_apart=pose_apart,
        defect=defect,
        **followed,
        margins=margins,
        clearance=_clearances(plan, trajectory),
        trajectory=trajectory,
        figures={"motion": partial(_figure, plan, trajectory)},
        scenes={"motion": partial(view.scene, plan.robot, trajectory)},
        machine_files=(TRAJECTORY,),
    )


def _along(plan: AxisPlan, run: Trajectory, work: Work) -> dict[str, Any]:
    """Return the path error, and the time by squared speeds as a cross-check; empty for a free motion."""
    path, second = plan.problem.path, None
    if path is None or plan.course is None:
        return {}
    deviation = np.linalg.norm(run["T"] - plan.course.path(np.clip(run["s"], 0.0, 1.0))[0], axis=1)
    if plan.order == 2:
        work.progress("squared speeds", None, {})
        motion = plan.by_squared_speeds(path.intervals)
        second = motion.final_time if motion.status.ok else None
    return {"path_length": plan.course.path.length, "path_error": float(np.max(deviation)), "cross_check_time": second}


def _clearances(plan: AxisPlan, run: Trajectory) -> list[float]:
    """Return the distances [m] of tool centre point and links from each obstacle."""
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


@study_function
def axis_study(
    robot: Model,
    start: AxisEnd,
    goal: AxisEnd,
    *,
    limits: AxisLimits,
    path: Shape | None = None,
    tool: ToolCourse | None = None,
    degrees_of_freedom: Literal[5, 6] = 5,
    cost: AxisCost | None = None,
    mesh: AxisMesh | None = None,
    solver: AxisSolver | None = None,
    earlier: Trajectory | None = None,
    **work_options: Unpack[WorkOptions],
) -> AxisStudy:
    """Compute the optimal motion of the F1 from rest to rest, free between positions of its axes or along a path.

    Args:
        robot: an F1 with three carts q1 to q3 [m] and three rotary axes q4 to q6 [rad].
        start, goal: positions of all axes, or, along a path, the tool centre point and the tool direction.
        limits: motor forces and torques, and further limits.
        path: `Line`, `Polyline`, `Arc`, `Spline` or `Taught` of `gtmodel.motion`; None: a free motion.
        tool: orientation of the tool along the path: its axis in the plate, and directions between the ends.
        degrees_of_freedom: 5 keeps q4 = -q5 throughout, 6 leaves all axes free.
        cost, mesh, solver: objective and options of the search. The mesh is refined if that can make a failed check
            pass.
        earlier: the trajectory of an earlier study, used as the guess.
        progress, max_seconds, stop: see `gtmodel.results.Work`. A study stopped during the optimisation contains the
            best iterate.

    Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import AxisEnd, AxisLimits, AxisMesh
    >>> start, goal = AxisEnd([0.72, 0.26, 0.21], [0.0, 0.0, 0.0]), AxisEnd([0.9, 0.5, 0.35], [0.2, -0.2, -0.15])
    >>> limits = AxisLimits(force=1000.0, torque=40.0)
    >>> s = gt.motion.axis_study(gt.robots.catalogue.make("f1"), start, goal, limits=limits, mesh=AxisMesh(4, 4))
    >>> s.tcp.shape
    (2, 3)
    """
    work = Work(**work_options)
    problem = AxisProblem(
        robot=robot, start=start, goal=goal, limits=limits, path=path, tool=tool or ToolCourse(),
        degrees_of_freedom=degrees_of_freedom, cost=cost or AxisCost(), mesh=mesh or AxisMesh(),
        solver=solver or AxisSolver(), earlier=earlier, title=work.title,
    )  # fmt: skip
    work.step("equations")
    plan = plan_of(problem)
    work.step("transcribing")
    return study_on_meshes(partial(on_this_mesh, plan, work), problem.mesh, MENDED, work.interrupted)
