"""The scene of a robot, from the components of its model: what joins two points is a bar; what a class declares as
`visual` covers its frames."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from .._near import meant
from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..lang.declarations import Declaration, Parameter
from ..results import ArgumentError, Trajectory
from .bodies import COLOURS, VisibleBody
from .poses import poses_of, size_of
from .solids import MeshFile, Visual, solids_of
from .space import RobotScene, VisiblePart

Array = np.ndarray
GROUND = "#b0b0b0"  # of bars that never move
SAME = 1e-9  # m: points closer than that at all times are one
BEYOND, AXIS = 0.25, 0.08  # guideway beyond the travel of its cart, and length of axes, in sizes of the robot
TOOLS = ("plate.frame", "end", "tool.frame", "flange.b")  # points whose path is drawn, of the robot or of a part of it
OVERSIZE = 30.0  # sizes of the robot; a solid larger than that is in another unit
WORLD = "world"  # frame of what stands still


def scene(
    robot: Model, motion: Trajectory | None = None, *, limits: Mapping[str, tuple[float, float]] | None = None,
    title: str = "", visual: Visual | None = None, still: bool = False,
) -> RobotScene:  # fmt: skip
    """Return the scene of a robot: rods, links, joints, carts, guideways and plate, from the components of its model.

    A component looks like the solids in `visual` of its class, if there is one: a dictionary from its frames or points
    to solids of gt.view, or a property that returns one.

    Args:
        robot: any model whose components have points in space.
        motion: with the actuators q or the tool centre point T, as studies return it; its signals are shown beside the
            robot. Without a motion, each drive moves to and fro about the home pose, or, in a mechanism without drives,
            each free coordinate about its start value.
        limits: (low, high) of signals by name, drawn with them.
        title: of the page.
        visual: more solids by frame of the robot or in "world": {"plate.frame": gt.view.Cuboid((0.3, 0.3, 0.02))}.
        still: only the home pose or the start values, without a motion.

    Raises ArgumentError for a model without points in space, for a motion that does not determine its poses, for a
    `visual` with an unknown frame, and for a solid 30 times larger than the robot, which is in another unit.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> page = gt.view.scene(robot)
    >>> page.at("plate.frame", 0.0).round(3), robot.home.round(3)
    (array([ 1.422, -0.437,  0.967]), array([ 1.422, -0.437,  0.967]))

    Parts with a look of their own:

    >>> class Lever(gt.Model):
    ...     L = gt.parameter(0.5, unit="m")
    ...     ground = gt.part(gt.mechanics.Ground)
    ...     joint = gt.part(gt.mechanics.Revolute, axis=[0.0, 1.0, 0.0])
    ...     arm = gt.part(gt.mechanics.FixedTranslation, d=lambda lever: [lever.L, 0.0, 0.0])
    ...     body = gt.part(gt.mechanics.RigidBody, m=2.0, I=0.01 * np.eye(3))
    ...
    ...     @property
    ...     def visual(self):
    ...         along = {"xyz": (self.L / 2, 0.0, 0.0), "rpy": (0.0, np.pi / 2, 0.0)}
    ...         return {"arm.a": gt.view.Cylinder(0.02, self.L, **along), "body.frame": gt.view.Cuboid((0.1, 0.1, 0.1))}
    ...
    ...     def equations(self):
    ...         yield gt.connect(self.ground.frame, self.joint.a)
    ...         yield gt.connect(self.joint.b, self.arm.a)
    ...         yield gt.connect(self.arm.b, self.body.frame)
    ...
    >>> page = gt.view.scene(Lever(L=0.4))
    >>> [body.name for body in page.bodies], page.at("body.frame", 0.0)
    (['arm.a', 'body.frame'], array([0.4, 0. , 0. ]))
    """
    flat, names = flat_of(robot), points_of(robot)
    solids = [*_solids(flat), *solids_of(visual or {}, type(robot).__name__)]
    if not names:
        raise ArgumentError(f"{type(robot).__name__} has no components with points in space", "robot")
    carried = _carried(flat, solids, type(robot).__name__)
    tools = _ending((n.removesuffix(".r") for n in names), TOOLS)
    turns = [n for n in (*(f"{tool}.R" for tool in tools[:1]), "R") if flat.groups.get(n, ((), []))[0] == (3, 3)][:1]
    rotations = [f"{n}.R" for n in carried if f"{n}.R" in flat.groups]
    time, values, shown = poses_of(robot, [*names, *turns, *rotations], motion, still)
    points = {n.removesuffix(".r"): v for n, v in zip(names, values, strict=False)}
    orientations = dict(zip(rotations, values[len(names) + len(turns) :], strict=True))
    values = values[: len(names) + len(turns)]
    frames = {n: _frame(points[n], orientations.get(f"{n}.R")) for n in carried}
    bodies = [solid.body(frame if frame != WORLD else "") for frame, solid in solids]
    points, one_of = _distinct(points)
    size = size_of(points)
    covered = {one_of[n] for n in carried}
    parts = [*_parts(flat, points, one_of, covered), *_guideways(flat, points, one_of, size)]
    for body in bodies if len(points) > 1 else ():
        if body.extent > OVERSIZE * size:
            raise ArgumentError(
                f"the solid in '{body.frame or WORLD}' is {body.extent:.3g} m across, the robot {size:.3g} m; a mesh "
                'in millimetres needs scale=0.001, in a URDF scale="0.001 0.001 0.001"', "visual",
            )  # fmt: skip
    if not parts and not bodies:
        raise ArgumentError(f"no component of {type(robot).__name__} joins two points", "robot")
    tool = one_of[tools[0]] if tools else ""
    if tool:
        parts.append(VisiblePart("path", (tool,), "path of the tool centre point"))
    if tool and turns:
        ends = np.moveaxis(np.asarray(points[tool])[..., None] + AXIS * size * values[-1], -1, 0)
        points |= {f"tool {axis}": end for axis, end in zip("xyz", ends, strict=True)}
        parts.append(VisiblePart("axes", (tool, *(f"tool {axis}" for axis in "xyz")), "tool frame"))
    shorter = {n: p[0] if np.ptp(p, axis=0).max() < SAME else p for n, p in points.items()}
    named = motion.title if motion is not None else ""
    name = title or named or type(robot).__name__
    same = {n: one for n, one in one_of.items() if n != one}
    return RobotScene(shorter, parts, time, shown, limits or {}, name, frames=frames, bodies=bodies, same=same)


def _ending(names: Iterable[str], wanted: Sequence[str]) -> list[str]:
    """The wanted names, first those without a prefix, in the order wanted."""
    known = sorted(names, key=lambda n: n.count("."))
    return [n for short in wanted for n in known if n == short or n.endswith(f".{short}")]


def around(robot: Model | None, bodies: Sequence[VisibleBody], *, title: str = "", note: str = "") -> RobotScene:
    """Return a scene of bodies and the robot in its home pose; without a robot that has no home or no points in space.

    >>> marks = gt.view.dots([[0.5, -0.9, 0.3]], name="goal")
    >>> gt.view.around(gt.robots.gantry_tau("l1_tape"), [marks]).bodies[0].name
    'goal'
    """
    empty = RobotScene({}, [])
    try:
        drawn = scene(robot, still=True) if robot is not None else empty
    except (ArgumentError, ModelError):
        drawn = empty
    return drawn.with_(bodies=[*drawn.bodies, *bodies], title=title, note=note)


def points_of(robot: Model) -> list[str]:
    """Return the names of the positions of points and frames in the components of a model, (3,) [m]; none if there is
    one at most and no part has a `visual`.

    >>> gt.view.points_of(gt.mechanics.UniformRod(L=1.0, m=1.0))
    ['a.r', 'b.r']
    """
    flat = flat_of(robot)
    points = [n for n, (shape, _) in flat.groups.items() if n.endswith(".r") and shape == (3,)]
    return points if len(points) > 1 or any(_visual_of(c) for c in flat.tree.components) else []


def _visual_of(component: Model) -> bool:
    """True if the class of a component says what it looks like."""
    return not isinstance(getattr(type(component), "visual", None), Declaration | None)


def _solids(flat: Any) -> Iterator[tuple[str, Any]]:
    """Frames, by their full names, and solids that the classes of the components declare."""
    for component in filter(_visual_of, flat.tree.components):
        cls, path = type(component), component._path
        visual: Any = getattr(cls, "visual", None)
        if isinstance(visual, property):  # which reads the parameters of its component as numbers
            assert visual.fget is not None
            visual = visual.fget(cls(**_numbers(flat, cls, path)))
        for frame, solid in solids_of(visual, cls.__name__):
            yield f"{path}.{frame}" if path and frame != WORLD else frame, _beside(cls, solid)


def _beside(cls: type[Model], solid: Any) -> Any:
    """A mesh file of a class stands from the folder of the Python file that declares its `visual`."""
    if not isinstance(solid, MeshFile) or Path(solid.path).is_absolute():
        return solid
    owner = next(c for c in cls.__mro__ if "visual" in vars(c))
    file = getattr(sys.modules.get(owner.__module__), "__file__", None)
    return replace(solid, path=Path(file).parent / solid.path) if file else solid


def _numbers(flat: Any, cls: type[Model], path: str) -> dict[str, Any]:
    """The values of the parameters of a component."""
    shape_of = {n: tuple(item.shape) for n, item in cls._declared.items() if isinstance(item, Parameter)}
    of = {n: f"{path}.{n}" if path else n for n in shape_of}
    known = {n: flat.bindings[name] for n, name in of.items() if name in flat.bindings}
    numbers = ca.Function("p", [flat.p], list(known.values())).call([flat.p0])
    arrays = [np.array(x, float).reshape(shape_of[n]) for n, x in zip(known, numbers, strict=True)]
    return {n: x if x.shape else float(x) for n, x in zip(known, arrays, strict=True) if np.isfinite(x).all()}


def _carried(flat: Any, solids: Sequence[tuple[str, Any]], owner: str) -> list[str]:
    """The frames and points that carry solids. Raises ArgumentError for names that the model does not have."""
    names = [frame for frame, _ in solids if frame != WORLD]
    there = [n.removesuffix(".r") for n, (shape, _) in flat.groups.items() if n.endswith(".r") and shape == (3,)]
    for name in names:
        if name not in there:
            hint = meant(name, there, f"there are {', '.join(there[:8])}")
            raise ArgumentError(f"visual: {owner} has no frame or point '{name}'; {hint}", "visual")
    return list(dict.fromkeys(names))


def _frame(point: Array, R: Array | None) -> Array:
    """Rotation and position (n, 3, 4), or (3, 4) for a frame that stands still."""
    r = np.asarray(point, float)[..., None]
    turned = np.broadcast_to(np.eye(3), (len(r), 3, 3)) if R is None else np.asarray(R, float)
    pose = np.concatenate([turned, r], axis=2)
    return pose[0] if np.ptp(pose, axis=0).max() < SAME else pose


def _distinct(points: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, str]]:
    """Points that are nowhere the same, and for each name the one that it is."""
    distinct: dict[str, Array] = {}
    one_of: dict[str, str] = {}
    for name, value in points.items():
        same = next((n for n, v in distinct.items() if np.abs(v - value).max() < SAME), None)
        one_of[name] = same or name
        if same is None:
            distinct[name] = np.asarray(value, float)
    return distinct, one_of


def _owners(one_of: Mapping[str, str]) -> dict[str, list[str]]:
    """The points of each component."""
    points: dict[str, list[str]] = defaultdict(list)
    for name, same in one_of.items():
        owner = name.rpartition(".")[0]
        if owner and same not in points[owner]:
            points[owner].append(same)
    return points


def _parts(
    flat: Any, points: Mapping[str, Array], one_of: Mapping[str, str], covered: Collection[str]
) -> Iterator[VisiblePart]:
    """Bars between the points of a component, faces of those with three or more, and joints at the ends; none of a
    component whose own frame is covered by a solid."""
    owners = _owners(one_of)
    bars: dict[frozenset[str], VisiblePart] = {}
    rods = [o for o in owners if f"{o}.tension" in flat.groups or f"{o}.L" in flat.bindings]
    hidden = {
        own
        for n in flat.rotations
        if covered and one_of.get(n.removesuffix(".R")) in covered and (own := n.removesuffix(".R").rpartition(".")[0])
    }
    owners = {own: p for own, p in owners.items() if own not in hidden}
    for owner in sorted(owners, key=lambda o: (-o.count("."), list(owners).index(o))):
        first, *others = owners[owner]
        colour = COLOURS[rods.index(owner) % len(COLOURS)] if owner in rods else ""
        for other in others:
            still = all(np.ptp(points[n], axis=0).max() < SAME for n in (first, other))
            bar = VisiblePart("bar", (first, other), owner, colour or (GROUND if still else ""))
            bars.setdefault(frozenset((first, other)), bar)
        if len(others) > 2:
            yield VisiblePart("face", tuple(_around(others, points)), owner)
    yield from bars.values()
    for point in dict.fromkeys(p for bar in bars.values() for p in bar.points):
        yield VisiblePart("joint", (point,), point)


def _around(names: list[str], points: Mapping[str, Array]) -> list[str]:
    """The points of a plate in the order of its outline."""
    first = np.array([points[n][0] for n in names])
    centred = first - first.mean(axis=0)
    axes = np.linalg.svd(centred)[2][:2]
    u, v = axes @ centred.T
    return [names[k] for k in np.argsort(np.arctan2(v, u), kind="stable")]


def _guideways(flat: Any, points: dict[str, Array], one_of: Mapping[str, str], size: float) -> Iterator[VisiblePart]:
    """Carts on straight guideways, and bars from a cart to the link joints that it carries beside it."""
    ways = [n.removesuffix(".frame") for n in one_of if f"{n.removesuffix('.frame')}.v" in flat.bindings]
    ways = [n for n in ways if f"{n}.A" in flat.bindings]
    masses = {own[0] for owner, own in _owners(one_of).items() if len(own) == 1 and f"{owner}.m" in flat.bindings}
    carts = {n: one_of[f"{n}.frame"] for n in ways if one_of[f"{n}.frame"] in masses}
    expressions = [flat.bindings[f"{n}.v"] for n in ways]
    directions = np.array(ca.Function("v", [flat.p], [ca.horzcat(*expressions)])(flat.p0)).T if ways else ()
    for way, v in zip(ways, directions, strict=True):
        joint, direction = one_of[f"{way}.frame"], v / np.linalg.norm(v)
        if way in carts:
            along = points[joint] @ direction
            middle = points[joint][0] - along[0] * direction
            for end, at in (("start", along.min() - BEYOND * size), ("end", along.max() + BEYOND * size)):
                points[f"{way} {end}"] = np.repeat([middle + at * direction], len(along), axis=0)
            yield VisiblePart("guideway", (f"{way} start", f"{way} end"), way)
            yield VisiblePart("cart", (joint,), way)
        elif carts and joint not in carts.values():
            cart = min(carts.values(), key=lambda c: float(np.linalg.norm(points[c][0] - points[joint][0])))
            yield VisiblePart("bar", (cart, joint), f"cart joint of {way.rpartition('.')[0]}")
