"""A robot's motion from one pose to another as an Optimization, and its guesses: the straight line with or without a
trapezoidal profile, and bent lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .. import lang as gt
from .._lazy import hint
from ..compiler.causal import CausalFunction
from ..lang.model import dependent
from ..results import ArgumentError, Status, Trajectory
from ..robots.links import links_of
from .constraints import NO_GUARD, MotionConstraints
from .options import MotionProblem

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

GUESS_TIME_S = 1.0
Barrier = Literal["adaptive", "monotone"]


@dataclass(frozen=True, eq=False)
class FurtherStart:
    """A guess, and the barrier strategy used with it if the problem's strategy is "auto"."""

    guess: Trajectory
    barrier: Barrier = "adaptive"


def trapezoid(rows: int = 201) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], path fraction and its two derivatives for a trapezoidal speed (1/4, 1/2, 1/4) over 1 s."""
    t = np.linspace(0.0, GUESS_TIME_S, rows)
    r = t / GUESS_TIME_S
    top = 4.0 / 3.0
    s = np.where(r < 0.25, 2 * top * r**2, np.where(r < 0.75, top * (r - 0.125), 1 - 2 * top * (1 - r) ** 2))
    ds = np.where(r < 0.25, 4 * top * r, np.where(r < 0.75, top, 4 * top * (1 - r))) / GUESS_TIME_S
    dds = np.where(r < 0.25, 4 * top, np.where(r < 0.75, 0.0, -4 * top)) / GUESS_TIME_S**2
    return t, s, ds, dds


def line_guess(
    inverse_dynamics: CausalFunction, start: np.ndarray, goal: np.ndarray, force: float, rows: int = 201
) -> Trajectory:
    """Return the straight line with a trapezoidal profile (1/4, 1/2, 1/4) of 1 s and clipped inverse dynamics."""
    t, s, ds, dds = trapezoid(rows)
    step = goal - start
    T, dT, ddT = start + s[:, None] * step, ds[:, None] * step, dds[:, None] * step
    tau, *_, status = inverse_dynamics.along(T, dT, ddT)
    tau[status != Status.OK] = 0.0  # the line may leave the workspace; the optimum need not
    values = {"robot.T": T, "der(robot.T)": dT, "der(robot.T,2)": ddT, "robot.tau": np.clip(tau, -force, force)}
    return Trajectory(t, values, {"robot.T": "m", "der(robot.T)": "m/s", "robot.tau": "N"})


def bare_guess(start: np.ndarray, goal: np.ndarray) -> Trajectory:
    """Return the straight line at constant speed, without velocities and forces."""
    return Trajectory([0.0, GUESS_TIME_S], {"robot.T": np.array([start, goal])}, {"robot.T": "m"})


def bent_guess(start: np.ndarray, goal: np.ndarray, rng: np.random.Generator, bend: float) -> Trajectory:
    """Return the line of `line_guess` with a half-sine lateral offset of 0.3 to 1 times `bend` [m] in a random
    direction."""
    t, s, _, _ = trapezoid()
    step = goal - start
    side = np.cross(step, rng.normal(size=3))
    offset = side / np.linalg.norm(side) * rng.uniform(0.3, 1.0) * bend
    T = start + s[:, None] * step + np.sin(np.pi * s)[:, None] * offset
    return Trajectory(t, {"robot.T": T}, {"robot.T": "m"})


def further_starts(
    start: np.ndarray, goal: np.ndarray, line: Trajectory, rng: np.random.Generator, bend: float
) -> Iterator[FurtherStart]:
    """Yield starts without end: the line bent to a random side and to the opposite side, the line with the other
    barrier strategy, the line without a profile, then further random bends with alternating strategies."""
    straight_starts = [FurtherStart(line, "monotone"), FurtherStart(bare_guess(start, goal))]
    strategies: tuple[Barrier, ...] = ("adaptive", "monotone")
    for barrier in cycle(strategies):
        bent = bent_guess(start, goal, rng, bend)
        _, s, _, _ = trapezoid()
        mirrored = 2 * (start + s[:, None] * (goal - start)) - bent["robot.T"]
        yield FurtherStart(bent, barrier)
        yield FurtherStart(bent.with_values({"robot.T": mirrored}, {"robot.T": "m"}), barrier)
        yield from straight_starts
        straight_starts = []


def progress_of(earlier: Trajectory) -> Trajectory:
    """Return the non-decreasing path coordinate and its rate of an earlier motion. Raises ArgumentError."""
    if "s" not in earlier:
        raise ArgumentError("is a free motion, but this problem follows a path", "earlier")
    s = np.maximum.accumulate(earlier["s"])
    return Trajectory(earlier.time, {"s": s, "der(s)": np.gradient(s, earlier.time)}, {"s": earlier.unit("s")})


SHORTEST_TIME_S = 0.05  # a free final time needs a lower bound; no motion of these robots is shorter


def motion(
    problem: MotionProblem, guard: MotionConstraints = NO_GUARD, path: Path | None = None, *, guarded: bool = False
) -> gt.Optimization:
    """Return the optimal motion as an Optimization, along `path` or free, with the margins of `guard` as constraints.

    guarded: also keep the links away from the boundary of the workspace.

    The robot must declare T (TCP position, m) and tau (motor forces, N). `along_guideway` are the components [m] of the
    links along their guideways, from cart to plate, 0 at the boundary of the workspace; `margin` are those of the
    guard. The control of a free motion is tau. Along a path the model is restricted to T == path(s), and its only
    control `drive` is the second or third derivative of the path coordinate s (Dressler 2012, section 3.5); the motor
    forces are dependent variables. They are also dependent in a free motion whose problem has an `order`; `drive` is
    then that derivative of T.

    >>> problem = gt.motion.MotionProblem(
    ...     robot=gt.robots.gantry_tau("l1_tape"), limits=gt.motion.Limits(force=700.0),
    ...     start=gt.motion.End([0.0, -0.9, 0.1]), goal=gt.motion.End([0.2, -0.9, 0.2]),
    ... )
    >>> solution = gt.solve(gt.motion.motion(problem), gt.Mesh(10))
    >>> round(solution.final_time, 2)  # [s]
    0.31
    """
    robot, limits, cost, order = problem.robot, problem.limits, problem.cost, problem.order
    links = links_of(robot)

    class Motion(gt.Optimization):
        robot: Any
        along_guideway: Any
        margin: Any
        s: Any
        drive: Any
        metre: Any
        final_time = gt.free(GUESS_TIME_S, min=SHORTEST_TIME_S, unit="s")
        force_limit = gt.parameter(limits.force, unit="N", positive=True)
        force_unit_N = gt.parameter(cost.force_unit, unit="N", positive=True)
        from_T = gt.parameter(problem.begin, unit="m")
        to_T = gt.parameter(problem.end, unit="m")

        def equations(self) -> Any:
            for k, (part, i) in enumerate(links):
                link = getattr(self.robot, part)[i]
                yield self.along_guideway[k] == gt.dot(link.rod.b.r - link.rod.a.r, link.v) / gt.norm(link.v)
            yield from guard.equations(self)
            if path is not None:
                yield self.robot.T == path.expression(self.s, self.metre)
            if order is not None:
                yield self.drive == gt.der(self.s if path is not None else self.robot.T, order)

        def objective(self) -> Any:
            total = cost.time * self.final_time
            if cost.energy:
                tau = self.robot.tau
                total = total + cost.energy * gt.integral(gt.dot(tau, tau) / self.force_unit_N**2)
            return total

        def constraints(self) -> Any:
            yield gt.between(-self.force_limit, self.robot.tau, self.force_limit)
            coordinates = self.robot.T if path is None else self.s
            begin, end = (self.from_T, self.to_T) if path is None else (0.0, 1.0)
            yield coordinates.at(self.start_time) == begin
            yield coordinates.at(self.final_time) == end
            if path is not None:
                yield gt.der(self.s) >= 0
            for instant, rest in ((self.start_time, problem.start.rest), (self.final_time, problem.goal.rest)):
                for k, name in ((1, "velocity"), (2, "acceleration")):
                    if name in rest:
                        yield gt.der(coordinates, k).at(instant) == 0

    declared = guard.declarations(robot if order is None else dependent(robot, "tau"), bounded=True)
    if links:
        least = limits.link_along_guideway if guarded else None
        declared["along_guideway"] = gt.variable(len(links), unit="m", min=least)
    if path is not None:
        declared["s"] = gt.variable(unit="1", min=0.0, max=1.0, prefer=2, description="path coordinate")
        declared["drive"] = gt.input(unit=f"1/s{order}", description="derivative of the path coordinate")
    elif order is not None:
        declared["drive"] = gt.input(3, unit=f"m/s{order}", nominal=10.0, description="derivative of T")
    return type("Motion", (Motion,), declared)()
