"""What an axis trajectory problem asks for, checked before anything is optimised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.mechanics.rotation import quaternion_matrix, rotation_about
from gtmodel.motion.guard import Carrier, Guard, guard_of
from gtmodel.motion.paths import path_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.results import Status, Trajectory
from gtmodel.robots import F1

from .axis_course import Course, turning
from .axis_keys import AxisTrajectoryProblem, End
from .axis_motion import CARTS, MOTORS, AxisPlan, coordinates

Array = np.ndarray
COUPLED = 1e-9  # degrees: typed numbers, so round-off only
SAME_AXES = 1e-6  # [m, rad] Newton's round-off, amplified near a singularity
SAMPLES = 201
X, Y = np.eye(3)[0], np.eye(3)[1]
LINKS = [("link", k) for k in range(6)]


@dataclass(frozen=True)
class _Place:
    """An end of a path: tool centre point [m], the plate's R (3, 3), and a tool direction where one is given."""

    T: Array
    R: Array
    direction: Array | None


def plan_of(problem: AxisTrajectoryProblem, context: Context) -> AxisPlan:
    """The plan of a problem. Raises InputError with one sentence and the key."""
    robot = problem.model(context)
    if not isinstance(robot, F1):
        raise InputError(
            f"axis_trajectory moves the six axes of an F1; '{problem.robot}' is a {type(robot).__name__}; "
            "kind trajectory moves three-link and six-link robots",
            "robot",
        )
    if problem.cost.time == 0.0 and problem.cost.energy == 0.0:
        raise InputError("both weights are zero, so nothing is minimised; give cost.time or cost.energy", "cost")
    for which, end in (("start", problem.start), ("goal", problem.goal)):
        _check_end(problem, end, which)
    start, goal, course = *(_axes(end) for end in (problem.start, problem.goal)), None
    if problem.path is not None:
        course = _course(problem, robot, context)
        start, goal = _ends_of(problem, course.function(robot, Guard([], {}), "robot.q"), start, goal)
    if np.array_equal(start, goal):
        raise InputError("the goal equals the start; give another goal", "goal")
    guard = _guard(problem, robot, start)
    plan = AxisPlan(problem, robot, start, goal, guard, course, _earlier(problem, course, context))
    _check_strokes(plan)
    _check_ends(plan)
    if course is not None:
        _check_way(plan)
    return plan


def _axes(end: End) -> Array:
    """Axes (6,) [m, rad] as given; NaN where they are not."""
    if end.q_m is None or end.q_deg is None:
        return np.full(MOTORS, np.nan)
    return np.concatenate([end.q_m, np.radians(end.q_deg)])


def _check_end(problem: AxisTrajectoryProblem, end: End, which: str) -> None:
    """An end is given by its axes, or on a path by its tool centre point, not by both."""
    axes = [key for key in ("q_m", "q_deg") if getattr(end, key) is not None]
    if problem.path is None:
        for key in ("tcp_m", "tool"):
            if getattr(end, key) is not None:
                raise InputError(
                    "needs a [path]; a free motion goes from axes to axes, q_m and q_deg", f"{which}.{key}"
                )
    elif end.tcp_m is not None:
        if axes:
            raise InputError(
                "is given beside tcp_m, which determines the axes; remove one of them", f"{which}.{axes[0]}"
            )
        if end.tool is not None and problem.degrees_of_freedom == 6:
            raise InputError(
                "leaves the turn of the plate about it open in six degrees of freedom; give the axes, q_m and q_deg",
                f"{which}.tool",
            )
        if end.tool is not None:
            _unit(np.array(end.tool), f"{which}.tool")
        return
    for key in ("q_m", "q_deg"):
        if getattr(end, key) is None:
            raise InputError(
                f"is missing{'' if problem.path is None else '; give q_m and q_deg, or tcp_m'}", f"{which}.{key}"
            )
    if end.tool is not None:
        raise InputError("is given beside the axes, which determine it; remove it", f"{which}.tool")
    q4, q5, _ = end.q_deg or (0.0, 0.0, 0.0)
    if problem.degrees_of_freedom == 5 and abs(q4 + q5) > COUPLED:
        raise InputError(
            f"q5 = {q5:g} is not -q4 = {-q4:g}; give q5 = -q4, or set degrees_of_freedom = 6", f"{which}.q_deg"
        )


def _course(problem: AxisTrajectoryProblem, robot: F1, context: Context) -> Course:
    """The path and how the plate is held on it."""
    keys = problem.path
    assert keys is not None
    tool = _unit(np.array(keys.tool_axis), "path.tool_axis")
    start, goal = (_place(robot, end, which) for which, end in (("start", problem.start), ("goal", problem.goal)))
    if problem.degrees_of_freedom == 6:
        if keys.tool:
            raise InputError("leaves the turn of the plate open in six degrees of freedom; remove it", "path.tool")
        R = [place.R if end.tcp_m is None else other.R for place, end, other in
             ((start, problem.start, goal), (goal, problem.goal, start))]  # fmt: skip
        e = Rotation.from_matrix(np.array(R)).as_quat(scalar_first=True)
        path = path_of(keys.options(context), start.T, goal.T)
        return Course(path, turning(np.array([0.0, 1.0]), e, "goal"), None)
    ends = [place.direction if end.tcp_m is not None else place.R @ tool for place, end in
            ((start, problem.start), (goal, problem.goal))]  # fmt: skip
    first = next((d for d in ends if d is not None), start.R @ tool)
    first, last = (first if d is None else d for d in ends)
    at = np.array([0.0, *(t.at for t in keys.tool), 1.0])
    if np.any(np.diff(at) <= 0):
        raise InputError("its fractions do not rise along the way", "path.tool")
    between = [_unit(np.array(t.direction), f"path.tool[{n}].direction") for n, t in enumerate(keys.tool)]
    course = turning(at, np.array([first, *between, last]), "path.tool" if keys.tool else "goal")
    return Course(path_of(keys.options(context), start.T, goal.T), course, tool)


def _place(robot: F1, end: End, which: str) -> _Place:
    if end.tcp_m is not None:
        direction = None if end.tool is None else _unit(np.array(end.tool), f"{which}.tool")
        return _Place(np.array(end.tcp_m), quaternion_matrix(np.asarray(robot.home_e, float)), direction)
    f = compile_causal(robot, known="q", targets=["T", "R"])
    T, R, status = f(_axes(end))
    if status != Status.OK:
        raise InputError(f"the links cannot close there: {f.diagnose(_axes(end))}", which)
    return _Place(T, R, None)


def _unit(v: Array, key: str) -> Array:
    if not np.any(v):
        raise InputError("is zero; a direction is expected", key)
    return v / np.linalg.norm(v)


def _ends_of(
    problem: AxisTrajectoryProblem, following: CausalFunction, start: Array, goal: Array
) -> tuple[Array, Array]:
    """Axes at both ends of the path; those of the file where it gives them."""
    found = []
    for which, s, given in (("start", 0.0, start), ("goal", 1.0, goal)):
        q, status = following(s)
        key = which if np.all(np.isfinite(given)) else f"{which}.tcp_m"
        if status != Status.OK:
            raise InputError(f"no axes hold the plate there: {following.diagnose(s)}", key)
        if np.max(np.abs(q - given), initial=0.0, where=np.isfinite(given)) > SAME_AXES:
            shown = ", ".join(f"{x:.4g}" for x in (*q[:CARTS], *np.degrees(q[CARTS:])))
            raise InputError(
                f"the same tool centre point and tool direction are reached with other axes, ({shown}) in m and "
                "degrees; the path is followed with these: give them, or tcp_m",
                key,
            )
        found.append(np.where(np.isfinite(given), given, q))
    return found[0], found[1]


def _guard(problem: AxisTrajectoryProblem, robot: F1, start: Array) -> Guard:
    """Further limits; strokes are bounds of the axes themselves."""
    limits = problem.limits.model_copy(update={"cart_low_m": None, "cart_high_m": None})
    return guard_of(limits.options(), LINKS, lambda arm, end: _carrier(robot, start, arm, end))


def _carrier(robot: F1, start: Array, arm: int, end: str) -> Carrier | None:
    """What turns a ball joint: the plate, or the joint plate of arm 2 or 3; raw quaternions scale both sides alike."""
    if end == "plate":
        R, _ = compile_causal(robot, known="q", targets="R")(start)
        return Carrier(lambda m: m.robot.R, R)
    if arm == 0:
        return None
    u2, u3, inner = (quaternion_matrix(np.asarray(u, float)) for u in (robot.u1_2, robot.u1_3, robot.u2_3))

    def turned(q: Any) -> Any:
        if arm < 3:
            return u2 @ rotation_about(Y, q[3])
        return u3 @ rotation_about(Y, q[4]) @ inner @ rotation_about(X, q[5])

    at_start = np.array(
        u2 @ Rotation.from_rotvec(start[3] * Y).as_matrix() if arm < 3 else
        u3 @ Rotation.from_rotvec(start[4] * Y).as_matrix() @ inner @ Rotation.from_rotvec(start[5] * X).as_matrix()
    )  # fmt: skip
    return Carrier(lambda m: turned(m.robot.q), at_start)


def _check_strokes(plan: AxisPlan) -> None:
    limits = plan.problem.limits
    for name in ("cart_{}_m", "axis_{}_deg"):
        low, high = (getattr(limits, name.format(side)) for side in ("low", "high"))
        if low and high and np.any(np.array(low) >= np.array(high)):
            k = int(np.argmax(np.array(low) >= np.array(high)))
            told = f"its number {k + 1}, {low[k]:g}, is not below {high[k]:g} of {name.format('high')}"
            raise InputError(told, f"limits.{name.format('low')}")
    for which, end, q in (("start", plan.problem.start, plan.start), ("goal", plan.problem.goal, plan.goal)):
        if told := _beyond(plan, q):
            key = "tcp_m" if end.tcp_m is not None else "q_m" if told.startswith(("q1", "q2", "q3")) else "q_deg"
            raise InputError(told, f"{which}.{key}")


def _beyond(plan: AxisPlan, q: Array) -> str:
    """One sentence on an axis outside its stroke; empty where there is none."""
    low, high = plan.strokes
    outside = np.flatnonzero((q < low) | (q > high))
    if not len(outside):
        return ""
    k = int(outside[0])
    side = "low" if q[k] < low[k] else "high"
    value, key = (q[k], f"cart_{side}_m") if k < CARTS else (np.degrees(q[k]), f"axis_{side}_deg")
    bound = getattr(plan.problem.limits, key)[k % CARTS]
    return f"q{k + 1} = {value:g} is {'below' if side == 'low' else 'above'} limits.{key}, {bound:g}"


def _check_ends(plan: AxisPlan) -> None:
    """At both ends the links close and the motors can hold the robot."""
    for which, q in (("start", plan.start), ("goal", plan.goal)):
        _, _, status = plan.poses(q)
        if status != Status.OK:
            raise InputError(f"the links cannot close there: {plan.poses.diagnose(q)}", which)
        tau, status = plan.inverse(q, np.zeros(MOTORS), np.zeros(MOTORS))
        if status != Status.OK:
            raise InputError(f"no motor forces hold the robot there: {Status(int(status)).name.lower()}", which)
        k = int(np.argmax(np.abs(tau) / plan.limits))
        if abs(tau[k]) > plan.limits[k]:
            unit, key = ("N", "force_N") if k < CARTS else ("N.m", "torque_Nm")
            raise InputError(
                f"{plan.limits[k]:g} {unit} is not enough: the weight alone needs {abs(tau[k]):.4g} {unit} of motor "
                f"{k + 1} to stand at {which}",
                f"limits.{key}",
            )
        if plan.course is None and (broken := plan.guard.broken(plan.margins(q))):  # of a path with all of its way
            raise InputError(broken[1], which)


def _check_way(plan: AxisPlan) -> None:
    """The whole path can be followed within strokes and the limits of positions."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    f = plan.following
    _, q, *_, status = found = f(s, *[np.zeros(SAMPLES)] * (len(f.inputs) - 1))
    assert plan.course is not None
    wanted = plan.course.path(s)[0]
    for k in range(SAMPLES):
        shown = f"({', '.join(f'{x:.4g}' for x in wanted[k])}) m, {100 * s[k]:.0f} % of the way"
        if status[k] != Status.OK:
            raise InputError(f"the path cannot be followed with this tool direction at {shown}", "path")
        if told := _beyond(plan, q[k]):
            raise InputError(f"{told}, at {shown}", "path")
    if plan.guard.margins and (broken := plan.guard.broken(found[-2])):
        raise InputError(f"the path {broken[1]}, {100 * s[broken[0]]:.0f} % of the way", "path")


def _earlier(problem: AxisTrajectoryProblem, course: Course | None, context: Context) -> Trajectory | None:
    """An earlier result's motion under the names of the optimisation."""
    run = context.guess()
    if run is None:
        return None
    if course is not None:
        if any(name not in run for name in ("s", "T", "e")):
            raise InputError("--start is a free motion; this problem follows a path")
        s = np.maximum.accumulate(run["s"])
        values = {"s": s, "der(s)": np.gradient(s, run.time)}
        units = {"s": run.unit("s"), "robot.T": run.unit("T"), "robot.e": run.unit("e")}
        return Trajectory(run.time, {**values, "robot.T": run["T"], "robot.e": run["e"]}, units)
    names = {"der(q)": "der(s)", "der(q,2)": "drive", "q": "s"}
    if any(name not in run for name in (*names, "T", "e")):
        raise InputError("--start: its trajectory lacks one of q, der(q), der(q,2), T and e; start from another result")
    values = {new: coordinates(run[old], problem.degrees_of_freedom) for old, new in names.items()}
    units = {"robot.T": run.unit("T"), "robot.e": run.unit("e")}
    return Trajectory(run.time, {**values, "robot.T": run["T"], "robot.e": run["e"]}, units)
