"""What one plan is about: robot, device, room and all options, as `plan_study` takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ...kinematics.workspace.options import Beam, Bodies, Box
from ...lang import Model
from ..unknowns import Choice
from .options import AnyDevice, Criteria, Evaluation, PlanLimits, PosesToMeasure, Room, Safety, Simulation

CURVE = (10, 15, 20, 30, 40, 60, 80, 100)


@dataclass(frozen=True, eq=False)
class Task:
    """The arguments of `plan_study`."""

    robot: Model
    device: AnyDevice
    room: Room
    choice: Choice = field(default_factory=Choice)
    home: Sequence[float] | None = None
    limits: PlanLimits = field(default_factory=PlanLimits)
    bodies: Bodies = field(default_factory=Bodies)
    obstacles: Sequence[Box] = ()
    beams: Sequence[Beam] = ()
    safety: Safety = field(default_factory=Safety)
    actuator_noise: float = 13e-6
    axis_noise: float = 20e-6
    poses: PosesToMeasure = field(default_factory=PosesToMeasure)
    curve: Sequence[int] = CURVE
    evaluation: Evaluation | None = None
    simulation: Simulation = field(default_factory=Simulation)
    criteria: Criteria = field(default_factory=Criteria)
    title: str = ""
