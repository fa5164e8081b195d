"""MJCF, the XML of MuJoCo: defaults, orientations, joints of bodies and equalities as links and joints."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from ..._near import meant
from ...geometry.rotations import rotation_about, rpy_of_rotation, shortest_rotation
from ...results import ArgumentError
from ...results.read_bounds import XmlFault
from ...view.solids import MeshFile, VisibleSolid
from .arm import SerialArm
from .described import (
    IDENTITY,
    MOVING,
    Pose,
    Urdf,
    UrdfJoint,
    UrdfLink,
    XmlElement,
    attribute,
    composed,
    inertia_of,
    number,
    read_file,
    relative,
    vector,
)  # fmt: skip
from .from_urdf import arm_of
from .mjcf_poses import TURNED, MjcfPoses
from .solids import SIZES, SOLIDS
from .structure import moved, six_of
from .visuals import drawable, hex_of, mjcf_solid

Array = np.ndarray
DENSITY = 1000.0  # kg/m3, MuJoCo's default
# sections of the file that change no position, mass or joint
UNUSED = (
    "asset", "visual", "statistic", "size", "contact", "sensor", "keyframe", "custom", "extension", "tendon",
)  # fmt: skip
# elements of a body that have no mass
MASSLESS = ("site", "camera", "light", "plugin")
TOP = ("compiler", "option", "default", "worldbody", "equality", "actuator", *UNUSED)
ORIENTED = "pos quat axisangle xyaxes zaxis euler"
# attributes of the elements whose misspelling would change the motion without a word
ATTRIBUTES = {
    "body": f"name childclass {ORIENTED} mocap gravcomp user sleep",
    "inertial": f"mass diaginertia fullinertia {ORIENTED}",
    "joint": "name class type group pos axis stiffness range limited actuatorfrcrange actuatorfrclimited margin ref "
    "springref armature damping frictionloss user actuatorgravcomp solreflimit solimplimit "
    "solreffriction solimpfriction",
}  # fmt: skip
INSIDE = {"mujoco": TOP, "worldbody": ("body", "geom", *MASSLESS),
          "body": ("body", "inertial", "joint", "freejoint", "geom", *MASSLESS)}  # fmt: skip
KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "free"}
CLOSURES = {"connect": "ball", "weld": "weld"}  # equalities that close loops, as joints


def from_mjcf(
    path: str | Path,
    tip: str | None = None,
    *,
    start: ArrayLike | None = None,
    smoothing: str = "tanh",
    payload: float = 0.0,
    **modifiers: Any,
) -> SerialArm:
    """Return a serial arm from an MJCF file: the chain from the world to a body, with limits, inertias and friction.

    Args:
        path: of the file, or its text.
        tip: body at the end of the chain, whose frame is the tool; by default the end of the only moving chain.
        start: joint coordinates (n,) [rad, m] of the home pose, or rows of them, as for `serial_arm`.
        smoothing, payload, modifiers: as for `from_urdf`.

    Read are the compiler's angle, eulerseq, autolimits and inertiafromgeom; classes of defaults; orientations as quat,
    axisangle, xyaxes, zaxis and euler; hinge and slide joints with pos, axis, range, ref, damping, frictionloss,
    armature and actuatorfrcrange; several joints of one body; inertial, or else the masses of spheres, boxes, capsules,
    cylinders and ellipsoids; and `<equality><joint>` of first order, as a joint that follows another. The coordinates
    are those of MuJoCo's qpos. `structure.notes` lists what is not used, such as springs and actuators.

    Raises ModelError with file and line for invalid MJCF, and for what is not supported: free and ball joints, loops
    (`<equality>` connect and weld), includes, and bodies whose mass depends on a mesh.

    >>> text = '''<mujoco model="lever">
    ...   <worldbody>
    ...     <body name="arm">
    ...       <joint name="shoulder" axis="0 1 0" range="-86 86"/>
    ...       <inertial pos="0.25 0 0" mass="2" diaginertia="0.001 0.01 0.01"/>
    ...     </body>
    ...   </worldbody>
    ... </mujoco>'''
    >>> arm = gt.robots.from_mjcf(text)
    >>> tau, status = arm.causal(known="q", targets="tau")([0.0], [0.0], [0.0])
    >>> arm, tau.round(3)
    (SerialArm('lever', 1 joints from world to arm), array([-4.905]))
    """
    return arm_of(read_mjcf(path), tip, start, smoothing, payload, modifiers)


def read_mjcf(source: str | Path) -> Urdf:
    """Read an MJCF file, or a text that begins with "<". Raises ModelError with file and line."""
    return read_file(source, "MJCF", lambda file, root: MjcfReader(file, root).urdf())


@dataclass
class _Class:
    """A class of defaults: attributes by tag, with those of the classes around it."""

    attributes: dict[str, dict[str, str]] = field(default_factory=dict)

    def within(self, e: XmlElement) -> _Class:
        merged = {tag: dict(values) for tag, values in self.attributes.items()}
        for inner in e.inside:
            if inner.tag != "default":
                merged[inner.tag] = {**merged.get(inner.tag, {}), **inner.attributes}
        return _Class(merged)


class MjcfReader(MjcfPoses):
    """Reads one file."""

    def __init__(self, file: str, root: XmlElement) -> None:
        super().__init__()
        self.file, self.root = file, root
        self.notes: list[str] = []
        self.links: dict[str, UrdfLink] = {}
        self.joints: dict[str, UrdfJoint] = {}
        self.classes: dict[str, _Class] = {"": _Class()}
        self.autolimits, self.from_geoms = True, "auto"
        self.placed = {"world": IDENTITY}  # bodies as drawn, in the world
        self.meshes: dict[str, MeshFile] = {}
        self.colours: dict[str, str] = {}
        self.sites: dict[str, tuple[str, Pose]] = {}  # body of each site, and pose in it

    def urdf(self) -> Urdf:
        root = self.root
        if root.tag != "mujoco":
            raise XmlFault(f"the outermost element is <{root.tag}>; expected <mujoco>", root.line)
        self.refuse(root)
        for e in root.all("compiler"):
            self.compiler(e)
        for e in root.all("default"):
            self.defaults(e, self.classes[""], "main")
        self.assets(root)
        self.links["world"] = UrdfLink("world", root.line)
        worlds = root.all("worldbody")
        for world in worlds:
            around = world.attributes.get("childclass", "main")
            self.place(world, "world", around)
            at_rest = self.links["world"].visuals + self.visuals(world, around)
            self.links["world"] = replace(self.links["world"], visuals=at_rest)
            for body in world.all("body"):
                self.body(body, "world", around)
        if not self.joints:
            raise XmlFault("no <body> of the file has a joint", worlds[0].line if worlds else root.line)
        for e in root.all("equality"):
            self.equality(e)
        unused = [tag for tag in UNUSED if root.all(tag) and tag != "asset"]  # meshes and materials are drawn
        if unused:
            self.notes.append(f"not used: {', '.join(unused)}")
        gravity = next(((vector(e, "gravity", [0.0, 0.0, -9.81]), e.line) for e in root.all("option")), None)
        name = root.attributes.get("model", "arm")
        return Urdf(name, self.file, "world", self.links, self.joints, self.notes, self.driven(root), gravity)

    def refuse(self, e: XmlElement) -> None:
        for inner in e.inside:
            if inner.tag in ("include", "frame", "replicate", "attach", "composite", "flexcomp", "flex", "deformable"):
                raise XmlFault(
                    f"<{inner.tag}> is not read; save the compiled model first: "
                    "mujoco.mj_saveLastXML('arm.xml', mujoco.MjModel.from_xml_path(...))",
                    inner.line,
                )
            if e.tag in INSIDE and inner.tag not in INSIDE[e.tag]:
                known = meant(inner.tag, INSIDE[e.tag], f"it takes {', '.join(INSIDE[e.tag])}")
                raise XmlFault(f"<{e.tag}> holds the unknown <{inner.tag}>; {known}", inner.line)
            names = ATTRIBUTES.get(inner.tag, "").split() if e.tag in ("body", "worldbody", "default") else []
            for name in inner.attributes if names else ():
                if name not in names:
                    known = meant(name, names, f"it takes {', '.join(names)}")
                    raise XmlFault(f"<{inner.tag}> has the unknown attribute '{name}'; {known}", inner.line)
            if e.tag not in (*UNUSED, "actuator"):
                self.refuse(inner)

    def compiler(self, e: XmlElement) -> None:
        words = {"angle": ("degree", "radian"), "autolimits": ("true", "false"),
                 "inertiafromgeom": ("auto", "true", "false"), "coordinate": ("local",)}  # fmt: skip
        for name, known in words.items():
            if e.attributes.get(name, known[0]) not in known:
                raise XmlFault(f"{name} of <compiler> is '{e.attributes[name]}'; expected {' or '.join(known)}", e.line)
        for name in ("inertiagrouprange", "settotalmass", "balanceinertia", "boundmass", "boundinertia"):
            if e.attributes.get(name, "false") not in ("false", "0", "-1"):
                raise XmlFault(f"{name} of <compiler> changes masses and is not read; remove it", e.line)
        self.set(e)
        self.autolimits = e.attributes.get("autolimits", "true") == "true"
        self.from_geoms = e.attributes.get("inertiafromgeom", self.from_geoms)

    def assets(self, root: XmlElement) -> None:
        """Read colours of materials, and names of mesh files that can be drawn."""
        folder = next((e.attributes[n] for e in root.all("compiler") for n in ("meshdir", "assetdir")
                       if n in e.attributes), "")  # fmt: skip
        for e in (inner for assets in root.all("asset") for inner in assets.inside):
            e = self.filled(e, "main")
            file = e.attributes.get("file", "")
            name = e.attributes.get("name", Path(file).stem)
            if e.tag == "material":
                self.colours[name] = hex_of(e.attributes.get("rgba", ""))
            elif e.tag == "mesh":
                try:
                    scale = vector(e, "scale", [1.0] * 3).tolist()
                    self.meshes[name] = MeshFile(str(Path(folder, drawable(file))), tuple(scale))
                except (XmlFault, ArgumentError):
                    continue

    def defaults(self, e: XmlElement, outer: _Class, name: str) -> None:
        name = e.attributes.get("class", name)
        self.classes[name] = outer.within(e)
        for inner in e.all("default"):
            attribute(inner, "class")
            self.defaults(inner, self.classes[name], "")

    def filled(self, e: XmlElement, around: str) -> XmlElement:
        """Return an element with the defaults of its class."""
        name = e.attributes.get("class", around)
        if name not in self.classes and name != "main":
            raise XmlFault(f"<{e.tag}> has the class '{name}', which no <default> declares", e.line)
        values = self.classes.get(name, self.classes[""]).attributes.get(e.tag, {})
        own = dict(e.attributes)
        if set(TURNED) & set(own):  # an orientation of the element replaces one of its class in another form
            values = {k: v for k, v in values.items() if k not in TURNED}
        return XmlElement(e.tag, {**values, **own}, e.line, e.inside)

    def body(self, e: XmlElement, parent: str, around: str) -> None:
        name = e.attributes.get("name", f"body_{len(self.links)}")
        around = e.attributes.get("childclass", around)
        if name in self.links:
            raise XmlFault(f"two bodies have the name '{name}'; the first is in line {self.links[name].line}", e.line)
        if e.attributes.get("mocap", "false") == "true":
            raise XmlFault(f"body '{name}' is a mocap body, whose motion is not in the file; remove it", e.line)
        if float(e.attributes.get("gravcomp", "0")):
            self.notes.append(f"line {e.line}: gravcomp of body '{name}' is not used")
        self.links[name] = UrdfLink(name, e.line)  # keeps the order of the file
        pose, at = self.pose(e), np.zeros(3)  # of the body in its parent; position of the last joint in the body
        self.placed[name] = composed(self.placed[parent], pose)
        self.place(e, name, around)
        moving = [
            self.filled(j, around)
            if j.tag == "joint"
            else XmlElement("joint", {**j.attributes, "type": "free"}, j.line)
            for j in e.inside
            if j.tag in ("joint", "freejoint")
        ]
        for n, j in enumerate(moving):
            child = f"{name}/{n + 1}" if n + 1 < len(moving) or np.any(vector(j, "pos", [0.0] * 3)) else name
            at = self.joint(j, parent, child, pose, at, name)
            parent, pose = child, (np.eye(3), np.zeros(3))
        if parent != name:
            offset = pose[1] - at if moving else pose[1]
            self.fixed(parent, name, (pose[0], offset), e.line)
        self.links[name] = replace(self.link(e, name, around), visuals=self.visuals(e, around))
        for inner in e.all("body"):
            self.body(inner, name, around)

    def visuals(self, e: XmlElement, around: str) -> tuple[VisibleSolid, ...]:
        drawn = (mjcf_solid(self.filled(g, around), self.pose, self.meshes, self.colours) for g in e.all("geom"))
        return tuple(solid for solid in drawn if solid is not None)

    def place(self, e: XmlElement, body: str, around: str) -> None:
        for site in (self.filled(s, around) for s in e.all("site")):
            if "fromto" not in site.attributes:
                self.sites[site.attributes.get("name", "")] = body, self.pose(site)

    def fixed(self, parent: str, child: str, pose: Pose, line: int) -> None:
        name = f"{child} fixed"
        self.joints[name] = UrdfJoint(
            name, "fixed", line, parent, child, pose[1], rpy_of_rotation(pose[0]), np.zeros(3)
        )

    def joint(self, e: XmlElement, parent: str, child: str, pose: Pose, at: Array, body: str) -> Array:
        """Add a joint; return its position in the body. at: position of the joint before it, the origin of `parent`."""
        name = e.attributes.get("name", f"{body}_joint_{len(self.joints) + 1}")
        kind = e.attributes.get("type", "hinge")
        if kind not in KINDS:
            raise XmlFault(f"joint '{name}' is {kind}; expected one of {', '.join(KINDS)}", e.line)
        if kind == "free" and parent != "world":
            raise XmlFault(f"joint '{name}' is free; only children of the world may have a free joint", e.line)
        if name in self.joints:
            first = self.joints[name].line
            raise XmlFault(f"two joints have the name '{name}'; the first is in line {first}", e.line)
        axis = vector(e, "axis", [0.0, 0.0, 1.0])
        if not np.any(axis):
            raise XmlFault(f"the axis of joint '{name}' is zero", e.line)
        axis = axis / np.linalg.norm(axis)
        place, hinge = vector(e, "pos", [0.0, 0.0, 0.0]) if kind != "free" else at, kind == "hinge"
        scaled = self.angle if hinge else float
        R, r = pose[0], pose[1] + pose[0] @ (place - at)
        reference = scaled(number(e, "ref", 0.0)) if KINDS[kind] in MOVING else 0.0
        if reference:  # the file shows the arm at this coordinate
            R, r = (R @ rotation_about(axis, -reference), r) if hinge else (R, r - R @ axis * reference)
        limits = self.limits(e, scaled)
        force = vector(e, "actuatorfrcrange", [0.0, 0.0])
        if e.attributes.get("actuatorfrclimited", "auto") == "false":
            force = np.zeros(2)
        unused = {"range", "damping", "frictionloss", "armature", "stiffness"} & set(e.attributes)
        if KINDS[kind] not in MOVING and unused:
            what = f"{', '.join(sorted(unused))} of joint '{name}', which is {kind}"
            self.notes.append(f"line {e.line}: {what}, not used")
        values: dict[str, float] = {}
        for key in ("damping", "stiffness"):
            first, *higher = e.attributes.get(key, "0").split() or ["0"]
            values[key] = number(XmlElement("joint", {key: first}, e.line), key)
            if higher:
                self.notes.append(f"line {e.line}: {key} of joint '{name}' is used in first order only")
        if child not in self.links:
            self.links[child] = UrdfLink(child, e.line, between=True)
        self.joints[name] = UrdfJoint(
            name, KINDS[kind], e.line, parent, child, r, rpy_of_rotation(R), axis,
            *limits, effort=float(force[1]) if np.any(force) else np.inf, damping=values["damping"],
            friction=number(e, "frictionloss", 0.0), rotor=number(e, "armature", 0.0),
            drawn=reference, spring=(values["stiffness"], scaled(number(e, "springref", 0.0))),
        )  # fmt: skip
        return place

    def limits(self, e: XmlElement, scaled: Any) -> tuple[float, float]:
        word = e.attributes.get("limited", "auto")
        if word == "auto" and not self.autolimits and "range" in e.attributes:
            raise XmlFault('the joint has a range without limited, and autolimits is "false"; set limited', e.line)
        if word == "false" or (word == "auto" and not (self.autolimits and "range" in e.attributes)):
            return -np.inf, np.inf
        low, high = (scaled(x) for x in vector(e, "range", [0.0, 0.0]))
        if low >= high:
            raise XmlFault(
                f"range of a joint takes a lower and a larger upper limit; found {low:g} and {high:g}", e.line
            )
        return low, high

    def link(self, e: XmlElement, name: str, around: str) -> UrdfLink:
        inertial = e.one("inertial")
        geoms = [self.filled(g, around) for g in e.all("geom")]
        if self.from_geoms == "true" or (inertial is None and self.from_geoms == "auto"):
            return self.of_geoms(e, name, geoms)
        if inertial is None:
            return UrdfLink(name, e.line)
        m, (R, r) = number(inertial, "mass"), self.pose(inertial)
        if "fullinertia" in inertial.attributes:
            I = inertia_of(vector(inertial, "fullinertia", [0.0] * 6).tolist())
        else:
            attribute(inertial, "diaginertia")
            I = np.diag(vector(inertial, "diaginertia", [0.0] * 3))
        if m < 0:
            raise XmlFault(f"the mass of body '{name}' is {m:g} kg; it cannot be negative", inertial.line)
        return UrdfLink(name, e.line, m, *moved(R, r, m, np.zeros(3), six_of(I)))

    def of_geoms(self, e: XmlElement, name: str, geoms: list[XmlElement]) -> UrdfLink:
        m, mc, J = 0.0, np.zeros(3), np.zeros(6)
        for g in geoms:
            mass, I, (R, r) = self.geom(g, name)
            first, second = moved(R, r, mass, np.zeros(3), six_of(I))
            m, mc, J = m + mass, mc + first, J + second
        return UrdfLink(name, e.line, m, mc, J)

    def geom(self, g: XmlElement, body: str) -> tuple[float, Array, Pose]:
        """Return mass, inertia about the centre and pose of a geom."""
        kind = g.attributes.get("type", "mesh" if "mesh" in g.attributes else "sphere")
        density = number(g, "density", DENSITY)
        given = number(g, "mass") if "mass" in g.attributes else None
        if given == 0.0 or (given is None and density == 0.0):
            return 0.0, np.zeros((3, 3)), (np.eye(3), np.zeros(3))
        if g.attributes.get("shellinertia", "false") == "true" or kind not in SOLIDS:
            raise XmlFault(
                f"body '{body}' has no <inertial>, and the mass of its {kind} is not computed; save the compiled model "
                "with its inertias first: mujoco.mj_saveLastXML",
                g.line,
            )
        (R, r), size = self.pose(g), [float(x) for x in g.attributes.get("size", "0").split()]
        if "fromto" in g.attributes:
            a, b = np.split(vector(g, "fromto", [0.0] * 6), 2)
            length = float(np.linalg.norm(b - a))
            if length == 0.0:
                raise XmlFault("fromto of <geom> takes two different points", g.line)
            R, r, size = shortest_rotation(np.array([0.0, 0.0, 1.0]), (a - b) / length), (a + b) / 2, size[:1]
            size += [length / 2] if kind in ("capsule", "cylinder") else [size[0], length / 2]
        if len(size) < SIZES[kind] or not all(np.isfinite(size)) or min(size[: SIZES[kind]]) <= 0:
            raise XmlFault(f"size of a {kind} takes {SIZES[kind]} positive numbers; found {size}", g.line)
        volume, I = SOLIDS[kind](*size[: SIZES[kind]])
        mass = density * volume if given is None else given
        return mass, np.diag(I) * mass, (R, r)

    def equality(self, e: XmlElement) -> None:
        for rule in e.inside:
            if rule.attributes.get("active", "true") == "false":
                continue
            if rule.tag not in (*CLOSURES, "joint"):
                raise XmlFault(f"<{rule.tag}> of <equality> is not read; remove it", rule.line)
            (self.close if rule.tag in CLOSURES else self.follow)(rule)

    def close(self, rule: XmlElement) -> None:
        """Add the ball joint or the weld that closes a loop, and the frame on the other body at which it acts."""
        name = rule.attributes.get("name", f"{rule.tag}_{len(self.joints)}")
        name = name if name not in self.joints else f"{name}_{rule.tag}"
        if number(rule, "torquescale", 1.0) == 0.0:
            raise XmlFault("<weld> with torquescale 0 holds no rotation; write <connect>", rule.line)
        if "site1" in rule.attributes:
            (first, own), (second, other) = (
                self.named(rule, attribute(rule, s), self.sites, "site") for s in ("site1", "site2")
            )
        else:
            first, second = attribute(rule, "body1"), rule.attributes.get("body2", "world")
            drawn, beside = self.named(rule, first, self.placed, "body"), self.named(rule, second, self.placed, "body")
            pose = vector(rule, "relpose", [0.0] * 7) if rule.tag == "weld" else np.zeros(7)
            if np.any(pose[3:]):  # of the second body in the first
                turn = XmlElement("weld", {"quat": " ".join(str(x) for x in pose[3:].tolist())}, rule.line)
                own, other = (self.turned(turn, "quat"), pose[:3]), IDENTITY
            else:  # as drawn
                if rule.tag == "connect":
                    attribute(rule, "anchor")
                own = np.eye(3), vector(rule, "anchor", [0.0] * 3)
                other = relative(beside, composed(drawn, own))
        at = f"{name} frame"
        self.links[at] = UrdfLink(at, rule.line, between=True)
        self.fixed(second, at, other, rule.line)
        self.joints[name] = UrdfJoint(
            name, CLOSURES[rule.tag], rule.line, first, at, own[1], rpy_of_rotation(own[0]), np.zeros(3)
        )  # fmt: skip

    def named(self, rule: XmlElement, name: str, there: dict[str, Any], what: str) -> Any:
        if name not in there:
            raise XmlFault(f"<{rule.tag}> of <equality> names '{name}', which is not a {what}; "
                           f"{meant(name, there, 'correct it')}", rule.line)  # fmt: skip
        return there[name]

    def follow(self, rule: XmlElement) -> None:
        follower = self.named(rule, attribute(rule, "joint1"), self.joints, "joint")
        leader = self.named(rule, rule.attributes.get("joint2", str(follower.name)), self.joints, "joint")
        if wrong := [j for j in (follower, leader) if j.kind not in MOVING]:
            raise XmlFault(f"joint '{wrong[0].name}' is {wrong[0].kind}; only hinge and slide joints follow", rule.line)
        if follower.leader is not None:
            raise XmlFault(f"joint '{follower.name}' follows '{follower.leader}' too; expected one", rule.line)
        words = rule.attributes.get("polycoef", "0 1 0 0 0").split()
        a = [number(XmlElement("joint", {"polycoef": w}, rule.line), "polycoef") for w in words]
        if len(a) > 5:
            raise XmlFault(f"polycoef of <joint> takes five numbers; found {len(a)}", rule.line)
        if "joint2" not in rule.attributes:  # a lock
            R, r = follower.pose(follower.drawn + a[0])
            self.joints[follower.name] = replace(follower, kind="fixed", xyz=r, rpy=rpy_of_rotation(R))
            self.notes.append(f"line {rule.line}: joint '{follower.name}' is locked at {follower.drawn + a[0]:g}")
            return
        # q1 - ref1 = a0 + a1 (q2 - ref2) + ...
        line = (Polynomial(a)(Polynomial([-leader.drawn, 1.0])) + Polynomial(np.zeros(2))).coef.tolist()
        higher = line[2:] if any(line[2:]) else []
        self.joints[follower.name] = replace(
            follower, leader=leader.name, offset=follower.drawn + line[0], multiplier=line[1], higher=tuple(higher)
        )

    def driven(self, root: XmlElement) -> tuple[str, ...]:
        """Return the joints with an actuator, in the order of the file."""
        names: dict[str, None] = {}
        for a in (a for e in root.all("actuator") for a in e.inside):
            name = a.attributes.get("joint", a.attributes.get("jointinparent"))
            if name is None:
                self.notes.append(f"line {a.line}: <{a.tag}> of <actuator> acts on no joint and is not used")
            elif name not in self.joints:
                raise XmlFault(f"<{a.tag}> of <actuator> names '{name}', which is not a joint", a.line)
            elif self.joints[name].kind in MOVING and self.joints[name].leader is None:
                names[name] = None
            else:
                self.notes.append(f"line {a.line}: <{a.tag}> of <actuator> is not used: joint '{name}' is ball, is "
                                  "locked or follows another one")  # fmt: skip
        if names:
            self.notes.append("of <actuator>, only the names of the joints are used")
        return tuple(names)
