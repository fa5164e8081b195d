"""Checks of a motion problem before the optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from .. import lang as gt
from .._lazy import hint
from ..compiler.causal import compile_causal, flat_of
from ..optimize.path import PathMotion
from ..results import ArgumentError, Status, Trajectory, Work
from ..robots.links import link_names, links_of
from .constraints import Carrier, MotionConstraints, guard_of
from .options import MotionProblem
from .path_parametrization import PathParametrization, along_guideways, link_ends, motion_function
from .search import MotionSearch
from .task import FurtherStart, bare_guess, further_starts, line_guess, progress_of, trapezoid

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

SLOW_M_S = 0.1  # speed of a motion that needs forces against friction and weight only


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """A checked problem with its margins, path and guess."""

    problem: MotionProblem
    guard: MotionConstraints
    path: Path | None
    earlier: Trajectory | None

    @property
    def robot(self) -> gt.Model:
        return self.problem.robot

    @property
    def start(self) -> np.ndarray:
        return self.problem.begin

    @property
    def goal(self) -> np.ndarray:
        return self.problem.end

    @property
    def smooth(self) -> bool:
        """Whether the second derivative of the motion must not jump, at an end or because the jerk is limited."""
        rest = [*self.problem.start.rest, *self.problem.goal.rest]
        return self.problem.limits.tcp_jerk is not None or "acceleration" in rest

    @property
    def restricted(self) -> bool:
        """Whether a derivative of the motion is the control, so that the forces follow from it."""
        return self.problem.order is not None

    @cached_property
    def follower(self) -> PathParametrization:
        assert self.path is not None
        return PathParametrization(self.problem, self.guard, self.path)

    def search(self, work: Work) -> MotionSearch:
        """Return the search from an earlier result, or from the trapezoidal profile along the line or path."""
        if self.path is not None:
            guess = self.follower.guess()
            return MotionSearch(self.problem, work, self.earlier or guess, guess, self.guard, self.path)
        return MotionSearch(
            self.problem, work, self.earlier or self.line, bare_guess(self.start, self.goal), self.guard
        )

    @cached_property
    def line(self) -> Trajectory:
        """The trapezoidal profile along the straight line, with its forces."""
        inverse = motion_function(self.robot, self.guard)
        return line_guess(inverse, self.start, self.goal, self.problem.limits.force)

    def likely_cause(self) -> str:
        """Return the likely reason why a problem was not solved; empty if unknown."""
        limit = self.problem.limits.force
        _, s, _, _ = trapezoid(21)
        step = self.goal - self.start
        T = self.start + s[:, None] * step
        velocity = np.broadcast_to(SLOW_M_S * step / np.linalg.norm(step), T.shape)
        tau, *_, status = motion_function(self.robot, self.guard).along(T, velocity)
        needed = np.abs(tau[status == Status.OK])
        if needed.size and np.max(needed) > limit:
            k = int(np.argmax(np.max(needed, axis=0)))
            return (
                f"; even a slow motion along the straight line needs {np.max(needed):.4g} N from motor {k + 1}, but "
                f"the limit is {limit:g} N"
            )
        return ""

    def further_starts(self) -> list[FurtherStart]:
        """Return the requested number of further starts; none along a path."""
        starts = self.problem.starts
        rng = np.random.default_rng(starts.seed)
        count = starts.count if self.path is None else 0
        return list(islice(further_starts(self.start, self.goal, self.line, rng, starts.bend), count))

    def followed(self, work: Work) -> PathMotion:
        """Compute the exported motion along the path."""
        assert self.problem.path is not None

        return self.follower.within(self.problem.path.intervals, work.iterations("exporting"), work.seconds_left())

    def cross_check(self, intervals: int) -> float:
        """Return the final time [s] along the path by squared speeds, with limits in the middle of intervals."""
        return self.follower.fastest(intervals, bounded="middle").final_time

    def links(self, run: Trajectory) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return both ends of every link along a motion, (n, 3) each [m]."""
        joints, tips, _ = link_ends(self.robot, run["T"], self.guard)
        return [(joints[:, k], tips[:, k]) for k in range(joints.shape[1])]


def plan_of(problem: MotionProblem, earlier: Trajectory | None = None) -> MotionPlan:
    """Check a problem and return its plan; earlier: a motion used as guess. Raises ArgumentError."""
    robot, start, goal = problem.robot, problem.begin, problem.end
    if problem.cost.time == 0.0 and problem.cost.energy == 0.0:
        raise ArgumentError("has zero weights only; give cost.time or cost.energy", "cost")
    _check_robot(robot)
    if np.array_equal(start, goal):
        raise ArgumentError("equals the start; give another goal", "goal.tcp")
    guard = guard_of(problem.limits, links_of(robot), lambda arm, end: _carrier(robot, end, start))
    _check_reach(problem, guard)
    _check_statics(problem, guard)
    path = None
    if problem.path is not None:
        from .paths import path_of  # local import: free motions need no splines

        path = path_of(problem.path, start, goal)
    plan = MotionPlan(problem, guard, path, None if earlier is None else _renamed(earlier, path))
    if path is not None and (problem_on_path := plan.follower.trouble()):
        raise ArgumentError(problem_on_path, "path")
    return plan


def _carrier(robot: gt.Model, end: str, start: np.ndarray) -> Carrier | None:
    """Return the plate if it rotates, that is if the robot has the rotation R as a variable."""
    if end != "plate" or flat_of(robot).groups.get("R", ((), []))[0] != (3, 3):
        return None
    R, status = compile_causal(robot, known="T", targets="R")(start)
    if status != Status.OK:
        raise _out_of_reach(robot, "start.tcp", start)
    return Carrier(lambda model: model.robot.R, R)


def _check_robot(robot: gt.Model) -> None:
    flat = flat_of(robot)
    motors = flat.groups.get("tau", ((), []))[0]
    if motors[1:] == () and motors not in ((), (3,)):
        raise ArgumentError(
            f"has {motors[0]} motors ('tau'), but this study is for robots with 3; use kind axis_trajectory for an F1, "
            "and write a gt.Optimization for a serial arm, see docs/howto/urdf.md",
            "robot",
        )
    for name in ("T", "tau"):
        if flat.groups.get(name, ((), []))[0] != (3,):
            raise ArgumentError(f"must declare '{name}' as a vector of 3; it has {flat.top()}", "robot")


def _check_reach(problem: MotionProblem, guard: MotionConstraints) -> None:
    robot, least = problem.robot, problem.limits.link_along_guideway
    for key, point in (("start.tcp", problem.begin), ("goal.tcp", problem.end)):
        joints, tips, status = link_ends(robot, point[None, :], guard)
        if status[0] != Status.OK:
            raise _out_of_reach(robot, key, point)
        along = along_guideways(robot, tips, joints)[0]
        if np.any(along < least):
            k = int(np.argmin(along))
            links = [name.removesuffix(".rod.a.r") for name in link_names(robot)]
            raise ArgumentError(
                f"the pose ({_place(point)}) m lies at the boundary of the workspace: the component of {links[k]} "
                f"along its guideway is {along[k]:.4g} m, less than limits.link_along_guideway_m = {least:g}",
                key,
            )


def _out_of_reach(robot: gt.Model, key: str, point: np.ndarray) -> ArgumentError:
    names = [name for name in ("q", "tau") if name in flat_of(robot).groups]
    inverse = compile_causal(robot, known="T", targets=names[0])
    reason = inverse.diagnose(*inverse.arguments_along(point))
    return ArgumentError(f"the pose ({_place(point)}) m is out of reach: {reason}", key)


def _place(point: np.ndarray) -> str:
    return ", ".join(f"{x:g}" for x in point)


def _check_statics(problem: MotionProblem, guard: MotionConstraints) -> None:
    """Check that the robot can stand still at both ends within the limits of positions."""
    limit = problem.limits.force
    for key, point in (("start.tcp", problem.begin), ("goal.tcp", problem.end)):
        tau, *_, last, _ = motion_function(problem.robot, guard).along(point)
        k = int(np.argmax(np.abs(tau)))
        if abs(tau[k]) > limit:
            raise ArgumentError(
                f"{limit:g} N is too small: holding the weight at {key} needs {abs(tau[k]):.4g} N from motor {k + 1}",
                "limits.force",
            )
        if guard.margins and (broken := guard.broken(last[None])):
            raise ArgumentError(broken[1], key)


def _renamed(earlier: Trajectory, path: Path | None) -> Trajectory:
    """Return an earlier result's motion under the names of the optimisation."""
    if "T" not in earlier or np.shape(earlier["T"])[1:] != (3,):
        fault = f"has shape {np.shape(earlier['T'])}" if "T" in earlier else "is missing"
        raise ArgumentError(f"its T {fault}; expected three coordinates for each of {len(earlier)} times", "earlier")
    names = {"T": "robot.T", "der(T)": "der(robot.T)", "tau": "robot.tau", "der(T,2)": "der(robot.T,2)"}
    if path is not None:
        return progress_of(earlier)
    values = {new: earlier[old] for old, new in names.items() if old in earlier}
    return Trajectory(earlier.time, values, {new: earlier.unit(old) for old, new in names.items() if old in earlier})
