"""What a motion must keep besides its forces: margins, each written once, >= 0 where it is kept.

The optimisation bounds them at its points, the fast engine along a path evaluates them by name, and the report looks
at the least of each over the exported motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import lang as gt
from ..results import ArgumentError
from ..results.options import declared, written_name
from .options import JointCone, MotionLimits, Obstacle

SHARPNESS_PER_M = (
    200.0  # of the smooth maximum over separating directions: at most log(6) / 200 = 9 mm on the safe side
)
ROUNDING_M = 1e-4  # of smooth absolute values
CARTS, ROTARY = range(3), range(3, 6)  # of the coordinates q
ROUND_OFF = 1e-9  # of margins
MARGIN_TOLERANCE = 0.01  # limits hold at collocation points; between them a jump of the force shows
FAR_M = 1.0  # a separation beyond this is far enough; keeps exponentials finite


@dataclass(frozen=True)
class Constraint:
    """One scalar margin: the limit it comes from, by its name in results, its unit, and its expression in a model that
    has `robot`."""

    key: str
    unit: str
    expression: Callable[[Any], Any]


@dataclass(frozen=True)
class MotionConstraints:
    """Margins and the parameters that their expressions use."""

    margins: list[Constraint]
    parameters: dict[str, Any]
    made: dict[int, tuple[gt.Model, gt.Model]] = field(default_factory=dict, repr=False, compare=False)

    def declarations(self, robot: gt.Model, bounded: bool = False) -> dict[str, Any]:
        """Class attributes of a model that holds the robot and its margins."""
        declared: dict[str, Any] = {"robot": gt.part(robot), "metre": gt.parameter(1.0, unit="m"), **self.parameters}
        if self.margins:
            declared["margin"] = gt.variable(len(self.margins), min=0.0 if bounded else None)
        return declared

    def equations(self, model: Any) -> Any:
        """Equations of the margins."""
        for k, margin in enumerate(self.margins):
            yield model.margin[k] == margin.expression(model)

    def least(self, values: np.ndarray) -> dict[str, float]:
        """The least of margins (n, k) by the key that they come from."""
        least: dict[str, float] = {}
        for k, margin in enumerate(self.margins):
            least[margin.key] = min(float(np.min(values[:, k])), least.get(margin.key, np.inf))
        return least

    def broken(self, values: np.ndarray) -> tuple[int, str] | None:
        """The first row of margins (n, k) that breaks a limit, and which one by how much; None where none does."""
        rows = np.flatnonzero(np.min(values, axis=1, initial=np.inf) < -ROUND_OFF)
        if not rows.size:
            return None
        row = int(rows[0])
        k = int(np.argmin(values[row]))
        return (
            row,
            f"breaks limits.{self.margins[k].key} by {-values[row, k]:.4g}{' m' * (self.margins[k].unit == 'm')}",
        )

    @property
    def prefix(self) -> str:
        """What stands before the robot's own names in `model`."""
        return "robot." if self.margins else ""

    def model(self, robot: gt.Model) -> gt.Model:
        """The robot with its margins, for functions of the motion; made once per robot, so functions are too."""
        if not self.margins:
            return robot
        guard = self
        if id(robot) in self.made:
            return self.made[id(robot)][1]

        def equations(self: Any) -> Any:
            yield from guard.equations(self)

        model = type("Guarded", (gt.Model,), {**self.declarations(robot), "equations": equations})()
        self.made[id(robot)] = (robot, model)
        return model


NO_GUARD = MotionConstraints([], {})


@dataclass(frozen=True)
class Carrier:
    """A body that turns and carries joints: its rotation in a model that has `robot`, and the one at the start."""

    rotation: Callable[[Any], Any]
    at_start: np.ndarray


Carriers = Callable[[int, str], Carrier | None]


def guard_of(
    limits: MotionLimits, arms: list[tuple[str, int]], carriers: Carriers = lambda arm, end: None
) -> MotionConstraints:
    """The margins of these limits.

    Args:
        arms: (part, index) of the robot's links.
        carriers: what turns the joint at an end of an arm; None where it keeps its direction.

    Raises ArgumentError for bounds that cross or name what the robot has not.
    """
    p: dict[str, Any] = {}
    margins: list[Constraint] = []

    def parameter(name: str, value: Any, unit: str) -> str:
        p[name] = gt.parameter(np.asarray(value, float), unit=unit)
        return name

    def known(limit: str) -> str:
        return written_name(limit, declared(type(limits))[limit])

    def magnitude(limit: str, order: int, unit: str) -> None:
        value = getattr(limits, limit)
        if value is not None:
            name = parameter(known(limit), value, unit)
            margins.append(
                Constraint(name, "1", lambda m: 1.0 - gt.dot(v := gt.der(m.robot.T, order), v) / getattr(m, name) ** 2)
            )

    def axes(limit: str, order: int, unit: str, which: range) -> None:
        value = getattr(limits, limit, None)  # a robot without rotary axes has none for them
        if value is not None:
            name = parameter(known(limit), value, unit)
            for i in which:
                margins.append(
                    Constraint(name, "1", lambda m, i=i: 1.0 - (gt.der(m.robot.q[i], order) / getattr(m, name)) ** 2)
                )

    def between(body: str, value: Callable[[Any, int], Any]) -> None:
        check_strokes(limits, body)
        for side, sign in (("low", 1.0), ("high", -1.0)):
            bound = getattr(limits, f"{body}_{side}")
            if bound is not None:
                name = parameter(known(f"{body}_{side}"), bound, "m")
                for i in range(3):
                    margins.append(
                        Constraint(name, "m", lambda m, i=i, s=sign, n=name: s * (value(m, i) - getattr(m, n)[i]))
                    )

    magnitude("tcp_velocity", 1, "m/s")
    magnitude("tcp_acceleration", 2, "m/s2")
    magnitude("tcp_jerk", 3, "m/s3")
    axes("cart_velocity", 1, "m/s", CARTS)
    axes("cart_acceleration", 2, "m/s2", CARTS)
    axes("axis_velocity", 1, "rad/s", ROTARY)
    axes("axis_acceleration", 2, "rad/s2", ROTARY)
    between("cart", lambda m, i: m.robot.q[i])
    between("tcp", lambda m, i: m.robot.T[i])
    for n, cone in enumerate(limits.joint_cones):
        margins.append(_cone(f"joint_cones[{n}]", cone, arms, carriers, parameter))
    for n, obstacle in enumerate(limits.obstacles):
        center = parameter(f"obstacle_{n}_center", obstacle.center, "m")
        half = np.array(obstacle.size) / 2
        for point, link in [(True, None), *((False, arm) for arm in arms)]:
            margins.append(
                Constraint(
                    f"obstacles[{n}]",
                    "m",
                    lambda m, c=center, link=link, point=point, half=half, o=obstacle: (
                        _separation(m, None if point else link, getattr(m, c), half) - o.clearance
                    ),
                )
            )
    return MotionConstraints(margins, p)


def check_strokes(limits: MotionLimits, *bodies: str) -> None:
    """Raises ArgumentError where a lower bound of "cart", "axis" or "tcp" is not below the upper one."""
    for body in bodies:
        low, high = (getattr(limits, f"{body}_{side}") for side in ("low", "high"))
        if low is not None and high is not None and not np.all(apart := np.array(low) < np.array(high)):
            k = int(np.argmin(apart))
            shown, unit = (np.degrees, "deg") if body == "axis" else (float, "m")
            raise ArgumentError(
                f"its number {k + 1}, {shown(low[k]):g} {unit}, is not below {shown(high[k]):g} of {body}_high",
                f"limits.{body}_low",
            )


def _link(model: Any, arm: tuple[str, int]) -> Any:
    """The rod of a link; the link itself where it has no other parts."""
    link = getattr(model.robot, arm[0])[arm[1]]
    return link.rod if hasattr(link, "rod") else link


def _cone(
    key: str,
    cone: JointCone,
    arms: list[tuple[str, int]],
    carriers: Carriers,
    parameter: Callable[[str, Any, str], str],
) -> Constraint:
    if cone.arm >= len(arms):
        raise ArgumentError(f"is {cone.arm}; the robot has the arms 0 to {len(arms) - 1}", f"limits.{key}.arm")
    axis = np.array(cone.axis)
    if not np.any(axis):
        raise ArgumentError("is zero; a direction is expected", f"limits.{key}.axis")
    axis = axis / np.linalg.norm(axis)
    carrier = carriers(cone.arm, cone.end)
    own = axis if carrier is None else np.linalg.solve(carrier.at_start, axis)
    name = parameter(key.replace("[", "_").replace("]", "_axis"), own, "1")
    arm, least = arms[cone.arm], float(np.cos(cone.half_angle))

    def expression(m: Any) -> Any:
        rod = _link(m, arm)
        now = getattr(m, name) if carrier is None else carrier.rotation(m) @ getattr(m, name)
        return gt.dot(rod.b.r - rod.a.r, now) / rod.L - least

    return Constraint(key, "1", expression)


def _separation(model: Any, arm: tuple[str, int] | None, center: Any, half: np.ndarray) -> Any:
    """Separation [m] of a link, or of the TCP where arm is None, from a box; a smooth lower bound.

    Of two convex polytopes a box and a segment are apart when one of six directions separates them: three normals of
    the box, three products of an edge with the segment.
    """
    metre = model.metre
    if arm is None:
        middle, along = (model.robot.T - center) / metre, None
    else:
        rod = _link(model, arm)
        middle = ((rod.a.r + rod.b.r) / 2 - center) / metre
        along = (rod.b.r - rod.a.r) / metre
    gaps = []
    for i in range(3):
        reach = half[i] if along is None else half[i] + _above(along[i]) / 2
        gaps.append(_below(middle[i]) - reach)
    if along is not None:
        for j, k in ((1, 2), (2, 0), (0, 1)):  # edge i = the third; its product with the segment
            size = gt.sqrt(along[j] ** 2 + along[k] ** 2 + ROUNDING_M**2)
            gap = _below(middle[j] * along[k] - middle[k] * along[j])
            gaps.append((gap - half[j] * _above(along[k]) - half[k] * _above(along[j])) / size)
    total = 0.0
    for gap in gaps:
        total = total + gt.exp(SHARPNESS_PER_M * gt.minimum(gap, FAR_M))
    return gt.log(total / len(gaps)) / SHARPNESS_PER_M


def _above(x: Any) -> Any:
    """Smooth, not below |x|."""
    return gt.sqrt(x**2 + ROUNDING_M**2)


def _below(x: Any) -> Any:
    """Smooth, not above |x|."""
    return gt.sqrt(x**2 + ROUNDING_M**2) - ROUNDING_M


def clearances(
    obstacles: Sequence[Obstacle], T: np.ndarray, links: Sequence[tuple[np.ndarray, np.ndarray]]
) -> list[float]:
    """Least distance [m] of the tool centre point T (n, 3) and of all links, both ends (n, 3) each, from each box."""
    distances = []
    for obstacle in obstacles:
        box = np.array(obstacle.center), np.array(obstacle.size)
        distances.append(min(clearance(T, T, *box, 1), *(clearance(a, b, *box) for a, b in links), np.inf))
    return distances


def clearance(points: np.ndarray, ends: np.ndarray, center: np.ndarray, size: np.ndarray, samples: int = 401) -> float:
    """Least distance [m] of segments, from points (n, 3) to ends (n, 3), from a box, by sampling: 0 inside."""
    least = np.inf
    for f in np.linspace(0.0, 1.0, samples):
        outside = np.maximum(np.abs(points + f * (ends - points) - center) - size / 2, 0.0)
        least = min(least, float(np.min(np.linalg.norm(outside, axis=1))))
    return least
