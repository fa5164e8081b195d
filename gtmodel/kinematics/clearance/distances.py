"""Distances of the links of a serial arm from each other and from obstacles, exact, at many postures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...compiler.causal import compile_causal
from ...geometry.distances import segment_to_box, segment_to_segment
from ...geometry.rotations import rotation_of_rpy
from ...lang import Model
from ...results import ArgumentError, Status
from .options import Clearance

Array = np.ndarray
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
RESOLUTION_M = 1e-4  # of the smallest distance along a motion


@dataclass(frozen=True, eq=False)
class Body:
    """Points within `radius` [m] of the convex hull of points (k, 3) [m].

    frame: None for the world, 0 for the base of the arm, k + 1 for the body that joint k moves. normal: of a plane,
    whose only point lies on it; box: rotation (3, 3) and half edges (3,) of a box around its corners.
    """

    name: str
    frame: int | None
    points: Array
    radius: float = 0.0
    normal: Array | None = None
    box: tuple[Array, Array, Array] | None = None


@dataclass(frozen=True)
class LeastDistance:
    """The smallest distance [m] of a pair over some postures, and the row (counted from 0) of its posture; along a
    motion the time [s] of its posture, and the row before it."""

    distance: float
    pair: tuple[str, str]
    row: int
    time: float | None = None

    def __str__(self) -> str:
        return f"{1e3 * self.distance:.4g} mm between {self.pair[0]} and {self.pair[1]}"


@dataclass(frozen=True, eq=False)
class LinkDistances:
    """The bodies of an arm and of its surroundings, and the pairs whose distance counts.

    Distances are between surfaces; they are negative if the bodies overlap, down to minus the radii if the segments
    inside meet.

    >>> arm = gt.robots.serial_arm(a=[0.5, 0.4, 0.3], alpha=0.0)
    >>> rods = [gt.kinematics.LinkCapsule(f"link_{k}", [-a, 0, 0], [0.0, 0, 0], 0.04) for k, a in ((1, 0.5), (3, 0.3))]
    >>> near = gt.kinematics.link_distances(arm, gt.kinematics.Clearance(capsules=rods))
    >>> print(near.least([[0.0, 2.4, 1.2]]))
    71.59 mm between link_1 and link_3
    """

    robot: Any
    bodies: tuple[Body, ...]
    pairs: tuple[tuple[int, int], ...]

    @property
    def names(self) -> list[tuple[str, str]]:
        """Names of the two bodies of each pair."""
        return [(self.bodies[i].name, self.bodies[j].name) for i, j in self.pairs]

    def frames(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return rotations (k, m, 3, 3) and origins (k, m, 3) [m] of base and links at postures q (m, n) [rad, m]."""
        q, links = np.atleast_2d(np.asarray(q, float)), len(self.robot.structure.joints)
        names = [f"link_{k + 1}.after.{what}" for k in range(links) for what in "Rr"]
        *results, status = compile_causal(self.robot, known="q", targets=names)(q)
        if np.any(status != Status.OK):
            raise ArgumentError(f"row {int(np.argmax(status != Status.OK))} cannot be evaluated", "q")
        R0 = np.tile(rotation_of_rpy(np.asarray(self.robot.base_rpy, float)), (len(q), 1, 1))
        r0 = np.tile(np.asarray(self.robot.base_xyz, float), (len(q), 1))
        R = [R0, *(np.reshape(x, (len(q), 3, 3)) for x in results[::2])]
        return np.array(R), np.array([r0, *results[1::2]])

    def placed(self, q: ArrayLike) -> list[Array]:
        """Return the points (m, k, 3) [m] of each body in the world."""
        R, r = self.frames(q)
        return [
            np.tile(b.points, (R.shape[1], 1, 1))
            if b.frame is None
            else b.points @ np.swapaxes(R[b.frame], 1, 2) + r[b.frame][:, None]
            for b in self.bodies
        ]

    def distances(self, q: ArrayLike) -> Array:
        """Return the distance (m, pairs) [m] of each pair at postures q (m, n) [rad, m]."""
        return self.nearest(q)[0]

    def nearest(self, q: ArrayLike) -> tuple[Array, Array, Array]:
        """Return distances (m, pairs) [m], and for each pair the nearest points (m, pairs, 3) of both segments, box or
        plane inside."""
        placed = self.placed(q)
        results = [_nearest(self.bodies[i], self.bodies[j], placed[i], placed[j]) for i, j in self.pairs]
        if not results:
            return np.zeros((len(placed[0]) if placed else 0, 0)), np.zeros((0, 0, 3)), np.zeros((0, 0, 3))
        distances, first, second = (np.stack(x, axis=1) for x in zip(*results, strict=True))
        radii = np.array([self.bodies[i].radius + self.bodies[j].radius for i, j in self.pairs])
        return distances - radii, first, second

    def least(self, q: ArrayLike) -> LeastDistance | None:
        """Return the smallest distance over postures q (m, n) [rad, m], with its pair and row; None without pairs."""
        distances = self.distances(q)
        if not distances.size:
            return None
        row, k = np.unravel_index(int(np.argmin(distances)), distances.shape)
        return LeastDistance(float(distances[row, k]), self.names[k], int(row))

    def least_along(self, time: Array, q: Array, v: Array) -> LeastDistance | None:
        """Return a lower bound of all distances at every instant of a motion, at most 0.1 mm below the smallest one;
        None without pairs.

        Args:
            time: ascending (m,) [s], m at least 2.
            q, v: joints (m, n) [rad, m] and their speeds (m, n); the motion is the cubic through both between two rows.

        A stretch of the motion moves a body, seen from the other one of its pair, by no more than the turn of each
        joint between them times the largest distance of the body's points from its axis. Stretches in which this leaves
        a smaller distance possible are halved.
        """
        h = np.diff(time)[:, None] / 3.0
        curves = np.stack([q[:-1], q[:-1] + h * v[:-1], q[1:] - h * v[1:], q[1:]], axis=1)  # Bernstein coefficients
        reach = self._reach(q, np.ptp(curves, axis=(0, 1)))
        begin, length = time[:-1], np.diff(time)
        least: LeastDistance | None = None
        while len(curves) and self.pairs:
            edges = (curves[:, :-1] + curves[:, 1:]) / 2  # de Casteljau, at the middle
            inner = (edges[:, :-1] + edges[:, 1:]) / 2
            middle = (inner[:, :1] + inner[:, 1:]) / 2
            left = np.concatenate([curves[:, :1], edges[:, :1], inner[:, :1], middle], axis=1)
            right = np.concatenate([middle, inner[:, 1:], edges[:, 2:], curves[:, 3:]], axis=1)
            distances = self.distances(middle[:, 0])
            m, k = np.unravel_index(int(np.argmin(distances)), distances.shape)
            if least is None or distances[m, k] < least.distance:
                instant = float(begin[m] + length[m] / 2)
                row = int(np.searchsorted(time, instant, side="right")) - 1
                least = LeastDistance(float(distances[m, k]), self.names[k], row, instant)
            moved = np.abs(np.concatenate([left, right], axis=1) - middle).max(axis=1) @ reach.T
            near = np.any(distances - moved < least.distance - RESOLUTION_M, axis=1)
            length = np.tile(length[near] / 2, 2)
            begin = np.concatenate([begin[near], begin[near] + length[: len(length) // 2]])
            curves = np.concatenate([left[near], right[near]])
        return least and replace(least, distance=least.distance - RESOLUTION_M)

    def _reach(self, q: Array, ranges: Array) -> Array:
        """Return how far (pairs, n) a unit of each joint's coordinate moves a body of each pair relative to the other
        one, at most [m/rad, 1], while the coordinates stay within `ranges` (n,) around q (m, n)."""
        structure = self.robot.structure
        _, r = self.frames(q[:1])
        steps = np.linalg.norm(np.diff(r[:, 0], axis=0), axis=1)  # between the origins of neighbouring links
        joints = [(structure.joints[k].kind, *structure.coordinate(k)) for k in range(len(steps))]
        steps += [abs(factor) * ranges[place] if kind == "prismatic" else 0.0 for kind, place, factor, _ in joints]
        reach = np.zeros((len(self.pairs), len(ranges)))
        for pair, row in zip(self.pairs, reach, strict=True):
            inner, outer = sorted((self.bodies[i] for i in pair), key=lambda body: body.frame or 0)
            far = float(np.linalg.norm(outer.points, axis=1).max())
            for k in reversed(range(inner.frame or 0, outer.frame or 0)):
                kind, place, factor, _ = joints[k]
                far += steps[k]  # the axis passes through the origin before or after this step
                row[place] += abs(factor) * (far if kind == "revolute" else 1.0)
        return reach


def link_distances(robot: Model, clearance: Clearance) -> LinkDistances:
    """Return the bodies and pairs of a serial arm that a clearance declares; see `LinkDistances`.

    Raises ArgumentError for a robot that is no serial arm, and for links that it does not have.

    >>> robot = gt.robots.serial_arm(a=[0.3, 0.2], alpha=[0.0, 0.0])
    >>> rod = gt.kinematics.LinkCapsule("link_2", [-0.2, 0.0, 0.0], [0.0, 0.0, 0.0], 0.03)
    >>> wall = gt.kinematics.PlaneObstacle([0.6, 0.0, 0.0], [-1.0, 0.0, 0.0])
    >>> gt.kinematics.link_distances(robot, gt.kinematics.Clearance(0.02, [rod], planes=[wall])).names
    [('link_2', 'planes[0]')]
    """
    structure = getattr(robot, "structure", None)
    if structure is None or not hasattr(structure, "joints"):
        raise ArgumentError("expected a serial arm, from a URDF or of Denavit-Hartenberg parameters", "robot")
    places = {structure.base: 0} | {joint.link: k + 1 for k, joint in enumerate(structure.joints)}
    declared = {c.link for c in clearance.capsules}
    merged = {s.link: s.body for s in structure.shapes}
    for n, name in enumerate(declared):
        if name not in places:
            raise ArgumentError(f"'{name}' is no link; links are {', '.join(places)}", f"capsules[{n}].link")
    bodies = [
        Body(s.link, s.body, np.array([s.begin, s.end]), s.radius)
        for s in structure.shapes if s.link not in declared
    ]  # fmt: skip
    bodies += [Body(c.link, places[c.link], np.array([c.begin, c.end]), c.radius) for c in clearance.capsules]
    if not bodies:
        raise ArgumentError(
            "is empty, and the robot's file has no collision geometry of spheres, cylinders or boxes; declare capsules",
            "capsules",
        )
    ignored = []
    for n, pair in enumerate(clearance.ignored):
        if len(pair) != 2 or not set(pair) <= set(places) | set(merged):
            raise ArgumentError(f"expected two links of {', '.join(places)}; found {pair}", f"ignored[{n}]")
        ignored.append(set(pair))
    first = len(bodies)
    bodies += _obstacles(clearance)
    pairs = [
        (i, j)
        for i, j in combinations(range(first), 2)
        if abs(int(bodies[i].frame or 0) - int(bodies[j].frame or 0)) > 1
        and {bodies[i].name, bodies[j].name} not in ignored
    ]
    pairs += [(i, j) for i in range(first) for j in range(first, len(bodies)) if bodies[i].frame]
    return LinkDistances(robot, tuple(bodies), tuple(pairs))


def _obstacles(clearance: Clearance) -> Iterator[Body]:
    for n, o in enumerate(clearance.obstacles):
        yield Body(f"obstacles[{n}]", None, np.array([o.begin, o.end]), o.radius)
    for n, box in enumerate(clearance.boxes):
        R, center, half = rotation_of_rpy(np.array(box.rpy)), np.array(box.center), np.array(box.size) / 2
        yield Body(f"boxes[{n}]", None, center + 2 * half * CORNERS @ R.T, box=(R, center, half))
    for n, plane in enumerate(clearance.planes):
        normal = np.array(plane.normal)
        if not np.any(normal):
            raise ArgumentError("is zero; expected a direction", f"planes[{n}].normal")
        yield Body(f"planes[{n}]", None, np.array([plane.point]), normal=normal / np.linalg.norm(normal))


def _nearest(first: Body, second: Body, a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return distances (m,) of the segments a (m, 2, 3) of a link from another body, and the nearest points (m, 3)."""
    if second.normal is not None:
        heights = (a - b) @ second.normal
        lowest = np.argmin(heights, axis=1)
        rows = np.arange(len(a))
        point = a[rows, lowest]
        return heights[rows, lowest], point, point - heights[rows, lowest, None] * second.normal
    if second.box is not None:
        R, center, half = second.box
        distance, p, on_box = segment_to_box((a[:, 0] - center) @ R, (a[:, 1] - center) @ R, half)
        return distance, p @ R.T + center, on_box @ R.T + center
    return segment_to_segment(a[:, 0], a[:, 1], b[:, 0], b[:, 1])
