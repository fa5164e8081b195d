"""The keys of kind "calibration_plan"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Section
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.section_keys import Pair

from .workspace.keys import Beam, Bodies, Box, Limits, Point

Count = Annotated[int, Field(ge=2, le=200)]


class RoomKeys(Section):
    """The box in which poses are looked for: the room."""

    low_m: Point = Field(description="its least corner")
    high_m: Point = Field(description="its greatest corner")
    step_m: PositiveFloat = Field(default=0.1, description="of the grid of candidates")
    turns_deg: list[Point] = Field(
        default=[[0.0, 0.0, 0.0]],
        description="of an F1: turns of the plate from home at each point, rotation vectors in plate axes",
        min_length=1,
    )


class SafetyKeys(Section):
    """Distances kept because the robot is not yet calibrated."""

    edge_m: NonNegativeFloat = Field(default=0.1, description="from the edge of the measurable workspace")
    obstacles_m: NonNegativeFloat = Field(default=0.05, description="around obstacles and beams")
    cone_deg: NonNegativeFloat = Field(default=0.0, description="taken off limits.cone_deg")
    stroke_m: NonNegativeFloat = Field(default=0.05, description="taken off both ends of limits.actuators_m")
    axes_deg: NonNegativeFloat = Field(default=0.0, description="taken off both ends of limits.axes_deg")


class PlanLimits(Limits):
    """What poses must keep."""

    axes_deg: list[Pair] | None = Field(default=None, description="least and greatest angle of every rotary axis")


class TrackerKeys(Section):
    """A laser tracker, which measures a distance and two angles."""

    kind: Literal["laser_tracker"] = Field(description="which device")
    at_m: Point = Field(description="where it stands, in the robot's frame")
    range_noise_um: PositiveFloat = Field(default=10.0, description="standard deviation of the distance")
    range_noise_um_per_m: NonNegativeFloat = Field(default=0.0, description="of the distance, per metre of it")
    angle_noise_urad: PositiveFloat = Field(default=7.0, description="standard deviation of each angle")
    orientation_noise_urad: PositiveFloat | None = Field(
        default=None, description="of a target with orientation, for robots whose plate turns; none if left out"
    )
    target_axis: Point | None = Field(
        default=None, description="where a target with orientation looks, in plate coordinates; any way if left out"
    )
    acceptance_deg: Annotated[float, Field(gt=0, le=180)] = Field(
        default=45.0, description="greatest angle between target_axis and the way to the tracker"
    )
    nearest_m: NonNegativeFloat = Field(default=0.5, description="least distance")
    farthest_m: PositiveFloat = Field(default=30.0, description="greatest distance")
    elevation_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        default=60.0, description="greatest angle above and below the horizontal"
    )


class CameraKeys(Section):
    """A fixed camera that sees a pattern on the plate."""

    kind: Literal["camera"] = Field(description="which device")
    at_m: Point = Field(description="where it stands, in the robot's frame")
    looks_at_m: Point = Field(description="a point in the middle of its picture")
    focal_pixel: PositiveFloat = Field(default=1500.0, description="focal length")
    width_pixel: PositiveFloat = Field(default=1600.0, description="of the picture")
    height_pixel: PositiveFloat = Field(default=1200.0, description="of the picture")
    pattern_mm: PositiveFloat = Field(default=200.0, description="side of the square pattern")
    marks: Annotated[int, Field(ge=2, le=50)] = Field(default=7, description="per side of the pattern")
    pixel_noise: PositiveFloat = Field(default=0.1, description="standard deviation of a mark's coordinates, pixel")


class DistanceKeys(Section):
    """A wire sensor, a bar or an interferometer: the distance of the tool centre point from one point."""

    kind: Literal["distance"] = Field(description="which device")
    at_m: Point = Field(description="the point, in the robot's frame, known")
    noise_um: PositiveFloat = Field(default=10.0, description="standard deviation")
    nearest_m: NonNegativeFloat = Field(default=0.0, description="least distance")
    farthest_m: PositiveFloat = Field(default=10.0, description="greatest distance")


class PlaneKeys(Section):
    """A dial gauge over a plane, or one coordinate: the height of the tool centre point above a known plane."""

    kind: Literal["plane"] = Field(description="which device")
    normal: Point = Field(description="of the plane; [1, 0, 0] measures the coordinate x")
    point_m: Point = Field(default=[0.0, 0.0, 0.0], description="a point of the plane")
    noise_um: PositiveFloat = Field(default=10.0, description="standard deviation")
    low_m: float = Field(default=-10.0, description="least height that is measured")
    high_m: float = Field(default=10.0, description="greatest height that is measured")


DeviceKeys = Annotated[TrackerKeys | CameraKeys | DistanceKeys | PlaneKeys, Field(discriminator="kind")]


class PoseKeys(Section):
    """Which poses, and how many."""

    number: PositiveInt = Field(default=30, description="of poses to calibrate with, at first")
    more: PositiveInt = Field(default=10, description="poses added while the criteria are not met")
    most: PositiveInt = Field(default=60, description="greatest number of poses")
    held_out: Annotated[int, Field(ge=0)] = Field(default=20, description="further poses, to judge the result by")
    method: Literal["I", "D", "E", "condition", "condition_one_by_one", "grid"] = Field(
        default="I",
        description="I: least error over the workspace; D, E: of determinant, least eigenvalue; condition: eq. (5.9), "
        "at once or one by one; grid: a regular one of about the number",
    )
    repeats: PositiveInt = Field(default=2, description="how often a pose may be chosen by I, D and E")
    starts: PositiveInt = Field(default=3, description="random starts of the exchange")
    seed: Annotated[int, Field(ge=0)] = Field(default=1, description="of starts and of the order of poses")
    settle_s: NonNegativeFloat = Field(default=2.0, description="wait at each pose of the robot program")


class CriteriaKeys(Section):
    """What the plan must reach before anything is measured."""

    accuracy_mm: PositiveFloat = Field(
        default=0.1, description="rms positioning error over the workspace that noise may cause"
    )
    condition: PositiveFloat | None = Field(
        default=None, description="greatest condition number of the slopes in units of the expected errors"
    )
    noise_amplification: PositiveFloat | None = Field(
        default=None, description="least index O4, least singular value squared over the greatest; in these units"
    )


class EvaluationKeys(Section):
    """Where the robot must be accurate; all that it reaches without safety distances if left out."""

    low_m: Point = Field(description="least corner of a box")
    high_m: Point = Field(description="greatest corner")
    counts: Annotated[list[Count], Field(min_length=3, max_length=3)] = Field(
        default=[9, 5, 5], description="points along x, y, z"
    )


class SimulationKeys(Section):
    """Simulated calibrations with the device's noise; synthetic."""

    runs: Annotated[int, Field(ge=0, le=10000)] = Field(default=20, description="how many")
    start_error_mm: NonNegativeFloat = Field(
        default=5.0, description="standard deviation of the parameters' error at the start; 1e-3 of it for numbers"
    )
    seed: Annotated[int, Field(ge=0)] = Field(default=1, description="of noise and start errors")


class Schema(RobotProblem):
    """A calibration planned before anything is measured (Dressler 2012, Fig. 5.21)."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's own home if left out")
    limits: PlanLimits = PlanLimits()
    bodies: Bodies = Bodies()
    obstacles: list[Box] = Field(default=[], description="boxes that links and plate must not touch, nor hide")
    beams: list[Beam] = Field(default=[], description="beams of the frame that links must not touch")

    free: list[str] = Field(default=[], description="parameters to calibrate, scalars, rows or whole; all if left out")
    fixed: list[str] = Field(default=[], description="parameters to leave, stronger than free")
    tied: dict[str, str] = Field(default={}, description="parameter -> parameter that it follows")
    unit_quaternions: list[str] = Field(default=[], description="quaternions that are turned at length one")
    sizes: dict[str, PositiveFloat] = Field(default={}, description="expected error of a parameter in SI; 0.001")
    room: RoomKeys = Field(description="where poses are looked for")
    safety: SafetyKeys = SafetyKeys()
    device: DeviceKeys = Field(description="what measures")
    actuator_noise_um: NonNegativeFloat = Field(default=13.0, description="repeatability of the carts")
    axis_noise_urad: PositiveFloat = Field(default=20.0, description="of an F1's rotary axes")
    poses: PoseKeys = PoseKeys()
    curve: list[PositiveInt] = Field(
        default=[10, 15, 20, 30, 40, 60, 80, 100],
        description="numbers of poses for the curve of predicted errors, with the number that suffices; [] for none",
    )
    evaluation: EvaluationKeys | None = Field(default=None, description="where the robot must be accurate")
    simulation: SimulationKeys = SimulationKeys()
    criteria: CriteriaKeys = CriteriaKeys()
