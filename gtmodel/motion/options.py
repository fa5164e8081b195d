"""Options of a motion: ends, limits, path, cost, mesh, solver, export, and the problem that contains them all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from .._lazy import hint
from ..results.options import Long, Options, Unit, Within
from ..results.refusal import ArgumentError

if TYPE_CHECKING:
    from ..lang import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

At = Literal["velocity", "acceleration"]
Barrier = Annotated[
    Literal["auto", "adaptive", "monotone"],
    "IPOPT's barrier strategy; auto: adaptive, then monotone if that fails",
]
MostElements = Annotated[
    int, Within(above=0, most=10000), "largest number of elements; the mesh is refined up to this if a check fails"
]


@dataclass(frozen=True)
class End(Options):
    """An end of the motion: the tool centre point and which of its derivatives vanish there.

    >>> gt.motion.End([0.9, -0.9, 0.45], rest=["speed"])
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: rest: expected one of velocity, acceleration; found 'speed'
    """

    tcp: Annotated[list[float], Unit("m"), Long(3), "tool centre point, three coordinates in the robot's frame"]
    rest: Annotated[list[At], "derivatives that vanish there: velocity, acceleration"] = field(
        default_factory=lambda: ["velocity"]
    )


@dataclass(frozen=True)
class JointCone(Options):
    """Largest tilt of a link in the ball joint at one of its ends.

    >>> cone = gt.motion.JointCone(arm=0, end="plate", axis=[0.0, 0.0, 1.0], half_angle=np.radians(35.0))
    >>> limits = gt.motion.Limits(force=700.0, joint_cones=[cone])
    >>> gt.motion.JointCone(0, "plate", [0.0, 0.0, 1.0], half_angle=35.0)  # degrees
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: half_angle: must be more than 0 and at most 1.5708; found 35
    """

    arm: Annotated[int, Within(least=0), "index of the arm, from 0"]
    end: Annotated[Literal["cart", "plate"], "the end of the link at which the joint sits"]
    axis: Annotated[
        list[float], Long(3),
        "mounting direction of the joint in the robot's frame, from cart towards plate; for a joint that "
        "turns with the plate or a rotary axis, its direction at the start",
    ]  # fmt: skip
    half_angle: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0, most=math.pi / 2),
        "largest angle between the link and the axis",
    ]  # fmt: skip


@dataclass(frozen=True)
class Obstacle(Options):
    """An axis-aligned box that the tool centre point and all links must avoid.

    >>> box = gt.motion.Obstacle(center=[0.45, -0.9, 0.3], size=[0.2, 0.2, 0.2], clearance=0.05)
    >>> limits = gt.motion.Limits(force=700.0, obstacles=[box])
    >>> gt.motion.Obstacle([0.45, -0.9, 0.3], [0.2, 0.2, 0.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: size: must be more than 0; found 0
    """

    center: Annotated[list[float], Unit("m"), Long(3), "its centre in the robot's frame"]
    size: Annotated[list[float], Unit("m"), Within(above=0.0), Long(3), "its edge lengths"]
    clearance: Annotated[
        float, Unit("m"), Within(least=0.0), "required distance from it, including the radii of tool and links"
    ] = 0.0


@dataclass(frozen=True)
class MotionLimits(Options):
    """Limits of the motion of a robot on three carts; None: unlimited."""

    force: Annotated[float, Unit("N"), Within(above=0.0), "largest motor force of each cart, friction included"]
    tcp_velocity: Annotated[
        float | None, Unit("m/s"), Within(above=0.0), "largest speed of the tool centre point"
    ] = None  # fmt: skip
    tcp_acceleration: Annotated[
        float | None, Unit("m/s2"), Within(above=0.0), "largest magnitude of its acceleration"
    ] = None  # fmt: skip
    tcp_jerk: Annotated[
        float | None, Unit("m/s3"), Within(above=0.0), "largest magnitude of its jerk; forces are then continuous"
    ] = None
    cart_velocity: Annotated[float | None, Unit("m/s"), Within(above=0.0), "largest speed of each cart"] = None
    cart_acceleration: Annotated[
        float | None, Unit("m/s2"), Within(above=0.0), "largest acceleration of each cart"
    ] = None  # fmt: skip
    cart_low: Annotated[
        list[float] | None, Unit("m"), Long(3), "smallest position of each cart on its guideway"
    ] = None  # fmt: skip
    cart_high: Annotated[
        list[float] | None, Unit("m"), Long(3), "largest position of each cart on its guideway"
    ] = None  # fmt: skip
    tcp_low: Annotated[
        list[float] | None, Unit("m"), Long(3), "lower corner of a box that the tool centre point must not leave"
    ] = None
    tcp_high: Annotated[
        list[float] | None, Unit("m"), Long(3), "upper corner of a box that the tool centre point must not leave"
    ] = None
    joint_cones: Annotated[list[JointCone], "cones of the ball joints"] = field(default_factory=list)
    obstacles: Annotated[list[Obstacle], "boxes to avoid"] = field(default_factory=list)


@dataclass(frozen=True)
class Limits(MotionLimits):
    """Limits of the motion of a robot on three carts; None: unlimited.

    >>> limits = gt.motion.Limits(force=700.0, tcp_velocity=2.0, cart_low=[-1.0, -1.0, -1.0])
    >>> limits.link_along_guideway
    0.02
    >>> gt.motion.Limits(force=-700.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: force: must be more than 0; found -700
    """

    link_along_guideway: Annotated[
        float, Unit("m"), Within(least=0.0),
        "smallest component of each link along its guideway: the distance from the boundary of the workspace",
    ] = 0.02  # fmt: skip


@dataclass(frozen=True)
class AxisLimits(MotionLimits):
    """Limits of the motion of a robot with three carts and three rotary axes; None: unlimited.

    >>> limits = gt.motion.AxisLimits(force=1000.0, torque=40.0, axis_velocity=np.radians(180.0))
    >>> gt.motion.AxisLimits(force=1000.0, torque=0.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: torque: must be more than 0; found 0
    """

    torque: Annotated[
        float, Unit("N.m"), Within(above=0.0), "largest motor torque of each rotary axis"
    ] = field(kw_only=True)  # fmt: skip
    axis_low: Annotated[
        list[float] | None, Unit("rad", written="deg"), Long(3), "smallest angle of each rotary axis"
    ] = None  # fmt: skip
    axis_high: Annotated[
        list[float] | None, Unit("rad", written="deg"), Long(3), "largest angle of each rotary axis"
    ] = None
    axis_velocity: Annotated[
        float | None, Unit("rad/s", written="deg/s"), Within(above=0.0), "largest speed of each rotary axis"
    ] = None
    axis_acceleration: Annotated[
        float | None, Unit("rad/s2", written="deg/s2"), Within(above=0.0), "largest acceleration of each rotary axis"
    ] = None


@dataclass(frozen=True)
class Shape(Options):
    """Base class of paths from start to goal: `Line`, `Polyline`, `Arc`, `Spline`, `Taught`.

    >>> gt.motion.Line(intervals=0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: intervals: must be more than 0; found 0
    """

    intervals: Annotated[
        int, Within(above=0),
        "number of intervals of the motion by squared speeds, which is exported if the robot has carts only",
    ] = field(default=400, kw_only=True)  # fmt: skip


@dataclass(frozen=True)
class Line(Shape):
    """The straight line from start to goal.

    >>> start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.2, -0.9, 0.1])
    >>> line = gt.motion.Line()
    >>> round(gt.motion.paths.path_of(line, start, goal).length, 4)  # [m]
    0.2
    """


@dataclass(frozen=True)
class Polyline(Shape):
    """Straight segments with corners rounded by curves of continuous curvature.

    via: its corners (n, 3) [m] between start and goal. The length in a study is that of the rounded path.

    >>> start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.2, -0.9, 0.1])
    >>> path = gt.motion.Polyline(via=[[0.1, -0.9, 0.3]], blend=0.05)
    >>> gt.motion.paths.path_of(path, start, goal)(np.array([0.5]))[0].round(3)  # the corner is cut by 17 mm
    array([[ 0.1 , -0.9 ,  0.283]])
    >>> round(gt.motion.paths.path_of(path, start, goal).length, 4)  # [m]; the polygon through the corner has 0.4472
    0.4215
    """

    via: Annotated[list[list[float]], Unit("m"), Long(3), "its corners between start and goal"] = field(
        default_factory=list
    )
    blend: Annotated[
        float, Unit("m"), Within(above=0.0), "distance from a corner at which its blend begins"
    ] = 0.05  # fmt: skip


@dataclass(frozen=True)
class Arc(Shape):
    """The circular arc from start to goal through a third point. Raises ArgumentError if the three are collinear.

    >>> start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.2, -0.9, 0.1])
    >>> half = gt.motion.Arc(through=[0.1, -0.9, 0.2])
    >>> round(gt.motion.paths.path_of(half, start, goal).length, 4)  # [m]: half a circle of radius 0.1 m
    0.3142
    """

    through: Annotated[list[float], Unit("m"), Long(3), "a third point between start and goal"]


@dataclass(frozen=True)
class Spline(Shape):
    """The natural cubic spline through points (n, 3) [m], n >= 3, over the length of their polygon.

    The first and last points are start and goal. The length in a study is that of the curve.

    >>> start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.2, -0.9, 0.1])
    >>> curve = gt.motion.Spline(points=np.array([start, [0.1, -0.85, 0.2], goal]))
    >>> gt.motion.paths.path_of(curve, start, goal)(np.array([0.5]))[0]
    array([[ 0.1 , -0.85,  0.2 ]])
    """

    points: Annotated[np.ndarray, Unit("m"), Long(3), "points on the path, three coordinates each"]


@dataclass(frozen=True)
class Taught(Shape):
    """A recorded path that is smoothed: points (n, 3) [m], at least six of them distinct.

    The path may deviate from start and goal by three times the tolerance.

    >>> start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.2, -0.9, 0.1])
    >>> s = np.linspace(0.0, 1.0, 50)[:, None]
    >>> noise = 2e-4 * np.random.default_rng(1).normal(size=(50, 3))  # synthetic, 0.2 mm
    >>> path = gt.motion.Taught(points=start + s * (goal - start) + noise, tolerance=5e-4)
    >>> round(gt.motion.paths.path_of(path, start, goal).length, 3)  # [m]
    0.2
    """

    points: Annotated[np.ndarray, Unit("m"), Long(3), "recorded points, three coordinates each"]
    tolerance: Annotated[
        float, Unit("m"), Within(above=0.0), "RMS distance of the smoothed path from the points"
    ] = 5e-4  # fmt: skip


@dataclass(frozen=True)
class Cost(Options):
    """The cost time * T + energy * sum int (F / force_unit_N)^2 dt, summed over the motors; T is the final time.

    >>> gt.motion.Cost(energy=0.01, force_unit=112.9).time  # time and energy together
    1.0
    >>> gt.motion.Cost(time=-1.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: time: must be at least 0; found -1
    """

    time: Annotated[float, Within(least=0.0), "weight of the final time"] = 1.0
    energy: Annotated[float, Within(least=0.0), "weight of the energy"] = 0.0
    force_unit: Annotated[float, Unit("N"), Within(above=0.0), "reference force in the energy"] = 1.0


@dataclass(frozen=True)
class Starts(Options):
    """Further starts of the search. The best optimum is used; the message says how many starts ended in it.

    The guesses are, in order: the line bent to a random side, bent to the opposite side, the line with the other
    barrier strategy, the line without a speed profile, then further random bends. The search stops early if four
    consecutive starts find no new optimum.

    >>> gt.motion.Starts(count=4).bend  # [m]
    0.15
    """

    count: Annotated[int, Within(least=0), "number of further starts"] = 0
    seed: Annotated[int, "random seed of the bends"] = 1
    bend: Annotated[float, Unit("m"), Within(above=0.0), "largest lateral offset of a bent line"] = 0.15


@dataclass(frozen=True)
class MotionMesh(Options):
    """The collocation mesh (Radau).

    A polynomial force may exceed its limit between collocation points; the exported motion does not.

    >>> gt.motion.MotionMesh(elements=50, points=12)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: points: must be at least 1 and at most 9; found 12
    """

    elements: Annotated[int, Within(above=0, most=10000), "number of elements of the horizon"] = 50
    most_elements: MostElements = 400
    points: Annotated[int, Within(least=1, most=9), "collocation points per element"] = 3
    control: Annotated[
        Literal["polynomial", "constant"],
        "force on each element: a polynomial, bounded at the collocation points only, or a constant",
    ] = "polynomial"
    blocks: Annotated[
        list[int] | None, Within(least=1), Long(3),
        "number of elements over which the force of each motor is constant, one number for each motor; for motions "
        "without a path and without a limit on velocity, acceleration or jerk",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Solver(Options):
    """Limits and formulation of the solver.

    >>> gt.motion.Solver(barrier="mehrotra")
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: barrier: expected one of auto, adaptive, monotone; found 'mehrotra'
    """

    tolerance: Annotated[float, Within(above=0.0), "tolerance of the scaled optimality conditions"] = 1e-8
    max_iterations: Annotated[
        int, Within(above=0),
        "limit of iterations over all attempts, further starts and the exported motion",
    ] = 1000  # fmt: skip
    barrier: Barrier = "auto"
    formulation: Annotated[
        Literal["auto", "inverse", "explicit", "torn", "dae"],
        "formulation of the collocated equations; dae: nothing eliminated, for robots without closed forms",
    ] = "auto"


@dataclass(frozen=True)
class Export(Options):
    """Sampling of the controller files: reference.csv and the RAPID module motion.mod.

    >>> gt.motion.Export().sample, gt.motion.Export().target  # [s]
    (0.004, 0.04)
    """

    sample: Annotated[float, Unit("s"), Within(least=1e-5), "sampling period of reference.csv"] = 0.004
    target: Annotated[float, Unit("s"), Within(least=1e-4), "time between targets in motion.mod"] = 0.04


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionProblem(Options):
    """A robot's motion from one pose to another.

    robot: declares T, the tool centre point (3,) [m], and tau, the motor forces (3,) [N].
    start, goal: ends. limits: see `Limits`. path: the path to follow; None: a free motion.
    cost, mesh, starts, solver: objective and options of the search. export: sampling of the controller files.

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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mesh.blocks is not None and self.order is not None:
            raise ArgumentError(
                "blocks of forces need forces as the control, so neither a path nor a limit on velocity, acceleration "
                "or jerk; leave them out",
                "mesh.blocks",
            )

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
        """Order of the derivative of the motion that is the control; None: the forces are the control.

        With a force that is constant per element, limits on acceleration and speed could not be kept, since friction
        changes within milliseconds.
        """
        limits = self.limits
        if limits.tcp_jerk is not None:
            return 3
        rates = (limits.tcp_velocity, limits.cart_velocity, limits.tcp_acceleration, limits.cart_acceleration)
        return 2 if self.path is not None or any(limit is not None for limit in rates) else None
