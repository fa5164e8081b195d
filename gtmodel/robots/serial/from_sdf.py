"""SDF, the format of Gazebo: poses of links and joints relative to any frame, as links and joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..._near import meant
from ...geometry.rotations import rotation_of_rpy, rpy_of_rotation
from ...results.read_bounds import XmlFault
from .arm import SerialArm
from .described import (
    IDENTITY,
    Pose,
    Urdf,
    UrdfJoint,
    UrdfLink,
    XmlElement,
    attribute,
    base_of,
    composed,
    inertia_of,
    number,
    read_file,
    relative,
    vector,
)  # fmt: skip
from .from_urdf import arm_of
from .structure import moved, six_of
from .visuals import sdf_solids

KINDS = ("revolute", "continuous", "prismatic", "fixed", "universal", "ball", "screw")
UNUSED = (
    "collision", "sensor", "plugin", "light", "gripper", "particle_emitter", "projector", "audio_source",
)  # fmt: skip
ZERO = np.zeros(3)
# elements of those whose misspelling would change the motion without a word
INSIDE = {
    "joint": "parent child pose axis axis2 physics sensor screw_thread_pitch",
    "axis2": "xyz limit dynamics mimic initial_position use_parent_model_frame",
    "axis": "xyz limit dynamics mimic initial_position use_parent_model_frame",
    "limit": "lower upper effort velocity stiffness dissipation",
    "dynamics": "damping friction spring_reference spring_stiffness", "mimic": "multiplier offset reference",
    "inertial": "mass density pose inertia auto_inertia_params fluid_added_mass",
    "inertia": "ixx ixy ixz iyy iyz izz",
}  # fmt: skip


def from_sdf(
    path: str | Path,
    tip: str | None = None,
    *,
    start: ArrayLike | None = None,
    smoothing: str = "tanh",
    payload: float = 0.0,
    **modifiers: Any,
) -> SerialArm:
    """Return a serial arm from the model of an SDF file: the chain from its base to a link, with limits and inertias.

    Args:
        path: of the file, or its text.
        tip: link at the end of the chain, whose frame is the tool; by default the end of the only moving chain.
        start: joint coordinates (n,) [rad, m] of the home pose, or rows of them, as for `serial_arm`.
        smoothing, payload, modifiers: as for `from_urdf`.

    Read are poses with relative_to, degrees and rotation_format; frames; axes with expressed_in; limits, damping,
    friction and mimic of axes; inertias. The joints are revolute, continuous, prismatic and fixed. The base is "world"
    if a joint has it as parent, and is then the model's frame; else the link without a parent. `structure.notes` lists
    what is not used, such as sensors and springs; visual shapes are drawn by `gt.view`.

    Raises ModelError with file and line for invalid SDF, other joints, several models, nested models and includes, and
    loops, which `mechanism` reads.

    >>> text = '''<sdf version="1.9"><model name="lever">
    ...   <link name="arm">
    ...     <inertial><pose>0.25 0 0 0 0 0</pose><mass>2</mass>
    ...       <inertia><ixx>0</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial>
    ...   </link>
    ...   <joint name="shoulder" type="revolute">
    ...     <parent>world</parent><child>arm</child>
    ...     <axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>1.5</upper></limit></axis>
    ...   </joint>
    ... </model></sdf>'''
    >>> arm = gt.robots.from_sdf(text)
    >>> tau, status = arm.causal(known="q", targets="tau")([0.0], [0.0], [0.0])
    >>> arm, tau.round(3)
    (SerialArm('lever', 1 joints from world to arm), array([-4.905]))
    """
    return arm_of(read_sdf(path), tip, start, smoothing, payload, modifiers)


def read_sdf(source: str | Path) -> Urdf:
    """Read an SDF file, or a text that begins with "<". Raises ModelError with file and line."""
    return read_file(source, "SDF", lambda file, root: SdfReader(file, root).urdf())


class SdfReader:
    """Reads one file."""

    def __init__(self, file: str, root: XmlElement) -> None:
        self.file, self.root = file, root
        self.notes: list[str] = []
        self.undrawn = 0  # visual shapes that are not drawn
        self.frames: dict[str, XmlElement] = {}  # links, joints and frames by name
        self.gravity: tuple[np.ndarray, int] | None = None
        self.known = {"__model__": IDENTITY, "world": IDENTITY}

    def urdf(self) -> Urdf:
        root = self.root
        if root.tag != "sdf":
            raise XmlFault(f"the outermost element is <{root.tag}>; expected <sdf>", root.line)
        models = [*root.all("model"), *(m for world in root.all("world") for m in world.all("model"))]
        if len(models) != 1:
            line = models[1].line if models else root.line
            raise XmlFault(f"the file has {len(models)} models; expected one", line)
        model = models[0]
        for tag in ("include", "model"):
            for e in model.all(tag):
                raise XmlFault(f"<{tag}> inside a model is not read; write its links and joints into the model", e.line)
        for e in model.all("link"):
            for inertial in e.all("inertial"):
                _refuse_unknown(inertial)
        for e in model.all("joint"):
            _refuse_unknown(e)
        for tag in ("link", "joint", "frame"):
            for e in model.all(tag):
                name = attribute(e, "name")
                if name in self.frames:
                    first = self.frames[name].line
                    raise XmlFault(f"two elements have the name '{name}'; the first is in line {first}", e.line)
                self.frames[name] = e
        links = {attribute(e, "name"): self.link(e) for e in model.all("link")}
        if not links:
            raise XmlFault("<model> holds no <link>", model.line)
        joints: dict[str, UrdfJoint] = {}
        for e in model.all("joint"):
            self.joint(e, links, joints)
        world = "world" if any(j.parent == "world" for j in joints.values()) else None
        if world:
            links[world] = UrdfLink(world, root.line)
        base = base_of(links, joints, world)
        for e in (g for w in root.all("world") for g in w.all("gravity")):
            self.gravity = _numbers(e, 3), e.line
        counts = {tag: sum(len(e.all(tag)) for e in [model, *model.all("link"), *model.all("joint")]) for tag in UNUSED}
        counts = {"visual": self.undrawn, **counts}
        if unused := [f"{n} <{tag}>" for tag, n in counts.items() if n]:
            self.notes.append(f"not used: {', '.join(unused)}")
        name = model.attributes.get("name", "arm")
        return Urdf(name, self.file, base, links, joints, self.notes, gravity=self.gravity)

    def link(self, e: XmlElement) -> UrdfLink:
        name, inertial, drawn = attribute(e, "name"), e.one("inertial"), [*sdf_solids(e, _pose)]
        self.undrawn += drawn.count(None)
        visuals = tuple(s for s in drawn if s is not None)
        if inertial is None:  # the format's default
            return UrdfLink(name, e.line, 1.0, ZERO, np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), visuals=visuals)
        if inertial.all("fluid_added_mass"):
            raise XmlFault(f"the added mass of link '{name}' is not read; remove it", inertial.line)
        m = _value(inertial, "mass", 1.0)
        if m < 0:
            raise XmlFault(f"the mass of link '{name}' is {m:g} kg; it cannot be negative", inertial.line)
        inertia = inertial.one("inertia") or XmlElement("inertia", {}, inertial.line)
        default = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0} if not inertia.inside else {}
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        I = inertia_of([_value(inertia, k, default.get(k, 0.0)) for k in keys])
        pose = inertial.one("pose")
        if pose is not None and pose.attributes.get("relative_to"):
            raise XmlFault("the <pose> of <inertial> is relative to its link; remove relative_to", pose.line)
        R, r = _pose(pose)
        return UrdfLink(name, e.line, m, *moved(R, r, m, ZERO, six_of(I)), visuals=visuals)

    def placed(self, name: str, e: XmlElement, within: tuple[str, ...] = ()) -> Pose:
        """Return the pose of a link, joint or frame in the model. e: the element that names it, for messages."""
        if name in self.known:
            return self.known[name]
        if name not in self.frames:
            raise XmlFault(f"<{e.tag}> names '{name}', which is no link, joint or frame of the model", e.line)
        if name in within:
            raise XmlFault(f"the poses of {' and '.join(within)} are relative to each other", self.frames[name].line)
        element = self.frames[name]
        pose = element.one("pose")
        to = "" if pose is None else pose.attributes.get("relative_to", "")
        if not to:
            default = {
                "joint": lambda: _text(element, "child"),
                "frame": lambda: element.attributes.get("attached_to", ""),
            }
            to = default.get(element.tag, lambda: "")() or "__model__"
        self.known[name] = composed(self.placed(to, pose or element, (*within, name)), _pose(pose))
        return self.known[name]

    def joint(self, e: XmlElement, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> None:
        """Add a joint, and a fixed one if its frame is not that of its child."""
        name, kind = attribute(e, "name"), attribute(e, "type")
        if kind not in KINDS:
            raise XmlFault(f"joint '{name}' is {kind}; expected one of {', '.join(KINDS)}", e.line)
        parent, child = _text(e, "parent"), _text(e, "child")
        for side, link in (("parent", parent), ("child", child)):
            if link not in links and not (side == "parent" and link == "world"):
                raise XmlFault(f"the {side} '{link}' of joint '{name}' is not a link", e.line)
        above, at, below = (self.placed(n, e) for n in (parent, name, child))
        options: dict[str, Any] = {}
        axis = np.array([0.0, 0.0, 1.0])
        element, second = e.one("axis"), e.one("axis2")
        if (second is not None) != (kind == "universal"):
            have = "has no" if second is None else "has an"
            raise XmlFault(f"joint '{name}' is {kind} and {have} <axis2>, which belongs to universal joints", e.line)
        if kind not in ("fixed", "ball") and element is not None:
            axis, options = self.axis(element, name, kind, at[0])
        if second is not None:
            options = {"second": self.axis(second, name, kind, at[0])[0]}
        if kind == "screw":
            _text(e, "screw_thread_pitch")
            options = {"lead": _value(e, "screw_thread_pitch", 0.0)}
        if kind in ("universal", "ball", "screw") and any(a.all("limit") or a.all("dynamics") for a in e.inside):
            self.notes.append(f"line {e.line}: limits and friction of joint '{name}', which is {kind}, are not used")
        follower = child
        offset, (R, r) = relative(at, below), relative(above, at)
        if not all(np.array_equal(x, y) for x, y in zip(at, below, strict=True)):
            follower = f"{name} frame"
            links[follower] = UrdfLink(follower, e.line, between=True)
            rest = f"{name} to {child}"
            joints[rest] = UrdfJoint(
                rest, "fixed", e.line, follower, child, offset[1], rpy_of_rotation(offset[0]), ZERO
            )  # fmt: skip
        joints[name] = UrdfJoint(name, kind, e.line, parent, follower, r, rpy_of_rotation(R), axis, **options)

    def axis(self, e: XmlElement, name: str, kind: str, R: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
        xyz = e.one("xyz")
        axis = np.array([0.0, 0.0, 1.0]) if xyz is None else _numbers(xyz, 3)
        length = float(np.linalg.norm(axis))
        if xyz is not None and length == 0.0:
            raise XmlFault(f"the axis of joint '{name}' is zero", xyz.line)
        axis = axis / length
        if xyz is not None and xyz.attributes.get("expressed_in"):
            axis = R.T @ self.placed(xyz.attributes["expressed_in"], xyz)[0] @ axis
        if e.all("use_parent_model_frame"):
            raise XmlFault("use_parent_model_frame is of SDF 1.6; write expressed_in instead", e.line)
        options: dict[str, Any] = {}
        if (limit := e.one("limit")) is not None:
            if kind != "continuous":
                low, high = _value(limit, "lower", -1e16), _value(limit, "upper", 1e16)
                if low > high:
                    raise XmlFault(f"the lower limit of joint '{name}' is above the upper one", limit.line)
                options["lower"] = low if low > -1e15 else -np.inf
                options["upper"] = high if high < 1e15 else np.inf
            for key in ("velocity", "effort"):
                value = _value(limit, key, -1.0)
                options[key] = value if 0 <= value < 1e15 else np.inf  # negative: unlimited
        if (dynamics := e.one("dynamics")) is not None:
            options["damping"], options["friction"] = (_value(dynamics, k, 0.0) for k in ("damping", "friction"))
            stiffness, rest = (_value(dynamics, f"spring_{k}", 0.0) for k in ("stiffness", "reference"))
            options["spring"] = stiffness, rest
        if (mimic := e.one("mimic")) is not None:
            multiplier, offset = _value(mimic, "multiplier", 1.0), _value(mimic, "offset", 0.0)
            options |= {"leader": attribute(mimic, "joint"), "multiplier": multiplier}
            options["offset"] = offset - multiplier * _value(mimic, "reference", 0.0)
            if options["leader"] not in self.frames or self.frames[options["leader"]].tag != "joint":
                raise XmlFault(f"joint '{name}' mimics '{options['leader']}', which is not a joint", mimic.line)
        return axis, options


def _refuse_unknown(e: XmlElement) -> None:
    names = INSIDE.get(e.tag, "").split()
    for inner in e.inside if names else ():
        if inner.tag not in names and ":" not in inner.tag:
            known = meant(inner.tag, names, f"it takes {', '.join(names)}")
            raise XmlFault(f"<{e.tag}> holds the unknown <{inner.tag}>; {known}", inner.line)
        if inner.tag != "physics":
            _refuse_unknown(inner)


def _text(e: XmlElement, tag: str) -> str:
    inner = e.one(tag)
    if inner is None or not inner.text.strip():
        raise XmlFault(f"<{e.tag}> has no <{tag}>", e.line)
    return inner.text.strip()


def _value(e: XmlElement, tag: str, default: float) -> float:
    inner = e.one(tag)
    if inner is None:
        return default
    text = inner.text.strip().lower().removeprefix("+")
    if text in ("inf", "-inf", "1e16", "-1e16"):
        return 1e16 if text[0] != "-" else -1e16
    return number(XmlElement(tag, {tag: text}, inner.line), tag)


def _numbers(e: XmlElement, count: int) -> np.ndarray:
    return vector(XmlElement(e.tag, {e.tag: e.text}, e.line), e.tag, [0.0] * count)


def _pose(e: XmlElement | None) -> Pose:
    """Return the pose that an element states: identity if it is missing or empty."""
    if e is None or not e.text.strip():
        return np.eye(3), ZERO
    if e.attributes.get("rotation_format", "euler_rpy") == "quat_xyzw":
        numbers = _numbers(e, 7)
        if abs(np.linalg.norm(numbers[3:]) - 1.0) > 1e-3:
            raise XmlFault(
                f"the quaternion of <pose> has the norm {np.linalg.norm(numbers[3:]):.4g}; expected 1", e.line
            )
        return scipy.spatial.transform.Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3]
    numbers = _numbers(e, 6)
    rpy = np.radians(numbers[3:]) if e.attributes.get("degrees", "false") in ("true", "1") else numbers[3:]
    return rotation_of_rpy(rpy), numbers[:3]
