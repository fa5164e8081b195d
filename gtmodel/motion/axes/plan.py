"""A motion of the F1 as an Optimization: free between two positions of its axes, or along a path with a prescribed tool
direction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy

from ... import lang as gt
from ...compiler.causal import CausalFunction, compile_causal
from ...lang import Model
from ...lang.model import dependent
from ...optimize.path import PathMotion, solve_path
from ...results import ArgumentError, Status, Trajectory
from ..constraints import MotionConstraints
from ..options import AxisLimits, Shape
from ..path_parametrization import task_along
from ..paths import Path
from ..task import GUESS_TIME_S, SHORTEST_TIME_S
from .options import AxisCost, AxisEnd, AxisMesh, AxisSolver, ToolCourse


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisProblem:
    """A motion of the F1 from rest to rest, free between two positions of its axes or along a path.

    start, goal: ends. limits: see `AxisLimits`. path: the path to follow; tool: the tool's orientation along it.
    degrees_of_freedom: 5 keeps q4 = -q5 throughout, 6 leaves all axes free.
    cost, mesh, solver: objective and options of the search. earlier: the motion of an earlier result, used as guess.
    """

    robot: Model
    start: AxisEnd
    goal: AxisEnd
    limits: AxisLimits
    path: Shape | None = None
    tool: ToolCourse = field(default_factory=ToolCourse)
    degrees_of_freedom: Literal[5, 6] = 5
    cost: AxisCost = field(default_factory=AxisCost)
    mesh: AxisMesh = field(default_factory=AxisMesh)
    solver: AxisSolver = field(default_factory=AxisSolver)
    earlier: Trajectory | None = None
    title: str = ""

    @property
    def ends(self) -> list[tuple[str, AxisEnd]]:
        """Start and goal with their names."""
        return [("start", self.start), ("goal", self.goal)]


Array = np.ndarray
WIDEST_DEG = 100.0  # largest angle between consecutive directions: their chord must stay away from zero


@dataclass(frozen=True, eq=False)
class PathOrientation:
    """A path and the orientation of the plate along it.

    turning: s -> tool direction (3,) in the robot's frame for five degrees of freedom, or the plate's quaternion (4,)
    for six; of any nonzero length.
    tool: the tool's direction in plate coordinates (3,); None for six degrees of freedom.
    """

    path: Path
    turning: scipy.interpolate.PPoly
    tool: Array | None

    def equations(self, robot: Any, s: Any, metre: Any) -> Iterator[Any]:
        """Yield the six equations that determine the axes of an F1 from the path coordinate s."""
        yield robot.T == self.path.expression(s, metre)
        target = gt.piecewise(s, self.turning.x, self.turning.c)
        if self.tool is None:
            w, x = target[0], gt.vector([target[k] for k in (1, 2, 3)])
            vector = gt.vector([robot.e[k] for k in (1, 2, 3)])
            yield w * vector - robot.e[0] * x - gt.cross(x, vector) == np.zeros(3)  # of conj(target) e
            return
        normal = gt.cross(target, self._reference_axis)
        direction = robot.R @ self.tool
        yield gt.dot(direction, normal) == 0.0
        yield gt.dot(direction, gt.cross(target, normal)) == 0.0
        yield robot.q[4] == -robot.q[3]

    @property
    def _reference_axis(self) -> Array:
        """The coordinate axis with the largest angle to the tool direction along the path."""
        directions = self.turning(np.linspace(0.0, 1.0, 101))
        directions = directions / np.linalg.norm(directions, axis=1)[:, None]
        return np.eye(3)[int(np.argmin(np.max(np.abs(directions), axis=0)))]

    def function(self, robot: gt.Model, guard: MotionConstraints, *targets: str) -> CausalFunction:
        """Return (s and its derivatives as needed) -> targets, names of `robot` or "margin"."""
        course = self

        def equations(model: Any) -> Iterator[Any]:
            yield from guard.equations(model)
            yield from course.equations(model.robot, model.s, model.metre)

        declared = {**guard.declarations(robot), "s": gt.variable(unit="1", start=0.0), "equations": equations}
        model = type("Restricted", (gt.Model,), declared)()
        return compile_causal(model, known="s", targets=targets)


def turning(at: Array, through: Array, argument: str) -> scipy.interpolate.PPoly:
    """Return a smooth curve through directions or quaternions (n, d) at fractions (n,) of the path.

    It is constant if all are equal. Raises ArgumentError about `argument` if consecutive directions are too far apart.

    >>> course = gt.motion.axes.turning(np.array([0.0, 1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), "goal")
    >>> course(0.5)
    array([0.5, 0.5, 0. ])
    """
    through = through / np.linalg.norm(through, axis=1)[:, None]
    if through.shape[1] == 4:  # e and -e are the same orientation: choose the closer sign
        for k in range(1, len(through)):
            through[k] *= 1.0 if through[k] @ through[k - 1] >= 0 else -1.0
    angles = np.degrees(np.arccos(np.clip(np.sum(through[1:] * through[:-1], axis=1), -1.0, 1.0)))
    if np.any(angles > WIDEST_DEG):
        k = int(np.argmax(angles))
        raise ArgumentError(
            f"the tool turns by {angles[k]:.4g} degrees between {100 * at[k]:.0f} % and {100 * at[k + 1]:.0f} % of the "
            f"path, more than {WIDEST_DEG:g} degrees; declare a direction in between",
            argument,
        )
    if np.all(np.ptp(through, axis=0) < 1e-12):
        return scipy.interpolate.PPoly(through[:1][None], np.array([0.0, 1.0]))
    curve = scipy.interpolate.CubicSpline(at, through, bc_type="natural")
    return scipy.interpolate.PPoly(curve.c, curve.x)


GUESS_ROWS = 41
SLOWER = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0)  # guesses of the time, relative to the shortest
MOTORS = 6
CARTS = 3
# matrices of q = COUPLING s; with five degrees of freedom q5 = -q4
COUPLING = {
    5: np.insert(np.eye(5, dtype=int), 4, [0, 0, 0, -1, 0], axis=0),
    6: np.eye(6, dtype=int),
}
FOLLOWED = ("robot.tau", "robot.q", "der(robot.q)", "der(robot.q,2)", "robot.T", "robot.e")
ACCELERATION = 10.0  # nominal [m/s2, rad/s2]


def coordinates(q: Array, degrees_of_freedom: int) -> Array:
    """Return the coordinates s of axes q (..., 6) that satisfy the coupling."""
    return q @ np.linalg.pinv(COUPLING[degrees_of_freedom]).T


def following(course: PathOrientation, robot: gt.Model, guard: MotionConstraints) -> CausalFunction:
    """Return (s and its derivatives) -> FOLLOWED and, if there are any, the guard's margins."""
    return course.function(robot, guard, *FOLLOWED, *(["margin"] if guard.margins else []))


def dynamics_of(robot: gt.Model) -> CausalFunction:
    """Return (q and its two derivatives) -> tau, T, e, R."""
    return compile_causal(robot, known="q", targets=["tau", "T", "e", "R"])


@dataclass(frozen=True, eq=False)
class AxisPlan:
    """A checked problem: robot, ends q (6,) [m, rad], further margins, and the path with its orientation, if any."""

    problem: AxisProblem
    robot: gt.Model
    start: Array
    goal: Array
    guard: MotionConstraints
    course: PathOrientation | None
    earlier: Trajectory | None
    along: CausalFunction | None = None  # `following`, if already compiled for the ends

    @property
    def coupling(self) -> Array:
        """Matrix (6, n) from the coordinates s of a free motion to the axes q."""
        return COUPLING[self.problem.degrees_of_freedom]

    @property
    def order(self) -> int:
        """Order of the derivative of the coordinates that is the control."""
        return 2 if self.problem.limits.tcp_jerk is None else 3

    @property
    def motors(self) -> Array:
        """Largest motor forces [N] and torques [N.m] (6,)."""
        limits = self.problem.limits
        return np.repeat([limits.force, limits.torque], CARTS)

    @cached_property
    def placing(self) -> CausalFunction:
        """q -> T, e by Newton's method from the home pose, without forces; used for diagnosis."""
        return compile_causal(self.robot, known="q", targets=["T", "e"])

    def poses(self, q: Array) -> tuple[Array, Array, Any]:
        """Return T, e and the status at axes q (6,) or (n, 6), by Newton's method from the home pose."""
        _, T, e, _, status = dynamics_of(self.robot).along(q)
        return (T, e, status) if np.all(status == Status.OK) else self.placing(q)

    def inverse(self, q: Array, velocity: Array, acceleration: Array) -> tuple[Array, Any]:
        """Return tau and the status for axes and their two derivatives."""
        tau, *_, status = dynamics_of(self.robot).along(q, velocity, acceleration)
        return tau, status

    def margins(self, q: Array) -> Array:
        """Return the further margins (1, k) at rest at axes q (6,)."""
        if not self.guard.margins:
            return np.zeros((1, 0))
        f = compile_causal(self.guard.model(self.robot), known="robot.q", targets="margin")
        return f.along(q)[0][None]

    @cached_property
    def following(self) -> CausalFunction:
        """(s and its derivatives) -> FOLLOWED and, if there are any, the margins."""
        assert self.course is not None
        return self.along or following(self.course, self.robot, self.guard)

    def held(self, run: Trajectory) -> dict[str, Array]:
        """Return axes and their two derivatives along the path at the rows of a motion of s; NaN where unreachable."""
        orders = len(self.following.inputs)
        _, *rates = self.following.along(*(run[name] for name in ("s", "der(s)", "der(s,2)", "drive")[:orders]))
        return dict(zip(("q", "der(q)", "der(q,2)"), rates, strict=False))

    @cached_property
    def strokes(self) -> tuple[Array, Array]:
        """Smallest and largest q (6,) [m, rad]; infinite if unlimited."""
        limits = self.problem.limits

        def of_all(carts: list[float] | None, axes: list[float] | None, free: float) -> Array:
            return np.concatenate([[free] * CARTS if values is None else values for values in (carts, axes)])

        return of_all(limits.cart_low, limits.axis_low, -np.inf), of_all(limits.cart_high, limits.axis_high, np.inf)

    @cached_property
    def optimization(self) -> gt.Optimization:
        """The motion with states s and their velocities, and one control `drive` per coordinate: its second derivative,
        or its third if the jerk is limited.

        In a free motion s are the independent axes, q = coupling s. Along a path the model is restricted, and s is the
        path coordinate (Dressler 2012, section 3.5). The six motor forces are dependent variables within their limits.
        """
        coupling, cost, course, guard, order = self.coupling, self.problem.cost, self.course, self.guard, self.order
        degrees_of_freedom = self.problem.degrees_of_freedom
        begin, end = coordinates(self.start, degrees_of_freedom), coordinates(self.goal, degrees_of_freedom)
        low, high = self.strokes
        # strokes along a path are checked beforehand
        bounded = [k for k in range(MOTORS) if course is None and (np.isfinite(low[k]) or np.isfinite(high[k]))]

        class AxisMotion(gt.Optimization):
            robot: Any
            metre: Any
            s: Any
            drive: Any
            final_time = gt.free(GUESS_TIME_S, min=SHORTEST_TIME_S, unit="s")
            limit = gt.parameter(self.motors, description="forces of the carts [N], torques of the rotary axes [N.m]")
            from_s = gt.parameter(begin if course is None else 0.0)
            to_s = gt.parameter(end if course is None else 1.0)

            def equations(self) -> Any:
                yield from guard.equations(self)
                if course is not None:
                    yield from course.equations(self.robot, self.s, self.metre)
                else:
                    for k, row in enumerate(coupling):
                        (i,) = np.flatnonzero(row)
                        yield self.robot.q[k] == int(row[i]) * self.s[int(i)]
                yield self.drive == gt.der(self.s, order)

            def objective(self) -> Any:
                total = cost.time * self.final_time
                if cost.energy:
                    shares = [self.robot.tau[k] / self.limit[k] for k in range(MOTORS)]
                    total = total + cost.energy * gt.integral(sum(x**2 for x in shares))
                return total

            def constraints(self) -> Any:
                yield gt.between(-self.limit, self.robot.tau, self.limit)
                for k in bounded:
                    if np.isfinite(low[k]):
                        yield self.robot.q[k] >= float(low[k])
                    if np.isfinite(high[k]):
                        yield self.robot.q[k] <= float(high[k])
                if course is not None:
                    yield gt.der(self.s) >= 0
                yield self.s.at(self.start_time) == self.from_s
                yield self.s.at(self.final_time) == self.to_s
                yield gt.der(self.s).at(self.start_time) == 0
                yield gt.der(self.s).at(self.final_time) == 0

        declared = guard.declarations(dependent(self.robot, "tau"), bounded=True)
        if course is not None:
            declared["s"] = gt.variable(unit="1", min=0.0, max=1.0, prefer=3, description="path coordinate")
            declared["drive"] = gt.input(unit=f"1/s{order}", nominal=ACCELERATION, description="its derivative")
        else:
            n = len(begin)
            declared["s"] = gt.variable(n, start=begin, prefer=3, description="carts [m], then angles [rad]")
            declared["drive"] = gt.input(n, nominal=ACCELERATION, description="their derivatives")
        return type("AxisMotion", (AxisMotion,), declared)()

    def guess(self) -> Trajectory:
        """Return an earlier result, or a quintic from rest to rest along the path or with all axes synchronised.

        It takes 1 s; along a path it takes longer if the further limits require that.
        """
        if self.earlier is not None:
            return self.earlier
        r = np.linspace(0.0, 1.0, GUESS_ROWS)[:, None]
        shape = (10 * r**3 - 15 * r**4 + 6 * r**5, 30 * r**2 - 60 * r**3 + 30 * r**4,
                 60 * r - 180 * r**2 + 120 * r**3, 60 - 360 * r + 360 * r**2)  # fmt: skip
        duration = GUESS_TIME_S * next((f for f in SLOWER if self._within_limits(shape, f * GUESS_TIME_S)), SLOWER[-1])
        profile = [x / duration**k for k, x in enumerate(shape)]
        if self.course is not None:
            s = [x[:, 0] for x in profile]
            _, _, _, _, T, e, *_ = self.following.along(*s)
        else:
            q = self.start + profile[0] * (self.goal - self.start)
            T, e, status = self.poses(q)
            if np.any(status != Status.OK):
                k = int(np.flatnonzero(status != Status.OK)[0])
                raise ArgumentError(
                    f"the plate's pose cannot be computed at {100 * r[k, 0]:.0f} % of the synchronised motion of the "
                    f"axes: {self.placing.diagnose(q[k])}; give a closer goal",
                    "goal",
                )
            degrees_of_freedom = self.problem.degrees_of_freedom
            s = [coordinates(x, degrees_of_freedom) for x in (q, *(p * (self.goal - self.start) for p in profile[1:]))]
        values = {"s": s[0], "der(s)": s[1], "drive": s[self.order], "robot.T": T, "robot.e": e}
        if self.order == 3:
            values["der(s,2)"] = s[2]
        return Trajectory(duration * r[:, 0], values, {})

    def _within_limits(self, shape: Sequence[Array], duration: float) -> bool:
        """Return whether that motion along the path satisfies the further limits; True for a free motion."""
        if self.course is None or not self.guard.margins:
            return True
        motion = (x[:, 0] / duration**k for k, x in enumerate(shape))
        return bool(np.all(self.following.along(*motion)[-2] >= 0))

    def by_squared_speeds(self, intervals: int) -> PathMotion:
        """Return the motion along the path from squared speeds, with limits in the middle of intervals and no jerk
        limit."""
        cost = self.problem.cost
        curve = lambda s: (s[:, None], np.ones((len(s), 1)), np.zeros((len(s), 1)))  # noqa: E731  # s itself
        squares = self.motors**-2.0
        task = task_along(
            self.following, curve, len(FOLLOWED), self.motors, squares, time=cost.time, energy=cost.energy
        )
        return solve_path(task, intervals)
