"""A robot's motion from one pose to another as an Optimization."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .. import lang as gt
from .._lazy import hint
from ..robots.links import links_of
from .constraints import NO_GUARD, MotionConstraints
from .guesses import GUESS_TIME_S
from .problem import MotionProblem

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

SHORTEST_TIME_S = 0.05  # a free final time needs a lower bound; no motion of these robots is shorter


def motion(
    problem: MotionProblem, guard: MotionConstraints = NO_GUARD, path: Path | None = None, *, guarded: bool = False
) -> gt.Optimization:
    """The optimal motion as an Optimization, along `path` or free, with the margins of `guard` as constraints.

    guarded: with the bound that keeps the links off the edge of reach as well.

    The robot must declare T (TCP position, m) and tau (motor forces, N). `along_guideway` are the components [m] of the
    links along their guideways, from cart to plate: at 0 the robot stands at the edge of its reach; `margin` those of
    the guard. The control of a free motion is tau. Along a path the model is restricted to T == path(s), and its one
    control `drive` is the second or third derivative of the path coordinate s (Dressler 2012, section 3.5); the motor
    forces are dependent variables. They are dependent as well in a free motion whose problem has an `order`: then
    `drive` is that derivative of T.

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
            moved = self.robot.T if path is None else self.s
            begin, end = (self.from_T, self.to_T) if path is None else (0.0, 1.0)
            yield moved.at(self.start_time) == begin
            yield moved.at(self.final_time) == end
            if path is not None:
                yield gt.der(self.s) >= 0
            for instant, rest in ((self.start_time, problem.start.rest), (self.final_time, problem.goal.rest)):
                for k, name in ((1, "velocity"), (2, "acceleration")):
                    if name in rest:
                        yield gt.der(moved, k).at(instant) == 0

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


def dependent(robot: gt.Model, name: str) -> gt.Model:
    """The same robot, whose input of that name is a variable that the motion determines."""
    cls: Any = type(robot)
    item = cls._declared[name]
    attributes = {k: v for k, v in item.attributes.items() if v is not None}
    variable = gt.variable(item.shape, unit=item.unit, **attributes)
    return type(cls.__name__, (cls,), {name: variable})(**robot._modifiers)
