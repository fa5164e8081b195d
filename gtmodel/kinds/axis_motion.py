"""A motion of the F1 between two positions of its axes as an Optimization, checked, with its guess."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.results import Status, Trajectory
from gtmodel.robots import F1

from .axis_keys import AxisTrajectoryProblem
from .base import Context, InputError
from .motion import GUESS_TIME_S, SHORTEST_TIME_S, dependent

Array = np.ndarray
GUESS_ROWS = 41
MOTORS = 6
CARTS = 3
# of the coordinates s in the axes q1..q6; with five degrees of freedom q5 = -q4
COUPLING = {
    5: np.insert(np.eye(5, dtype=int), 4, [0, 0, 0, -1, 0], axis=0),
    6: np.eye(6, dtype=int),
}
COUPLED = 1e-9  # degrees: typed numbers, so round-off only
ACCELERATION = 10.0  # nominal [m/s2, rad/s2]


@dataclass(frozen=True, eq=False)
class AxisPlan:
    """A checked problem: robot, ends q (6,) [m, rad], and the poses there."""

    problem: AxisTrajectoryProblem
    robot: gt.Model
    start: Array
    goal: Array
    earlier: Trajectory | None

    @property
    def coupling(self) -> Array:
        """(6, n): axes q from the coordinates s."""
        return COUPLING[self.problem.degrees_of_freedom]

    @property
    def limits(self) -> Array:
        """Largest motor forces [N] and torques [N.m] (6,)."""
        limits = self.problem.limits
        return np.repeat([limits.force_N, limits.torque_Nm], CARTS)

    @cached_property
    def poses(self) -> CausalFunction:
        """q -> T, e by Newton from the home pose."""
        return compile_causal(self.robot, known="q", targets=["T", "e"])

    @cached_property
    def inverse(self) -> CausalFunction:
        """q and its two derivatives -> tau."""
        return compile_causal(self.robot, known="q", targets="tau")

    @cached_property
    def strokes(self) -> tuple[Array, Array]:
        """Least and largest q (6,) [m, rad]; infinite where there is none."""
        limits = self.problem.limits
        least, most = [-np.inf] * CARTS, [np.inf] * CARTS
        low = np.concatenate([limits.cart_low_m or least, np.radians(limits.axis_low_deg or least)])
        high = np.concatenate([limits.cart_high_m or most, np.radians(limits.axis_high_deg or most)])
        return low, high

    def coordinates(self, q: Array) -> Array:
        """s of axes q (..., 6) that keep the coupling."""
        return q @ np.linalg.pinv(self.coupling).T

    def optimization(self) -> gt.Optimization:
        """The motion: states s and their velocities, one control `drive` per coordinate, its acceleration.

        The robot's axes are q = coupling s, its six motor forces follow and keep their limits.
        """
        coupling, cost = self.coupling, self.problem.cost
        begin, end = self.coordinates(self.start), self.coordinates(self.goal)
        n = len(begin)
        low, high = self.strokes
        bounded = [k for k in range(MOTORS) if np.isfinite(low[k]) or np.isfinite(high[k])]

        class AxisMotion(gt.Optimization):
            robot: Any = gt.part(dependent(self.robot, "tau"))
            final_time = gt.free(GUESS_TIME_S, min=SHORTEST_TIME_S, unit="s")
            limit = gt.parameter(self.limits, description="forces of the carts [N], torques of the rotary axes [N.m]")
            from_s = gt.parameter(begin)
            to_s = gt.parameter(end)
            s = gt.variable(n, start=begin, prefer=3, description="carts [m], then angles [rad]")
            drive = gt.input(n, nominal=ACCELERATION, description="their accelerations")

            def equations(self) -> Any:
                for k, row in enumerate(coupling):
                    (i,) = np.flatnonzero(row)
                    yield self.robot.q[k] == int(row[i]) * self.s[int(i)]
                yield self.drive == gt.der(self.s, 2)

            def objective(self) -> Any:
                found = cost.time * self.final_time
                if cost.energy:
                    shares = [self.robot.tau[k] / self.limit[k] for k in range(MOTORS)]
                    found = found + cost.energy * gt.integral(sum(x**2 for x in shares))
                return found

            def constraints(self) -> Any:
                yield gt.between(-self.limit, self.robot.tau, self.limit)
                for k in bounded:
                    if np.isfinite(low[k]):
                        yield self.robot.q[k] >= float(low[k])
                    if np.isfinite(high[k]):
                        yield self.robot.q[k] <= float(high[k])
                yield self.s.at(self.start_time) == self.from_s
                yield self.s.at(self.final_time) == self.to_s
                yield gt.der(self.s).at(self.start_time) == 0
                yield gt.der(self.s).at(self.final_time) == 0

        return AxisMotion()

    def guess(self) -> Trajectory:
        """An earlier result, or all axes on their straight way in 1 s, a quintic from rest to rest, poses by Newton."""
        if self.earlier is not None:
            return self.earlier
        r = np.linspace(0.0, 1.0, GUESS_ROWS)[:, None]
        q = self.start + (10 * r**3 - 15 * r**4 + 6 * r**5) * (self.goal - self.start)
        v = (30 * r**2 - 60 * r**3 + 30 * r**4) / GUESS_TIME_S * (self.goal - self.start)
        a = (60 * r - 180 * r**2 + 120 * r**3) / GUESS_TIME_S**2 * (self.goal - self.start)
        T, e, status = self.poses(q)
        if np.any(status != Status.OK):
            k = int(np.flatnonzero(status != Status.OK)[0])
            raise InputError(
                f"on the straight way of the axes, {100 * r[k, 0]:.0f} % from the start, the plate cannot be followed: "
                f"{self.poses.diagnose(q[k])}; give a nearer goal",
                "goal",
            )
        s, ds, dds = (self.coordinates(x) for x in (q, v, a))
        values = {"s": s, "der(s)": ds, "drive": dds, "robot.T": T, "robot.e": e}
        return Trajectory(GUESS_TIME_S * r[:, 0], values, {})


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
    ends = [np.concatenate([end.q_m, np.radians(end.q_deg)]) for end in (problem.start, problem.goal)]
    plan = AxisPlan(problem, robot, ends[0], ends[1], None)
    if np.array_equal(plan.start, plan.goal):
        raise InputError("the goal equals the start; give another goal", "goal")
    _check_strokes(plan)
    _check_ends(plan)
    return AxisPlan(problem, robot, ends[0], ends[1], _earlier(plan, context))


def _check_strokes(plan: AxisPlan) -> None:
    limits = plan.problem.limits
    for name in ("cart_{}_m", "axis_{}_deg"):
        low, high = (getattr(limits, name.format(side)) for side in ("low", "high"))
        if low and high and np.any(np.array(low) >= np.array(high)):
            k = int(np.argmax(np.array(low) >= np.array(high)))
            told = f"its number {k + 1}, {low[k]:g}, is not below {high[k]:g} of {name.format('high')}"
            raise InputError(told, f"limits.{name.format('low')}")
    low, high = plan.strokes
    for which, end, q in (("start", plan.problem.start, plan.start), ("goal", plan.problem.goal, plan.goal)):
        q4, q5, _ = end.q_deg
        if plan.problem.degrees_of_freedom == 5 and abs(q4 + q5) > COUPLED:
            raise InputError(
                f"q5 = {q5:g} is not -q4 = {-q4:g}; give q5 = -q4, or set degrees_of_freedom = 6", f"{which}.q_deg"
            )
        outside = np.flatnonzero((q < low) | (q > high))
        if len(outside):
            k = int(outside[0])
            cart = k < CARTS
            given = end.q_m[k] if cart else end.q_deg[k - CARTS]
            side = "low" if q[k] < low[k] else "high"
            key = f"cart_{side}_m" if cart else f"axis_{side}_deg"
            bound = getattr(limits, key)[k % CARTS]
            told = f"q{k + 1} = {given:g} is {'below' if side == 'low' else 'above'} limits.{key}, {bound:g}"
            raise InputError(told, f"{which}.{'q_m' if cart else 'q_deg'}")


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


def _earlier(plan: AxisPlan, context: Context) -> Trajectory | None:
    """An earlier result's motion under the names of the optimisation."""
    run = context.guess()
    if run is None:
        return None
    names = {"der(q)": "der(s)", "der(q,2)": "drive", "q": "s"}
    if any(name not in run for name in (*names, "T", "e")):
        raise InputError("--start: its trajectory lacks one of q, der(q), der(q,2), T and e; start from another result")
    values = {new: plan.coordinates(run[old]) for old, new in names.items()}
    return Trajectory(run.time, {**values, "robot.T": run["T"], "robot.e": run["e"]}, {})
