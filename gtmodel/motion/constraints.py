"""Further constraints of a motion as margins, which are >= 0 if the constraint is satisfied.

The optimisation bounds them at its collocation points, the path parametrisation evaluates them by name, and the study
reports the smallest margin over the exported motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import lang as gt
from ..geometry.distances import segment_to_box
from ..results import ArgumentError
from ..results.options import declared, written_name
from .options import JointCone, MotionLimits, Obstacle

SHARPNESS_PER_M = 200.0  # of the smooth maximum over separating directions: conservative by at most log(6) / 200 = 9 mm
ROUNDING_M = 1e-4  # of smooth absolute values
CARTS, ROTARY = range(3), range(3, 6)  # indices in q
ROUND_OFF = 1e-9  # of margins
MARGIN_TOLERANCE = 0.01  # limits are imposed at collocation points; force jumps may exceed them in between
FAR_M = 1.0  # larger separations are clipped to keep exponentials finite


@dataclass(frozen=True)
class Constraint:
    """One scalar margin: its limit's name in results, its unit, and its expression in a model with a `robot`."""

    key: str
    unit: str
    expression: Callable[[Any], Any]


@dataclass(frozen=True)
class MotionConstraints:
    """Margins and the parameters in their expressions."""

    margins: list[Constraint]
    parameters: dict[str, Any]
    made: dict[int, tuple[gt.Model, gt.Model]] = field(default_factory=dict, repr=False, compare=False)

    def declarations(self, robot: gt.Model, bounded: bool = False) -> dict[str, Any]:
        """Return the class attributes of a model with the robot and its margins."""
        declared: dict[str, Any] = {"robot": gt.part(robot), "metre": gt.parameter(1.0, unit="m"), **self.parameters}
        if self.margins:
            declared["margin"] = gt.variable(len(self.margins), min=0.0 if bounded else None)
        return declared

    def equations(self, model: Any) -> Any:
        """Yield the equations of the margins."""
        for k, margin in enumerate(self.margins):
            yield model.margin[k] == margin.expression(model)

    def least(self, values: np.ndarray) -> dict[str, float]:
        """Return the smallest of margins (n, k) by key of the limit."""
        least: dict[str, float] = {}
        for k, margin in enumerate(self.margins):
            least[margin.key] = min(float(np.min(values[:, k])), least.get(margin.key, np.inf))
        return least

    def broken(self, values: np.ndarray) -> tuple[int, str] | None:
        """Return the first row of margins (n, k) that violates a limit, and a sentence on it; None if there is none."""
        rows = np.flatnonzero(np.min(values, axis=1, initial=np.inf) < -ROUND_OFF)
        if not rows.size:
            return None
        row = int(rows[0])
        k = int(np.argmin(values[row]))
        return (
            row,
            f"violates limits.{self.margins[k].key} by {-values[row, k]:.4g}{' m' * (self.margins[k].unit == 'm')}",
        )

    @property
    def prefix(self) -> str:
        """Prefix of the robot's names in `model`."""
        return "robot." if self.margins else ""

    def model(self, robot: gt.Model) -> gt.Model:
        """Return the robot with its margins; cached per robot, so that compiled functions are reused."""
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
    """A rotating body that carries joints: its rotation in a model with a `robot`, and its rotation at the start."""

    rotation: Callable[[Any], Any]
    at_start: np.ndarray


Carriers = Callable[[int, str], Carrier | None]


def guard_of(
    limits: MotionLimits, arms: list[tuple[str, int]], carriers: Carriers = lambda arm, end: None
) -> MotionConstraints:
    """Return the margins of limits.

    Args:
        arms: (part, index) of the robot's links.
        carriers: the body that rotates the joint at an end of an arm; None if the joint keeps its direction.

    Raises ArgumentError for contradictory bounds and for arms that the robot does not have.
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
        value = getattr(limits, limit, None)  # Limits has no fields for rotary axes
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
    """Raise ArgumentError if a lower bound of "cart", "axis" or "tcp" is not below the upper one."""
    for body in bodies:
        low, high = (getattr(limits, f"{body}_{side}") for side in ("low", "high"))
        if low is not None and high is not None and not np.all(ordered := np.array(low) < np.array(high)):
            k = int(np.argmin(ordered))
            convert, unit = (np.degrees, "deg") if body == "axis" else (float, "m")
            raise ArgumentError(
                f"entry {k + 1} is {convert(low[k]):g} {unit}, not below {convert(high[k]):g} {unit} in {body}_high",
                f"limits.{body}_low",
            )


def _link(model: Any, arm: tuple[str, int]) -> Any:
    """Return the rod of a link, or the link itself if it has no rod."""
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
        raise ArgumentError(f"is {cone.arm}; expected an arm from 0 to {len(arms) - 1}", f"limits.{key}.arm")
    axis = np.array(cone.axis)
    if not np.any(axis):
        raise ArgumentError("is zero; expected a direction", f"limits.{key}.axis")
    axis = axis / np.linalg.norm(axis)
    carrier = carriers(cone.arm, cone.end)
    direction = axis if carrier is None else np.linalg.solve(carrier.at_start, axis)
    name = parameter(key.replace("[", "_").replace("]", "_axis"), direction, "1")
    arm, least = arms[cone.arm], float(np.cos(cone.half_angle))

    def expression(m: Any) -> Any:
        rod = _link(m, arm)
        axis_now = getattr(m, name) if carrier is None else carrier.rotation(m) @ getattr(m, name)
        return gt.dot(rod.b.r - rod.a.r, axis_now) / rod.L - least

    return Constraint(key, "1", expression)


def _separation(model: Any, arm: tuple[str, int] | None, center: Any, half: np.ndarray) -> Any:
    """Return a smooth lower bound of the separation [m] of a link, or of the TCP if arm is None, from a box.

    A box and a segment are disjoint if one of six directions separates them: the three normals of the box and the
    three cross products of an edge with the segment.
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
        for j, k in ((1, 2), (2, 0), (0, 1)):  # cross product of the third edge with the segment
            size = gt.sqrt(along[j] ** 2 + along[k] ** 2 + ROUNDING_M**2)
            gap = _below(middle[j] * along[k] - middle[k] * along[j])
            gaps.append((gap - half[j] * _above(along[k]) - half[k] * _above(along[j])) / size)
    total = 0.0
    for gap in gaps:
        total = total + gt.exp(SHARPNESS_PER_M * gt.minimum(gap, FAR_M))
    return gt.log(total / len(gaps)) / SHARPNESS_PER_M


def _above(x: Any) -> Any:
    """Return a smooth upper bound of |x|."""
    return gt.sqrt(x**2 + ROUNDING_M**2)


def _below(x: Any) -> Any:
    """Return a smooth lower bound of |x|."""
    return gt.sqrt(x**2 + ROUNDING_M**2) - ROUNDING_M


def clearances(
    obstacles: Sequence[Obstacle], T: np.ndarray, links: Sequence[tuple[np.ndarray, np.ndarray]]
) -> list[float]:
    """Return the smallest distance [m] of the TCP T (n, 3) and all links (both ends (n, 3) each) from each box."""
    distances = []
    for obstacle in obstacles:
        center, half = np.array(obstacle.center), np.array(obstacle.size) / 2
        gaps = [segment_to_box(a - center, b - center, half)[0] for a, b in [(T, T), *links]]
        distances.append(float(np.min(gaps)))
    return distances
