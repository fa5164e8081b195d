"""Options of a motion of a serial arm, and the result of its study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ...results import Long, Options, Quantity, Row, Study, Unit, Within, listed


@dataclass(frozen=True)
class ArmPose(Options):
    """A pose of an arm: its joints, or its tool centre point with or without the orientation of the tool.

    >>> above = gt.motion.ArmPose(tcp=[0.4, 0.1, 0.5], rpy=[np.pi, 0.0, 0.0])  # the tool points down
    >>> gt.motion.ArmPose(tcp=[0.4, 0.1])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: tcp: expected 3 numbers; found 2
    """

    q: Annotated[
        list[float] | None, Unit("rad", written="deg", key="q_deg"), "angles of the joints that turn, in order"
    ] = None  # fmt: skip
    slides: Annotated[list[float] | None, Unit("m"), "positions of the joints that slide, in order"] = None
    tcp: Annotated[list[float] | None, Unit("m"), Long(3), "tool centre point, instead of joints"] = None
    rpy: Annotated[
        list[float] | None, Unit("rad", written="deg"), Long(3),
        "orientation of the tool, with tcp: Rz(yaw) Ry(pitch) Rx(roll); free if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Waypoint(ArmPose):
    """A pose through which the motion passes, at a free time: without a stop, or at rest.

    >>> gt.motion.Waypoint(q=[0.0, -1.2, 1.2, 0.0, 1.5, 0.0]).stop
    False
    """

    stop: Annotated[bool, "whether the arm rests there; otherwise it flies by at the best speed"] = False


@dataclass(frozen=True)
class ArmLimits(Options):
    """Limits of the motion: those of the arm or others, a share of them, and accelerations. Arrays have one number per
    joint, in m, m/s, N for joints that slide.

    >>> gt.motion.ArmLimits(speed=0.5).effort
    1.0
    """

    speed: Annotated[float, Within(above=0.0, most=1.0), "share of the limits of speed that is used"] = 1.0
    effort: Annotated[float, Within(above=0.0, most=1.0), "share of the limits of effort that is used"] = 1.0
    joint_speed: Annotated[
        list[float] | None, Unit("rad/s"), Within(above=0.0),
        "largest speed of each joint, in m/s of those that slide; those of the arm if left out",
    ] = None  # fmt: skip
    joint_effort: Annotated[
        list[float] | None, Unit("N.m"), Within(above=0.0),
        "largest motor effort of each joint, in N of those that slide; those of the arm if left out",
    ] = None  # fmt: skip
    joint_acceleration: Annotated[
        list[float] | None, Unit("rad/s2"), Within(above=0.0),
        "largest acceleration of each joint, in m/s2 of those that slide; unlimited if left out",
    ] = None  # fmt: skip


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ArmStudy(Study):
    """An optimal motion of a serial arm through waypoints, re-simulated, with the smallest distances of its links.

    refined: whether the mesh was refined.
    """

    final_time: Annotated[float | None, Quantity("s", "final time of the optimum", "final time")] = None
    passed: Annotated[Array | None, Quantity("s", "times of the waypoints")] = None
    elements: Annotated[int | None, "mesh elements of each segment; more than requested if the mesh was refined"] = None
    peak_speed: Annotated[Sequence[float], "largest share of its speed limit that each joint reaches"] = ()
    peak_effort: Annotated[Sequence[float], "largest share of its effort limit that each motor reaches"] = ()
    missed: Annotated[
        float | None, "largest deviation from start, waypoints and goal, in m and rad, of the re-simulated motion"
    ] = None
    defect: Annotated[
        float | None, "largest difference of re-simulated and collocated states at an element edge, in nominals"
    ] = None
    clearance: Annotated[
        float | None,
        Quantity("m", "lower bound of all distances of two links, or of a link from an obstacle, at every instant"),
    ] = None
    nearest: Annotated[Sequence[str], "the two bodies at this distance"] = ()
    nearest_time: Annotated[float | None, Quantity("s", "time of this distance")] = None
    pairs: Annotated[int | None, "number of pairs whose distance is checked"] = None
    constrained: Annotated[Sequence[str], "pairs whose distance is a constraint of the optimisation"] = ()
    refined: bool = False

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("final time", self.final_time, "s")] if self.final_time is not None else []
        if self.passed is None:
            return rows
        if len(self.passed):
            rows.append(Row("waypoints passed at", listed(self.passed), "s"))
        rows += [
            Row("largest share of the speed limits", listed(np.round(100 * np.array(self.peak_speed), 1)), "%"),
            Row("largest share of the effort limits", listed(np.round(100 * np.array(self.peak_effort), 1)), "%"),
        ]
        if self.clearance is not None and self.nearest_time is not None:
            rows += [
                Row("smallest distance", 1e3 * self.clearance, "mm"),
                Row("  between", " and ".join(self.nearest)),
                Row("  at", self.nearest_time, "s"),
                Row("pairs checked", self.pairs),
                Row("pairs in the optimisation", ", ".join(self.constrained) or "none"),
            ]
        if self.refined:
            rows.append(Row("mesh elements after refinement", self.elements))
        return rows


def joints_of(pose: ArmPose, revolute: Sequence[bool], where: str) -> Array | None:
    """Return the joint coordinates (n,) [rad, m] of a pose; None if it gives the tool centre point. Raises
    ArgumentError about an argument of the field `where`."""
    from ...results import ArgumentError

    given: dict[str, Any] = {"q": pose.q, "slides": pose.slides, "tcp": pose.tcp, "rpy": pose.rpy}
    if pose.tcp is not None:
        for name in ("q", "slides"):
            if given[name] is not None:
                raise ArgumentError("gives joints and tool centre point; leave one out", f"{where}.{name}")
        return None
    if pose.rpy is not None:
        raise ArgumentError("is the orientation at a tool centre point; add tcp, or leave it out", f"{where}.rpy")
    q = np.zeros(len(revolute))
    for name, turns in (("q", True), ("slides", False)):
        places = np.flatnonzero(np.array(revolute) == turns)
        values = given[name] or []
        if len(values) != len(places):
            what = "turn" if turns else "slide"
            advice = ", or the tool centre point tcp" if given[name] is None else ""
            raise ArgumentError(
                f"has {len(values)} numbers; expected {len(places)}, one for each joint that can {what}{advice}",
                f"{where}.{name}",
            )
        q[places] = values
    return q
