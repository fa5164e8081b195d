"""What one plan is about: robot, device, room and all options, as `plan_study` takes them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from ..._lazy import hint
from ...kinematics.workspace.options import Beam, Bodies, Box
from ...results.options import Long, Options, Unit, Within
from ..choice import Choice
from .options import MICRO, AnyDevice, Criteria, Evaluation, PlanLimits, PlanSimulation, PosesToMeasure, Room, Safety

if TYPE_CHECKING:
    from ...lang import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

CURVE = (10, 15, 20, 30, 40, 60, 80, 100)


@dataclass(frozen=True, eq=False)
class Task(Options):
    """The arguments of `plan_study`, from which the keys of its files are made. Raises ArgumentError for numbers out of
    bounds."""

    robot: Model
    device: AnyDevice
    room: Annotated[Room, "where poses are looked for"]
    choice: Choice = field(default_factory=Choice)
    home: Annotated[
        list[float] | None, Unit("m"), Long(3), "pose of the cone axes; the robot's own home if left out"
    ] = None  # fmt: skip
    limits: PlanLimits = field(default_factory=PlanLimits)
    bodies: Bodies = field(default_factory=Bodies)
    obstacles: Annotated[list[Box], "boxes that links and plate must not touch, nor hide"] = field(default_factory=list)
    beams: Annotated[list[Beam], "beams of the frame that links must not touch"] = field(default_factory=list)
    safety: Safety = field(default_factory=Safety)
    actuator_noise: Annotated[
        float, Unit("m", written="um"), Within(least=0.0), "repeatability of the carts"
    ] = 13 * MICRO  # fmt: skip
    axis_noise: Annotated[
        float, Unit("rad", written="urad"), Within(above=0.0), "of an F1's rotary axes"
    ] = 20 * MICRO  # fmt: skip
    poses: PosesToMeasure = field(default_factory=PosesToMeasure)
    curve: Annotated[
        list[int], Within(above=0),
        "numbers of poses for the curve of predicted errors, with the number that suffices; [] for none",
    ] = field(default_factory=lambda: list(CURVE))  # fmt: skip
    evaluation: Annotated[Evaluation | None, "where the robot must be accurate"] = None
    simulation: PlanSimulation = field(default_factory=PlanSimulation)
    criteria: Criteria = field(default_factory=Criteria)
    title: str = ""
