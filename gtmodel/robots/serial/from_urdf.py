"""A serial arm out of a URDF: the chain to a tip, what is fixed gathered, side branches locked where they stand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..._near import meant
from ...geometry.rotations import rotation_about, rotation_of_rpy, rpy_of_rotation
from ...lang import ModelError
from .arm import FRICTION, SerialArm, arm_class
from .structure import ArmJoint, ArmStructure, moved, with_payload
from .urdf_file import MOVING, Urdf, UrdfJoint, read_urdf

Array = np.ndarray
Pose = tuple[Array, Array]  # R (3, 3), r (3,)
IDENTITY: Pose = (np.eye(3), np.zeros(3))


def from_urdf(
    path: str | Path, tip: str | None = None, *, smoothing: str = "tanh", payload: float = 0.0, **modifiers: Any
) -> SerialArm:
    """A serial arm from a URDF file: the chain from its root to a link, with limits, inertias and friction.

    Args:
        path: of the file, or its text.
        tip: link at the end of the chain, whose frame is the tool; the end of the only chain that moves if left out.
        smoothing: of friction, "tanh", "piecewise_linear", "sign" or "stiction".
        payload: point mass at the tip's origin [kg].
        modifiers: parameters of `SerialArm` in place of those of the file.

    Revolute, continuous, prismatic and fixed joints are read, and mimics, whose joints follow their leader in q and
    whose efforts count in its tau. What hangs on the chain by fixed joints belongs to its links; a side branch that
    moves stays where it stands, and `structure.notes` says so, as it says what was not used: shapes, transmissions.

    Raises ModelError with file and line for what is no URDF, floating and planar joints, loops, and where several
    chains move and no tip is named.

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
    >>> arm, tau.round(3)  # by the right-hand rule a negative torque holds it up
    (SerialArm('lever', 1 joints from base to arm), array([-4.905]))
    """
    if smoothing not in FRICTION:
        raise ModelError(f"friction smoothing is one of {', '.join(FRICTION)}; found {smoothing!r}")
    urdf = read_urdf(path)
    return _Chain(urdf, _tip(urdf, tip)).arm(smoothing, payload, modifiers)


def tips_of(urdf: Urdf) -> list[str]:
    """Links where chains that move may end: the last ones, each behind the last moving joint of its chain."""
    ends = [name for name in urdf.links if not urdf.joints_on(name)]
    return [name for name in ends if any(j.kind in MOVING for j in _way(urdf, name))]


def _tip(urdf: Urdf, tip: str | None) -> str:
    if tip is not None:
        if tip not in urdf.links:
            hint = meant(tip, urdf.links, f"there are {', '.join(list(urdf.links)[:8])}", most=2)
            raise ModelError(f"{urdf.file} has no link '{tip}'; {hint}")
        if not any(j.kind in MOVING for j in _way(urdf, tip)):
            raise ModelError(f"no joint of {urdf.file} moves between '{urdf.root}' and '{tip}'")
        return tip
    ends = tips_of(urdf)
    if not ends:
        raise ModelError(f"no joint of {urdf.file} moves")
    moving = {e: [j.name for j in _way(urdf, e) if j.kind in MOVING] for e in ends}
    longest = max(moving.values(), key=len)
    # on a branch of fixed joints off a longer chain nothing of its own moves
    ends = [e for e in ends if moving[e] != longest[: len(moving[e])] or moving[e] == longest]
    if len(ends) > 1:
        every = sorted(tips_of(urdf), key=lambda e: -len(moving[e]))
        raise ModelError(
            f"{urdf.file} has several ends: {', '.join(every[:6])}{', ...' if len(every) > 6 else ''}; name the link "
            f"that the tool is, such as tip = '{ends[0]}' or {urdf.file}:{ends[0]}"
        )
    return ends[0]


def _way(urdf: Urdf, tip: str) -> list[UrdfJoint]:
    """Joints from the root to a link."""
    parent = {j.child: j for j in urdf.joints.values()}
    way: list[UrdfJoint] = []
    while tip in parent:
        way.append(parent[tip])
        tip = parent[tip].parent
    return way[::-1]


def _pose(j: UrdfJoint, coordinate: float = 0.0) -> Pose:
    """Of the child in the parent."""
    R = rotation_of_rpy(j.rpy)
    if j.kind == "prismatic":
        return R, j.xyz + R @ (coordinate * j.axis)
    if j.kind == "fixed" or coordinate == 0.0:
        return R, j.xyz
    return R @ rotation_about(j.axis, coordinate), j.xyz


def _behind(first: Pose, second: Pose) -> Pose:
    return first[0] @ second[0], first[0] @ second[1] + first[1]


class _Chain:
    def __init__(self, urdf: Urdf, tip: str) -> None:
        self.urdf, self.tip = urdf, tip
        self.way = _way(urdf, tip)
        self.notes = list(urdf.notes)
        self.on_chain = {j.name for j in self.way}
        self.moving = [j for j in self.way if j.kind in MOVING and not self.locked(j)]

    def arm(self, smoothing: str, payload: float, modifiers: dict[str, Any]) -> SerialArm:
        urdf, values, pose, placed, plain = self.urdf, self.values(), IDENTITY, [], True
        moving = {j.name for j in self.moving}
        for j in self.way:
            # a joint that stands alone keeps the numbers of its file
            own = plain and j.name in moving
            if j.name in moving:
                R, r = _behind(pose, _pose(j))
                placed.append((j.xyz, j.rpy) if own else (r, rpy_of_rotation(R)))
                pose, plain = IDENTITY, True
            else:
                pose, plain = _behind(pose, _pose(j, self.stands(j))), False
        xyz, rpy = (np.array(column) for column in zip(*placed, strict=True))
        structure = ArmStructure(
            urdf.name, tuple(self.joints()), "rpy", urdf.root, self.tip, smoothing, tuple(dict.fromkeys(self.notes))
        )
        given = {
            "xyz": xyz, "rpy": rpy, "axis": np.array([j.axis for j in self.moving]), **values,
            "viscous": np.array([j.damping for j in self.moving]),
            "coulomb": np.array([j.friction for j in self.moving]),
            "tool_xyz": pose[1], "tool_rpy": rpy_of_rotation(pose[0]), **modifiers,
        }  # fmt: skip
        return arm_class(structure)(**with_payload(given, payload, len(self.moving)))

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
        """The joint that moves by itself, and multiplier and offset to it."""
        multiplier, offset, seen = 1.0, 0.0, {j.name}
        while j.leader is not None:
            offset += multiplier * j.offset
            multiplier *= j.multiplier
            if j.leader in seen:
                raise self.urdf.fault(f"joint '{j.name}' mimics itself", j.line)
            seen.add(j.leader)
            j = self.urdf.joints[j.leader]
        return j.name, multiplier, offset

    def locked(self, j: UrdfJoint) -> bool:
        """Whether a joint of the chain follows one that is not on it, and stands still with it."""
        leader, *_ = self.leader(j)
        leading = self.urdf.joints[leader]
        if leader in self.on_chain and leading.kind in MOVING:
            return False
        self.notes.append(f"line {j.line}: joint '{j.name}' follows '{leader}', which is not on the chain to "
                          f"'{self.tip}'; it stands at {self.stands(j):g}")  # fmt: skip
        return True

    def stands(self, j: UrdfJoint) -> float:
        """Where a joint stands that is not moved: nearest to 0 within its limits, a follower where that puts it."""
        if j.kind == "fixed":
            return 0.0
        name, multiplier, offset = self.leader(j)
        leading = self.urdf.joints[name]
        at = 0.0 if leading.kind == "fixed" else float(np.clip(0.0, leading.lower, leading.upper))
        return multiplier * at + offset

    def values(self) -> dict[str, Array]:
        """Masses, first moments and inertias of each moving link, with all that is fixed to it."""
        urdf, names = self.urdf, {j.name for j in self.moving}
        m, mc, J = np.zeros(len(names)), np.zeros((len(names), 3)), np.zeros((len(names), 6))
        for k, first in enumerate(self.moving):
            waiting: list[tuple[str, Pose]] = [(first.child, IDENTITY)]
            while waiting:
                name, (R, r) = waiting.pop()
                link = urdf.links[name]
                m[k] += link.m
                more = moved(R, r, link.m, link.mc, link.J)
                mc[k] += more[0]
                J[k] += more[1]
                for j in urdf.joints_on(name):
                    if j.name in names:
                        continue
                    if j.kind in MOVING and j.name not in self.on_chain:
                        self.notes.append(
                            f"line {j.line}: joint '{j.name}' is not on the chain to '{self.tip}'; its links stand "
                            f"still at {self.stands(j):g} and count with their mass"
                        )
                    waiting.append((j.child, _behind((R, r), _pose(j, self.stands(j)))))
        return {"m": m, "mc": mc, "J": J}
