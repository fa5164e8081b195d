"""A robot under the limits that it is asked to keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...lang import Model
from ...results import ArgumentError
from ..mechanism import Mechanism, mechanism_of
from ..section import CrossSection, SectionPlane, refuse_disordered
from .clearance import FrameClearance, LinkClearance, Obstacles
from .limits import ActuatorLimits, BallJointCones, CartesianBox, Limit, Singularities
from .options import Beam, Bodies, Box, WorkspaceLimits
from .reach import Reach

Array = np.ndarray
MOST_POINTS = 2.5e7  # of a section, some 500 MB
LONGEST_STROKE = 100.0  # in link lengths; a longer one was given in millimetres


def limited_mechanism(model: Model, home: Sequence[float] | Array | None, bodies: Bodies) -> Mechanism:
    """The robot with its home pose (3,) [m] and its real plate joints. Raises ArgumentError.

    >>> from gtmodel.kinematics.workspace import Bodies, limited_mechanism
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), [1.4, -0.4, 0.9], Bodies(link_radius=0.02))
    >>> robot.home.T, robot.lengths.round(2)
    (array([[ 1.4, -0.4,  0.9]]), array([2.05, 1.82, 1.81]))
    """
    joints = bodies.plate_joints
    home = None if home is None else np.asarray(home, float)
    robot = mechanism_of(model, home)
    if joints is None:
        return robot
    count = len(robot.lengths)
    if len(joints) != count:
        raise ArgumentError(f"the robot has {count} links; found {len(joints)} joints", "bodies.plate_joints")
    return mechanism_of(model, home, np.array(joints, dtype=float))


def limits_of(
    limits: WorkspaceLimits, bodies: Bodies, boxes: Sequence[Box], beams: Sequence[Beam], robot: Mechanism
) -> list[Limit]:
    """Limits in the order of their cost and of their certainty. Raises ArgumentError.

    Two limits are asked for; singular poses are one in any case:

    >>> from gtmodel.kinematics.workspace import Bodies, WorkspaceLimits, limited_mechanism, limits_of
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> wanted = WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3, cone=np.radians(40.0))
    >>> [type(limit).__name__ for limit in limits_of(wanted, Bodies(), [], [], robot)]
    ['Singularities', 'ActuatorLimits', 'BallJointCones']
    """
    all_limits: list[Limit] = [Singularities(robot.directions, limits.singularity)]
    if limits.actuators is not None:
        all_limits.append(_strokes(limits.actuators, robot))
    if limits.tcp_low is not None or limits.tcp_high is not None:
        low = np.full(3, -np.inf) if limits.tcp_low is None else np.array(limits.tcp_low)
        high = np.full(3, np.inf) if limits.tcp_high is None else np.array(limits.tcp_high)
        refuse_disordered(low, high, "limits.tcp_high")
        all_limits.append(CartesianBox(low, high))
    if limits.cone is not None:
        all_limits.append(BallJointCones.about_home(robot.home, limits.cone))
    radius = np.full(len(robot.lengths), bodies.link_radius)
    if boxes:
        for k, box in enumerate(boxes):
            refuse_disordered(np.array(box.low), np.array(box.high), f"obstacles[{k}].high")
        low, high = (np.array([getattr(box, end) for box in boxes], dtype=float) for end in ("low", "high"))
        names = [box.name or f"box {k + 1}" for k, box in enumerate(boxes)]
        all_limits.append(Obstacles(low, high, radius, bodies.plate_radius, names))
    if bodies.link_clearance:
        if bodies.plate_joints is None:
            raise ArgumentError(
                "the links meet in the tool centre point; give bodies.plate_joints_m", "bodies.link_clearance"
            )
        all_limits.append(LinkClearance(radius))
    return all_limits + ([_frame(beams, radius)] if beams else [])


def _strokes(actuators: Sequence[Sequence[float]], robot: Mechanism) -> ActuatorLimits:
    carts, pairs = robot.home.q.shape[1], np.array(actuators, dtype=float)
    if pairs.shape != (carts, 2):
        raise ArgumentError(f"the robot has {carts} carts; found {len(actuators)} pairs", "limits.actuators")
    low, high = pairs.T
    refuse_disordered(low, high, "limits.actuators")
    stroke, longest = float(np.max(high - low)), float(robot.lengths.max())
    if stroke > LONGEST_STROKE * longest:
        raise ArgumentError(
            f"a stroke of {stroke:.6g} m is more than {LONGEST_STROKE:g} times the longest link, {longest:.4g} m; "
            "give metres, not millimetres",
            "limits.actuators",
        )
    return ActuatorLimits(low, high)


def _frame(beams: Sequence[Beam], radius: Array) -> FrameClearance:
    count = len(radius)
    for k, beam in enumerate(beams):
        wrong = [i for i in beam.skip_links if not 1 <= i <= count]
        if wrong:
            raise ArgumentError(f"there is no link {wrong[0]}; there are 1 to {count}", f"beams[{k}].skip_links")
        if len(set(beam.skip_links)) == count:
            raise ArgumentError(
                "names all links, so that nothing is tested; leave the beam out", f"beams[{k}].skip_links"
            )
    skip = [(i - 1, k) for k, beam in enumerate(beams) for i in beam.skip_links]
    ends = np.array([[beam.from_, beam.to] for beam in beams])
    return FrameClearance(ends, np.array([beam.radius for beam in beams]), radius, skip)


@dataclass(frozen=True)
class WorkspaceTask:
    """What is looked at: the robot, its tests, and the part low <= (u, v) <= high [m] of the section."""

    robot: Mechanism
    reach: Reach
    section: SectionPlane
    low: Array
    high: Array


def task_of(
    robot: Model,
    limits: WorkspaceLimits,
    home: Sequence[float] | None,
    section: CrossSection,
    bodies: Bodies,
    obstacles: Sequence[Box],
    beams: Sequence[Beam],
) -> WorkspaceTask:
    """The section is what all links can reach at most, unless it is given. Raises ArgumentError."""
    mechanism = limited_mechanism(robot, home, bodies)
    reach = Reach(mechanism.inverse, limits_of(limits, bodies, obstacles, beams, mechanism))
    plane = mechanism.section(section.along)
    low, high = section.window(*mechanism.farthest(plane.pierced(mechanism.anchors, mechanism.directions)))
    if np.any(high - low <= section.step):
        raise ArgumentError(
            f"the section is {high[0] - low[0]:.4g} m by {high[1] - low[1]:.4g} m, so that no point lies within it; "
            f"take a step below {np.min(high - low):.3g} m",
            "section.step",
        )
    size = np.prod((high - low) / section.step)
    if size > MOST_POINTS:
        raise ArgumentError(f"the grid would have {size:.1e} points; take a larger step", "section.step")
    return WorkspaceTask(mechanism, reach, plane, low, high)
