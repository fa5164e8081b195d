"""What the readers of URDF, SDF and MJCF share: elements of XML with their lines, and links and joints, loops
included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...geometry.rotations import rotation_about, rotation_of_rpy
from ...lang import ModelError
from ...results.disk import path_of
from ...results.read_bounds import XmlFault, walk_xml
from ...view.solids import MeshFile, VisibleSolid

Array = np.ndarray
Pose = tuple[Array, Array]  # R (3, 3), r (3,)
IDENTITY: Pose = (np.eye(3), np.zeros(3))
MOVING = {"revolute", "continuous", "prismatic"}  # joints with one coordinate that may have a motor
COUNTED = {2: "two", 3: "three", 4: "four", 6: "six"}
Segment = tuple[Array, Array, float]  # both ends (3,) [m] in the link's frame, and radius [m], of a capsule


def composed(first: Pose, second: Pose) -> Pose:
    """Return the second pose, which is relative to the first, as the first is given."""
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def relative(frame: Pose, other: Pose) -> Pose:
    """Return another pose as seen from a frame, both given in the same coordinates."""
    return frame[0].T @ other[0], frame[0].T @ (other[1] - frame[1])


@dataclass(frozen=True)
class UrdfLink:
    """A link with mass [kg], first moments (3) [kg m] and inertia (6) [kg m2] in its frame, its line, capsules around
    its collision shapes, and its visual shapes. `between`: a frame between two joints, which is no link of the file."""

    name: str
    line: int
    m: float = 0.0
    mc: Array = field(default_factory=lambda: np.zeros(3))
    J: Array = field(default_factory=lambda: np.zeros(6))
    capsules: tuple[Segment, ...] = ()
    between: bool = False
    visuals: tuple[VisibleSolid, ...] = ()


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as written; `leader` is the name of the joint that it mimics, `rotor` the inertia of its motor times the
    gear ratio squared (armature in MJCF).

    Its coordinate is offset + multiplier x + higher[0] x^2 + ... of the leader's x. `drawn`: its coordinate in the pose
    that the file shows. `second`: the other axis of a universal joint. `lead`: of a screw [m per turn]. `spring`: its
    stiffness [N.m/rad, N/m] and its coordinate at rest.
    """

    name: str
    kind: str
    line: int
    parent: str
    child: str
    xyz: Array
    rpy: Array
    axis: Array
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf
    damping: float = 0.0
    friction: float = 0.0
    leader: str | None = None
    multiplier: float = 1.0
    offset: float = 0.0
    rotor: float = 0.0
    higher: tuple[float, ...] = ()
    drawn: float = 0.0
    second: Array | None = None
    lead: float = 0.0
    spring: tuple[float, float] = (0.0, 0.0)

    def pose(self, coordinate: float = 0.0) -> Pose:
        """Return the pose of the child in the parent."""
        R = rotation_of_rpy(self.rpy)
        if self.kind == "prismatic":
            return R, self.xyz + R @ (coordinate * self.axis)
        if self.kind == "fixed" or coordinate == 0.0:
            return R, self.xyz
        return R @ rotation_about(self.axis, coordinate), self.xyz


@dataclass(frozen=True)
class Urdf:
    """The links and joints of a file by name, its root link, and notes about elements that are not used.

    A link may be the child of several joints: then they form a loop. driven: names of the joints with a motor, if the
    file states any. gravity: (3) [m/s2] and its line, None for that of `mechanics.World`.
    """

    name: str
    file: str
    root: str
    links: dict[str, UrdfLink]
    joints: dict[str, UrdfJoint]
    notes: list[str] = field(default_factory=list)
    driven: tuple[str, ...] = ()
    gravity: tuple[Array, int] | None = None

    def joints_on(self, link: str) -> list[UrdfJoint]:
        """Return the joints whose parent is a link, in the order of the file."""
        return [j for j in self.joints.values() if j.parent == link]

    def fault(self, sentence: str, line: int) -> ModelError:
        """Return an error at a line of the file."""
        return ModelError(f"{self.file}, line {line}: {sentence}")


def closing(joints: Mapping[str, UrdfJoint]) -> tuple[UrdfJoint, UrdfJoint] | None:
    """Return the first two joints with the same child, which therefore close a loop; None for a tree."""
    above: dict[str, UrdfJoint] = {}
    for j in joints.values():
        if (first := above.setdefault(j.child, j)) is not j:
            return first, j
    return None


def base_of(links: Mapping[str, UrdfLink], joints: Mapping[str, UrdfJoint], world: str | None = None) -> str:
    """Return the link that stands still: the world if the file has it, else the only one without a parent. Raises
    XmlFault for none or several of these, and for a link without a connection to it."""
    children = {j.child for j in joints.values()}
    roots = [name for name in links if name not in children] if world is None else [world]
    if not roots:
        raise XmlFault("the joints form a loop: every link has a parent", next(iter(joints.values())).line)
    if len(roots) > 1:
        raise XmlFault(f"several links have no parent: {', '.join(roots[:4])}; expected one, the base",
                       links[roots[1]].line)  # fmt: skip
    reached, waiting = {roots[0]}, [roots[0]]
    while waiting:
        at = waiting.pop()
        beside = {j.child if j.parent == at else j.parent for j in joints.values() if at in (j.parent, j.child)}
        waiting += beside - reached
        reached |= beside
    if lost := [name for name in links if name not in reached]:
        raise XmlFault(f"no joint connects link '{lost[0]}' to '{roots[0]}'", links[lost[0]].line)
    return roots[0]


@dataclass
class XmlElement:
    """An element with its tag, attributes, first line, inner elements and text."""

    tag: str
    attributes: dict[str, str]
    line: int
    inside: list[XmlElement] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> list[XmlElement]:
        """Return the direct inner elements with a tag."""
        return [e for e in self.inside if e.tag == tag]

    def one(self, tag: str) -> XmlElement | None:
        """Return the inner element with a tag, or None. Raises XmlFault if there are several."""
        several = self.all(tag)
        if len(several) > 1:
            raise XmlFault(f"<{self.tag}> holds {len(several)} <{tag}>; expected one", several[1].line)
        return several[0] if several else None


def parsed(content: bytes) -> XmlElement:
    """Return the outermost element. Raises XmlFault for invalid XML and for declared entities."""
    outside = XmlElement("", {}, 1)
    stack = [outside]

    def begin(tag: str, attributes: dict[str, str], line: int) -> None:
        element = XmlElement(tag, attributes, line)
        stack[-1].inside.append(element)
        stack.append(element)

    def end() -> None:
        stack.pop()

    def text(part: str) -> None:
        stack[-1].text += part

    walk_xml(content, begin, end, text)
    return outside.inside[0]


def read_file(source: str | Path, kind: str, read: Callable[[str, XmlElement], Urdf]) -> Urdf:
    """Read a file, or a text that begins with "<"; kind: of the text, for messages. Raises ModelError with file and
    line."""
    path_of(source, "source")
    text = str(source)
    if text.lstrip().startswith("<"):
        file, content, folder = f"{kind} text", text.encode(), Path()
    else:
        file, folder = Path(source).name, Path(source).parent
        try:
            content = Path(source).read_bytes()
        except OSError as error:
            raise ModelError(f"{text} cannot be read: {error.strerror}") from None
    try:
        return _with_meshes(read(file, parsed(content)), folder)
    except XmlFault as fault:
        raise ModelError(f"{file}, line {fault.line}: {fault.sentence}") from None


def _with_meshes(urdf: Urdf, folder: Path) -> Urdf:
    """Return the file with the paths of its meshes, searched from its folder upwards; notes say which are missing."""
    links, missing = dict(urdf.links), list[str]()
    for name, link in urdf.links.items():
        kept = list[VisibleSolid]()
        for solid in link.visuals:
            path = _mesh_path(str(solid.path), folder) if isinstance(solid, MeshFile) else None
            if isinstance(solid, MeshFile) and path is None:
                missing.append(f"'{solid.path}' of link '{name}'")
            else:
                kept.append(
                    replace(solid, path=str(path.absolute())) if isinstance(solid, MeshFile) and path else solid
                )
        links[name] = replace(link, visuals=tuple(kept))
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        urdf.notes.append(f"mesh files not found and not drawn: {', '.join(missing[:3])}{more}")
    return replace(urdf, links=links)


def _mesh_path(written: str, folder: Path) -> Path | None:
    """Return the path of a mesh file, None if there is none. package://NAME/REST is NAME/REST or REST in the folder of
    the file or in one around it."""
    if not written.startswith(("package://", "model://")):
        path = folder / written.removeprefix("file://")
        return path if path.is_file() else None
    rest = Path(written.partition("://")[2])
    inner = Path(*rest.parts[1:])
    near = (around / place for around in (folder, *folder.resolve().parents) for place in (rest, inner))
    return next((path for path in near if path.is_file()), None)


def inertia_of(entries: Sequence[float]) -> Array:
    """Return the tensor (3, 3) from xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def attribute(e: XmlElement, name: str) -> str:
    if name not in e.attributes:
        raise XmlFault(f"<{e.tag}> has no attribute '{name}'", e.line)
    return e.attributes[name]


def number(e: XmlElement, name: str, default: float | None = None) -> float:
    if default is not None and name not in e.attributes:
        return default
    text = attribute(e, name)
    try:
        value = float(text)
    except ValueError:
        raise XmlFault(f"{name} of <{e.tag}> takes a number; found '{text[:40]}'", e.line) from None
    if not np.isfinite(value):
        raise XmlFault(f"{name} of <{e.tag}> must be finite; found '{text[:40]}'", e.line)
    return value


def vector(e: XmlElement, name: str, default: list[float]) -> Array:
    if name not in e.attributes:
        return np.array(default)
    words, count = e.attributes[name].split(), len(default)
    try:
        value = np.array([float(w) for w in words])
    except ValueError:
        value = np.full(count, np.nan)
    if value.shape != (count,) or not np.all(np.isfinite(value)):
        raise XmlFault(f"{name} of <{e.tag}> takes {COUNTED[count]} numbers; found '{e.attributes[name][:40]}'", e.line)
    return value
