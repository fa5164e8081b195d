"""The keys of a trajectory problem: where the motion begins and ends, what it keeps, what it costs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Section
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.solver_keys import Barrier, MostElements

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Rest = list[Literal["velocity", "acceleration"]]


class Start(Section):
    """Where the motion begins."""

    tcp_m: Point = Field(description="tool centre point, three coordinates in the robot's frame")
    rest: Rest = Field(["velocity"], description="what vanishes there: velocity, acceleration")


class Goal(Section):
    """Where the motion ends."""

    tcp_m: Point = Field(description="tool centre point, three coordinates in the robot's frame")
    rest: Rest = Field(["velocity"], description="what vanishes there: velocity, acceleration")


class JointCone(Section):
    """How far a link may lean in the ball joint at one of its ends."""

    arm: int = Field(ge=0, description="number of the arm, from 0")
    end: Literal["cart", "plate"] = Field(description="the end of the link at which the joint sits")
    axis: Point = Field(
        description="mounting direction of the joint in the robot's frame, from cart towards plate; of a joint that "
        "turns with the plate or a rotary axis, its direction at the start"
    )
    half_angle_deg: float = Field(gt=0, le=90, description="largest angle between the link and the axis")


class Obstacle(Section):
    """A box, parallel to the axes, that the tool centre point and all links stay out of."""

    center_m: Point = Field(description="its centre in the robot's frame")
    size_m: Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)] = Field(description="its edge lengths")
    clearance_m: NonNegativeFloat = Field(0.0, description="distance kept from it, radii of tool and links included")


class MotionLimits(Section):
    """What the motion of a robot on three carts must keep; what is left out is unlimited."""

    force_N: PositiveFloat = Field(description="largest motor force of each cart, friction included")
    tcp_velocity_m_s: PositiveFloat | None = Field(None, description="largest speed of the tool centre point")
    tcp_acceleration_m_s2: PositiveFloat | None = Field(None, description="largest magnitude of its acceleration")
    tcp_jerk_m_s3: PositiveFloat | None = Field(
        None, description="largest magnitude of its jerk; forces are then continuous"
    )
    cart_velocity_m_s: PositiveFloat | None = Field(None, description="largest speed of each cart")
    cart_acceleration_m_s2: PositiveFloat | None = Field(None, description="largest acceleration of each cart")
    cart_low_m: Point | None = Field(None, description="least position of each cart on its guideway")
    cart_high_m: Point | None = Field(None, description="largest position of each cart on its guideway")
    tcp_low_m: Point | None = Field(None, description="lower corner of the box that holds the tool centre point")
    tcp_high_m: Point | None = Field(None, description="upper corner of the box that holds the tool centre point")
    joint_cones: list[JointCone] = Field([], description="cones of the ball joints")
    obstacles: list[Obstacle] = Field([], description="boxes to stay out of")


class Limits(MotionLimits):
    """What the motion must keep; what is left out is unlimited."""

    link_along_guideway_m: NonNegativeFloat = Field(
        0.02, description="least component of each link along its guideway: how far to stay off the edge of reach"
    )


class Cost(Section):
    """What is minimised: time * T + energy * sum int (F / force_unit_N)^2 dt."""

    time: NonNegativeFloat = Field(1.0, description="weight of the final time")
    energy: NonNegativeFloat = Field(0.0, description="weight of the energy")
    force_unit_N: PositiveFloat = Field(1.0, description="force that counts as one in the energy")


class PathSection(Section):
    """The path to follow, from start to goal."""

    shape: Literal["line", "polyline", "arc", "spline", "taught"] = Field(
        "line",
        description="straight; straight pieces with blended corners; arc of a circle; smooth curve through the points "
        "of a file; a recorded path, smoothed",
    )
    via_m: list[Point] = Field([], description="polyline: its corners between start and goal")
    blend_m: PositiveFloat = Field(0.05, description="polyline: distance from a corner at which its blend begins")
    through_m: Point | None = Field(None, description="arc: a third point between start and goal")
    file: str = Field("", description="spline, taught: CSV file with the columns x_m, y_m, z_m")
    tolerance_m: PositiveFloat = Field(5e-4, description="taught: root mean square distance left by the smoothing")
    intervals: PositiveInt = Field(
        400, description="intervals of the motion by squared speeds, the exported one of kind trajectory"
    )


class Starts(Section):
    """Further starts of the search, from bent lines; of all optima the best counts."""

    count: NonNegativeInt = Field(0, description="number of further starts")
    seed: int = Field(1, description="seed of their drawing")
    bend_m: PositiveFloat = Field(0.15, description="how far a line is bent")


class Mesh(Section):
    """Where the equations are collocated (Radau)."""

    elements: PositiveInt = Field(50, le=10000, description="number of elements of the horizon")
    most_elements: MostElements = 400
    points: int = Field(3, ge=1, le=9, description="collocation points per element")
    control: Literal["polynomial", "constant"] = Field(
        "polynomial", description="force polynomial per element, bounded at its points only, or one value"
    )


class Solver(Section):
    """When the solver stops."""

    tolerance: PositiveFloat = Field(1e-8, description="on the scaled optimality conditions")
    max_iterations: PositiveInt = Field(
        1000,
        description="limit of iterations: of all attempts together, further starts and the exported motion included",
    )
    barrier: Barrier = "auto"
    formulation: Literal["auto", "inverse", "explicit", "torn", "dae"] = Field(
        "auto", description="which equations are collocated; dae: all as they stand, for robots without closed forms"
    )


class Export(Section):
    """The files for a controller."""

    sample_s: PositiveFloat = Field(0.004, ge=1e-5, description="interval of reference.csv")
    target_s: PositiveFloat = Field(0.04, ge=1e-4, description="interval of the targets in motion.mod")


class TrajectoryProblem(RobotProblem):
    """Optimal motion between two poses, free or along a path."""

    start: Start
    goal: Goal
    limits: Limits
    path: PathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Cost = Cost()  # type: ignore[call-arg]
    mesh: Mesh = Mesh()  # type: ignore[call-arg]
    starts: Starts = Starts()  # type: ignore[call-arg]
    solver: Solver = Solver()  # type: ignore[call-arg]
    export: Export = Export()  # type: ignore[call-arg]
