"""Along a path: the functions of its coordinate that the fast engine needs, and its motion as a trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .._lazy import hint
from ..compiler.causal import compile_causal
from ..lang import Model
from ..optimize.path import PathMotion, solve_path
from ..optimize.watch import Progress
from ..results import Status, Trajectory
from .constraints import MotionConstraints
from .followed_branch import FollowedBranch
from .guesses import trapezoid
from .links import along_guideways, joint_names, joints_of, link_ends, motion_function
from .path_rows import task_along
from .problem import MotionProblem

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

FORCE_RESERVE = 1e-5  # of the limit: what the root's rounding at rest and the curvature between nodes may take
TIGHTENINGS = 4  # each takes what the curvature of the path adds between nodes, some 0.1 %, off the limit
PER_INTERVAL = 4  # forces between nodes are looked at so often
FOLLOWING = 1e-9  # tolerance of the integrator, relative and absolute
DEGREE = 5  # of the polynomial that stands for a force within one interval when it is integrated


@dataclass(frozen=True, eq=False)
class PathParametrization:
    """The robot of a problem, which follows a path within its limits and further margins."""

    problem: MotionProblem
    guard: MotionConstraints
    path: Path

    def trouble(self, samples: int = 401) -> str:
        """One sentence on a place that the path cannot pass; empty where there is none."""
        s = np.linspace(0.0, 1.0, samples)
        T = self.path(s)[0]
        joints, tips, status = link_ends(self.problem.robot, T)
        least_along = np.min(along_guideways(self.problem.robot, tips, joints), axis=1, initial=np.inf)
        bad = np.flatnonzero(status != Status.OK)
        least = self.problem.limits.link_along_guideway
        for k in range(samples):
            shown = f"({', '.join(f'{x:.4g}' for x in T[k])}) m, {100 * s[k]:.0f} % of the way"
            if bad.size and k == bad[0]:
                return f"the path leaves the workspace at {shown}"
            if least_along[k] < least:
                return f"the path comes to the edge of reach at {shown}: a link stands {least_along[k]:.3g} m along"
        margins = motion_function(self.problem.robot, self.guard).along(T)[-2] if self.guard.margins else None
        broken = None if margins is None else self.guard.broken(margins)
        return f"the path {broken[1]}, {100 * s[broken[0]]:.0f} % of the way" if broken else ""

    def guess(self) -> Trajectory:
        """The trapezoid of 1 s along the path."""
        t, s, ds, dds = trapezoid()
        return Trajectory(t, {"s": s, "der(s)": ds, "der(s,2)": dds, "drive": dds})

    def fastest(
        self,
        intervals: int,
        progress: Progress | None = None,
        max_seconds: float | None = None,
        bounded: Literal["middle", "ends"] = "ends",
        reserve: float = 0.0,
    ) -> PathMotion:
        """The optimal motion; its limits hold on both sides of every node, and so in between, or in the middles."""
        problem, cost = self.problem, self.problem.cost
        f = motion_function(problem.robot, self.guard)
        task = task_along(
            f, self.path, len(f.outputs) - bool(self.guard.margins),
            np.full(3, problem.limits.force * (1 - reserve)), np.full(3, cost.force_unit**-2),
            time=cost.time, energy=cost.energy,
            rest=("velocity" in problem.start.rest, "velocity" in problem.goal.rest),
        )  # fmt: skip
        return solve_path(task, intervals, bounded=bounded, progress=progress, max_seconds=max_seconds)

    def within(self, intervals: int, progress: Progress | None = None, max_seconds: float | None = None) -> PathMotion:
        """The fastest motion whose forces keep their limit between the nodes too: lowered by what was seen there."""
        reserve = FORCE_RESERVE
        motion = self.fastest(intervals, progress, max_seconds, reserve=reserve)
        for _ in range(TIGHTENINGS):
            peak = float(np.max(np.abs(self.trajectory(motion)["tau"]))) if motion.status.ok else 0.0
            if peak <= self.problem.limits.force:
                break
            reserve += peak / self.problem.limits.force - 1 + FORCE_RESERVE
            motion = self.fastest(intervals, progress, max_seconds, reserve=reserve)
        return motion

    def sample(self, motion: PathMotion, times: np.ndarray) -> Trajectory:
        """Everything at the given instants [s]: the motion itself, and what inverse dynamics says of it."""
        return self.along(times, *motion.at(times))

    def along(self, times: np.ndarray, s: np.ndarray, v: np.ndarray, a: np.ndarray) -> Trajectory:
        """Everything at the given instants [s] for a path coordinate and its two derivatives."""
        x, slope, bend = self.path(s)
        T, dT = x, slope * v[:, None]
        ddT = bend * v[:, None] ** 2 + slope * a[:, None]
        return sampled(self.problem.robot, times, T, dT, ddT, self.guard).with_values({"s": s})

    def trajectory(self, motion: PathMotion) -> Trajectory:
        """The motion at its nodes and between them; at a node what holds just after it."""
        fractions = np.arange(PER_INTERVAL) / PER_INTERVAL
        times = (motion.t[:-1, None] + fractions * np.diff(motion.t)[:, None]).reshape(-1)
        end = np.nextafter(motion.final_time, 0.0)  # just before the end: the last interval's force
        return self.sample(motion, np.unique(np.append(times, end)))

    def integrated_end(self, motion: PathMotion) -> np.ndarray:
        """TCP position [m] at the end when the forces alone act, by an error-controlled integrator."""
        nodes = (1 - np.cos(np.pi * (2 * np.arange(DEGREE + 1) + 1) / (2 * DEGREE + 2))) / 2
        steps = np.diff(motion.t)
        times = motion.t[:-1, None] + nodes * steps[:, None]
        tau = self.sample(motion, times.reshape(-1))["tau"].reshape(len(steps), DEGREE + 1, 3)
        power = np.linalg.inv(np.vander(nodes, increasing=True))
        c = np.einsum("pn,knm->kpm", power, tau)
        import scipy  # here: a free motion starts sooner without it

        forward = FollowedBranch(compile_causal(self.problem.robot, known="tau", targets="der(T,2)", prefer="T"))
        y = np.concatenate([self.path(np.zeros(1))[0][0], self.path(np.zeros(1))[1][0] * np.sqrt(motion.b[0])])
        for begin, step, polynomial in zip(motion.t, steps, c, strict=False):

            def arguments(
                t: float, y: np.ndarray, begin: float = begin, step: float = step, polynomial: np.ndarray = polynomial
            ) -> list[np.ndarray]:
                tau = ((t - begin) / step) ** np.arange(DEGREE + 1) @ polynomial
                given = {("T", 0): y[:3], ("T", 1): y[3:], ("tau", 0): tau}
                return [given[_base(signal.name), signal.pairs[0][1]] for signal in forward.f.inputs]

            def rates(t: float, y: np.ndarray, arguments: Callable[..., Any] = arguments) -> np.ndarray:
                return np.concatenate([y[3:], forward(*arguments(t, y))])

            span = begin, begin + step
            run = scipy.integrate.solve_ivp(
                rates, span, y, method="DOP853", rtol=FOLLOWING, atol=FOLLOWING, first_step=step
            )
            y = run.y[:, -1]
            forward.kept(*arguments(span[1], y))
            if not run.success:
                return np.full(3, np.nan)
        return y[:3] if np.all(forward.statuses() == Status.OK) else np.full(3, np.nan)


def _base(name: str) -> str:
    return name.removeprefix("der(").partition(",")[0].rstrip(")")


class NotReached(Exception):
    """A motion goes where the robot cannot be: at `samples` instants."""

    def __init__(self, samples: int) -> None:
        super().__init__(f"the motion leaves the robot's reach at {samples} instants: use more mesh.elements")
        self.samples = samples


def sampled(
    robot: Model, times: np.ndarray, T: np.ndarray, dT: np.ndarray, ddT: np.ndarray, guard: MotionConstraints
) -> Trajectory:
    """A TCP motion with carts, forces, links and margins, by inverse kinematics and dynamics.

    Raises NotReached where the robot cannot be at an instant.
    """
    p, f = guard.prefix, motion_function(robot, guard)
    *columns, status = f.along(T, dT, ddT)
    if np.any(status != Status.OK):
        raise NotReached(int(np.count_nonzero(status)))
    values = {signal.name: value for signal, value in zip(f.outputs, columns, strict=True)}
    result = {"T": T, "der(T)": dT, "der(T,2)": ddT, "tau": values[f"{p}tau"], "q": values[f"{p}q"],
              "der(q)": values[f"der({p}q)"]}  # fmt: skip
    units = {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2", "tau": "N", "q": "m", "der(q)": "m/s"}
    if names := joint_names(robot):
        joints, tips = joints_of(names, [values[f"{p}{name}"] for name in names], len(T))
        result["along_guideway"] = along_guideways(robot, tips, joints)
        units["along_guideway"] = "m"
    if "margin" in values:
        result["margin"] = values["margin"]
    return Trajectory(times, result, units)
