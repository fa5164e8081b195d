"""What one plan is about: robot, device, room and all options, as `plan_study` takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

from ...kinematics.workspace.options import Beam, Bodies, Box
from ...lang import Model
from ...results.options import Long, Options, Within
from ..unknowns import Choice
from .options import MICRO, AnyDevice, Criteria, Evaluation, PlanLimits, PosesToMeasure, Room, Safety, Simulation

CURVE = (10, 15, 20, 30, 40, 60, 80, 100)


@dataclass(frozen=True, eq=False)
class Task(Options):
    """The arguments of `plan_study`, in its units. Raises ArgumentError for numbers out of bounds."""

    robot: Model
    device: AnyDevice
    room: Room
    choice: Choice = field(default_factory=Choice)
    home: Annotated[Sequence[float] | None, Long(3)] = None
    limits: PlanLimits = field(default_factory=PlanLimits)
    bodies: Bodies = field(default_factory=Bodies)
    obstacles: Sequence[Box] = ()
    beams: Sequence[Beam] = ()
    safety: Safety = field(default_factory=Safety)
    actuator_noise: Annotated[float, Within(least=0.0)] = 13 * MICRO
    axis_noise: Annotated[float, Within(above=0.0)] = 20 * MICRO
    poses: PosesToMeasure = field(default_factory=PosesToMeasure)
    curve: Annotated[Sequence[int], Within(above=0)] = CURVE
    evaluation: Evaluation | None = None
    simulation: Simulation = field(default_factory=Simulation)
    criteria: Criteria = field(default_factory=Criteria)
    title: str = ""
