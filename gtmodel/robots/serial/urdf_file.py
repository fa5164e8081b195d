"""Reading of URDF files: links with inertias, joints with origins, axes and limits, each with its line in the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ..._near import meant
from ...geometry.distances import bounding_capsule
from ...geometry.rotations import rotation_of_rpy, rpy_of_rotation
from ...results.read_bounds import XmlFault
from .described import (
    MOVING,
    Segment,
    Urdf,
    UrdfJoint,
    UrdfLink,
    XmlElement,
    attribute,
    base_of,
    closing,
    inertia_of,
    number,
    read_file,
    vector,
)  # fmt: skip
from .structure import moved, six_of
from .visuals import colour_of, urdf_solids

Array = np.ndarray
KINDS = (*sorted(MOVING), "fixed")
DEGREES = 13.0  # rad; limits beyond two turns are probably degrees
MILLIMETRES = 100.0  # m; origins farther away are probably millimetres
# inner elements of each element; and its attributes: those that are read, and those that do not affect the motion
INSIDE = {
    "robot": ("link", "joint"), "link": ("inertial",), "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
}  # fmt: skip
ATTRIBUTES: dict[str, tuple[str, str]] = {
    "robot": ("name", "version"), "link": ("name", "type concave"), "joint": ("name type", "dont_collapse"),
    "origin": ("xyz rpy quat_xyzw", ""), "inertial": ("", ""), "mass": ("value", ""),
    "inertia": ("ixx ixy ixz iyy iyz izz", ""), "parent": ("link", ""), "child": ("link", ""), "axis": ("xyz", ""),
    "limit": ("lower upper velocity effort", "acceleration deceleration jerk"), "dynamics": ("damping friction", ""),
    "mimic": ("joint multiplier offset", ""),
}  # fmt: skip
UNIT_NORM = 1e-3  # tolerance of a quaternion's norm, for rounded digits
# elements that no equation needs, with their names in the notes
LEFT_OUT = {
    "visual": "visual shapes (STL, OBJ, boxes and round ones are drawn)",
    "collision": "collision meshes", "transmission": "transmissions",
    "gazebo": "Gazebo elements", "safety_controller": "safety controllers", "calibration": "calibration marks",
    "material": "materials", "ros2_control": "ros2_control elements", "sensor": "sensors",
}  # fmt: skip


# half length, axis and radius of a capsule around each collision shape; a cylinder's capsule is longer by its radius
SHAPES: dict[str, Callable[[XmlElement], tuple[float, int, float]]] = {
    "sphere": lambda e: (0.0, 2, number(e, "radius")),
    "cylinder": lambda e: (number(e, "length") / 2, 2, number(e, "radius")),
    "capsule": lambda e: (number(e, "length") / 2, 2, number(e, "radius")),
    "box": lambda e: bounding_capsule(vector(e, "size", [0.0, 0.0, 0.0])),
}


def read_urdf(source: str | Path) -> Urdf:
    """Read a URDF file, or a text that begins with "<". Raises ModelError with file and line."""
    return read_file(source, "URDF", lambda file, robot: UrdfReader(file, robot).urdf())


@contextmanager
def _naming(owner: XmlElement) -> Iterator[None]:
    """Add the name of a link or joint to the sentence of a fault inside it."""
    try:
        yield
    except XmlFault as fault:
        name = owner.attributes.get("name", "")
        if not name or f"'{name}'" in fault.sentence:
            raise
        raise XmlFault(f"{owner.tag} '{name}': {fault.sentence}", fault.line) from None


class UrdfReader:
    """Reads one file."""

    def __init__(self, file: str, robot: XmlElement) -> None:
        self.file, self.robot = file, robot
        self.notes: list[str] = []
        self.undrawn = 0  # visual shapes that are not drawn

    def urdf(self) -> Urdf:
        robot = self.robot
        if robot.tag == "sdf":
            raise XmlFault("the file is SDF; read it with from_sdf, or name it arm.sdf", robot.line)
        if robot.tag == "mujoco":
            raise XmlFault("the file is MJCF; read it with from_mjcf, or name it arm.xml", robot.line)
        if robot.tag != "robot":
            raise XmlFault(f"the outermost element is <{robot.tag}>; expected <robot>", robot.line)
        self.refuse_xacro(robot)
        self.refuse_unknown(robot, "")
        links: dict[str, UrdfLink] = {}
        joints: dict[str, UrdfJoint] = {}
        for element in robot.all("link"):
            with _naming(element):
                link = self.link(element)
            self.refuse_second(links, link.name, "link", element)
            links[link.name] = link
        for element in robot.all("joint"):
            with _naming(element):
                joint = self.joint(element)
            self.refuse_second(joints, joint.name, "joint", element)
            joints[joint.name] = joint
        if not links:
            raise XmlFault("<robot> holds no <link>", robot.line)
        self.count(robot)
        for j in joints.values():
            for name, side in ((j.parent, "parent"), (j.child, "child")):
                if name not in links:
                    raise XmlFault(f"the {side} '{name}' of joint '{j.name}' is not a link", j.line)
        if (pair := closing(joints)) is not None:
            first, second = pair
            raise XmlFault(
                f"link '{second.child}' is the child of '{first.name}' and of '{second.name}'; URDF has no loops: "
                "describe a closed mechanism in SDF or MJCF, or as a gtmodel model",
                second.line,
            )
        root = base_of(links, joints)
        for joint in joints.values():
            if joint.leader is not None and joint.leader not in joints:
                raise XmlFault(f"joint '{joint.name}' mimics '{joint.leader}', which is not a joint", joint.line)
        self.doubt(links, joints)
        return Urdf(robot.attributes.get("name", "arm"), self.file, root, links, joints, self.notes)

    def refuse_xacro(self, element: XmlElement) -> None:
        if element.tag.startswith("xacro:") or any("${" in v or "$(" in v for v in element.attributes.values()):
            raise XmlFault("this is a xacro template; create the URDF first: xacro arm.xacro > arm.urdf", element.line)
        for inner in element.inside:
            self.refuse_xacro(inner)

    def refuse_unknown(self, e: XmlElement, owner: str) -> None:
        """Refuse unknown attributes, and elements that are misplaced or mistyped, except names with a namespace. owner:
        the link or joint of the element, for messages."""
        if e.tag in ("link", "joint"):
            owner = f" of {e.tag} '{e.attributes.get('name', '')}'"
        read, idle = (names.split() for names in ATTRIBUTES[e.tag])
        for name in e.attributes:
            if ":" in name or name == "xmlns" or name in read:
                continue
            if name not in idle:
                known = meant(name.lower(), read, f"it takes {', '.join(read) or 'none'}")
                raise XmlFault(f"<{e.tag}>{owner} has the unknown attribute '{name}'; {known}", e.line)
            if name != "version":
                self.notes.append(f"line {e.line}: '{name}' of <{e.tag}>{owner} is not used")
        allowed = INSIDE.get(e.tag, ())
        for inner in e.inside:
            if inner.tag in allowed:
                self.refuse_unknown(inner, owner)
                continue
            slip = "" if inner.tag in LEFT_OUT else meant(inner.tag.lower(), allowed, cutoff=0.75)
            if inner.tag in ATTRIBUTES or slip:
                known = slip or f"it takes {', '.join(allowed) or 'none'}"
                raise XmlFault(f"<{e.tag}>{owner} holds <{inner.tag}>, which it does not take; {known}", inner.line)

    def refuse_second(
        self, elements: Mapping[str, UrdfLink | UrdfJoint], name: str, what: str, element: XmlElement
    ) -> None:
        if name in elements:
            line = elements[name].line
            raise XmlFault(f"two elements <{what}> have the name '{name}'; the first is in line {line}", element.line)

    def link(self, e: XmlElement) -> UrdfLink:
        name = attribute(e, "name")
        inertial, capsules = e.one("inertial"), self.capsules(e)
        materials = {m.attributes.get("name", ""): colour_of(m) for m in self.robot.all("material")}
        drawn = [*urdf_solids(e, _origin, materials)]
        self.undrawn += drawn.count(None)
        if drawn and not any(drawn):  # meshes in another format, such as Collada, often collide as STL
            drawn += urdf_solids(e, _origin, materials, "collision")
        visuals = tuple(s for s in drawn if s is not None)
        if inertial is None:
            return UrdfLink(name, e.line, capsules=capsules, visuals=visuals)
        mass, inertia = inertial.one("mass"), inertial.one("inertia")
        if mass is None or inertia is None:
            missing = "mass" if mass is None else "inertia"
            raise XmlFault(f"the <inertial> of link '{name}' has no <{missing}>", inertial.line)
        m = number(mass, "value")
        if m < 0:
            raise XmlFault(f"the mass of link '{name}' is {m:g} kg; it cannot be negative", mass.line)
        I = inertia_of([number(inertia, f"i{k}") for k in ("xx", "yy", "zz", "xy", "xz", "yz")])
        principal = np.linalg.eigvalsh(I)
        if principal[0] < -1e-9 * abs(principal[2]) or principal[2] > (1 + 1e-6) * (principal[0] + principal[1]):
            self.notes.append(f"line {inertia.line}: the inertia of link '{name}' is physically impossible: its "
                              f"principal moments are {', '.join(f'{p:.3g}' for p in principal)} kg m2")  # fmt: skip
        xyz, rpy = _origin(inertial)
        mc, J = moved(rotation_of_rpy(rpy), xyz, m, np.zeros(3), six_of(I))
        return UrdfLink(name, e.line, m, mc, J, capsules, visuals=visuals)

    def capsules(self, link: XmlElement) -> tuple[Segment, ...]:
        """Return capsules around the collision shapes of a link, without those of meshes."""
        segments: list[Segment] = []
        for collision in link.all("collision"):
            shape = _shape(collision)
            if shape is None:
                continue
            xyz, rpy = _origin(collision)
            half, axis, radius = SHAPES[shape.tag](shape)
            along = half * rotation_of_rpy(rpy)[:, axis]
            segments.append((xyz - along, xyz + along, radius))
        return tuple(segments)

    def joint(self, e: XmlElement) -> UrdfJoint:
        name, kind = attribute(e, "name"), attribute(e, "type")
        if kind not in KINDS:
            base = "; a serial arm has a fixed base" if kind in ("floating", "planar") else ""
            raise XmlFault(f"joint '{name}' is {kind}; expected one of {', '.join(KINDS)}{base}", e.line)
        ends: list[str] = []
        for side in ("parent", "child"):
            element = e.one(side)
            if element is None:
                raise XmlFault(f"joint '{name}' has no <{side}>", e.line)
            ends.append(attribute(element, "link"))
        xyz, rpy = _origin(e)
        axis_element = e.one("axis")
        axis = np.array([1.0, 0.0, 0.0]) if axis_element is None else vector(axis_element, "xyz", [1.0, 0.0, 0.0])
        length = float(np.linalg.norm(axis))
        if kind != "fixed" and length == 0.0:
            raise XmlFault(f"the axis of joint '{name}' is zero", axis_element.line if axis_element else e.line)
        options: dict[str, Any] = {}
        limit = e.one("limit")
        if limit is not None and kind != "fixed":
            if kind != "continuous":
                options["lower"], options["upper"] = (number(limit, k, 0.0) for k in ("lower", "upper"))
                if options["lower"] > options["upper"]:
                    raise XmlFault(f"the lower limit of joint '{name}' is above the upper one", limit.line)
            for key in ("velocity", "effort"):
                value = number(limit, key, 0.0)
                options[key] = value if value > 0 else np.inf
        elif kind in ("revolute", "prismatic"):
            self.notes.append(f"line {e.line}: joint '{name}' is {kind} without a <limit>; it is used without limits")
        dynamics = e.one("dynamics")
        if dynamics is not None:
            options["damping"], options["friction"] = (number(dynamics, k, 0.0) for k in ("damping", "friction"))
        mimic = e.one("mimic")
        if mimic is not None and kind != "fixed":
            options["leader"] = attribute(mimic, "joint")
            options["multiplier"], options["offset"] = number(mimic, "multiplier", 1.0), number(mimic, "offset", 0.0)
        return UrdfJoint(name, kind, e.line, ends[0], ends[1], xyz, rpy, axis / (length or 1.0), **options)

    def count(self, robot: XmlElement) -> None:
        counts = dict.fromkeys(LEFT_OUT, 0) | {"visual": self.undrawn}
        others: dict[str, int] = {}

        def walk(e: XmlElement) -> None:
            for inner in e.inside:
                if inner.tag in LEFT_OUT:
                    used = {"visual": True, "material": bool(colour_of(inner)), "collision": _shape(inner) is not None}
                    counts[inner.tag] += not used.get(inner.tag, False)
                elif inner.tag not in ATTRIBUTES:
                    others.setdefault(inner.tag, inner.line)
                else:
                    walk(inner)

        walk(robot)
        unused = [f"{number} {LEFT_OUT[tag]}" for tag, number in counts.items() if number]
        if unused:
            self.notes.append(f"not used: {', '.join(unused)}")
        self.notes += [f"line {line}: <{tag}> is unknown and not used" for tag, line in others.items()]

    def doubt(self, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> None:
        for j in joints.values():
            if np.max(np.abs(j.xyz)) > MILLIMETRES:
                self.notes.append(f"line {j.line}: the origin of joint '{j.name}' is {np.max(np.abs(j.xyz)):g} m away; "
                                  "URDF is in metres, this looks like millimetres")  # fmt: skip
            if j.kind == "revolute" and np.any(np.abs([j.lower, j.upper])[np.isfinite([j.lower, j.upper])] > DEGREES):
                self.notes.append(f"line {j.line}: the limits of joint '{j.name}' are {j.lower:g} and {j.upper:g} rad; "
                                  "URDF is in radians, these look like degrees")  # fmt: skip


def _shape(collision: XmlElement) -> XmlElement | None:
    """Return the shape of a collision if a capsule can be put around it, None for a mesh."""
    geometry = collision.one("geometry")
    return next((e for e in geometry.inside if e.tag in SHAPES), None) if geometry is not None else None


def _origin(e: XmlElement) -> tuple[Array, Array]:
    origin = e.one("origin")
    if origin is None:
        return np.zeros(3), np.zeros(3)
    xyz = vector(origin, "xyz", [0.0, 0.0, 0.0])
    if "quat_xyzw" not in origin.attributes:
        return xyz, vector(origin, "rpy", [0.0, 0.0, 0.0])
    if "rpy" in origin.attributes:
        raise XmlFault("<origin> has both rpy and quat_xyzw; expected one of them", origin.line)
    quaternion = vector(origin, "quat_xyzw", [0.0, 0.0, 0.0, 1.0])
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > UNIT_NORM:
        raise XmlFault(f"quat_xyzw of <origin> has the norm {norm:.4g}; expected 1", origin.line)
    return xyz, rpy_of_rotation(scipy.spatial.transform.Rotation.from_quat(quaternion).as_matrix())
