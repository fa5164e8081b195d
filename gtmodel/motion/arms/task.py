"""A motion of a serial arm from pose to pose as one Optimization for each segment, and its guess.

Two bodies are apart by d if a plane separates them: a unit normal n and an offset c with n.a >= c + r_a + d for the
points a of the one, n.b <= c - r_b for the points b of the other. Normal and offset of each pair are controls of the
optimisation, which keeps the constraint smooth where the distance itself is not, at parallel segments and edges. Since
|n| <= 1 suffices, a solution of these rows proves the distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ... import lang as gt
from ...compiler.causal import compile_causal
from ...geometry.chains import postures
from ...geometry.rotations import rotation_of_rpy
from ...kinematics.clearance import Clearance, LinkDistances, link_distances
from ...kinematics.serial_chain import chain_of
from ...lang import Model
from ...results import ArgumentError, Status, Trajectory
from ..axes.options import AxisCost
from ..task import SHORTEST_TIME_S
from .options import ArmLimits, ArmPose, Waypoint, joints_of

Array = np.ndarray
GUESS_ROWS = 61
SLOWER = 1.5  # guess of the time, relative to the shortest by the limits of speed
TURN_RATE = 1.0  # rad/s, m/s: speed of the guess if a joint has no limit
SPARE_M = 1e-3  # more than the required distance at collocation points, for the motion between them
AHEAD_M = 0.1  # pairs nearer than this along the guess are constraints from the start


@dataclass(frozen=True, eq=False)
class TaskPose:
    """A pose of the task: joints of the guess q (n,), whether they are prescribed, or T (3,) and R (3, 3) or None."""

    name: str
    q: Array
    prescribed: bool
    rest: bool
    T: Array | None = None
    R: Array | None = None

    def rows(self, arm: Any, instant: Any) -> Iterator[Any]:
        """Yield the constraints of the pose at an instant."""
        for k in range(len(self.q)):
            if self.prescribed:
                yield arm.q[k].at(instant) == float(self.q[k])
            if self.rest:
                yield gt.der(arm.q[k]).at(instant) == 0
        if self.T is not None:
            for k in range(3):
                yield arm.T[k].at(instant) == float(self.T[k])
        if self.R is not None:
            off = self.R.T @ arm.R  # a rotation by 180 degrees has the same three rows; the guess excludes it
            for i, j in ((2, 1), (0, 2), (1, 0)):
                yield (off[i, j] - off[j, i]).at(instant) == 0

    def missed(self, q: Array, T: Array, R: Array) -> float:
        """Return the deviation of joints [rad, m], position [m] or orientation [rad] from the pose."""
        parts = [np.abs(q - self.q).max()] if self.prescribed else []
        if self.T is not None:
            parts.append(np.linalg.norm(T - self.T))
        if self.R is not None:
            parts.append(np.linalg.norm(self.R.T @ R - np.eye(3)) / np.sqrt(2.0))
        return float(max(parts))


@dataclass(frozen=True, eq=False)
class ArmTask:
    """A checked motion: robot, poses in order, limits, cost, and the bodies whose distances count."""

    robot: Any
    poses: list[TaskPose]
    limits: ArmLimits
    cost: AxisCost
    clearance: Clearance | None
    near: LinkDistances | None

    @property
    def speed(self) -> Array:
        """Largest joint speeds (n,) [rad/s, m/s]."""
        own = self.limits.joint_speed
        return self.limits.speed * np.asarray(self.robot.speed_limits if own is None else own)

    @property
    def effort(self) -> Array:
        """Largest motor efforts (n,) [N.m, N]."""
        own = self.limits.joint_effort
        return self.limits.effort * np.asarray(self.robot.effort_limits if own is None else own)

    @cached_property
    def required(self) -> Array:
        """Distances (pairs,) [m] to keep at collocation points: those required, with a spare if all poses have it."""
        assert self.near is not None and self.clearance is not None
        room = self.near.distances(np.array([pose.q for pose in self.poses])).min(axis=0) - self.clearance.distance
        return self.clearance.distance + np.clip(room, 0.0, SPARE_M)

    def guess(self) -> list[Trajectory]:
        """Return a smooth motion from pose to pose for each segment, at rest at each, with planes between the pairs."""
        runs, begin = [], 0.0
        s = np.linspace(0.0, 1.0, GUESS_ROWS)
        shape, rate, bend = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
        for a, b in zip(self.poses, self.poses[1:], strict=False):
            step = b.q - a.q
            speed = np.where(np.isfinite(self.speed), self.speed, TURN_RATE)
            time = max(SLOWER * 1.875 * float(np.max(np.abs(step) / speed)), 2 * SHORTEST_TIME_S)
            q = a.q + shape[:, None] * step
            values = {
                "robot.q": q, "der(robot.q)": rate[:, None] * step / time,
                "der(robot.q,2)": bend[:, None] * step / time**2,
            }  # fmt: skip
            runs.append(Trajectory(begin + time * s, values | self.planes(q), {}))
            begin += time
        return runs

    def planes(self, q: Array) -> dict[str, Array]:
        """Return normals and offsets [m] of planes half way between the nearest points of all pairs, at postures q."""
        if self.near is None:
            return {}
        _, first, second = self.near.nearest(q)
        values = {}
        for k, (i, j) in enumerate(self.near.pairs):
            a, b = first[:, k], second[:, k]
            gap = np.linalg.norm(a - b, axis=1)
            away = np.where(gap[:, None] > 0, a - b, [0.0, 0.0, 1.0])
            n = away / np.linalg.norm(away, axis=1)[:, None]
            shift = (self.near.bodies[i].radius - self.near.bodies[j].radius) / 2
            values[f"normal_{k}"] = n
            values[f"offset_{k}"] = np.einsum("mi,mi->m", n, (a + b) / 2) - shift
        return values

    def segment(self, k: int, active: Sequence[int], guess: Trajectory) -> gt.Optimization:
        """Return the motion from pose k to pose k + 1, with planes between the pairs of indices `active`."""
        task, near = self, self.near
        first, last = k == 0, self.poses[k + 1]
        bounded = [i for i, (low, high) in enumerate(_limits(self.robot)) if np.isfinite([low, high]).any()]

        class Segment(gt.Optimization):
            robot: Any
            metre: Any

            def objective(self) -> Any:
                total = task.cost.time * (self.final_time - self.start_time)
                if task.cost.energy:
                    shares = [self.robot.tau[i] / self.largest[i] for i in range(len(task.effort))]
                    total = total + task.cost.energy * gt.integral(sum((x**2 for x in shares[1:]), shares[0] ** 2))
                return total

            def constraints(self) -> Any:
                q, tau = self.robot.q, self.robot.tau
                if not first:
                    yield self.final_time - self.start_time >= SHORTEST_TIME_S
                else:
                    yield from task.poses[0].rows(self.robot, self.start_time)
                yield from last.rows(self.robot, self.final_time)
                for i in range(len(task.effort)):
                    if np.isfinite(task.effort[i]):
                        yield gt.between(-self.largest[i], tau[i], self.largest[i])
                    if np.isfinite(task.speed[i]):
                        yield gt.between(-float(task.speed[i]), gt.der(q[i]), float(task.speed[i]))
                    if task.limits.joint_acceleration is not None:
                        most = float(task.limits.joint_acceleration[i])
                        yield gt.between(-most, gt.der(q[i], 2), most)
                for i in bounded:
                    low, high = _limits(task.robot)[i]
                    yield gt.between(float(low), q[i], float(high))
                yield from self.apart()

            def apart(self) -> Any:
                if near is None:
                    return
                for p in active:
                    a, b = (near.bodies[i] for i in near.pairs[p])
                    least, points = float(task.required[p]) + a.radius, placed(self, near, near.pairs[p][0])
                    if b.normal is not None:
                        for point in points:
                            yield gt.dot(point - b.points[0] * self.metre, b.normal) >= least
                        continue
                    n, c = getattr(self, f"normal_{p}"), getattr(self, f"offset_{p}")
                    yield gt.dot(n, n) <= 1.0
                    for point in points:
                        yield gt.dot(n, point) - c >= least
                    for point in placed(self, near, near.pairs[p][1]):
                        yield gt.dot(n, point) - c <= -b.radius

        declared: dict[str, Any] = {
            "robot": gt.part(self.robot), "metre": gt.parameter(1.0, unit="m"),
            "largest": gt.parameter(np.where(np.isfinite(self.effort), self.effort, 1.0)),
            "final_time": gt.free(float(guess.time[-1]), min=SHORTEST_TIME_S, unit="s"),
        }  # fmt: skip
        if not first:
            declared["start_time"] = gt.free(float(guess.time[0]), unit="s")
        for p in active:
            if near is not None and near.bodies[near.pairs[p][1]].normal is None:
                declared[f"normal_{p}"] = gt.input(3, min=-1.0, max=1.0)
                declared[f"offset_{p}"] = gt.input(unit="m")
        return type("Segment", (Segment,), declared)()


def placed(model: Any, near: LinkDistances, body: int) -> list[Any]:
    """Return the points [m] of a body in the world, as expressions of a model with the arm."""
    b = near.bodies[body]
    if b.frame is None:
        return [p * model.metre for p in b.points]
    if b.frame == 0:
        R, r = near.frames(np.zeros(len(near.robot.structure.leaders)))
        return [(R[0, 0] @ p + r[0, 0]) * model.metre for p in b.points]
    frame = model.robot.links[b.frame - 1].after
    return [frame.r + frame.R @ p * model.metre for p in b.points]


def _limits(robot: Any) -> Array:
    return np.asarray(robot.structure.limits())


def task_of(
    robot: Model, start: ArmPose, goal: ArmPose, waypoints: Sequence[Waypoint], limits: ArmLimits, cost: AxisCost,
    clearance: Clearance | None,
) -> ArmTask:  # fmt: skip
    """Check a motion and return it. Raises ArgumentError."""
    arm: Any = robot
    if not hasattr(arm, "structure") or not hasattr(arm.structure, "leaders"):
        raise ArgumentError("expected a serial arm, from a URDF or of Denavit-Hartenberg parameters", "robot")
    if cost.time == 0.0 and cost.energy == 0.0:
        raise ArgumentError("has zero weights only; give cost.time or cost.energy", "cost")
    joints = [arm.structure.joints[k] for k in arm.structure.leaders]
    for name in ("joint_speed", "joint_effort", "joint_acceleration"):
        values = getattr(limits, name)
        if values is not None and len(values) != len(joints):
            raise ArgumentError(f"has {len(values)} numbers; expected {len(joints)}, one per joint", f"limits.{name}")
    near = None
    if clearance is not None:
        try:
            near = link_distances(robot, clearance)
        except ArgumentError as error:
            where = error.argument if error.argument == "robot" else f"clearance.{error.argument}"
            raise ArgumentError(error.message, where) from None
    task = ArmTask(arm, [], limits, cost, clearance, near)
    if cost.energy and not np.all(np.isfinite(task.effort)):
        k = int(np.argmin(np.isfinite(task.effort)))
        raise ArgumentError(
            f"is missing: joint '{joints[k].name}' has no limit of effort, which cost.energy needs",
            "limits.joint_effort",
        )
    given: list[tuple[str, ArmPose, bool]] = [("start", start, True)]
    given += [(f"waypoints[{n}]", w, w.stop) for n, w in enumerate(waypoints)] + [("goal", goal, True)]
    for name, pose, rest in given:
        task.poses.append(_pose(task, name, pose, rest, [joint.kind == "revolute" for joint in joints]))
    for before, then in zip(task.poses, task.poses[1:], strict=False):
        if np.array_equal(before.q, then.q):
            raise ArgumentError(f"is the same pose as {before.name}; give another one", f"{then.name}.q")
    if near is not None and clearance is not None:
        for pose in task.poses:
            least = near.least(pose.q)
            if pose.prescribed and least is not None and least.distance < clearance.distance:
                raise ArgumentError(
                    f"has {least}; expected at least {1e3 * clearance.distance:g} mm: move it, or leave the pair out "
                    "with clearance.ignored",
                    f"{pose.name}.q",
                )
    return task


def _pose(task: ArmTask, name: str, pose: ArmPose, rest: bool, revolute: list[bool]) -> TaskPose:
    bounds = _limits(task.robot)
    q = joints_of(pose, revolute, name)
    if q is not None:
        out = np.flatnonzero((q < bounds[:, 0]) | (q > bounds[:, 1]))
        if out.size:
            k = int(out[0])
            raise ArgumentError(
                f"entry {k + 1} is {q[k]:.4g}; the limits of this joint are {bounds[k, 0]:.4g} and {bounds[k, 1]:.4g} "
                f"(rad, m)",
                f"{name}.q" if revolute[k] else f"{name}.slides",
            )
        return TaskPose(name, q, True, rest)
    before = task.poses[-1].q if task.poses else np.clip(np.zeros(len(revolute)), *bounds.T)
    T = np.array(pose.tcp)
    R = None if pose.rpy is None else rotation_of_rpy(np.array(pose.rpy))
    chain = chain_of(task.robot)
    candidates = []
    if R is None:  # the guess keeps the orientation if it can
        kept = np.asarray(compile_causal(task.robot, known="q", targets="R")(before)[0])
        candidates.append(postures(chain, T, kept, limits=bounds, near=before))
    if R is not None or not np.any(candidates[0].status == Status.OK):
        candidates.append(postures(chain, T, R, limits=bounds, near=before))
    good = np.array([q for f in candidates for q, s in zip(f.q[0], f.status[0], strict=True) if s == Status.OK])
    if not len(good):
        advice = "" if R is not None else "; give rpy, or q"
        raise ArgumentError(f"no posture within the limits of the joints reaches it{advice}", f"{name}.tcp")
    if task.near is not None and task.clearance is not None and task.near.pairs:
        room = task.near.distances(good).min(axis=1)
        if R is not None and room.max() < task.clearance.distance:
            least = task.near.least(good[int(np.argmax(room))])
            raise ArgumentError(
                f"no posture keeps the distance of {1e3 * task.clearance.distance:g} mm; the best has {least}",
                f"{name}.tcp",
            )
        good = good[room >= task.clearance.distance] if room.max() >= task.clearance.distance else good
    return TaskPose(name, good[0], False, rest, T, R)
