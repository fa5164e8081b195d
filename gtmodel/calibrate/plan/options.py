"""What a calibration plan asks for: a room, a device, safety, poses, criteria."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...kinematics.workspace import options
from ...results.options import Long, Options, Unit, Within

Pair = Annotated[list[float], Long(2)]
Point = Annotated[list[float], Long(3)]
Method = Literal["I", "D", "E", "condition", "condition_one_by_one", "grid"]
DEGREE, MICRO = math.pi / 180, 1e-6


@dataclass(frozen=True)
class Room(Options):
    """The box in which poses are looked for: the room."""

    low: Annotated[list[float], Unit("m"), Long(3), "its least corner"]
    high: Annotated[list[float], Unit("m"), Long(3), "its greatest corner"]
    step: Annotated[float, Unit("m"), Within(above=0.0), "of the grid of candidates"] = 0.1
    turns: Annotated[
        list[Point], Unit("rad", written="deg"),
        "of an F1: turns of the plate from home at each point, rotation vectors in plate axes",
    ] = field(default_factory=lambda: [[0.0, 0.0, 0.0]])  # fmt: skip


@dataclass(frozen=True)
class Safety(Options):
    """Distances kept because the robot is not yet calibrated."""

    edge: Annotated[float, Unit("m"), Within(least=0.0), "from the edge of the measurable workspace"] = 0.1
    obstacles: Annotated[float, Unit("m"), Within(least=0.0), "around obstacles and beams"] = 0.05
    cone: Annotated[float, Unit("rad", written="deg"), Within(least=0.0), "taken off limits.cone_deg"] = 0.0
    stroke: Annotated[float, Unit("m"), Within(least=0.0), "taken off both ends of limits.actuators_m"] = 0.05
    axes: Annotated[
        float, Unit("rad", written="deg"), Within(least=0.0), "taken off both ends of limits.axes_deg"
    ] = 0.0  # fmt: skip


@dataclass(frozen=True)
class PlanLimits(options.WorkspaceLimits):
    """What poses must keep."""

    axes: Annotated[
        list[Pair] | None, Unit("rad", written="deg"), "least and greatest angle of every rotary axis"
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Tracker(Options):
    """A laser tracker, which measures a distance and two angles."""

    at: Annotated[list[float], Unit("m"), Long(3), "where it stands, in the robot's frame"]
    range_noise: Annotated[
        float, Unit("m", written="um"), Within(above=0.0), "standard deviation of the distance"
    ] = 10 * MICRO  # fmt: skip
    range_noise_per_metre: Annotated[
        float, Unit("1", written="um/m", key="range_noise_um_per_m"), Within(least=0.0),
        "of the distance, per metre of it",
    ] = 0.0  # fmt: skip
    angle_noise: Annotated[
        float, Unit("rad", written="urad"), Within(above=0.0), "standard deviation of each angle"
    ] = 7 * MICRO  # fmt: skip
    orientation_noise: Annotated[
        float | None, Unit("rad", written="urad"), Within(above=0.0),
        "of a target with orientation, for robots whose plate turns; none if left out",
    ] = None  # fmt: skip
    target_axis: Annotated[
        list[float] | None, Long(3),
        "where a target with orientation looks, in plate coordinates; any way if left out",
    ] = None  # fmt: skip
    acceptance: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi),
        "greatest angle between target_axis and the way to the tracker",
    ] = 45 * DEGREE  # fmt: skip
    nearest: Annotated[float, Unit("m"), Within(least=0.0), "least distance"] = 0.5
    farthest: Annotated[float, Unit("m"), Within(above=0.0), "greatest distance"] = 30.0
    elevation: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi / 2),
        "greatest angle above and below the horizontal",
    ] = 60 * DEGREE  # fmt: skip


@dataclass(frozen=True)
class PatternCamera(Options):
    """A fixed camera that sees a pattern on the plate."""

    at: Annotated[list[float], Unit("m"), Long(3), "where it stands, in the robot's frame"]
    looks_at: Annotated[list[float], Unit("m"), Long(3), "a point in the middle of its picture"]
    focal_pixel: Annotated[float, Within(above=0.0), "focal length"] = 1500.0
    width_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1600.0
    height_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1200.0
    pattern: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "side of the square pattern"] = 0.2
    marks: Annotated[int, Within(least=2, most=50), "per side of the pattern"] = 7
    pixel_noise: Annotated[float, Within(above=0.0), "standard deviation of a mark's coordinates, pixel"] = 0.1
    distortion: Annotated[list[float], Long(5), "of the lens, k1, k2, p1, p2, k3"] = field(
        default_factory=lambda: [0.0] * 5
    )


@dataclass(frozen=True)
class Wire(Options):
    """A wire sensor, a bar or an interferometer: the distance of the tool centre point from one point."""

    at: Annotated[list[float], Unit("m"), Long(3), "the point, in the robot's frame, known"]
    noise: Annotated[float, Unit("m", written="um"), Within(above=0.0), "standard deviation"] = 10 * MICRO
    nearest: Annotated[float, Unit("m"), Within(least=0.0), "least distance"] = 0.0
    farthest: Annotated[float, Unit("m"), Within(above=0.0), "greatest distance"] = 10.0


@dataclass(frozen=True)
class Gauge(Options):
    """A dial gauge over a plane, or one coordinate: the height of the tool centre point above a known plane."""

    normal: Annotated[list[float], Long(3), "of the plane; [1, 0, 0] measures the coordinate x"]
    point: Annotated[list[float], Unit("m"), Long(3), "a point of the plane"] = field(
        default_factory=lambda: [0.0, 0.0, 0.0]
    )
    noise: Annotated[float, Unit("m", written="um"), Within(above=0.0), "standard deviation"] = 10 * MICRO
    low: Annotated[float, Unit("m"), "least height that is measured"] = -10.0
    high: Annotated[float, Unit("m"), "greatest height that is measured"] = 10.0


AnyDevice = Tracker | PatternCamera | Wire | Gauge


@dataclass(frozen=True)
class PosesToMeasure(Options):
    """Which poses, and how many."""

    number: Annotated[int, Within(above=0), "of poses to calibrate with, at first"] = 30
    more: Annotated[int, Within(above=0), "poses added while the criteria are not met"] = 10
    most: Annotated[int, Within(above=0), "greatest number of poses"] = 60
    held_out: Annotated[int, Within(least=0), "further poses, to judge the result by"] = 20
    method: Annotated[
        Method,
        "I: least error over the workspace; D, E: of determinant, least eigenvalue; condition: eq. (5.9), "
        "at once or one by one; grid: a regular one of about the number",
    ] = "I"
    repeats: Annotated[int, Within(above=0), "how often a pose may be chosen by I, D and E"] = 2
    starts: Annotated[int, Within(above=0), "random starts of the exchange"] = 3
    seed: Annotated[int, Within(least=0), "of starts and of the order of poses"] = 1
    settle: Annotated[float, Unit("s"), Within(least=0.0), "wait at each pose of the robot program"] = 2.0


@dataclass(frozen=True)
class Criteria(Options):
    """What the plan must reach before anything is measured."""

    accuracy: Annotated[
        float, Unit("m", written="mm"), Within(above=0.0),
        "rms positioning error over the workspace that noise may cause",
    ] = 1e-4  # fmt: skip
    condition: Annotated[
        float | None, Within(above=0.0), "greatest condition number of the derivatives in units of the expected errors"
    ] = None  # fmt: skip
    noise_amplification: Annotated[
        float | None, Within(above=0.0),
        "least index O4, least singular value squared over the greatest; in these units",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Evaluation(Options):
    """Where the robot must be accurate; all that it reaches without safety distances if left out."""

    low: Annotated[list[float], Unit("m"), Long(3), "least corner of a box"]
    high: Annotated[list[float], Unit("m"), Long(3), "greatest corner"]
    counts: Annotated[list[int], Within(least=2, most=200), Long(3), "points along x, y, z"] = field(
        default_factory=lambda: [9, 5, 5]
    )


@dataclass(frozen=True)
class PlanSimulation(Options):
    """Simulated calibrations with the device's noise; synthetic."""

    runs: Annotated[int, Within(least=0, most=10000), "how many"] = 20
    start_error: Annotated[
        float, Unit("m", written="mm"), Within(least=0.0),
        "standard deviation of the parameters' error at the start; 1e-3 of it for numbers",
    ] = 5e-3  # fmt: skip
    seed: Annotated[int, Within(least=0), "of noise and start errors"] = 1
