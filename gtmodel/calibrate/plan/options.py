"""Options of a calibration plan (room, device, safety, poses, criteria), and its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from ..._lazy import hint
from ...kinematics.workspace import options
from ...kinematics.workspace.options import Beam, Bodies, Box
from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ..options import Choice

if TYPE_CHECKING:
    from ...lang import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

Pair = Annotated[list[float], Long(2)]
Point = Annotated[list[float], Long(3)]
Method = Literal["I", "D", "E", "condition", "condition_one_by_one", "grid"]
DEGREE, MICRO = math.pi / 180, 1e-6


@dataclass(frozen=True)
class Room(Options):
    """The box in which poses are selected."""

    low: Annotated[list[float], Unit("m"), Long(3), "lower corner"]
    high: Annotated[list[float], Unit("m"), Long(3), "upper corner"]
    step: Annotated[float, Unit("m"), Within(above=0.0), "step of the grid of candidates"] = 0.1
    turns: Annotated[
        list[Point], Unit("rad", written="deg"),
        "F1 only: orientations of the plate at each point, as rotation vectors from home in plate axes",
    ] = field(default_factory=lambda: [[0.0, 0.0, 0.0]])  # fmt: skip


@dataclass(frozen=True)
class Safety(Options):
    """Distances kept because the robot is not yet calibrated."""

    edge: Annotated[float, Unit("m"), Within(least=0.0), "distance from the edge of the measurable workspace"] = 0.1
    obstacles: Annotated[float, Unit("m"), Within(least=0.0), "around obstacles and beams"] = 0.05
    cone: Annotated[float, Unit("rad", written="deg"), Within(least=0.0), "subtracted from limits.cone_deg"] = 0.0
    stroke: Annotated[float, Unit("m"), Within(least=0.0), "at both ends of limits.actuators_m"] = 0.05
    axes: Annotated[
        float, Unit("rad", written="deg"), Within(least=0.0), "at both ends of limits.axes_deg"
    ] = 0.0  # fmt: skip


@dataclass(frozen=True)
class PlanLimits(options.WorkspaceLimits):
    """Limits that poses must respect."""

    axes: Annotated[
        list[Pair] | None, Unit("rad", written="deg"), "smallest and largest angle of every rotary axis"
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Tracker(Options):
    """A laser tracker: measures a distance and two angles."""

    at: Annotated[list[float], Unit("m"), Long(3), "its position in the robot's frame"]
    range_noise: Annotated[
        float, Unit("m", written="um"), Within(above=0.0), "standard deviation of the distance"
    ] = 10 * MICRO  # fmt: skip
    range_noise_per_metre: Annotated[
        float, Unit("1", written="um/m", key="range_noise_um_per_m"), Within(least=0.0),
        "standard deviation of the distance per metre",
    ] = 0.0  # fmt: skip
    angle_noise: Annotated[
        float, Unit("rad", written="urad"), Within(above=0.0), "standard deviation of each angle"
    ] = 7 * MICRO  # fmt: skip
    orientation_noise: Annotated[
        float | None, Unit("rad", written="urad"), Within(above=0.0),
        "standard deviation of the orientation of a 6D target, for plates that turn; not measured if left out",
    ] = None  # fmt: skip
    target_axis: Annotated[
        list[float] | None, Long(3),
        "viewing direction of a 6D target in plate coordinates; any direction if left out",
    ] = None  # fmt: skip
    acceptance: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi),
        "largest angle between target_axis and the direction to the tracker",
    ] = 45 * DEGREE  # fmt: skip
    nearest: Annotated[float, Unit("m"), Within(least=0.0), "smallest distance"] = 0.5
    farthest: Annotated[float, Unit("m"), Within(above=0.0), "largest distance"] = 30.0
    elevation: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi / 2),
        "largest angle above and below the horizontal",
    ] = 60 * DEGREE  # fmt: skip


@dataclass(frozen=True)
class PatternCamera(Options):
    """A fixed camera that sees a pattern on the plate."""

    at: Annotated[list[float], Unit("m"), Long(3), "its position in the robot's frame"]
    looks_at: Annotated[list[float], Unit("m"), Long(3), "a point in the centre of its image"]
    focal_pixel: Annotated[float, Within(above=0.0), "focal length"] = 1500.0
    width_pixel: Annotated[float, Within(above=0.0), "width of the image"] = 1600.0
    height_pixel: Annotated[float, Within(above=0.0), "height of the image"] = 1200.0
    pattern: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "side of the square pattern"] = 0.2
    marks: Annotated[int, Within(least=2, most=50), "marks per side of the pattern"] = 7
    pixel_noise: Annotated[float, Within(above=0.0), "standard deviation of a mark's coordinates, pixel"] = 0.1
    distortion: Annotated[list[float], Long(5), "lens distortion k1, k2, p1, p2, k3"] = field(
        default_factory=lambda: [0.0] * 5
    )


@dataclass(frozen=True)
class Wire(Options):
    """A wire sensor, ball-bar or interferometer: the distance of the tool centre point from a known point."""

    at: Annotated[list[float], Unit("m"), Long(3), "the known point in the robot's frame"]
    noise: Annotated[float, Unit("m", written="um"), Within(above=0.0), "standard deviation"] = 10 * MICRO
    nearest: Annotated[float, Unit("m"), Within(least=0.0), "smallest distance"] = 0.0
    farthest: Annotated[float, Unit("m"), Within(above=0.0), "largest distance"] = 10.0


@dataclass(frozen=True)
class Gauge(Options):
    """A dial gauge over a plane, or one coordinate: the height of the tool centre point above a known plane."""

    normal: Annotated[list[float], Long(3), "normal of the plane; [1, 0, 0] measures the x coordinate"]
    point: Annotated[list[float], Unit("m"), Long(3), "a point of the plane"] = field(
        default_factory=lambda: [0.0, 0.0, 0.0]
    )
    noise: Annotated[float, Unit("m", written="um"), Within(above=0.0), "standard deviation"] = 10 * MICRO
    low: Annotated[float, Unit("m"), "smallest height that can be measured"] = -10.0
    high: Annotated[float, Unit("m"), "largest height that can be measured"] = 10.0


AnyDevice = Tracker | PatternCamera | Wire | Gauge


@dataclass(frozen=True)
class PosesToMeasure(Options):
    """Selection and number of poses."""

    number: Annotated[int, Within(above=0), "number of poses to calibrate with, at first"] = 30
    more: Annotated[int, Within(above=0), "poses added while the criteria are not met"] = 10
    most: Annotated[int, Within(above=0), "largest number of poses"] = 60
    held_out: Annotated[int, Within(least=0), "further poses to verify the result"] = 20
    method: Annotated[
        Method,
        "I: smallest error over the workspace; D, E: by determinant or smallest eigenvalue of the information; "
        "condition: eq. (5.9), at once or one by one; grid: a regular one with about that number",
    ] = "I"
    repeats: Annotated[int, Within(above=0), "how often I, D and E may choose a pose"] = 2
    starts: Annotated[int, Within(above=0), "random starts of the exchange"] = 3
    seed: Annotated[int, Within(least=0), "seed of the starts and of the order of poses"] = 1
    settle: Annotated[float, Unit("s"), Within(least=0.0), "wait at each pose of the robot program"] = 2.0


@dataclass(frozen=True)
class Criteria(Options):
    """Criteria that the plan must meet before anything is measured."""

    accuracy: Annotated[
        float, Unit("m", written="mm"), Within(above=0.0),
        "largest rms positioning error over the workspace due to noise",
    ] = 1e-4  # fmt: skip
    condition: Annotated[
        float | None, Within(above=0.0), "largest condition number of the Jacobian in units of the expected errors"
    ] = None  # fmt: skip
    noise_amplification: Annotated[
        float | None, Within(above=0.0),
        "smallest index O4 (smallest singular value squared over the largest), in the same units",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Evaluation(Options):
    """Where the robot must be accurate; by default everywhere it reaches without safety distances."""

    low: Annotated[list[float], Unit("m"), Long(3), "lower corner of a box"]
    high: Annotated[list[float], Unit("m"), Long(3), "upper corner"]
    counts: Annotated[list[int], Within(least=2, most=200), Long(3), "points along x, y, z"] = field(
        default_factory=lambda: [9, 5, 5]
    )


@dataclass(frozen=True)
class PlanSimulation(Options):
    """Simulated calibrations with the device's noise; synthetic."""

    runs: Annotated[int, Within(least=0, most=10000), "number of simulated calibrations"] = 20
    start_error: Annotated[
        float, Unit("m", written="mm"), Within(least=0.0),
        "standard deviation of the parameters' start errors; for dimensionless parameters 1e-3 of the number",
    ] = 5e-3  # fmt: skip
    seed: Annotated[int, Within(least=0), "seed of noise and start errors"] = 1


CURVE = (10, 15, 20, 30, 40, 60, 80, 100)


@dataclass(frozen=True, eq=False)
class Task(Options):
    """The arguments of `plan_study`; the keys of its files are made from them.

    Raises ArgumentError for numbers out of bounds."""

    robot: Model
    device: AnyDevice
    room: Annotated[Room, "box in which poses are selected"]
    choice: Choice = field(default_factory=Choice)
    home: Annotated[
        list[float] | None, Unit("m"), Long(3), "pose of the cone axes; the robot's home if left out"
    ] = None  # fmt: skip
    limits: PlanLimits = field(default_factory=PlanLimits)
    bodies: Bodies = field(default_factory=Bodies)
    obstacles: Annotated[
        list[Box], "boxes that links and plate must not touch, and that block the view of the device"
    ] = field(default_factory=list)  # fmt: skip
    beams: Annotated[list[Beam], "beams of the frame that links must not touch"] = field(default_factory=list)
    safety: Safety = field(default_factory=Safety)
    actuator_noise: Annotated[
        float, Unit("m", written="um"), Within(least=0.0), "repeatability of the carts"
    ] = 13 * MICRO  # fmt: skip
    axis_noise: Annotated[
        float, Unit("rad", written="urad"), Within(above=0.0), "repeatability of an F1's rotary axes"
    ] = 20 * MICRO  # fmt: skip
    poses: PosesToMeasure = field(default_factory=PosesToMeasure)
    curve: Annotated[
        list[int], Within(above=0),
        "numbers of poses for the curve of predicted errors and for the sufficient number; [] for no curve",
    ] = field(default_factory=lambda: list(CURVE))  # fmt: skip
    evaluation: Annotated[Evaluation | None, "where the robot must be accurate"] = None
    simulation: PlanSimulation = field(default_factory=PlanSimulation)
    criteria: Criteria = field(default_factory=Criteria)
    title: str = ""


Array = np.ndarray
Places = Sequence[Mapping[str, float]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanStudy(Study):
    """A calibration planned before anything is measured (Dressler 2012, Fig. 5.21).

    commanded: (n, 3) poses in measuring order, rows of T [m]; (n, 7) for an F1, with the plate's quaternion last.
    purpose: "calibrate" or "verify" for each pose. actuators: (n, m) for each pose [m, rad].
    """

    approved: Annotated[bool, Quantity("", "whether all criteria are met")] = False
    verdict: Annotated[str, Quantity("", "the verdict in a sentence")] = ""
    stages: Annotated[
        Mapping[str, int],
        Quantity("", "grid points left after each stage: workspace, obstacles, safety, device, safety distance"),
    ] = field(default_factory=dict)
    workspace_left: Annotated[
        float | None, Quantity("", "share of the workspace's points that remain for calibration")
    ] = None  # fmt: skip
    poses: Annotated[int, Quantity("", "number of poses to calibrate with")] = 0
    held_out: Annotated[int, Quantity("", "number of poses to verify the result")] = 0
    rounds: Annotated[Sequence[int], Quantity("", "numbers of poses that were tried")] = ()
    parameters: Annotated[int | None, Quantity("", "number of parameters to calibrate")] = None
    rank: Annotated[int | None, Quantity("", "number of parameter combinations that the poses determine")] = None
    determined_no_better: Annotated[
        int | None, Quantity("", "how many of these the poses determine no better than prior knowledge")
    ] = None  # fmt: skip
    condition: Annotated[
        float | None, Quantity("", "condition number of the Jacobian, in expected errors per noise")
    ] = None  # fmt: skip
    o1: Annotated[
        float | None,
        Quantity("", "observability index O1, geometric mean of singular values over the root of the number of poses"),
    ] = None
    o2: Annotated[float | None, Quantity("", "O2, smallest over largest singular value")] = None
    o3: Annotated[float | None, Quantity("", "O3, smallest singular value")] = None
    o4: Annotated[
        float | None, Quantity("", "O4, noise amplification: smallest singular value squared over the largest")
    ] = None  # fmt: skip
    o5: Annotated[float | None, Quantity("", "O5, 1 / sum of 1 / singular values")] = None
    identifiability: Annotated[Sequence[str], Quantity("", "determined and undetermined parameters, in sentences")] = ()
    parameter_std: Annotated[
        Mapping[str, float | None],
        Quantity("", "predicted standard deviation by parameter, SI; null if not determined"),
    ] = field(default_factory=dict)
    predicted_error: Annotated[
        float | None,
        Quantity("m", "predicted rms positioning error over the workspace after calibration, from noise alone"),
    ] = None
    predicted_greatest: Annotated[float | None, Quantity("m", "predicted rms error at the worst place")] = None
    worst_place: Annotated[Array | None, Quantity("m", "the worst place")] = None
    simulated_error: Annotated[
        float | None, Quantity("m", "rms positioning error of the simulated calibrations; synthetic")
    ] = None  # fmt: skip
    simulations_lost: Annotated[int, Quantity("", "simulated calibrations that did not converge")] = 0
    curve: Annotated[Places, Quantity("", "for selected poses: poses, predicted_error_m, greatest_m")] = ()
    grid_curve: Annotated[Places, Quantity("", "the same curve for regular grids")] = ()
    enough_poses: Annotated[
        int | None,
        Quantity("", "smallest sufficient number of selected poses; null if more than four times poses.most"),
    ] = None
    assumptions: Annotated[Sequence[str], Quantity("", "assumptions, in sentences")] = ()
    commanded: Array = field(default_factory=lambda: np.zeros((0, 3)))
    purpose: Sequence[str] = ()
    actuators: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        rows = [Row(f"points after {name}", count) for name, count in self.stages.items()]
        rows += [
            Row("share of the workspace left", self.workspace_left),
            Row("poses to calibrate with", self.poses),
            Row("poses held out", self.held_out),
            Row("parameters determined", self._determined()),
            Row("condition number", self.condition),
            *(Row(f"observability O{k}", getattr(self, f"o{k}")) for k in range(1, 6)),
        ]
        if self.predicted_error is not None and self.predicted_greatest is not None:
            rows += [
                Row("predicted rms error", 1e3 * self.predicted_error, "mm"),
                Row("predicted rms error at the worst place", 1e3 * self.predicted_greatest, "mm"),
            ]
        if self.simulated_error is not None:
            rows.append(Row("simulated rms error (synthetic)", 1e3 * self.simulated_error, "mm"))
        if self.curve:
            enough = self.enough_poses
            rows.append(Row("sufficient number of poses", "more than tried" if enough is None else enough))
        for curve, kind in ((self.curve, "selected poses"), (self.grid_curve, "poses of a regular grid")):
            rows += [
                Row(f"predicted rms error with {p['poses']} {kind}", 1e3 * p["predicted_error_m"], "mm") for p in curve
            ]
        if self.rank != self.parameters or self.determined_no_better:
            rows += [Row("undetermined", sentence) for sentence in self.identifiability[1:]]
        return rows + [Row("assumed", sentence) for sentence in self.assumptions]

    def _determined(self) -> str | None:
        if self.rank is None or not (weak := self.determined_no_better):
            return None if self.rank is None else f"{self.rank} of {self.parameters}"
        return f"{self.rank - weak} of {self.parameters}, {weak} more no better than known before"
