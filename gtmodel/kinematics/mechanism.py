"""What the kinematic engines need of a robot: poses of its links, its guideways and link lengths, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import compile_causal, flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, Status
from ..robots.links import link_names
from .poses import InverseKinematics, Poses
from .section import SectionPlane, section_of

Array = np.ndarray
MARGIN_M = 0.05  # around what the links can reach at most


@dataclass(frozen=True)
class Mechanism:
    """A robot whose links run on guideways.

    Attributes:
        inverse: tool centre points to poses. home: its pose at the model's home, one row.
        anchors, directions: (l, 3) guideway of each link: point at q = 0 [m] and motion per q.
        lengths: (l,) of the links [m].
        plate_arms: (l,) from the tool centre point to each link's end [m], simplified joints: so much farther than its
            link the tool centre point may be from a guideway.
        length_names: the parameters that hold them; empty where they are bound.
    """

    model: Model
    inverse: InverseKinematics
    home: Poses
    anchors: Array
    directions: Array
    lengths: Array
    plate_arms: Array
    length_names: tuple[str, ...]

    def section(self, along: float | None = None) -> SectionPlane:
        """The section across the guideways through the home pose, or at `along` [m]. Raises ArgumentError."""
        return section_of(self.anchors, self.directions, self.home.T[0], along)

    def farthest(self, pierced: Array) -> tuple[Array, Array]:
        """Least and greatest (u, v) [m] that any tool centre point of a section may have, and a little more.

        pierced: (l, 2) where the guideways pierce the section. No point is farther from one than link and plate reach.
        """
        reach = (self.lengths + self.plate_arms + MARGIN_M)[:, None]
        return (pierced - reach).max(axis=0), (pierced + reach).min(axis=0)


def mechanism_of(model: Model, home: Array | None = None, offsets: Array | None = None) -> Mechanism:
    """The robot's mechanism; links are parts with `rod` and `v`, as in the robots of the library.

    Args:
        home: (3,) the pose where joint cones have their axes [m]; the model's own if left out.
        offsets: (l, 3) from the simplified joints to the real ones [m].

    Raises ArgumentError.
    """
    flat = flat_of(model)
    if flat.groups.get("T", ((), []))[0] != (3,):
        raise ArgumentError(f"the robot must declare 'T' as a vector of 3; it has {flat.top()}", "robot")
    names = [name.removesuffix(".rod.a.r") for name in link_names(model)]
    if not names:
        raise ArgumentError("the robot has no links on guideways: parts NAME[i] with A, v and a part 'rod'", "robot")
    coordinates = "q" if "q" in flat.groups else "tau"
    targets = [coordinates, *(f"{name}.rod.{end}.r" for name in names for end in "ab")]
    try:
        function = compile_causal(model, known="T", targets=targets)
    except ModelError as error:
        raise ArgumentError(str(error), "robot") from error
    if len(function.inputs) != 1:
        raise ArgumentError(
            f"the links must follow from T alone; {', '.join(s.name for s in function.inputs[1:])} would be needed too",
            "robot",
        )
    inverse = InverseKinematics(function, offsets)
    T = np.asarray(getattr(model, "home", np.zeros(3)) if home is None else home, dtype=float)
    solution = inverse(T[None])
    if solution.status[0] != Status.OK:
        shown = ", ".join(f"{x:g}" for x in T)
        raise ArgumentError(f"the home pose ({shown}) m cannot be reached: {function.diagnose(T)}", "home")
    expressions = [flat.bindings[f"{name}.{key}"] for key in ("A", "v") for name in names]
    lengths = [flat.bindings[f"{name}.rod.L"] for name in names]
    values = ca.Function("p", [flat.p], [ca.horzcat(*expressions), ca.vertcat(*lengths)])(flat.p0)
    A, v = np.split(np.array(values[0]).T, 2)
    ends = solution.b[0] if offsets is None else solution.b[0] - offsets
    return Mechanism(
        model, inverse, solution, A, v, np.array(values[1]).ravel(), np.linalg.norm(ends - T, axis=1),
        _symbols(lengths, function.parameter_names),
    )  # fmt: skip


def home_figure(robot: Mechanism, curves: list[Array], title: str) -> Any:
    """The robot at home, and closed curves (k, 3) [m]."""
    from ..plot.robot3d import robot_figure

    home = robot.home
    return robot_figure(home.a[0], home.b[0], home.T[0], robot.directions, curves=curves, title=title)


def _symbols(expressions: list[Any], known: list[str]) -> tuple[str, ...]:
    names = tuple(x.name() for x in expressions if x.is_symbolic())
    return names if len(names) == len(expressions) and set(names) <= set(known) else ()
