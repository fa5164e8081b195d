"""Serial arms from URDF: the chain to a tip, with fixed links merged and side branches locked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..._near import meant
from ...geometry.rotations import rpy_of_rotation
from ...lang import ModelError
from .arm import FRICTION, SerialArm, arm_class
from .described import IDENTITY, MOVING, Pose, Urdf, UrdfJoint, closing, composed
from .structure import ArmJoint, ArmStructure, LinkShape, moved, started, with_payload
from .urdf_file import read_urdf
from .visuals import moved_solid

Array = np.ndarray
NEAR_GRAVITY = 0.02  # m/s2; files round 9.81


def from_urdf(
    path: str | Path,
    tip: str | None = None,
    *,
    start: ArrayLike | None = None,
    smoothing: str = "tanh",
    payload: float = 0.0,
    **modifiers: Any,
) -> SerialArm:
    """Return a serial arm from a URDF file: the chain from its root to a link, with limits, inertias and friction.

    Args:
        path: of the file, or its text.
        tip: link at the end of the chain, whose frame is the tool; by default the end of the only moving chain.
        start: joint coordinates (n,) [rad, m] of the home pose, or rows of them, as for `serial_arm`.
        smoothing: of Coulomb friction. "tanh", the default, is coulomb * tanh(velocity / velocity_scale);
            "piecewise_linear" rises linearly up to velocity_scale; "sign" is exact except at standstill; "stiction" is
            exact and can stick, with events.
        payload: point mass at the tip's origin [kg]; 0 by default.
        modifiers: parameters of `SerialArm` that replace those of the file, such as velocity_scale, by default 0.1
            rad/s (m/s for prismatic joints).

    `<limit>` becomes `joint_limits`, `speed_limits` and `effort_limits` of the arm; speeds and efforts are not enforced
    unless you write them as constraints. `<dynamics>` becomes `viscous` and `coulomb`.

    Supported joints are revolute, continuous, prismatic and fixed. A mimic joint follows its leader in q, and its
    effort is part of the leader's tau. Links fixed to the chain are merged into its links. A moving side branch is
    locked; `structure.notes` lists it, and all elements that were not used, such as
    transmissions. Visual shapes are drawn by `gt.view`.

    Raises ModelError with file and line for invalid URDF, floating and planar joints, loops, and several moving chains
    if no tip is given; `mechanism` reads all chains.

    >>> text = '''<robot name="lever">
    ...   <link name="base"/>
    ...   <link name="arm">
    ...     <inertial><origin xyz="0.25 0 0"/><mass value="2"/>
    ...       <inertia ixx="0" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    ...   </link>
    ...   <joint name="shoulder" type="revolute">
    ...     <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    ...     <limit lower="-1.5" upper="1.5" velocity="2" effort="20"/>
    ...   </joint>
    ... </robot>'''
    >>> arm = gt.robots.from_urdf(text)
    >>> tau, status = arm.causal(known="q", targets="tau")([0.0], [0.0], [0.0])
    >>> arm, tau.round(3)  # a negative torque about +y holds it up
    (SerialArm('lever', 1 joints from base to arm), array([-4.905]))
    """
    return arm_of(read_urdf(path), tip, start, smoothing, payload, modifiers)


def arm_of(
    urdf: Urdf, tip: str | None, start: ArrayLike | None, smoothing: str, payload: float, modifiers: dict[str, Any]
) -> SerialArm:
    """Return the arm to the tip of a file that was read; arguments as for `from_urdf`."""
    if smoothing not in FRICTION:
        raise ModelError(f"friction smoothing is one of {', '.join(FRICTION)}; found {smoothing!r}")
    advice = f"a serial arm has none: read the file with gt.robots.mechanism, or as '{urdf.file}:*' in a problem"
    if (pair := closing(urdf.joints)) is not None:
        raise urdf.fault(f"this joint closes a loop; {advice}", pair[1].line)
    for j in urdf.joints.values():
        if j.kind not in (*MOVING, "fixed") or j.higher:
            kind = "a nonlinear follower" if j.higher else j.kind
            raise urdf.fault(f"joint '{j.name}' is {kind}; {advice}", j.line)
    sprung = [j for j in urdf.joints.values() if j.spring[0]]
    urdf.notes.extend(f"line {j.line}: stiffness of joint '{j.name}' is not used" for j in sprung)
    if urdf.gravity is not None and np.any(np.abs(urdf.gravity[0] - [0.0, 0.0, -9.81]) > NEAR_GRAVITY):
        urdf.notes.append(f"line {urdf.gravity[1]}: the gravity {urdf.gravity[0].tolist()} m/s2 is not used; that of "
                          "the arm is along -z")  # fmt: skip
    return _Chain(urdf, _tip(urdf, tip)).arm(start, smoothing, payload, modifiers)


def tips_of(urdf: Urdf) -> list[str]:
    """Return the links at the ends of moving chains."""
    ends = [name for name in urdf.links if not urdf.joints_on(name)]
    return [name for name in ends if any(j.kind in MOVING for j in _path(urdf, name))]


def _tip(urdf: Urdf, tip: str | None) -> str:
    if tip is not None:
        if tip not in urdf.links:
            hint = meant(tip, urdf.links, f"there are {', '.join(list(urdf.links)[:8])}", most=2)
            raise ModelError(f"{urdf.file} has no link '{tip}'; {hint}")
        if not any(j.kind in MOVING for j in _path(urdf, tip)):
            raise ModelError(f"no joint of {urdf.file} moves between '{urdf.root}' and '{tip}'")
        return tip
    ends = tips_of(urdf)
    if not ends:
        raise ModelError(f"no joint of {urdf.file} moves")
    moving = {e: [j.name for j in _path(urdf, e) if j.kind in MOVING] for e in ends}
    longest = max(moving.values(), key=len)
    # drop a branch of fixed joints off a longer chain: it has no moving joint that the chain does not have
    ends = [e for e in ends if moving[e] != longest[: len(moving[e])] or moving[e] == longest]
    if len(ends) > 1:
        every = sorted(tips_of(urdf), key=lambda e: -len(moving[e]))
        raise ModelError(
            f"{urdf.file} has several ends: {', '.join(every[:6])}{', ...' if len(every) > 6 else ''}; name the tool's "
            f"link, such as tip = '{ends[0]}' or {urdf.file}:{ends[0]}; gt.robots.mechanism and {urdf.file}:* read all"
        )
    return ends[0]


def _path(urdf: Urdf, tip: str) -> list[UrdfJoint]:
    """Return the joints from the root to a link."""
    parent = {j.child: j for j in urdf.joints.values()}
    path: list[UrdfJoint] = []
    while tip in parent:
        path.append(parent[tip])
        tip = parent[tip].parent
    return path[::-1]


class _Chain:
    def __init__(self, urdf: Urdf, tip: str) -> None:
        self.urdf, self.tip = urdf, tip
        self.path = _path(urdf, tip)
        self.notes = list(urdf.notes)
        self.on_chain = {j.name for j in self.path}
        self.moving = [j for j in self.path if j.kind in MOVING and not self.locked(j)]

    def arm(self, start: ArrayLike | None, smoothing: str, payload: float, modifiers: dict[str, Any]) -> SerialArm:
        urdf, values, pose, placements, direct = self.urdf, self.values(), IDENTITY, [], True
        moving = {j.name for j in self.moving}
        for j in self.path:
            if j.name in moving:
                R, r = composed(pose, j.pose())
                # without fixed joints in between, the numbers of the file are kept exactly
                placements.append((j.xyz, j.rpy) if direct else (r, rpy_of_rotation(R)))
                pose, direct = IDENTITY, True
            else:
                pose, direct = composed(pose, j.pose(self.locked_at(j))), False
        xyz, rpy = (np.array(column) for column in zip(*placements, strict=True))
        structure = ArmStructure(
            urdf.name, tuple(self.joints()), "rpy", urdf.root, self.tip, smoothing, tuple(dict.fromkeys(self.notes)),
            shapes=tuple(self.shapes()),
            visuals=tuple((body, moved_solid(s, pose)) for name, body, pose in self.fixed_links()
                          for s in self.urdf.links[name].visuals),
        )  # fmt: skip
        parameters = {
            "xyz": xyz, "rpy": rpy, "axis": np.array([j.axis for j in self.moving]), **values,
            "viscous": np.array([j.damping for j in self.moving]),
            "coulomb": np.array([j.friction for j in self.moving]),
            "rotor_inertia": np.array([j.rotor for j in self.moving]),
            "tool_xyz": pose[1], "tool_rpy": rpy_of_rotation(pose[0]), **modifiers,
        }  # fmt: skip
        return arm_class(started(structure, start))(**with_payload(parameters, payload, len(self.moving)))

    def joints(self) -> Iterator[ArmJoint]:
        places = {j.name: k for k, j in enumerate(self.moving)}
        for j in self.moving:
            name, multiplier, offset = self.leader(j)
            kind = "prismatic" if j.kind == "prismatic" else "revolute"
            leader = None if name == j.name else places[name]
            yield ArmJoint(
                j.name, kind, j.child, j.lower, j.upper, j.velocity, j.effort, leader, multiplier, offset
            )  # fmt: skip

    def leader(self, j: UrdfJoint) -> tuple[str, float, float]:
        """Return the independent joint that j follows, and multiplier and offset to its coordinate."""
        multiplier, offset, visited = 1.0, 0.0, {j.name}
        while j.leader is not None:
            offset += multiplier * j.offset
            multiplier *= j.multiplier
            if j.leader in visited:
                raise self.urdf.fault(f"joint '{j.name}' mimics itself", j.line)
            visited.add(j.leader)
            j = self.urdf.joints[j.leader]
        return j.name, multiplier, offset

    def locked(self, j: UrdfJoint) -> bool:
        """Return whether a joint of the chain follows a joint outside it, and is therefore locked."""
        leader, *_ = self.leader(j)
        leading = self.urdf.joints[leader]
        if leader in self.on_chain and leading.kind in MOVING:
            return False
        self.notes.append(f"line {j.line}: joint '{j.name}' follows '{leader}', which is not on the chain to "
                          f"'{self.tip}'; it is locked at {self.locked_at(j):g}")  # fmt: skip
        return True

    def locked_at(self, j: UrdfJoint) -> float:
        """Return the coordinate of a locked joint: its leader is at the value nearest to 0 within its limits."""
        if j.kind == "fixed":
            return 0.0
        name, multiplier, offset = self.leader(j)
        leading = self.urdf.joints[name]
        nearest = 0.0 if leading.kind == "fixed" else float(np.clip(0.0, leading.lower, leading.upper))
        return multiplier * nearest + offset

    def shapes(self) -> Iterator[LinkShape]:
        """Yield the capsules of all links, in the frame of the base or of the moving link to which each is fixed."""
        for name, body, (R, r) in self.fixed_links():
            for begin, end, radius in self.urdf.links[name].capsules:
                a, b = ((R @ p + r).tolist() for p in (begin, end))
                yield LinkShape(name, body, (a[0], a[1], a[2]), (b[0], b[1], b[2]), radius)

    def fixed_links(self) -> Iterator[tuple[str, int, Pose]]:
        """Yield each link with the number of the body to which it is fixed, 0 for the base, and its pose in it."""
        bodies = {j.name: k + 1 for k, j in enumerate(self.moving)}
        waiting: list[tuple[str, int, Pose]] = [(self.urdf.root, 0, IDENTITY)]
        while waiting:
            name, body, (R, r) = waiting.pop(0)
            yield name, body, (R, r)
            for j in self.urdf.joints_on(name):
                if j.name in bodies:
                    waiting.append((j.child, bodies[j.name], IDENTITY))
                else:
                    waiting.append((j.child, body, composed((R, r), j.pose(self.locked_at(j)))))

    def values(self) -> dict[str, Array]:
        """Return mass, first moments and inertia of each moving link with the links fixed to it."""
        urdf, names = self.urdf, {j.name for j in self.moving}
        m, mc, J = np.zeros(len(names)), np.zeros((len(names), 3)), np.zeros((len(names), 6))
        for k, first in enumerate(self.moving):
            waiting: list[tuple[str, Pose]] = [(first.child, IDENTITY)]
            while waiting:
                name, (R, r) = waiting.pop()
                link = urdf.links[name]
                m[k] += link.m
                moments = moved(R, r, link.m, link.mc, link.J)
                mc[k] += moments[0]
                J[k] += moments[1]
                for j in urdf.joints_on(name):
                    if j.name in names:
                        continue
                    if j.kind in MOVING and j.name not in self.on_chain:
                        self.notes.append(
                            f"line {j.line}: joint '{j.name}' is not on the chain to '{self.tip}'; it is locked at "
                            f"{self.locked_at(j):g}, and the masses of its links are included"
                        )
                    waiting.append((j.child, composed((R, r), j.pose(self.locked_at(j)))))
        return {"m": m, "mc": mc, "J": J}
