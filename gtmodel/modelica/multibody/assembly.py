"""Assembly of MultiBody parts: connections of frames, loop closures, free bodies, and quantities of parts in
expressions."""

from __future__ import annotations

from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np

from ...geometry.quaternions import quaternion_of
from ..arrays import Values, array, scalar
from ..constraints import Flattened, ScalarEquation
from ..instances import Declared, Instance
from ..scalars import Operation, Scalar, operation
from ..syntax import FunctionCall, Literal, ModelicaError, Place
from .library import NAME, is_own, part_name
from .parts import ROUND_OFF, MappedComponent, MechanicsPart, component, in_turn, is_frame, kind, numbers, values

PART = "part"  # operation with arguments: name of the part, path in it, indices


def quantity(part: str, path: str, indices: tuple[int, ...], at: Place | None) -> Scalar:
    """Return one scalar of a part, such as ("joint.part", "a.r", (0,)), as an operation."""
    return Operation(PART, (part, path, ",".join(map(str, indices))), at)


def called(node: FunctionCall, scope: Any) -> Values:
    """Return the value of __mechanics("part.shaft.phi"), with a length for a vector; only for multibody.mo."""
    instance = scope.instance
    if instance is None or not part_name(scope.space.text):
        raise ModelicaError(f"there is no function '{node.reference}'", node.at)
    path, *length = [a.value for a in node.arguments if isinstance(a, Literal)]
    part, _, port_path = str(path).partition(".")
    name = instance.full(part)
    if not length:
        return scalar(quantity(name, port_path, (), node.at))
    return array([quantity(name, port_path, (i,), node.at) for i in range(int(length[0]))], (int(length[0]),))


def vector(part: str, path: str, at: Place | None) -> Values:
    """Return a vector of a part in world coordinates."""
    return array([quantity(part, path, (i,), at) for i in range(3)], (3,))


def turned(part: str, port: str, path: str, at: Place | None) -> Values:
    """Return a vector of a part in coordinates of its frame: R' v."""
    result = np.empty(3, object)
    for j in range(3):
        terms = [
            operation("*", (quantity(part, f"{port}.R", (i, j), at), quantity(part, path, (i,), at)), at)
            for i in range(3)
        ]
        result[j] = operation("+", (operation("+", (terms[0], terms[1]), at), terms[2]), at)
    return result


PARALLEL = 1e-9  # tolerance for products of unit vectors
_CLOSING = ("Spherical", "PlanarLoopClosure")
# variables that may be omitted if nothing reads them
OPTIONAL = {"a", "tau", "f", "angle", "r_0", "v_0", "a_0", "w_a", "z_a"}


class Assembly:
    """Connected MultiBody frames and the parts to which they belong."""

    def __init__(self) -> None:
        self._joined: list[tuple[Instance, Instance, Place]] = []
        self._above: dict[int, int] = {}
        self._ports: dict[int, tuple[MechanicsPart, str]] = {}  # of a frame

    def join(self, a: Instance, b: Instance, at: Place) -> None:
        self._joined.append((a, b, at))

    def settle(self, instances: list[Instance], places: dict[int, Place], out: Flattened, model: Any) -> None:
        """Add parts and connections to `out`, and expressions of the variables of frames. Raises ModelicaError."""
        frames = [i for i in instances if is_frame(i)]
        mapped = [i for i in instances if kind(i)]
        if not frames and not mapped:
            return
        components = [component(i, places.get(id(i), i.at)) for i in mapped]
        self._check_world(components, out.at)
        parts = [p for c in components for p in c.parts]
        for part in parts:
            for name, port in part.frames.items():
                assert part.instance is not None
                self._ports[id(part.instance.elements[name].component)] = (part, port)
        closures = self._graph(parts, out)
        out.parts = [*parts, *closures]
        for c in components:
            out.joined += [(a, b, c.parts[0].at) for a, b in c.joined]
        self._connections(frames, closures, places, out)
        for frame in frames:
            self._mean(frame, places.get(id(frame), frame.at))
        out.optional |= {
            id(f) for i in instances for n, e in i.elements.items()
            if is_own(e.text.at.source.path) and isinstance(e.component, Declared) for f in e.component.flats
            if n in OPTIONAL or f.kind == "parameter"
        }  # fmt: skip
        self._record(frames, out)
        for i in instances:
            for element in i.elements.values():
                if id(i) in places and isinstance(element.component, Declared) and is_own(element.text.at.source.path):
                    for flat in element.component.flats:
                        flat.at = places[id(i)]
        library = instances[0].space.root.local_class("Modelica")
        if library is not None and library.folder is not None:
            model.warn(
                "MultiBody components are replaced by parts of gt.mechanics; those of the library are not used", out.at
            )

    @staticmethod
    def _check_world(components: list[MappedComponent], at: Place) -> None:
        worlds = [c for c in components if kind(c.instance) == "World"]
        if len(worlds) > 1:
            names = " and ".join(f"'{c.instance.path}'" for c in worlds)
            raise ModelicaError(f"a model must have one World; found {names}: declare all others as outer",
                                worlds[1].parts[0].at)  # fmt: skip
        if components and not worlds:
            raise ModelicaError(f"a model with MultiBody components must declare `inner {NAME}.World world;`",
                                components[0].parts[0].at)  # fmt: skip

    # the graph of orientations

    def _set(self, frame: int) -> int:
        while (above := self._above.get(frame, frame)) != frame:
            frame = above
        return frame

    def _unite(self, a: int, b: int) -> bool:
        """Unite two sets; False if both frames are in one set already."""
        p, q = self._set(a), self._set(b)
        self._above[q] = p
        return p != q

    def _graph(self, parts: list[MechanicsPart], out: Flattened) -> list[MechanicsPart]:
        for a, b, _ in self._joined:
            self._unite(id(a), id(b))
        sets = dict(self._above)  # connections only; the union below also follows rigid parts and joints
        closures: list[MechanicsPart] = []
        edges = [p for p in parts if p.edge]
        fixed = [self._first(p) for p in parts if p.root and p.frames]
        for a, b in pairwise(fixed):  # all are fixed in the world
            self._unite(a, b)
        for part in sorted(edges, key=_rank):
            assert part.instance is not None
            a, b = (id(part.instance.elements[n].component) for n in ("frame_a", "frame_b"))
            if self._unite(a, b):
                continue
            if part.rigid:
                raise ModelicaError(
                    f"'{part.instance.path}' rigidly connects frames that are rigidly connected already", part.at
                )
            if _planar(edges):
                raise ModelicaError(
                    f"'{part.instance.path}' closes a planar loop, which has three redundant constraints; replace one "
                    "joint of the loop by Joints.RevolutePlanarLoopConstraint",
                    part.at,
                )
            closures.append(
                MechanicsPart(part.instance.full("closure"), "LoopClosure", part.at, instance=part.instance)
            )
        self._roots(parts, out)
        if closures or any(p.cls in _CLOSING and self._is_loop(p) for p in parts):
            _follow(edges)
        self._above = sets
        return closures

    def _is_loop(self, part: MechanicsPart) -> bool:
        assert part.instance is not None
        a, b = (self._set(id(part.instance.elements[n].component)) for n in ("frame_a", "frame_b"))
        return a == b

    def _roots(self, parts: list[MechanicsPart], out: Flattened) -> None:
        """Make one body of each group that is not connected to the world a free body."""
        rooted: dict[int, MechanicsPart] = {}
        for part in parts:
            if part.root and part.frames:
                self._take_root(rooted, part)
        bodies = [p for p in parts if p.cls == "RigidBody"]
        for part in sorted(bodies, key=lambda p: not _true(p, "enforceStates")):
            assert part.instance is not None
            if self._set(self._first(part)) in rooted:
                for name in ("angles_fixed", "w_0_fixed"):
                    if _true(part, name):
                        raise ModelicaError(
                            f"{name} of '{part.instance.path}' is not supported, since joints connect it to another "
                            "body or the world; set start values of these joints",
                            part.at,
                        )
                continue
            part.cls = "FreeBody"
            self._take_root(rooted, part)
            _starts(part, out)
        for part in parts:
            if part.frames and self._set(self._first(part)) not in rooted:
                assert part.instance is not None
                raise ModelicaError(
                    f"the orientation of '{part.instance.path}' is undetermined: no body and no joint defines it",
                    part.at,
                )

    def _first(self, part: MechanicsPart) -> int:
        assert part.instance is not None
        return id(part.instance.elements[next(iter(part.frames))].component)

    def _take_root(self, rooted: dict[int, MechanicsPart], part: MechanicsPart) -> None:
        rooted.setdefault(self._set(self._first(part)), part)

    # output

    def _connections(
        self, frames: list[Instance], closures: list[MechanicsPart], places: dict[int, Place], out: Flattened
    ) -> None:
        by_frame = {id(c.instance.elements["frame_b"].component): c for c in closures if c.instance is not None}
        at = {id(x): place for a, b, place in self._joined for x in (a, b)}
        sets: dict[int, list[tuple[str, Place]]] = {}
        for frame in frames:
            if id(frame) not in self._ports:
                continue
            part, port = self._ports[id(frame)]
            name, place = f"{part.name}.{port}", at.get(id(frame), part.at)
            if (closure := by_frame.get(id(frame))) is not None:
                out.joined.append((name, f"{closure.name}.a", place))
                name = f"{closure.name}.b"
            sets.setdefault(self._set(id(frame)), []).append((name, place))
        for members in sets.values():
            first = members[0][0]
            out.joined += [(first, other, place) for other, place in members[1:]]

    def _mean(self, frame: Instance, at: Place) -> None:
        """Replace the variables of a frame by quantities of its part, or of a part connected to it."""
        own_port = self._ports.get(id(frame))
        behind = [own_port] if own_port is not None else self._behind(frame)
        source = own_port or next((p for key, p in self._ports.items() if self._set(key) == self._set(id(frame))), None)
        R: Any = frame.elements["R"].component
        variables = {n: frame.elements[n].component for n in ("r_0", "f", "t")} | {
            n: R.elements[n].component for n in ("T", "w")
        }
        for name, variable in variables.items():
            assert isinstance(variable, Declared)
            if source is None or (not behind and name in ("f", "t")):
                reason = (
                    "nothing is connected to it" if source is None else "read the force at a component connected to it"
                )
                for flat in variable.flats:
                    flat.replaced = Operation("refused", (f"'{flat.name}' has no value here: {reason}",), at)
                continue
            part, port = source
            if name == "r_0":
                expressions = list(vector(part.name, f"{port}.r", at))
            elif name == "T":
                expressions = [quantity(part.name, f"{port}.R", (j, i), at) for i in range(3) for j in range(3)]
            elif name == "w":
                expressions = list(turned(part.name, port, f"{port}.w", at))
            else:
                forces = [turned(p.name, x, f"{x}.{name}", at) for p, x in behind]
                expressions = [
                    reduce(lambda a, b: operation("+", (a, b), at), column) for column in zip(*forces, strict=True)
                ]
            for flat, value in zip(variable.flats, expressions, strict=True):
                flat.replaced = value

    def _behind(self, frame: Instance) -> list[tuple[MechanicsPart, str]]:
        """Return the ports in the component of a frame that are connected to it, on which its force acts.

        Empty if another frame of the component is in the same connection set: then the force is not determined.
        """
        owner = frame.parent
        if owner is None or sum(self._set(id(f)) == self._set(id(frame)) for f in _frames_of(owner)) > 1:
            return []
        return [
            p
            for key, p in self._ports.items()
            if self._set(key) == self._set(id(frame)) and _inside(p[0].instance, owner)
        ]

    def _record(self, frames: list[Instance], out: Flattened) -> None:
        """Add the positions of frames to the results, under their names in the text."""
        for frame in frames:
            positions, owner = frame.elements["r_0"].component, frame.parent
            in_library_part = (
                owner is not None and owner.parent is not None and bool(part_name(owner.parent.space.text))
            )
            if not in_library_part and isinstance(positions, Declared):
                out.shown += [f for f in positions.flats if f.replaced.name == PART]


def _frames_of(owner: Instance) -> list[Instance]:
    components = [e.component for e in owner.elements.values()]
    return [x for m in components for x in (m.ravel() if isinstance(m, np.ndarray) else [m])
            if isinstance(x, Instance) and is_frame(x)]  # fmt: skip


def _inside(instance: Instance | None, owner: Instance) -> bool:
    while instance is not None:
        if instance is owner:
            return True
        instance = instance.parent
    return False


def _rank(part: MechanicsPart) -> tuple[int, int]:
    """Sort key of edges for the spanning tree: rigid parts first, then joints with preferred or fixed coordinates."""
    if part.rigid:
        return 0, 0
    assert part.instance is not None
    name = "phi" if part.cls == "Revolute" else "s"
    (flat,) = part.instance.elements[name].component.flats
    choice = flat.get("stateSelect")
    return 1, -int(getattr(choice, "name", "") == "always") - int(flat.get("fixed") is True)


def _follow(joints: list[MechanicsPart]) -> None:
    """Remove default start values of joints in loops: 0 is a bad guess, values in the text are kept."""
    for part in joints:
        for name in ("phi", "w", "s", "v"):
            element = part.instance.elements.get(name) if part.instance is not None else None
            if element is None or not isinstance(element.component, Declared):
                continue
            start = element.modifier.get("start").value
            if start is not None and part_name(start.scope.space.text):
                for flat in element.component.flats:
                    flat.cache["start"] = None


def _planar(edges: list[MechanicsPart]) -> bool:
    """True if all joints move in parallel planes."""
    axes = [np.array(p.options["axis"]) for p in edges if p.cls == "Revolute"]
    slides = [np.array(p.options["v"]) for p in edges if p.cls == "Prismatic"]
    if not axes or any(p.cls == "Fixed" for p in edges):
        return False
    along = all(abs(abs(a @ axes[0]) - 1) < PARALLEL for a in axes)
    return along and all(abs(v @ axes[0]) < PARALLEL for v in slides)


def _true(part: MechanicsPart, name: str) -> bool:
    from ..scalars import number_of

    assert part.instance is not None
    return bool(number_of(values(part.instance, name)[()], part.at, f"'{part.instance.full(name)}'"))


def _starts(part: MechanicsPart, out: Flattened) -> None:
    """Set the initial orientation and angular velocity of a free body."""
    body = part.instance
    assert body is not None
    R = in_turn(numbers(body, "sequence_start"), numbers(body, "angles_start"))
    e = quaternion_of(R, positive="largest")
    e[np.abs(e) < ROUND_OFF] = 0.0
    part.options["attitude"] = {"e": {"start": e.tolist()}}
    if _true(part, "angles_fixed"):
        for k in np.argsort(np.abs(e))[:3]:  # the largest component is determined by the norm
            out.initial.append(ScalarEquation(quantity(part.name, "attitude.e", (int(k),), part.at), float(e[k]),
                                              part.at))  # fmt: skip
    if _true(part, "w_0_fixed") or not out.optimization:
        for k, value in enumerate(values(body, "w_0_start")):
            out.initial.append(ScalarEquation(quantity(part.name, "frame.w", (k,), part.at), value, part.at))


def declared_places(instances: list[Instance]) -> dict[int, Place]:
    """Return the place in the user's text at which each component, also of a library part, is declared."""
    places: dict[int, Place] = {}
    for owner in instances:
        user_place = places.get(id(owner))
        for element in owner.elements.values():
            if "outer" in element.text.prefixes:
                continue
            at = user_place if user_place is not None and part_name(element.scope.space.text) else element.text.at
            component = element.component
            for item in component.ravel() if isinstance(component, np.ndarray) else [component]:
                if isinstance(item, Instance):
                    places[id(item)] = at
    return places
