"""The keys of kind "calibration_plan"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.calibrate.plan import options
from gtmodel.calibrate.plan.task import CURVE
from gtmodel.kinds.workspace.keys import Beam, Bodies, Box, Point
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(options.Room)
class Room(Made):
    """The box in which poses are looked for: the room."""


@made_from(options.Safety)
class Safety(Made):
    """Distances kept because the robot is not yet calibrated."""


@made_from(options.PlanLimits)
class Limits(Made):
    """What poses must keep."""


@made_from(options.Tracker)
class Tracker(Made):
    """A laser tracker, which measures a distance and two angles."""

    kind: Literal["laser_tracker"] = Field(description="which device")


@made_from(options.PatternCamera)
class Camera(Made):
    """A fixed camera that sees a pattern on the plate."""

    kind: Literal["camera"] = Field(description="which device")


@made_from(options.Wire)
class Wire(Made):
    """A wire sensor, a bar or an interferometer: the distance of the tool centre point from one point."""

    kind: Literal["distance"] = Field(description="which device")


@made_from(options.Gauge)
class Gauge(Made):
    """A dial gauge over a plane, or one coordinate: the height of the tool centre point above a known plane."""

    kind: Literal["plane"] = Field(description="which device")


@made_from(options.PosesToMeasure)
class Poses(Made):
    """Which poses, and how many."""


@made_from(options.Evaluation)
class Evaluation(Made):
    """Where the robot must be accurate; all that it reaches without safety distances if left out."""


@made_from(options.Simulation)
class Simulation(Made):
    """Simulated calibrations with the device's noise; synthetic."""


@made_from(options.Criteria)
class Criteria(Made):
    """What the plan must reach before anything is measured."""


class Schema(RobotProblem):
    """A calibration planned before anything is measured (Dressler 2012, Fig. 5.21)."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's own home if left out")
    limits: Limits = Limits()
    bodies: Bodies = Bodies()
    obstacles: list[Box] = Field(default=[], description="boxes that links and plate must not touch, nor hide")
    beams: list[Beam] = Field(default=[], description="beams of the frame that links must not touch")

    free: list[str] = Field(default=[], description="parameters to calibrate, scalars, rows or whole; all if left out")
    fixed: list[str] = Field(default=[], description="parameters to leave, stronger than free")
    tied: dict[str, str] = Field(default={}, description="parameter -> parameter that it follows")
    unit_quaternions: list[str] = Field(default=[], description="quaternions that are turned at length one")
    sizes: dict[str, PositiveFloat] = Field(default={}, description="expected error of a parameter in SI; 0.001")
    room: Room = Field(description="where poses are looked for")
    safety: Safety = Safety()
    device: Annotated[Tracker | Camera | Wire | Gauge, Field(discriminator="kind", description="what measures")]
    actuator_noise_um: NonNegativeFloat = Field(default=13.0, description="repeatability of the carts")
    axis_noise_urad: PositiveFloat = Field(default=20.0, description="of an F1's rotary axes")
    poses: Poses = Poses()
    curve: list[PositiveInt] = Field(
        default=list(CURVE),
        description="numbers of poses for the curve of predicted errors, with the number that suffices; [] for none",
    )
    evaluation: Evaluation | None = Field(default=None, description="where the robot must be accurate")
    simulation: Simulation = Simulation()
    criteria: Criteria = Criteria()
