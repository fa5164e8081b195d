"""Mapping of MultiBody components to parts of gt.mechanics with their options, and their Python syntax trees."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np

from ...geometry.rotations import right_handed, rotation_about
from ..arrays import Values, array, each
from ..instances import Declared, Instance
from ..scalars import EnumerationLiteral, Operation, is_literal, number_of, operation
from ..syntax import ModelicaError, Place
from .library import part_name

X, Y, Z = np.eye(3)
ROUND_OFF = 1e-15  # of a rotation: below it an entry is zero
STANDARD_GRAVITY = 9.80665  # default of the library from version 4; before it 9.81


@dataclass(eq=False)
class MechanicsPart:
    """One part: `name = gt.part(gt.mechanics.cls, **options)`.

    options: arrays of scalars, or numbers, lists and dictionaries. frames: frame of the component -> port of the part.
    edge: it connects the orientations of its two frames; root: it determines the orientation of its frame.
    """

    name: str
    cls: str
    at: Place
    options: dict[str, Any] = field(default_factory=dict)
    frames: dict[str, str] = field(default_factory=dict)
    edge: bool = False
    rigid: bool = False
    root: bool = False
    instance: Instance | None = None


@dataclass(eq=False)
class MappedComponent:
    """The parts of one component, and its connected ports, such as ("part.shaft", "drive.shaft")."""

    instance: Instance
    parts: list[MechanicsPart]
    joined: list[tuple[str, str]] = field(default_factory=list)


def kind(instance: Instance) -> str:
    """Return the mapped class that a component is or extends; "" for others."""
    return next((k for s in instance.sections if (k := part_name(s.text)) in PARTS), "")


def is_frame(instance: Instance) -> bool:
    return any(part_name(s.text) == "Interfaces.Frame" for s in instance.sections)


def component(instance: Instance, at: Place) -> MappedComponent:
    """Map a component to its parts. Raises ModelicaError, at the place `at`, for unsupported values."""
    return PARTS[kind(instance)](instance, at)


def values(instance: Instance, name: str) -> Values:
    component = instance.elements[name].component
    assert isinstance(component, Declared)
    return component.symbols


def numbers(instance: Instance, name: str) -> np.ndarray:
    """Return the values of a parameter, which must be known at translation."""
    path = instance.full(name)
    known_values: Any = each(lambda x: number_of(x, None, f"'{path}'"), values(instance, name))
    return np.array(known_values.tolist(), float)


def literal(instance: Instance, name: str) -> str:
    value = number_of(values(instance, name)[()], None, f"'{instance.full(name)}'")
    assert isinstance(value, EnumerationLiteral)
    return value.name


def _unit(instance: Instance, name: str, at: Place) -> np.ndarray:
    n = numbers(instance, name)
    if not np.any(n):
        raise ModelicaError(f"'{instance.full(name)}' must be a direction; found {{0, 0, 0}}", at)
    return n / np.linalg.norm(n)


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix from coordinates of the rotated frame to the original frame."""
    R = rotation_about(axis, angle)
    return np.where(np.abs(R) < ROUND_OFF, 0.0, R)


def in_turn(sequence: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the product of successive rotations about axes 1, 2, 3 of the rotated frame."""
    turns = [rotation((X, Y, Z)[int(n) - 1], float(a)) for n, a in zip(sequence, angles, strict=True)]
    return reduce(np.matmul, turns)


def _between(instance: Instance, cls: str, at: Place, **given: Any) -> MechanicsPart:
    frames = {"frame_a": "a", "frame_b": "b"}
    return MechanicsPart(instance.full("part"), cls, at, frames=frames, instance=instance, **given)


def _world(instance: Instance, at: Place) -> MappedComponent:
    gravity_type = literal(instance, "gravityType")
    if gravity_type == "PointGravity":
        raise ModelicaError("PointGravity is not supported; use UniformGravity or NoGravity", at)
    n = _unit(instance, "n", at)
    element = instance.elements["g"].component
    assert isinstance(element, Declared)
    (g,) = element.flats
    gravity_binding = element.modifier.value
    if (
        gravity_type == "UniformGravity" and gravity_binding is not None and part_name(gravity_binding.scope.space.text)
    ):  # the default of the built-in text
        library = instance.space.root.local_class("Modelica")
        if library is not None and library.folder is not None and library.local_class("Units") is not None:
            g.cache["binding"] = STANDARD_GRAVITY
        instance.model.warn(f"gravity is {number_of(g.binding)} m/s2; set it as {instance.path}(g = ...)", at)
    strength = values(instance, "g")[()] if gravity_type == "UniformGravity" else 0
    weight = array([operation("*", (strength, float(x)), at) if x else 0.0 for x in n], (3,))
    gravity = MechanicsPart(instance.full("gravity"), "World", at, {"g": weight})
    ground = MechanicsPart(
        instance.full("ground"), "Ground", at, frames={"frame_b": "frame"}, root=True, instance=instance
    )
    return MappedComponent(instance, [gravity, ground])


def _revolute(instance: Instance, at: Place) -> MappedComponent:
    axis = {"axis": _plain(_unit(instance, "n", at))}
    part = _between(instance, "Revolute", at, options=axis, edge=True)
    return _driven(part, "TorqueMotor", "shaft", instance, at)


def _prismatic(instance: Instance, at: Place) -> MappedComponent:
    part = _between(instance, "Prismatic", at, options={"v": _plain(_unit(instance, "n", at))}, edge=True)
    return _driven(part, "ForceMotor", "flange", instance, at)


def _driven(part: MechanicsPart, motor: str, port: str, instance: Instance, at: Place) -> MappedComponent:
    if not number_of(values(instance, "useAxisFlange")[()]):
        return MappedComponent(instance, [part])
    drive = MechanicsPart(instance.full("drive"), motor, at)
    return MappedComponent(instance, [part, drive], [(f"{part.name}.{port}", f"{drive.name}.{port}")])


def _spherical(instance: Instance, at: Place) -> MappedComponent:
    return MappedComponent(instance, [_between(instance, "Spherical", at)])


def _planar_loop(instance: Instance, at: Place) -> MappedComponent:
    n = _unit(instance, "n", at)
    _, first, second = right_handed(n)
    plane = {"first": _plain(first), "second": _plain(second)}
    return MappedComponent(instance, [_between(instance, "PlanarLoopClosure", at, options=plane)])


def _fixed(instance: Instance, at: Place) -> MappedComponent:
    ground = MechanicsPart(instance.full("ground"), "Ground", at, root=True)
    part = MechanicsPart(instance.full("part"), "FixedTranslation", at, {"d": values(instance, "r")}, {"frame_b": "b"},
                root=True, instance=instance)  # fmt: skip
    return MappedComponent(instance, [ground, part], [(f"{ground.name}.frame", f"{part.name}.a")])


def _translation(instance: Instance, at: Place) -> MappedComponent:
    options = {"d": values(instance, "r")}
    return MappedComponent(
        instance, [_between(instance, "FixedTranslation", at, options=options, edge=True, rigid=True)]
    )


def _rotation(instance: Instance, at: Place) -> MappedComponent:
    how = literal(instance, "rotationType")
    if how == "RotationAxis":
        R = rotation(_unit(instance, "n", at), np.radians(float(numbers(instance, "angle"))))
    elif how == "TwoAxesVectors":
        x, y = _unit(instance, "n_x", at), _unit(instance, "n_y", at)
        if not np.linalg.norm(np.cross(x, y)) > 1e-3:
            raise ModelicaError(f"n_x and n_y of '{instance.path}' are parallel", at)
        z = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
        R = np.stack([x, np.cross(z, x), z], axis=1)
    else:
        R = in_turn(numbers(instance, "sequence"), np.radians(numbers(instance, "angles")))
    options = {"d": values(instance, "r"), "R": _plain(R)}
    return MappedComponent(instance, [_between(instance, "Fixed", at, options=options, edge=True, rigid=True)])


def _body(instance: Instance, at: Place) -> MappedComponent:
    i = {k: values(instance, f"I_{k}")[()] for k in (11, 22, 33, 21, 31, 32)}
    inertia = array([i[11], i[21], i[31], i[21], i[22], i[32], i[31], i[32], i[33]], (3, 3))
    options = {"m": values(instance, "m"), "c": values(instance, "r_CM"), "I": inertia}
    if instance.parent is not None and any(part_name(s.text) == "Parts.Solid" for s in instance.parent.sections):
        options = {k: each(lambda x: number_of(x, None, f"'{instance.path}'"), v) for k, v in options.items()}
    frames = {"frame_a": "frame"}
    part = MechanicsPart(instance.full("part"), "RigidBody", at, options, frames, instance=instance)
    return MappedComponent(instance, [part])


def _load(instance: Instance, at: Place) -> MappedComponent:
    resolve_in = literal(instance, "resolveInFrame")
    if resolve_in == "frame_resolve":
        raise ModelicaError(
            f"'{instance.path}' with resolveInFrame = frame_resolve is not supported; use world or frame_b", at
        )
    return MappedComponent(instance, [MechanicsPart(instance.full("part"), "AppliedLoad", at, {}, {"frame_b": "frame"},
                                     instance=instance)])  # fmt: skip


def _line_force(instance: Instance, at: Place) -> MappedComponent:
    if "m" in instance.elements and np.any(numbers(instance, "m")):
        raise ModelicaError(f"the mass m of the spring '{instance.path}' is not supported; use a body instead", at)
    options = {"k": values(instance, "c"), "d": values(instance, "d"), "length0": values(instance, "s_unstretched")}
    part = MechanicsPart(instance.full("part"), "SpringDamper", at, options)
    ends = [
        MechanicsPart(instance.full(f"end_{x}"), "PointOnFrame", at, {}, {f"frame_{x}": "frame"}, instance=instance)
        for x in "ab"
    ]
    joined = [(f"{end.name}.point", f"{part.name}.{x}") for end, x in zip(ends, "ab", strict=True)]
    return MappedComponent(instance, [*ends, part], joined)


def _plain(x: np.ndarray) -> Any:
    return (np.asarray(x, float) + 0.0).tolist()


PARTS: dict[str, Callable[[Instance, Place], MappedComponent]] = {
    "World": _world, "Joints.Revolute": _revolute, "Joints.Prismatic": _prismatic, "Joints.Spherical": _spherical,
    "Joints.RevolutePlanarLoopConstraint": _planar_loop, "Parts.Fixed": _fixed,
    "Parts.FixedTranslation": _translation, "Parts.FixedRotation": _rotation, "Parts.Body": _body,
    "Forces.WorldForce": _load, "Forces.WorldTorque": _load, "Forces.WorldForceAndTorque": _load,
    "Forces.LineForce": _line_force,
}  # fmt: skip


class PartWriter:
    """Writes parts as Python: unique names, declarations, connections and quantities."""

    def __init__(
        self, parts: Iterable[MechanicsPart], naming: Callable[[str], str], taken: Iterable[str], units: bool
    ) -> None:
        self._names, used, self._units = dict[str, str](), set(taken), units
        for part in parts:
            name = naming(part.name)
            while name in used:
                name += "_"
            used.add(name)
            self._names[part.name] = name

    def declared(
        self, part: MechanicsPart, resolved: Callable[[Any, Place], Any], written: Callable[[Any], ast.expr]
    ) -> Any:
        """`name = gt.part(gt.mechanics.Revolute, axis=[0.0, 0.0, 1.0])`."""

        def option(value: Any) -> ast.expr:
            """Return the option as numbers, or as a function of the model if it depends on parameters."""
            if not hasattr(value, "ravel"):
                return ast.parse(repr(value), mode="eval").body
            items = [resolved(x, part.at) for x in value.ravel()]
            rows: list[ast.expr] = [written(float(x) if is_literal(x) else x) for x in items]
            for n in reversed(value.shape):
                rows = [ast.List(rows[k : k + n], ast.Load()) for k in range(0, len(rows), n)]
            if all(is_literal(x) for x in items):
                return rows[0]
            arguments = ast.arguments(
                posonlyargs=[], args=[ast.arg("self")], kwonlyargs=[], kw_defaults=[], defaults=[]
            )
            return ast.Lambda(arguments, rows[0])

        options = [ast.keyword(k, option(v)) for k, v in part.options.items()]
        value = ast.Call(_attributes("gt", "part"), [_attributes("gt", "mechanics", part.cls)], options)
        return ast.Assign([ast.Name(self._names[part.name], ast.Store())], value)

    def connected(self, a: str, b: str) -> ast.stmt:
        """`yield gt.connect(self.joint.b, self.body.frame)`."""
        ports: list[ast.expr] = []
        for path in (a, b):
            part, port = path.rsplit(".", 1)
            ports.append(_attributes("self", self._names[part], port))
        return ast.Expr(ast.Yield(ast.Call(_attributes("gt", "connect"), ports, [])))

    def quantity(self, x: Operation) -> ast.expr:
        """`self.joint.shaft.phi`."""
        part, path, indices = x.arguments
        result = _attributes("self", self._names[part], *path.split("."))
        if indices:
            numbers: list[ast.expr] = [ast.Constant(int(i)) for i in indices.split(",")]
            index = numbers[0] if len(numbers) == 1 else ast.Tuple(numbers, ast.Load())
            result = ast.Subscript(result, index, ast.Load())
        return result if self._units else ast.Call(ast.Name("plain", ast.Load()), [result], [])


def _attributes(first: str, *names: str) -> ast.expr:
    result: ast.expr = ast.Name(first, ast.Load())
    for name in names:
        result = ast.Attribute(result, name, ast.Load())
    return result
