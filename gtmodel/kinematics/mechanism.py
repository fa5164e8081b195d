"""A robot as arrays for the kinematic analyses: links, guideways and lengths, and its poses in rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..compiler.rows import RowFunction
from ..lang import Model, ModelError
from ..results import ArgumentError, Status
from ..robots.links import link_names
from .section import SectionPlane, section_of

Array = np.ndarray


@dataclass(frozen=True)
class Poses:
    """n poses of a robot with m actuators and l links.

    Attributes:
        T: (n, 3) tool centre points [m].
        q: (n, m) actuator coordinates [m or rad].
        a, b: (n, l, 3) the two ends of each link, at its cart and at the plate [m].
        status: (n,) codes of `Status`; rows that are not OK are NaN.
    """

    T: Array
    q: Array
    a: Array
    b: Array
    status: Array

    def rows(self, chosen: Array) -> Poses:
        """Return the chosen rows only."""
        return Poses(*(x[chosen] for x in (self.T, self.q, self.a, self.b, self.status)))

    @property
    def directions(self) -> Array:
        """(n, l, 3) unit vectors of the links, from cart to plate."""
        d = self.b - self.a
        return d / np.sqrt(np.einsum("nli,nli->nl", d, d))[..., None]


class InverseKinematics:
    """Inverse kinematics from tool centre points to `Poses`.

    Args:
        function: called with T (n, 3); returns q (n, m), a_1 (n, 3), b_1 (n, 3), a_2, ..., and Status codes (n,).
            A CausalFunction fits.
        offsets: (l, 3) added to both ends of each link [m], from the simplified joint A to the real joint: R B_i of a
            plate with constant orientation (Dressler 2012, eq. (4.9)). Default: zero.
    """

    def __init__(self, function: Callable[..., Any], offsets: Array | None = None) -> None:
        self._causal = function if isinstance(function, CausalFunction) else None
        if isinstance(function, CausalFunction) and all(b.kind != "Newton" for b in function.plan.blocks):
            function = RowFunction(function)
        self._function = function
        self._offsets = None if offsets is None else np.asarray(offsets, dtype=float)

    def diagnose(self, T: Array) -> str:
        """Return a sentence on T (3,) [m]: ok, or why no pose exists, with the variable if it is known."""
        if self._causal is not None and np.isfinite(T).all():
            return self._causal.diagnose(T)
        return Status(int(self(np.asarray(T)[None]).status[0])).message

    def __call__(self, T: Array) -> Poses:
        """Return the poses at T (n, 3) [m]. A row without a solution is NaN, and its status gives the reason."""
        T = np.asarray(T, dtype=float)
        q, *ends, status = self._function(T)
        a, b = np.stack(ends[0::2], axis=1), np.stack(ends[1::2], axis=1)
        if self._offsets is not None:
            a, b = a + self._offsets, b + self._offsets
        status = np.asarray(status)
        finite = np.isfinite(T).all(axis=1)
        return Poses(T, q, a, b, np.where(finite, status, Status.NOT_FINITE))


MARGIN_M = 0.05  # added to the largest reach of the links


@dataclass(frozen=True)
class Mechanism:
    """A robot whose links run on guideways.

    Attributes:
        inverse: inverse kinematics. home: the pose at the model's home, one row.
        anchors, directions: (l, 3) guideway of each link: point at q = 0 [m] and displacement per unit of q.
        lengths: (l,) of the links [m].
        plate_arms: (l,) distances from the tool centre point to the simplified plate joint of each link [m]. The tool
            centre point can be farther from a guideway than the link length by this distance.
        length_names: names of the length parameters; empty if the lengths are bound.
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
        """Return the section across the guideways through the home pose, or at `along` [m]. Raises ArgumentError."""
        return section_of(self.anchors, self.directions, self.home.T[0], along)

    def farthest(self, pierced: Array) -> tuple[Array, Array]:
        """Return bounds of (u, v) [m] for all tool centre points in a section, with a margin.

        pierced: (l, 2) points where the guideways pierce the section [m]. The reach of link and plate bounds the
        distance of the tool centre point from each guideway.
        """
        reach = (self.lengths + self.plate_arms + MARGIN_M)[:, None]
        return (pierced - reach).max(axis=0), (pierced + reach).min(axis=0)


def mechanism_of(model: Model, home: Array | None = None, offsets: Array | None = None) -> Mechanism:
    """Return the mechanism of a robot. Its links are parts with `rod` and `v`, as in the robots of the library.

    Args:
        home: (3,) home pose, which defines the axes of the joint cones [m]; default: the model's home.
        offsets: (l, 3) from the simplified to the real joints [m].

    Raises ArgumentError.
    """
    flat = flat_of(model)
    if flat.groups.get("T", ((), []))[0] != (3,):
        raise ArgumentError(f"the robot must declare 'T' as a vector of 3; it declares {flat.top()}", "robot")
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
            f"T alone must determine the links; this robot also needs {', '.join(s.name for s in function.inputs[1:])}",
            "robot",
        )
    inverse = InverseKinematics(function, offsets)
    T = np.asarray(getattr(model, "home", np.zeros(3)) if home is None else home, dtype=float)
    solution = inverse(T[None])
    if solution.status[0] != Status.OK:
        point = ", ".join(f"{x:g}" for x in T)
        raise ArgumentError(f"the robot cannot reach the home pose ({point}) m: {function.diagnose(T)}", "home")
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
    """Draw the robot at home, with closed curves (k, 3) [m]."""
    from ..plot.robot3d import robot_figure

    home = robot.home
    return robot_figure(home.a[0], home.b[0], home.T[0], robot.directions, curves=curves, title=title)


def _symbols(expressions: list[Any], known: list[str]) -> tuple[str, ...]:
    names = tuple(x.name() for x in expressions if x.is_symbolic())
    return names if len(names) == len(expressions) and set(names) <= set(known) else ()
