"""What one motion is asked to be, all of it in one object."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .._lazy import hint
from ..results import Options
from .options import Cost, End, Export, Limits, MotionMesh, Shape, Solver, Starts

if TYPE_CHECKING:
    from ..lang import Model
else:
    Model = hint("gtmodel.lang.model", "Model")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProblem(Options):
    """A robot's motion from one pose to another.

    robot: declares T, the tool centre point (3,) [m], and tau, the motor forces (3,) [N].
    start, goal: its ends. limits: what it must keep. path: what it follows; free if None.
    cost, mesh, starts, solver: what is minimised, and how it is searched. export: of the files for a controller.

    Raises ArgumentError for objects of other classes.

    >>> problem = gt.motion.MotionProblem(
    ...     robot=gt.robots.gantry_tau("l1_tape"), limits=gt.motion.Limits(force=700.0),
    ...     start=gt.motion.End([0.0, -0.9, 0.1]), goal=gt.motion.End([0.2, -0.9, 0.2]),
    ... )
    >>> problem.order is None  # a free motion: the motor forces are its control
    True
    """

    robot: Model
    start: End
    goal: End
    limits: Limits
    path: Shape | None = None
    cost: Cost = field(default_factory=Cost)
    mesh: MotionMesh = field(default_factory=MotionMesh)
    starts: Starts = field(default_factory=Starts)
    solver: Solver = field(default_factory=Solver)
    export: Export = field(default_factory=Export)
    title: str = ""

    @property
    def begin(self) -> np.ndarray:
        """Tool centre point (3,) at the start [m]."""
        return np.array(self.start.tcp)

    @property
    def end(self) -> np.ndarray:
        """Tool centre point (3,) at the goal [m]."""
        return np.array(self.goal.tcp)

    @property
    def order(self) -> int | None:
        """The derivative of the motion that is the control; None: the forces are.

        A constant force on an element holds neither an acceleration nor a speed: friction changes within milliseconds.
        """
        limits = self.limits
        if limits.tcp_jerk is not None:
            return 3
        rates = (limits.tcp_velocity, limits.cart_velocity, limits.tcp_acceleration, limits.cart_acceleration)
        return 2 if self.path is not None or any(limit is not None for limit in rates) else None
