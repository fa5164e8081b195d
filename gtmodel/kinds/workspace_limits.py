"""What a workspace must keep: strokes, joint cones, bodies and what stands in their way."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat

from gtmodel.kinematics.mechanism import Mechanism, mechanism_of
from gtmodel.kinematics.workspace import (
    ActuatorLimits,
    BallJointCones,
    CartesianBox,
    FrameClearance,
    Limit,
    LinkClearance,
    Obstacles,
    Singularities,
)
from gtmodel.lang import Model
from gtmodel.problem_files.base import InputError, Section
from gtmodel.problem_files.section_keys import Pair

LONGEST_STROKE = 100.0  # in link lengths; a longer one was given in millimetres

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(gt=0, le=180)]


class Limits(Section):
    """What the workspace must keep."""

    actuators_m: list[Pair] | None = Field(default=None, description="least and greatest q of every cart")
    cone_deg: Angle | None = Field(default=None, description="half-angle of ball-joint cones about the links at home")
    singularity_deg: NonNegativeFloat = Field(
        default=0.1, description="least angle of a link from orthogonal to its guideway and from the others' plane"
    )
    tcp_low_m: Point | None = Field(default=None, description="least tool centre point, such as a wall of the frame")
    tcp_high_m: Point | None = Field(default=None, description="greatest tool centre point")


class Bodies(Section):
    """Sizes of links and plate, for clearances. Lengths from the simplified to the real joints may be given."""

    link_radius_m: NonNegativeFloat = Field(default=0.0, description="of every link")
    plate_radius_m: NonNegativeFloat = Field(default=0.0, description="of a sphere about the TCP that holds the plate")
    plate_joints_m: list[Point] | None = Field(
        default=None,
        description="plate joint of each link from the TCP, robot frame; the links meet in the TCP without",
    )
    link_clearance: bool = Field(default=False, description="keep the links clear of one another; needs plate_joints_m")


class Box(Section):
    """An obstacle with sides along the axes."""

    name: str = Field(default="", description="for messages")
    low_m: Point = Field(description="its least corner")
    high_m: Point = Field(description="its greatest corner")


class Beam(Section):
    """A beam of the frame."""

    from_m: Point = Field(description="one end")
    to_m: Point = Field(description="the other end")
    radius_m: NonNegativeFloat = Field(default=0.0, description="its radius")
    skip_links: list[int] = Field(default=[], description="numbers of links (from 1) that may touch it")


def limited_mechanism(model: Model, home_m: Point | None, bodies: Bodies) -> Mechanism:
    """The robot with its home pose and its real plate joints. Raises InputError."""
    joints = bodies.plate_joints_m
    home = None if home_m is None else np.array(home_m)
    robot = mechanism_of(model, home)
    if joints is None:
        return robot
    count = len(robot.lengths)
    if len(joints) != count:
        raise InputError(f"the robot has {count} links; found {len(joints)} joints", "bodies.plate_joints_m")
    return mechanism_of(model, home, np.array(joints, dtype=float))


def limits_of(keys: Limits, bodies: Bodies, boxes: list[Box], beams: list[Beam], robot: Mechanism) -> list[Limit]:
    """Limits in the order of their cost and of their certainty. Raises InputError naming the key."""
    count, carts = len(robot.lengths), robot.home.q.shape[1]
    limits: list[Limit] = [Singularities(robot.directions, np.radians(keys.singularity_deg))]
    if keys.actuators_m is not None:
        if len(keys.actuators_m) != carts:
            raise InputError(f"the robot has {carts} carts; found {len(keys.actuators_m)} pairs", "limits.actuators_m")
        low, high = np.array(keys.actuators_m, dtype=float).T
        refuse_disordered(low, high, "limits.actuators_m")
        stroke, longest = float(np.max(high - low)), float(robot.lengths.max())
        if stroke > LONGEST_STROKE * longest:
            raise InputError(
                f"a stroke of {stroke:.6g} m is more than {LONGEST_STROKE:g} times the longest link, {longest:.4g} m; "
                "give metres, not millimetres",
                "limits.actuators_m",
            )
        limits.append(ActuatorLimits(low, high))
    if keys.tcp_low_m is not None or keys.tcp_high_m is not None:
        low = np.full(3, -np.inf) if keys.tcp_low_m is None else np.array(keys.tcp_low_m)
        high = np.full(3, np.inf) if keys.tcp_high_m is None else np.array(keys.tcp_high_m)
        refuse_disordered(low, high, "limits.tcp_high_m")
        limits.append(CartesianBox(low, high))
    if keys.cone_deg is not None:
        limits.append(BallJointCones.about_home(robot.home, np.radians(keys.cone_deg)))
    radius = np.full(count, bodies.link_radius_m)
    if boxes:
        low, high = (np.array([getattr(box, key) for box in boxes]) for key in ("low_m", "high_m"))
        refuse_disordered(low, high, "obstacles.high_m")
        names = [box.name or f"box {k + 1}" for k, box in enumerate(boxes)]
        limits.append(Obstacles(low, high, radius, bodies.plate_radius_m, names))
    if bodies.link_clearance:
        if bodies.plate_joints_m is None:
            raise InputError(
                "the links meet in the tool centre point; give bodies.plate_joints_m", "bodies.link_clearance"
            )
        limits.append(LinkClearance(radius))
    if beams:
        wrong = [i for beam in beams for i in beam.skip_links if not 1 <= i <= count]
        if wrong:
            raise InputError(f"there is no link {wrong[0]}; there are 1 to {count}", "beams.skip_links")
        idle = [k for k, beam in enumerate(beams) if len(set(beam.skip_links)) == count]
        if idle:
            key = f"beams[{idle[0]}].skip_links"
            raise InputError("names all links, so that nothing is tested; leave the beam out", key)
        skip = [(i - 1, k) for k, beam in enumerate(beams) for i in beam.skip_links]
        ends = np.array([[beam.from_m, beam.to_m] for beam in beams])
        limits.append(FrameClearance(ends, np.array([beam.radius_m for beam in beams]), radius, skip))
    return limits


def refuse_disordered(low: np.ndarray, high: np.ndarray, key: str) -> None:
    if np.any(low >= high):
        raise InputError("every lower limit must be less than its upper one", key)
