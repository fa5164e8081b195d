"""Visual shapes of URDF, SDF and MJCF files as solids that a view draws. They change no equation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...geometry.rotations import rotation_of_rpy, rpy_of_rotation, shortest_rotation
from ...results import ArgumentError
from ...results.read_bounds import XmlFault
from ...view.solids import Capsule, Cuboid, Cylinder, MeshFile, Sphere, VisibleSolid
from .described import Pose, XmlElement, attribute, composed, number, vector

Array = np.ndarray
READ = (".stl", ".obj")  # mesh files that are drawn
HIDDEN = 3  # first group of MJCF that MuJoCo does not show


def moved_solid(solid: VisibleSolid, pose: Pose) -> VisibleSolid:
    """Return a solid in the coordinates in which the pose of its frame is given."""
    R, r = composed(pose, (rotation_of_rpy(np.array(solid.rpy)), np.array(solid.xyz)))
    return replace(solid, xyz=tuple(r.tolist()), rpy=tuple(rpy_of_rotation(R).tolist()))


def solid_of(shape: XmlElement, read: Mapping[str, Callable[[XmlElement], VisibleSolid]]) -> VisibleSolid | None:
    """Return what `read`, by the tag of the shape, makes of it; None for another shape and for wrong numbers."""
    try:
        return read[shape.tag](shape) if shape.tag in read else None
    except (XmlFault, ArgumentError):
        return None


def drawable(path: str) -> str:
    """Return the name of a mesh file that can be drawn. Raises XmlFault for other formats."""
    if not path.lower().endswith(READ):
        raise XmlFault("neither STL nor OBJ", 0)
    return path


URDF_SHAPES: dict[str, Callable[[XmlElement], VisibleSolid]] = {
    "box": lambda e: Cuboid(tuple(vector(e, "size", [0.0] * 3).tolist())),
    "cylinder": lambda e: Cylinder(number(e, "radius"), number(e, "length")),
    "capsule": lambda e: Capsule(number(e, "radius"), number(e, "length")),
    "sphere": lambda e: Sphere(number(e, "radius")),
    "mesh": lambda e: MeshFile(drawable(attribute(e, "filename")), tuple(vector(e, "scale", [1.0] * 3).tolist())),
}


def urdf_solids(
    link: XmlElement, origin: Callable[[XmlElement], tuple[Array, Array]], materials: Mapping[str, str],
    tag: str = "visual",
) -> Iterator[VisibleSolid | None]:  # fmt: skip
    """Yield what each <visual>, or <collision>, of a link of URDF looks like; None for one that is not drawn."""
    for visual in link.all(tag):
        geometry = next(iter(visual.all("geometry")), None)
        shape = next(iter(geometry.inside), None) if geometry is not None else None
        solid = None if shape is None else solid_of(shape, URDF_SHAPES)
        if solid is None:
            yield None
            continue
        try:
            xyz, rpy = origin(visual)
        except XmlFault:
            yield None
            continue
        named = next(
            (materials.get(m.attributes.get("name", "")) or colour_of(m) for m in visual.all("material")), None
        )
        yield replace(solid, xyz=tuple(xyz.tolist()), rpy=tuple(rpy.tolist()), colour=named or solid.colour)


def colour_of(material: XmlElement) -> str:
    """Return the colour of a material of URDF, "" if it has none."""
    colour = next(iter(material.all("color")), None)
    return hex_of(colour.attributes.get("rgba", "")) if colour is not None else ""


def hex_of(rgba: str) -> str:
    """Return numbers from 0 to 1 as "#0072b2", "" for anything else.

    >>> from gtmodel.robots.serial.visuals import hex_of
    >>> hex_of("1 0.5 0 1")
    '#ff8000'
    """
    try:
        rgb = np.clip([float(x) for x in rgba.split()[:3]], 0.0, 1.0)
    except ValueError:
        return ""
    return "#" + "".join(f"{round(255 * x):02x}" for x in rgb.tolist()) if len(rgb) == 3 else ""


def _words(e: XmlElement, tag: str, count: int) -> tuple[float, ...]:
    inner = e.one(tag)
    text = "" if inner is None else inner.text
    return tuple(vector(XmlElement(tag, {tag: text}, e.line), tag, [1.0] * count).tolist())


def _one(e: XmlElement, tag: str) -> float:
    inner = e.one(tag)
    return number(XmlElement(tag, {tag: "" if inner is None else inner.text.strip()}, e.line), tag)


def _uri(e: XmlElement) -> MeshFile:
    scale: Any = _words(e, "scale", 3) if e.all("scale") else 1.0
    return MeshFile(drawable("".join(u.text for u in e.all("uri")).strip()), scale)


SDF_SHAPES: dict[str, Callable[[XmlElement], VisibleSolid]] = {
    "box": lambda e: Cuboid(_words(e, "size", 3)),  # type: ignore[arg-type]  # vector refuses another number
    "cylinder": lambda e: Cylinder(_one(e, "radius"), _one(e, "length")),
    "capsule": lambda e: Capsule(_one(e, "radius"), _one(e, "length")),
    "sphere": lambda e: Sphere(_one(e, "radius")),
    "ellipsoid": lambda e: Sphere(1.0, _words(e, "radii", 3)),  # type: ignore[arg-type]
    "mesh": _uri,
}


def sdf_solids(link: XmlElement, pose: Callable[[XmlElement | None], Pose]) -> Iterator[VisibleSolid | None]:
    """Yield what each <visual> of a link of SDF looks like; None for one that is not drawn."""
    for visual in link.all("visual"):
        geometry, place = next(iter(visual.all("geometry")), None), next(iter(visual.all("pose")), None)
        shape = next(iter(geometry.inside), None) if geometry is not None else None
        solid = None if shape is None else solid_of(shape, SDF_SHAPES)
        if solid is None or (place is not None and place.attributes.get("relative_to")):
            yield None
            continue
        paint = "".join(hex_of(c.text) for m in visual.all("material") for c in m.all("diffuse")[:1])
        try:
            yield moved_solid(replace(solid, colour=paint or solid.colour), pose(place))
        except XmlFault:
            yield None


def mjcf_solid(
    g: XmlElement, pose: Callable[[XmlElement], Pose], meshes: Mapping[str, MeshFile], colours: Mapping[str, str]
) -> VisibleSolid | None:
    """Return what a geom of MJCF looks like, None for one that is hidden or not drawn."""
    kind = g.attributes.get("type", "mesh" if "mesh" in g.attributes else "sphere")
    try:
        place, size = pose(g), [float(x) for x in g.attributes.get("size", "").split()]
        if int(g.attributes.get("group", "0")) >= HIDDEN:
            return None
        if "fromto" in g.attributes:
            a, b = np.split(vector(g, "fromto", [0.0] * 6), 2)
            length = float(np.linalg.norm(b - a))
            place = shortest_rotation(np.array([0.0, 0.0, 1.0]), (b - a) / length), (a + b) / 2
            size = [size[0], length / 2] if kind in ("capsule", "cylinder") else [size[0], size[0], length / 2]
        if kind == "mesh":
            solid: VisibleSolid = meshes[g.attributes.get("mesh", "")]
        elif kind == "box":
            solid = Cuboid((2 * size[0], 2 * size[1], 2 * size[2]))
        elif kind in ("cylinder", "capsule"):
            solid = (Cylinder if kind == "cylinder" else Capsule)(size[0], 2 * size[1])
        elif kind in ("sphere", "ellipsoid"):
            solid = Sphere(size[0]) if kind == "sphere" else Sphere(1.0, (size[0], size[1], size[2]))
        else:
            return None
    except (XmlFault, ArgumentError, ValueError, IndexError, KeyError, ZeroDivisionError):
        return None
    paint = colours.get(g.attributes.get("material", "")) or hex_of(g.attributes.get("rgba", ""))
    return moved_solid(replace(solid, colour=paint or solid.colour), place)
