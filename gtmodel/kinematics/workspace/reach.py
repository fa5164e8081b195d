"""Reachability of tool centre points under limits, and the reasons why points cannot be reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...lang import Model
from ...results import ArgumentError, Status
from ...workers.mapped import mapped
from ..mechanism import Array, InverseKinematics, Mechanism, mechanism_of
from ..section import CrossSection, Grid, SectionPlane, refuse_disordered
from .clearance import FrameClearance, LinkClearance, Obstacles
from .limits import ActuatorLimits, BallJointCones, CartesianBox, Limit, Singularities
from .options import Beam, Bodies, Box, WorkspaceLimits

REACHABLE = 0
FIRST_LIMIT = 64  # smaller codes are those of `Status`; code FIRST_LIMIT + k is limit k
# rows evaluated together: about 10 MB of poses and margins for any grid
CHUNK = 16384


class Reach:
    """Reachability of tool centre points, tested in this order: finite input, inverse kinematics, then each limit.

    Called with T (3,) or (n, 3) [m] it returns codes: 0 for reachable, a `Status` of the inverse kinematics below
    FIRST_LIMIT, and FIRST_LIMIT + k if limit k is the first violated limit. It raises no error for any values of T, and
    a row with NaN does not affect other rows.
    """

    def __init__(self, inverse: InverseKinematics, limits: Sequence[Limit] = ()) -> None:
        self.inverse = inverse
        self.limits = tuple(limits)

    @property
    def assumptions(self) -> list[str]:
        """The assumptions of the limits, in sentences."""
        return [limit.assumes for limit in self.limits if limit.assumes]

    def __call__(self, T: Array) -> Any:
        """Return codes: an int for T (3,), uint8 (n,) for T (n, 3) [m]."""
        T = np.asarray(T, dtype=float)
        if T.shape[-1:] != (3,) or T.ndim not in (1, 2):
            raise TypeError(f"expected tool centre points of shape (3,) or (n, 3); found {T.shape}")
        if T.ndim == 1:
            return int(self(T[None])[0])
        poses = self.inverse(T)
        codes = np.asarray(poses.status).astype(np.uint8)
        remaining = np.flatnonzero(codes == REACHABLE)
        if self.limits and len(remaining) < len(codes):
            poses = poses.rows(remaining)
        for k, limit in enumerate(self.limits):
            if not len(remaining):
                break
            with np.errstate(invalid="ignore"):
                inside = np.asarray(np.all(limit.margins(poses) >= 0, axis=1))
            codes[remaining[~inside]] = FIRST_LIMIT + k
            if k + 1 < len(self.limits) and not inside.all():
                poses = poses.rows(inside)
            remaining = remaining[inside]
        return codes

    def inside(self, T: Array) -> Array:
        """Return True for reachable rows of T (n, 3) [m]."""
        return self(T) == REACHABLE

    def message(self, code: int) -> str:
        """Return the meaning of a code."""
        if code == REACHABLE:
            return "reachable"
        if code < FIRST_LIMIT:
            return Status(code).message
        return f"outside the {self.limits[code - FIRST_LIMIT].name}"

    def diagnose(self, T: Array) -> str:
        """Return a sentence on a single point (3,): reachable, or the violated limit and the amount."""
        T = np.asarray(T, dtype=float)
        point = f"({', '.join(f'{x:.4g}' for x in T)}) m"
        code = self(T)
        if code == REACHABLE:
            return f"{point} can be reached"
        if code < FIRST_LIMIT:
            return f"{point} cannot be reached: {self.inverse.diagnose(T)}"
        poses = self.inverse(T[None])
        limit = self.limits[code - FIRST_LIMIT]
        margins = limit.margins(poses)[0]
        worst = int(np.argmin(margins))
        amount, unit = (np.degrees(margins[worst]), "deg") if limit.unit == "rad" else (margins[worst], limit.unit)
        return f"{point} cannot be reached: {limit.name} violated by {-amount:.4g} {unit} ({limit.parts[worst]})"

    def counts(self, codes: Array) -> dict[str, int]:
        """Return the number of points by reason, in the order of the tests, without reasons that do not occur."""
        counts = np.bincount(np.asarray(codes, dtype=int).ravel())
        return {self.message(code): int(n) for code, n in enumerate(counts) if n}


@dataclass(frozen=True)
class ReachMap:
    """Codes of a grid.

    Attributes:
        codes: uint8 of the grid's shape; NOT_LOOKED_AT for points not evaluated before a stop.
        complete: False after a stop.
    """

    grid: Grid
    codes: Array
    complete: bool = True

    @property
    def reachable(self) -> Array:
        """True for reachable points, of the grid's shape."""
        return self.codes == REACHABLE


NOT_LOOKED_AT = 255


def map_grid(
    reach: Reach,
    grid: Grid,
    *,
    chunk: int = CHUNK,
    progress: Callable[[float], bool] | None = None,
) -> ReachMap:
    """Return the codes of all points of a grid, evaluated in chunks that limit the memory.

    Args:
        chunk: points per chunk.
        progress: called with the completed fraction; if it returns True, the work stops.

    The L1 in a block near its home, with carts that move within +-1 m:

    >>> from gtmodel.kinematics.workspace import ActuatorLimits, Bodies, Reach, box_grid, limited_mechanism, map_grid
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> reach = Reach(robot.inverse, [ActuatorLimits(np.full(3, -1.0), np.full(3, 1.0))])
    >>> block = box_grid(np.array([1.4, -0.4, 0.9]), np.array([2.6, -0.4, 1.0]), 0.1)
    >>> reach.counts(map_grid(reach, block).codes)
    {'reachable': 46, 'outside the actuator limits': 6}
    """
    codes = np.full(grid.size, NOT_LOOKED_AT, dtype=np.uint8)
    spans = [(begin, min(begin + chunk, grid.size)) for begin in range(0, grid.size, chunk)]
    for (begin, end), part in zip(spans, mapped(partial(_codes, reach, grid), spans), strict=True):
        codes[begin:end] = part
        if progress is not None and progress(end / grid.size) and end < grid.size:
            return ReachMap(grid, codes.reshape(grid.shape), complete=False)
    return ReachMap(grid, codes.reshape(grid.shape))


def _codes(reach: Reach, grid: Grid, span: tuple[int, int]) -> Array:
    return reach(grid.points(*span))


MOST_POINTS = 2.5e7  # of a section, about 500 MB
LONGEST_STROKE = 100.0  # in link lengths; a longer stroke is in millimetres


def limited_mechanism(model: Model, home: Sequence[float] | Array | None, bodies: Bodies) -> Mechanism:
    """Return the robot's mechanism with its home pose (3,) [m] and its real plate joints. Raises ArgumentError.

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
        raise ArgumentError(f"expected a joint for each of {count} links; found {len(joints)}", "bodies.plate_joints")
    return mechanism_of(model, home, np.array(joints, dtype=float))


def limits_of(
    limits: WorkspaceLimits, bodies: Bodies, boxes: Sequence[Box], beams: Sequence[Beam], robot: Mechanism
) -> list[Limit]:
    """Return the limits, the cheapest and most certain first. Raises ArgumentError.

    Two limits in addition to the singularity limit, which always applies:

    >>> from gtmodel.kinematics.workspace import Bodies, WorkspaceLimits, limited_mechanism, limits_of
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> limits = WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3, cone=np.radians(40.0))
    >>> [type(limit).__name__ for limit in limits_of(limits, Bodies(), [], [], robot)]
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
                "without bodies.plate_joints_m the links meet in the tool centre point; give the plate joints",
                "bodies.link_clearance",
            )
        all_limits.append(LinkClearance(radius))
    return all_limits + ([_frame(beams, radius)] if beams else [])


def _strokes(actuators: Sequence[Sequence[float]], robot: Mechanism) -> ActuatorLimits:
    carts, pairs = robot.home.q.shape[1], np.array(actuators, dtype=float)
    if pairs.shape != (carts, 2):
        raise ArgumentError(f"expected a pair for each of {carts} carts; found {len(actuators)}", "limits.actuators")
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
            raise ArgumentError(f"no link {wrong[0]}; expected 1 to {count}", f"beams[{k}].skip_links")
        if len(set(beam.skip_links)) == count:
            raise ArgumentError("all links are skipped; remove the beam", f"beams[{k}].skip_links")
    skip = [(i - 1, k) for k, beam in enumerate(beams) for i in beam.skip_links]
    ends = np.array([[beam.from_, beam.to] for beam in beams])
    return FrameClearance(ends, np.array([beam.radius for beam in beams]), radius, skip)


@dataclass(frozen=True)
class WorkspaceTask:
    """The robot, its reachability test, and the part low <= (u, v) <= high [m] of the section."""

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
    """Return the task; by default its section covers the largest reach of the links. Raises ArgumentError."""
    mechanism = limited_mechanism(robot, home, bodies)
    reach = Reach(mechanism.inverse, limits_of(limits, bodies, obstacles, beams, mechanism))
    plane = mechanism.section(section.along)
    low, high = section.window(*mechanism.farthest(plane.pierced(mechanism.anchors, mechanism.directions)))
    if np.any(high - low <= section.step):
        raise ArgumentError(
            f"the section of {high[0] - low[0]:.4g} m by {high[1] - low[1]:.4g} m is too small for this step; "
            f"use a step below {np.min(high - low):.3g} m",
            "section.step",
        )
    size = np.prod((high - low) / section.step)
    if size > MOST_POINTS:
        raise ArgumentError(f"the grid would have {size:.1e} points; use a larger step", "section.step")
    return WorkspaceTask(mechanism, reach, plane, low, high)
