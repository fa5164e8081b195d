"""What one motion of six axes is asked to be, all of it in one object."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ...lang import Model
from ...results import Trajectory
from ..options import AxisLimits, Shape
from .options import AxisCost, AxisEnd, AxisMesh, AxisSolver, ToolCourse


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisProblem:
    """A motion of the F1 from rest to rest, free between two positions of its axes or along a path.

    start, goal: its ends. limits: what it must keep. path: what it follows, `tool` how the tool is held on it.
    degrees_of_freedom: 5 keeps q4 = -q5 all the way, 6 leaves all axes free.
    cost, mesh, solver: what is minimised, and how it is searched. earlier: a motion of an earlier result to start from.
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
