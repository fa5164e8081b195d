"""A serial arm placed by xyz and rpy, as a URDF has it, by Denavit-Hartenberg numbers: the same motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...geometry.rotations import rotation_of_rpy, rpy_of_rotation
from .arm import SerialArm, arm_class
from .bodies import moved
from .geometry import NEARLY_PARALLEL

Array = np.ndarray
Pose = tuple[Array, Array]
# of the sine between axes: below, they are parallel and the direction across them comes from their distance alone
PARALLEL = 1e-9
MEETING = 1e-9  # m


def as_dh(arm: SerialArm) -> SerialArm:
    """The same arm by standard Denavit-Hartenberg numbers, for a calibration: with limits, mimics, inertias, friction.

    Frames follow the common normals of the axes; where an axis is within 5 degrees of parallel to the next, d is 0 and
    Hayati's beta says the rest. What comes before the first axis is base_xyz and base_rpy, what comes behind the last
    one tool_xyz and tool_rpy. An arm that has such numbers already is returned as it is.

    >>> text = '''<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
    ...   <joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
    ...   <joint name="lift" type="continuous"><parent link="b"/><child link="c"/>
    ...     <origin xyz="0.1 0 0.4"/><axis xyz="0 1 0"/></joint></robot>'''
    >>> arm = gt.robots.as_dh(gt.robots.from_urdf(text))
    >>> print(arm.a.round(3), arm.d.round(3), np.degrees(arm.alpha).round())
    [0.1 0. ] [0.4 0. ] [-90.   0.]
    """
    s = arm.structure
    if s.style != "rpy":
        return arm
    here, links = _links(arm)
    axes = [(R @ _unit(axis), r) for (R, r), axis in zip(links, np.asarray(arm.axis, float), strict=True)]
    n = len(links)
    numbers = np.zeros((n, 5))  # theta, d, a, alpha, beta
    frames = [_first(here, *axes[0])]
    for k in range(n - 1):
        if s.joints[k].kind == "prismatic":  # its axis is a direction; it may pass anywhere
            axes[k] = (axes[k][0], frames[k][1])
        through = frames[k][1] if s.joints[k + 1].kind == "prismatic" else axes[k + 1][1]
        numbers[k], after = _step(frames[k], axes[k + 1][0], through)
        frames.append(after)
    ends = [*frames[1:], frames[-1]]  # where each link's frame is, behind its numbers
    tool = _behind(links[-1], (rotation_of_rpy(arm.tool_rpy), np.asarray(arm.tool_xyz, float)))
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    bodies = [moved(*_seen_from(ends[k], links[k]), m[k], mc[k], J[k]) for k in range(n)]
    last = _seen_from(ends[-1], tool)
    values: dict[str, Any] = dict(zip(("theta", "d", "a", "alpha", "beta"), numbers.T, strict=True))
    values |= {"m": m, "mc": np.array([x for x, _ in bodies]), "J": np.array([x for _, x in bodies])}
    values |= {"base_xyz": frames[0][1], "base_rpy": rpy_of_rotation(frames[0][0])}
    values |= {"tool_xyz": last[1], "tool_rpy": rpy_of_rotation(last[0])}
    values |= {name: getattr(arm, name) for name in ("viscous", "coulomb", "velocity_scale")}
    return arm_class(replace(s, style="standard"))(**values)


def _links(arm: SerialArm) -> tuple[Pose, list[Pose]]:
    """The base, and each link's frame with all joints at 0, in the world."""
    base = (rotation_of_rpy(arm.base_rpy), np.asarray(arm.base_xyz, float))
    poses, pose = [], base
    for xyz, rpy in zip(np.asarray(arm.xyz, float), np.asarray(arm.rpy, float), strict=True):
        pose = _behind(pose, (rotation_of_rpy(rpy), xyz))
        poses.append(pose)
    return base, poses


def _first(base: Pose, z: Array, point: Array) -> Pose:
    """The frame on the first axis that is nearest to the base: its origin at the foot, its x along the base's."""
    R, r = base
    x = R[:, 0] - (R[:, 0] @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = R[:, 1] - (R[:, 1] @ z) * z
    x = _unit(x)
    return np.column_stack([x, np.cross(z, x), z]), point + ((r - point) @ z) * z


def _step(frame: Pose, z: Array, point: Array) -> tuple[Array, Pose]:
    """theta, d, a, alpha, beta from a frame to the next axis, along z through a point, and the frame there."""
    R, r = frame
    own, at = R.T @ z, R.T @ (point - r)  # in the frame
    across = float(np.hypot(own[0], own[1]))
    if across < np.sin(NEARLY_PARALLEL):
        foot = at - own * (at[2] / own[2])  # where the next axis passes the plane z = 0
        a = float(np.hypot(foot[0], foot[1]))
        theta, d = float(np.arctan2(foot[1], foot[0])) if a > MEETING else 0.0, 0.0
        seen = _about_z(-theta) @ own
        beta, alpha = float(np.arcsin(np.clip(seen[0], -1.0, 1.0))), float(np.arctan2(-seen[1], seen[2]))
    else:
        normal = np.array([-own[1], own[0], 0.0]) / across  # z x own
        a = float(normal @ at)
        if a < -MEETING:
            normal, a = -normal, -a
        a = a if abs(a) > MEETING else 0.0
        theta, beta = float(np.arctan2(normal[1], normal[0])), 0.0
        # the foot on this axis: at + s own has no part across the normal
        side = np.array([-normal[1], normal[0], 0.0])
        d = float(at[2] - own[2] * (side @ at) / (side @ own))
        alpha = float(np.arctan2(-(side @ own), own[2]))
    x, y, turn = (rotation_of_rpy(v) for v in ([alpha, 0, 0], [0, beta, 0], [0, 0, theta]))
    placed = (turn @ x @ y, np.array([a * np.cos(theta), a * np.sin(theta), d]))
    return np.array([theta, d, a, alpha, beta]), _behind(frame, placed)


def _about_z(angle: float) -> Array:
    return rotation_of_rpy([0.0, 0.0, angle])


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def _behind(first: Pose, second: Pose) -> Pose:
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def _seen_from(frame: Pose, other: Pose) -> Pose:
    return frame[0].T @ other[0], frame[0].T @ (other[1] - frame[1])
