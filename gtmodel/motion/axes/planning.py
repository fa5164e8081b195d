"""Checks of an axis trajectory problem before the optimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...compiler.causal import CausalFunction, compile_causal
from ...geometry.quaternions import quaternion_matrix, quaternion_of
from ...geometry.rotations import rotation_about
from ...results import ArgumentError, Status, Trajectory
from ...robots import F1
from ..constraints import NO_GUARD, Carrier, MotionConstraints, check_strokes, guard_of
from ..paths import path_of
from ..task import progress_of
from .options import AxisEnd
from .plan import (
    CARTS,
    COUPLING,
    FOLLOWED,
    MOTORS,
    AxisPlan,
    AxisProblem,
    PathOrientation,
    coordinates,
    dynamics_of,
    following,
    turning,
)

Array = np.ndarray
COUPLED = 1e-9  # degrees: rounding of input values
SAME_AXES = 1e-6  # [m, rad] Newton's rounding error, amplified near a singularity
SAMPLES = 201
X, Y = np.eye(3)[0], np.eye(3)[1]
LINKS = [("link", k) for k in range(6)]


@dataclass(frozen=True)
class _Place:
    """An end of a path: tool centre point [m], the plate's R (3, 3), and the tool direction, if given."""

    T: Array
    R: Array
    direction: Array | None


def plan_of(problem: AxisProblem) -> AxisPlan:
    """Check a problem and return its plan. Raises ArgumentError.

    >>> end = gt.motion.AxisEnd([0.72, 0.26, 0.21], [0.1, 0.0, 0.0])
    >>> problem = gt.motion.axes.AxisProblem(
    ...     robot=gt.robots.catalogue.make("f1"), start=end, goal=end,
    ...     limits=gt.motion.AxisLimits(force=1000.0, torque=40.0),
    ... )
    >>> gt.motion.axes.plan_of(problem)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: start.axes: q5 = 0 is not -q4 = -5.72958 degrees; ...
    """
    robot = problem.robot
    if not isinstance(robot, F1):
        raise ArgumentError(
            f"is a {type(robot).__name__}, but axis_trajectory needs an F1; use kind trajectory for three-link and "
            "six-link robots, and write a gt.Optimization for a serial arm, see docs/howto/urdf.md",
            "robot",
        )
    if problem.degrees_of_freedom not in COUPLING:
        raise ArgumentError(f"expected 5 or 6; found {problem.degrees_of_freedom}", "degrees_of_freedom")
    if problem.cost.time == 0.0 and problem.cost.energy == 0.0:
        raise ArgumentError("has zero weights only; give cost.time or cost.energy", "cost")
    for which, end in problem.ends:
        _check_end(problem, end, which)
    start, goal, course = *(_axes(end) for _, end in problem.ends), None
    guard, along = None, None
    if problem.path is not None:
        course = _course(problem, robot)
        # compile one function for the path, unless its limits depend on the ends
        guard = NO_GUARD if problem.limits.joint_cones else _guard(problem, robot, start)
        along = following(course, robot, guard)
        start, goal = _ends_of(problem, along, start, goal)
    if np.array_equal(start, goal):
        raise ArgumentError("equals the start; give another goal", "goal")
    if guard is None or problem.limits.joint_cones:
        guard, along = _guard(problem, robot, start), None
    plan = AxisPlan(problem, robot, start, goal, guard, course, _earlier(problem), along)
    _check_strokes(plan)
    _check_ends(plan)
    if course is not None:
        _check_way(plan)
    return plan


def _axes(end: AxisEnd) -> Array:
    """Return the given axes (6,) [m, rad]; NaN if there are none."""
    if end.carts is None or end.axes is None:
        return np.full(MOTORS, np.nan)
    return np.concatenate([end.carts, end.axes])


def _check_end(problem: AxisProblem, end: AxisEnd, which: str) -> None:
    """Check that an end has either its axes or, on a path, its tool centre point."""
    axis_names = [name for name in ("carts", "axes") if getattr(end, name) is not None]
    if problem.path is None:
        for name in ("tcp", "tool"):
            if getattr(end, name) is not None:
                raise ArgumentError("needs a path; give carts and axes for a free motion", f"{which}.{name}")
    elif end.tcp is not None:
        if axis_names:
            raise ArgumentError(
                "is redundant with the tool centre point, which determines the axes; remove one of them",
                f"{which}.{axis_names[0]}",
            )
        if end.tool is not None and problem.degrees_of_freedom == 6:
            raise ArgumentError(
                "leaves the rotation about the tool undetermined with six degrees of freedom; give carts and axes",
                f"{which}.tool",
            )
        if end.tool is not None:
            _unit(np.array(end.tool), f"{which}.tool")
        return
    for name in ("carts", "axes"):
        if name not in axis_names:
            instead = "" if problem.path is None else "; give carts and rotary axes, or the tool centre point"
            raise ArgumentError(f"is missing{instead}", f"{which}.{name}")
    if end.tool is not None:
        raise ArgumentError("is redundant with the axes, which determine it; remove it", f"{which}.tool")
    q4, q5, _ = np.degrees(_axes(end)[CARTS:])
    if problem.degrees_of_freedom == 5 and abs(q4 + q5) > COUPLED:
        raise ArgumentError(
            f"q5 = {q5:g} is not -q4 = {-q4:g} degrees; give q5 = -q4, or degrees_of_freedom 6", f"{which}.axes"
        )


def _course(problem: AxisProblem, robot: F1) -> PathOrientation:
    """Return the path with the plate's orientation along it."""
    shape, tool_options = problem.path, problem.tool
    assert shape is not None
    tool = _unit(np.array(tool_options.axis), "tool.axis")
    start, goal = (_place(robot, end, which) for which, end in problem.ends)
    if problem.degrees_of_freedom == 6:
        if tool_options.through:
            raise ArgumentError(
                "leaves the plate's rotation undetermined with six degrees of freedom; remove it", "tool.through"
            )
        R = [place.R if end.tcp is None else opposite.R for place, end, opposite in
             ((start, problem.start, goal), (goal, problem.goal, start))]  # fmt: skip
        e = quaternion_of(np.array(R))
        return PathOrientation(path_of(shape, start.T, goal.T), turning(np.array([0.0, 1.0]), e, "goal"), None)
    ends = [place.direction if end.tcp is not None else place.R @ tool for place, end in
            ((start, problem.start), (goal, problem.goal))]  # fmt: skip
    first = next((d for d in ends if d is not None), start.R @ tool)
    first, last = (first if d is None else d for d in ends)
    fractions = np.array([0.0, *(t.at for t in tool_options.through), 1.0])
    if np.any(np.diff(fractions) <= 0):
        raise ArgumentError("has fractions that do not increase along the path", "tool.through")
    between = [_unit(np.array(t.direction), f"tool.through[{n}].direction") for n, t in enumerate(tool_options.through)]
    course = turning(fractions, np.array([first, *between, last]), "tool.through" if tool_options.through else "goal")
    return PathOrientation(path_of(shape, start.T, goal.T), course, tool)


def _place(robot: F1, end: AxisEnd, which: str) -> _Place:
    if end.tcp is not None:
        direction = None if end.tool is None else _unit(np.array(end.tool), f"{which}.tool")
        return _Place(np.array(end.tcp), quaternion_matrix(np.asarray(robot.home_e, float)), direction)
    q = _axes(end)
    _, T, _, R, status = dynamics_of(robot).along(q)
    if status != Status.OK:  # solve for the pose alone
        f = compile_causal(robot, known="q", targets=["T", "R"])
        T, R, status = f(q)
        if status != Status.OK:
            raise ArgumentError(f"the closure equations have no solution there: {f.diagnose(q)}", which)
    return _Place(T, R, None)


def _unit(v: Array, argument: str) -> Array:
    if not np.any(v):
        raise ArgumentError("is zero; expected a direction", argument)
    return v / np.linalg.norm(v)


def _ends_of(problem: AxisProblem, along: CausalFunction, start: Array, goal: Array) -> tuple[Array, Array]:
    """Return the axes at both ends of the path; the problem's, if given."""
    ends = []
    for which, s, prescribed in (("start", 0.0, start), ("goal", 1.0, goal)):
        *values, status = along.along(s)
        q = values[FOLLOWED.index("robot.q")]
        argument = which if np.all(np.isfinite(prescribed)) else f"{which}.tcp"
        if status != Status.OK:
            raise ArgumentError(f"the pose is out of reach: {along.diagnose(*along.arguments_along(s))}", argument)
        if np.max(np.abs(q - prescribed), initial=0.0, where=np.isfinite(prescribed)) > SAME_AXES:
            axes_text = ", ".join(f"{x:.4g}" for x in (*q[:CARTS], *np.degrees(q[CARTS:])))
            raise ArgumentError(
                f"the path reaches this tool centre point and tool direction with other axes, ({axes_text}) in m and "
                "degrees; give these, or the tool centre point",
                argument,
            )
        ends.append(np.where(np.isfinite(prescribed), prescribed, q))
    return ends[0], ends[1]


def _guard(problem: AxisProblem, robot: F1, start: Array) -> MotionConstraints:
    """Return the margins of the further limits; strokes of carts are bounds of the axes."""
    limits = replace(problem.limits, cart_low=None, cart_high=None)
    return guard_of(limits, LINKS, lambda arm, end: _carrier(robot, start, arm, end))


def _carrier(robot: F1, start: Array, arm: int, end: str) -> Carrier | None:
    """Return the body that rotates a ball joint: the plate, or the joint plate of arm 2 or 3.

    Quaternions are not normalised, since they scale both rotations alike.
    """
    if end == "plate":
        *_, R, _ = dynamics_of(robot).along(start)
        return Carrier(lambda m: m.robot.R, R)
    if arm == 0:
        return None
    u2, u3, inner = (quaternion_matrix(np.asarray(u, float)) for u in (robot.u1_2, robot.u1_3, robot.u2_3))

    def rotation(q: Any) -> Any:
        if arm < 3:
            return u2 @ rotation_about(Y, q[3])
        return u3 @ rotation_about(Y, q[4]) @ inner @ rotation_about(X, q[5])

    return Carrier(lambda m: rotation(m.robot.q), np.array(rotation(start)))


def _check_strokes(plan: AxisPlan) -> None:
    check_strokes(plan.problem.limits, "cart", "axis")
    for (which, end), q in zip(plan.problem.ends, (plan.start, plan.goal), strict=True):
        k, fault = _beyond(plan, q)
        if fault:
            raise ArgumentError(fault, f"{which}.{'tcp' if end.tcp is not None else 'carts' if k < CARTS else 'axes'}")


def _beyond(plan: AxisPlan, q: Array) -> tuple[int, str]:
    """Return an axis outside its stroke and a sentence on it; -1 and an empty sentence if there is none."""
    low, high = plan.strokes
    outside = np.flatnonzero((q < low) | (q > high))
    if not len(outside):
        return -1, ""
    k = int(outside[0])
    side, bound = ("low", low[k]) if q[k] < low[k] else ("high", high[k])
    body, unit, scale = ("cart", "m", 1.0) if k < CARTS else ("axis", "deg", np.degrees(1.0))
    value, bound = f"{scale * q[k]:g} {unit}", f"{scale * bound:g} {unit}"
    return k, f"q{k + 1} = {value} is {'below' if side == 'low' else 'above'} limits.{body}_{side}, {bound}"


def _check_ends(plan: AxisPlan) -> None:
    """Check that the closure equations can be solved at both ends and the motors can hold the robot there."""
    for which, q in (("start", plan.start), ("goal", plan.goal)):
        _, _, status = plan.poses(q)
        if status != Status.OK:
            raise ArgumentError(f"the closure equations have no solution there: {plan.placing.diagnose(q)}", which)
        tau, status = plan.inverse(q, np.zeros(MOTORS), np.zeros(MOTORS))
        if status != Status.OK:
            raise ArgumentError(f"the holding forces cannot be computed: {Status(int(status)).name.lower()}", which)
        k = int(np.argmax(np.abs(tau) / plan.motors))
        if abs(tau[k]) > plan.motors[k]:
            unit, limit = ("N", "force") if k < CARTS else ("N.m", "torque")
            raise ArgumentError(
                f"{plan.motors[k]:g} {unit} is too small: holding the weight at {which} needs {abs(tau[k]):.4g} "
                f"{unit} from motor {k + 1}",
                f"limits.{limit}",
            )
        if plan.course is None and (broken := plan.guard.broken(plan.margins(q))):  # paths: see _check_way
            raise ArgumentError(broken[1], which)


def _check_way(plan: AxisPlan) -> None:
    """Check that the whole path can be followed within strokes and the limits of positions."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    _, q, *_, status = motion = plan.following.along(s)
    assert plan.course is not None
    points = plan.course.path(s)[0]
    for k in range(SAMPLES):
        place = f"({', '.join(f'{x:.4g}' for x in points[k])}) m, {100 * s[k]:.0f} % of the way"
        if status[k] != Status.OK:
            raise ArgumentError(f"cannot be followed with this tool direction at {place}", "path")
        _, fault = _beyond(plan, q[k])
        if fault:
            raise ArgumentError(f"{fault}, at {place}", "path")
    if plan.guard.margins and (broken := plan.guard.broken(motion[-2])):
        raise ArgumentError(f"{broken[1]}, {100 * s[broken[0]]:.0f} % of the way", "path")


def _earlier(problem: AxisProblem) -> Trajectory | None:
    """Return an earlier result's motion under the names of the optimisation."""
    run = problem.earlier
    if run is None:
        return None
    names = {} if problem.path is not None else {"der(q)": "der(s)", "der(q,2)": "drive", "q": "s"}
    if any(name not in run for name in (*names, "T", "e")):
        message = "lacks one of q, der(q), der(q,2), T and e in its trajectory; use another result"
        raise ArgumentError(message, "earlier")
    values = {new: coordinates(run[old], problem.degrees_of_freedom) for old, new in names.items()}
    guess = Trajectory(run.time, values, {}) if values else progress_of(run)
    pose = {"robot.T": "T", "robot.e": "e"}
    return guess.with_values({new: run[old] for new, old in pose.items()}, {n: run.unit(o) for n, o in pose.items()})
