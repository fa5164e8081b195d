"""Mechanisms from SDF, MJCF and URDF files: all links and joints, with branches and closed loops."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.polynomial import Polynomial

from .. import lang as gt
from .._near import meant
from ..results.read_bounds import XmlFault
from .mechanisms import JointedMechanism, MechanismGraph, MechanismJoint, MechanismLink, coupling_of, mechanism_class
from .serial.arm import FRICTION, SerialArm
from .serial.described import (
    IDENTITY,
    MOVING,
    Pose,
    Urdf,
    UrdfJoint,
    XmlElement,
    closing,
    composed,
    read_file,
    relative,
)
from .serial.from_mjcf import MjcfReader
from .serial.from_sdf import SdfReader
from .serial.from_urdf import arm_of
from .serial.urdf_file import UrdfReader

READERS = {"robot": UrdfReader, "sdf": SdfReader, "mujoco": MjcfReader}  # by the outermost element
UNORIENTED = ("ball", "weld", "free")  # the orientation of the child does not follow from that of the parent


def mechanism(
    path: str | Path,
    *,
    driven: str | Sequence[str] | None = None,
    start: Mapping[str, float] | None = None,
    cut: Sequence[str] = (),
    redundant: str = "drop",
    smoothing: str = "tanh",
    **modifiers: Any,
) -> JointedMechanism:
    """Return the mechanism of an SDF, MJCF or URDF file: all its links and joints, with branches and closed loops.

    Args:
        path: of the file, or its text; the outermost element tells the format.
        driven: name or names of the joints with motors, whose coordinates and efforts are q and tau, in this order. By
            default those that `<actuator>` of MJCF names; in a file without these, all joints of a tree, and in one
            with loops those with a limit of effort. A joint without a motor turns freely, up to friction and spring.
        start: coordinates [rad, m] of joints by name, at which loops are assembled; by default the pose that the file
            shows and, without loops, the nearest limit.
        cut, redundant: as for `gt.loops`; loops of a file have their redundant constraints dropped by default.
        smoothing: of Coulomb friction, as for `from_urdf`.
        modifiers: parameters by part, such as crank={"viscous": 0.1} or world={"g": [0, 0, 0]}.

    A loop closes where a link of an SDF is the child of two joints, or by `<connect>`, a ball joint, and `<weld>` of
    MJCF, which are exact here: solref and solimp are not used. Joints that follow another one (mimic,
    `<equality><joint>` up to the fourth order) act on its effort. SDF's universal, ball and screw joints and MJCF's
    ball and free joints are read too; they have no motor. Sensors and tendons, and all of an actuator but the name of
    its joint, are not used, which `graph.notes` lists; visual shapes are only drawn, by `gt.view`.

    Raises ModelError with file and line for what the formats or this reader do not allow, for names of joints that the
    file does not have, and for a joint that cannot have a motor.

    A four-bar of MJCF: a connect closes it, and the rocker of a parallelogram turns with the crank.

    >>> text = '''<mujoco model="parallelogram"><compiler angle="radian"/><worldbody>
    ...   <body name="bar"><joint name="crank" axis="0 -1 0" ref="1"/>
    ...     <geom type="capsule" fromto="0 0 0 0 0 .3" size=".01"/>
    ...     <body name="top" pos="0 0 .3"><joint name="elbow" axis="0 -1 0"/>
    ...       <geom type="capsule" fromto="0 0 0 .5 0 0" size=".01"/></body></body>
    ...   <body name="arm" pos=".5 0 0"><joint name="rocker" axis="0 -1 0" ref="1"/>
    ...     <geom type="capsule" fromto="0 0 0 0 0 .3" size=".01"/></body></worldbody>
    ...   <equality><connect name="tip" body1="top" body2="arm" anchor=".5 0 0"/></equality>
    ...   <actuator><motor joint="crank"/></actuator></mujoco>'''
    >>> linkage = gt.robots.mechanism(text)
    >>> report = linkage.mobility()
    >>> print(report.mobility, report.redundant)
    1 1
    >>> angle, status = linkage.causal("q", "rocker.phi")([1.4])
    >>> print(round(angle, 6), status)
    1.4 OK
    """
    motors = [driven] if isinstance(driven, str) else driven
    return _mechanism(read_robot(path), motors, start, cut, redundant, smoothing).with_(**modifiers)


def read_robot(source: str | Path) -> Urdf:
    """Read a URDF, SDF or MJCF file, or its text. Raises ModelError with file and line."""

    def read(file: str, root: XmlElement) -> Urdf:
        if root.tag not in READERS:
            known = "<robot> of URDF, <sdf>, or <mujoco> of MJCF"
            raise XmlFault(f"the outermost element is <{root.tag}>; expected {known}", root.line)
        return READERS[root.tag](file, root).urdf()

    return read_file(source, "robot", read)


def robot_of(
    path: str | Path, tip: str | None = None, *, smoothing: str = "tanh", payload: float = 0.0, **modifiers: Any
) -> SerialArm | JointedMechanism:
    """Return the robot that a problem file names: a `SerialArm` to the tip, a `JointedMechanism` for the tip "*" and,
    without a tip, of a file with loops. Arguments and errors as for `from_urdf` and `mechanism`."""
    urdf = read_robot(path)
    if tip != "*" and (tip is not None or closing(urdf.joints) is None):
        return arm_of(urdf, tip, None, smoothing, payload, modifiers)
    if payload:
        raise gt.ModelError(
            f"a payload acts at the tool of a serial arm; set the mass of a link of {urdf.file} instead"
        )
    return _mechanism(urdf, None, None, (), "drop", smoothing).with_(**modifiers)


def _mechanism(
    urdf: Urdf, driven: Sequence[str] | None, start: Mapping[str, float] | None, cut: Sequence[str], redundant: str,
    smoothing: str,
) -> JointedMechanism:  # fmt: skip
    if smoothing not in FRICTION:
        raise gt.ModelError(f"friction smoothing is one of {', '.join(FRICTION)}; found {smoothing!r}")
    if redundant not in ("error", "drop"):
        raise gt.ModelError(f"redundant is 'error' or 'drop'; found {redundant!r}")
    for name in (*(driven or ()), *(start or ()), *cut):
        if name not in urdf.joints:
            hint = meant(name, urdf.joints, f"there are {', '.join(list(urdf.joints)[:8])}")
            raise gt.ModelError(f"{urdf.file} has no joint '{name}'; {hint}")
    looped = closing(urdf.joints) is not None
    at = _coordinates(urdf, start or {}, looped)
    q = tuple(dict.fromkeys(driven if driven is not None else urdf.driven or _with_motors(urdf, looped)))
    for j in urdf.joints.values():
        if j.leader is not None and (kind := urdf.joints[j.leader].kind) not in MOVING:
            raise urdf.fault(
                f"joint '{j.name}' follows '{j.leader}', which is {kind}; it can follow a revolute or prismatic one",
                j.line,
            )
    for name in q:
        j = urdf.joints[name]
        if j.kind not in MOVING or j.leader is not None:
            why = f"is {j.kind}" if j.leader is None else f"follows '{j.leader}'"
            raise urdf.fault(f"joint '{name}' {why} and cannot be driven", j.line)
    free, leaders = _free(urdf), {j.leader for j in urdf.joints.values()}
    links, joints = _parts(urdf, free)
    moving = {n: j for n, j in urdf.joints.items() if j.kind in MOVING}
    motors = {n for n, j in moving.items() if n in q or j.leader is not None or n in leaders or j.rotor or j.spring[0]}
    graph = MechanismGraph(
        urdf.name, urdf.file, urdf.root,
        tuple((n, MechanismLink(links.get(n, ""), k.line, n in free)) for n, k in urdf.links.items() if n != urdf.root),
        tuple((n, _described(urdf.joints[n], part, n in motors)) for n, part in joints.items()),
        q, tuple(cut), looped and redundant == "drop", smoothing, tuple(dict.fromkeys(urdf.notes)),
        tuple((f"{links[n]}.frame" if n in links else "ground.frame", s) for n, k in urdf.links.items()
              if n in links or n == urdf.root for s in k.visuals),
    )  # fmt: skip
    values: dict[str, Any] = {} if urdf.gravity is None else {"world": {"g": urdf.gravity[0]}}
    if q:
        values["q"] = {"start": [at[name] for name in q]}
    poses = _poses(urdf, at)
    for name, part in links.items():
        link, (R, r) = urdf.links[name], poses[name]
        values[part] = {"m": link.m, "mc": link.mc, "J": link.J}
        if name in free:
            x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(R).as_quat()
            values[part] |= {"r": {"start": r}, "attitude": {"e": {"start": [w, x, y, z]}}}
    for name, part in joints.items():
        values[part] = _values(urdf.joints[name], at[name], name in motors)
        if (j := urdf.joints[name]).leader is not None:
            values[coupling_of(part)] = {"c": [j.offset, j.multiplier, *j.higher, 0.0, 0.0, 0.0][:5]}
    return mechanism_class(graph)(**values)


def _described(j: UrdfJoint, part: str, motor: bool) -> MechanismJoint:
    friction = j.kind in MOVING and bool(j.damping or j.friction)
    return MechanismJoint(part, j.kind, j.line, j.parent, j.child, motor, friction, j.leader)


def _with_motors(urdf: Urdf, looped: bool) -> list[str]:
    free = [j for j in urdf.joints.values() if j.kind in MOVING and j.leader is None]
    return [j.name for j in free if not looped or 0.0 < j.effort < np.inf]


def _coordinates(urdf: Urdf, start: Mapping[str, float], looped: bool) -> dict[str, float]:
    """Return the start value of each joint's coordinate, 0 for joints that have none or several."""
    known = {n: j.drawn for n, j in urdf.joints.items() if j.leader is None}
    if not looped:  # a loop closes in the pose that the file shows, even outside of limits
        known = {n: float(np.clip(x, urdf.joints[n].lower, urdf.joints[n].upper)) for n, x in known.items()}
    known |= start

    def at(j: UrdfJoint, before: tuple[str, ...] = ()) -> float:
        if j.name in before:
            raise urdf.fault(f"joint '{j.name}' follows itself", j.line)
        if j.name not in known:
            leader = at(urdf.joints[str(j.leader)], (*before, j.name))
            known[j.name] = float(Polynomial([j.offset, j.multiplier, *j.higher])(leader))
        return known[j.name]

    return {name: at(j) for name, j in urdf.joints.items()}


def _poses(urdf: Urdf, at: Mapping[str, float]) -> dict[str, Pose]:
    """Return the pose of each link in the world."""
    poses, waiting = {urdf.root: IDENTITY}, [urdf.root]
    while waiting:
        here = waiting.pop()
        for j in urdf.joints.values():
            step = j.pose(at[j.name])
            if j.parent == here and j.child not in poses:
                poses[j.child] = composed(poses[here], step)
                waiting.append(j.child)
            elif j.child == here and j.parent not in poses:
                poses[j.parent] = composed(poses[here], relative(step, IDENTITY))
                waiting.append(j.parent)
    return poses


def _free(urdf: Urdf) -> set[str]:
    """Return one link of each group whose orientations no joint connects to the root."""
    oriented = [j for j in urdf.joints.values() if j.kind not in UNORIENTED]
    free: set[str] = set()
    reached: set[str] = set()
    for first in sorted(urdf.links.values(), key=lambda link: (link.name != urdf.root, link.between)):
        if first.name in reached:
            continue
        free |= {first.name} - {urdf.root}
        waiting = [first.name]
        while waiting:
            here = waiting.pop()
            reached.add(here)
            for j in oriented:
                waiting += {j.parent, j.child} - reached if here in (j.parent, j.child) else ()
    return free


def _parts(urdf: Urdf, free: set[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the names of parts, which Python allows, by those of links and of joints in the file."""
    taken = {"q", "tau", "velocity_scale", *dir(JointedMechanism), *JointedMechanism._declared}

    def part(name: str, what: str) -> str:
        word = re.sub(r"\W", "_", name, flags=re.ASCII)
        if not word[:1].isalpha() or word in taken:
            word = f"{word}_{what}" if word[:1].isalpha() else f"{what}_{word}"
        while word in taken:
            word += "_"
        taken.update((word, coupling_of(word)))
        return word

    links = {n: part(n, "link") for n, k in urdf.links.items() if n != urdf.root and (not k.between or n in free)}
    return links, {n: part(n, "joint") for n, j in urdf.joints.items() if j.kind != "free"}


def _values(j: UrdfJoint, at: float, motor: bool) -> dict[str, Any]:
    """Return the parameters of a joint's part."""
    values: dict[str, Any] = {"xyz": j.xyz, "rpy": j.rpy}
    if j.kind == "universal":
        values |= {"axis_1": j.axis, "axis_2": j.second}
    elif j.kind == "screw":
        values |= {"axis": j.axis, "lead": j.lead}
    elif j.kind in MOVING:
        symbol = "s" if j.kind == "prismatic" else "phi"
        values |= {"axis": j.axis, symbol: {"start": at, "min": j.lower, "max": j.upper}}
        values |= {"viscous": j.damping, "coulomb": j.friction} if j.damping or j.friction else {}
        values |= {"rotor_inertia": j.rotor, "stiffness": j.spring[0], "rest": j.spring[1]} if motor else {}
    return values
