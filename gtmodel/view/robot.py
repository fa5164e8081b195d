"""The scene of a robot, from the components of its model: what joins two points is a bar."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, Status, Trajectory
from .space import RobotScene, VisiblePart

Array = np.ndarray
# Okabe-Ito, which colour-blind readers tell apart; the same as in gtmodel.plot.style, which needs matplotlib
ROD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
GROUND = "#b0b0b0"  # of bars that never move
FRAMES = 240  # most instants of a page
PER_DRIVE, PERIOD = 24, 2.0  # instants and seconds in which a drive moves to and fro
TURN, TRAVEL = 0.35, 0.1  # rad, and part of the robot's size, by which it moves
SAME = 1e-9  # m: points closer than that at all times are one
BEYOND, AXIS = 0.25, 0.08  # guideway beyond the travel of its cart, and length of axes, in sizes of the robot
TOOLS = ("plate.frame", "end", "tool.frame")  # points whose path is drawn
KNOWN = (("q",), ("T",), ("T", "e"), ("T", "R"))  # what may determine the pose


def scene(
    robot: Model, motion: Trajectory | None = None, *, limits: Mapping[str, tuple[float, float]] | None = None,
    title: str = "",
) -> RobotScene:  # fmt: skip
    """Return the scene of a robot: rods, links, joints, carts, guideways and plate, from the components of its model.

    Args:
        robot: any model whose components have points in space.
        motion: with the actuators q or the tool centre point T, as studies return it; its signals are shown beside the
            robot. Without a motion, each drive moves to and fro about the home pose.
        limits: (low, high) of signals by name, drawn with them.
        title: of the page.

    Raises ArgumentError for a model without points in space, and for a motion that does not determine its poses.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> page = gt.view.scene(robot)
    >>> page.at("plate.frame", 0.0).round(3), robot.home
    (array([ 0.5, -0.9,  0.3]), array([ 0.5, -0.9,  0.3]))
    """
    flat, names = flat_of(robot), points_of(robot)
    if not names:
        raise ArgumentError(f"{type(robot).__name__} has no components with points in space", "robot")
    turns = [n for n in ("R", "end.R", "plate.frame.R") if flat.groups.get(n, ((), []))[0] == (3, 3)][:1]
    time, values, shown = _poses(robot, [*names, *turns], motion)
    points = {n.removesuffix(".r"): v for n, v in zip(names, values, strict=False)}
    tools = [n for n in TOOLS if n in points]
    points, one_of = _distinct(points)
    size = _size(points)
    parts = [*_parts(flat, points, one_of), *_guideways(flat, points, one_of, size)]
    if not parts:
        raise ArgumentError(f"no component of {type(robot).__name__} joins two points", "robot")
    tool = one_of[tools[0]] if tools else ""
    if tool:
        parts.append(VisiblePart("path", (tool,), "path of the tool centre point"))
    if tool and turns:
        ends = np.moveaxis(np.asarray(points[tool])[..., None] + AXIS * size * values[-1], -1, 0)
        points |= {f"tool {axis}": end for axis, end in zip("xyz", ends, strict=True)}
        parts.append(VisiblePart("axes", (tool, *(f"tool {axis}" for axis in "xyz")), "tool frame"))
    still = {n: p[0] if np.ptp(p, axis=0).max() < SAME else p for n, p in points.items()}
    named = motion.title if motion is not None else ""
    name = title or named or type(robot).__name__
    return RobotScene(still, parts, time, shown, limits or {}, name)


def points_of(robot: Model) -> list[str]:
    """Return the names of the positions of points and frames in the components of a model, (3,) [m]; none if there is
    one at most.

    >>> gt.view.points_of(gt.mechanics.UniformRod(L=1.0, m=1.0))
    ['a.r', 'b.r']
    """
    points = [n for n, (shape, _) in flat_of(robot).groups.items() if n.endswith(".r") and shape == (3,)]
    return points if len(points) > 1 else []


def _poses(robot: Model, targets: Sequence[str], motion: Trajectory | None) -> tuple[Array, list[Array], Any]:
    """Times (n,), the targets (n, ...), and the signals at these times."""
    if motion is None:
        time, values = _to_and_fro(robot, targets)
        return time, values, None
    rows = np.unique(np.linspace(0, len(motion.time) - 1, min(FRAMES, len(motion.time))).round().astype(int))
    for known in KNOWN:
        if not set(known) <= set(motion.names) or (function := _compiled(robot, known, targets)) is None:
            continue
        *values, status = function(*(np.asarray(motion[name])[rows] for name in known))
        if np.all(np.asarray(status) == Status.OK):
            signals = {name: np.asarray(motion[name])[rows] for name in motion.names}
            units = {name: motion.units[name] for name in motion.names if name in motion.units}
            return motion.time[rows], values, Trajectory(motion.time[rows], signals, units, title=motion.title)
    raise ArgumentError(
        "the motion does not determine the poses of the robot; it needs q, or T, within the robot's reach; it has "
        f"{', '.join(motion.names)}", "motion",
    )  # fmt: skip


def _compiled(robot: Model, known: Sequence[str], targets: Sequence[str]) -> CausalFunction | None:
    """The function from `known` alone to the targets; None if they do not follow from it."""
    try:
        function = compile_causal(robot, known=list(known), targets=list(targets))
    except ModelError:
        return None
    return function if len(function.inputs) == len(known) else None


def _to_and_fro(robot: Model, targets: Sequence[str]) -> tuple[Array, list[Array]]:
    """The home pose, and each drive in turn moved to and fro, as far as the robot reaches."""
    flat, home = flat_of(robot), _home(robot, targets)
    if home is None:
        raise ArgumentError(f"no home pose of {type(robot).__name__} is known; pass a motion with q", "robot")
    start, function = home
    (moved, first), *others = start.items()
    *at_home, _ = function(*start.values())
    size = _size({str(k): np.asarray(v)[None] for k, v in enumerate(at_home) if np.shape(v) == (3,)})
    shift = np.sin(2 * np.pi * np.arange(PER_DRIVE) / PER_DRIVE)
    moves = [first[None]]
    for k, index in enumerate(flat.groups[moved][1]):
        far = TRAVEL * size if flat.variables[index].unit == "m" else TURN
        moves.append(first + np.outer(far * shift, np.eye(len(first))[k]))
    rows = np.vstack([*moves, first])
    *values, status = function(rows, *(np.repeat([value], len(rows), axis=0) for _, value in others))
    good = np.asarray(status) == Status.OK
    time = PERIOD / PER_DRIVE * np.arange(int(good.sum()))
    return time, [np.asarray(v)[good] for v in values]


def _home(robot: Model, targets: Sequence[str]) -> tuple[dict[str, Array], CausalFunction] | None:
    """What determines the home pose, with its values, and the function of it."""
    flat, starts = flat_of(robot), dict[str, Array]()
    for name in ("q", "T", "e", "R"):
        shape, indices = flat.groups.get(name, ((), []))
        known = [flat.variables[k].start for k in indices]
        if known and (name == "q" or None not in known):
            starts[name] = np.array([x or 0.0 for x in known]).reshape(shape)
    point = np.asarray(getattr(robot, "home", ()), float)
    if point.shape == (3,) and "T" in flat.groups:
        starts["T"] = point
        # a home that is a point tells q better than starts that nobody set
        inverse = _compiled(robot, ("T",), ("q",)) if "q" in starts and not starts["q"].any() else None
        if inverse is not None and (q := inverse(point))[1] == Status.OK:
            starts["q"] = np.asarray(q[0])
    for known in KNOWN:
        if set(known) <= set(starts) and (function := _compiled(robot, known, targets)) is not None:
            values = {name: starts[name] for name in known}
            if function(*values.values())[-1] == Status.OK:
                return values, function
    return None


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


def _size(points: Mapping[str, Array]) -> float:
    """Extent of the points at the first instant [m]."""
    first = np.array([p[0] for p in points.values()])
    return float(np.linalg.norm(np.ptp(first, axis=0))) or 1.0


def _owners(one_of: Mapping[str, str]) -> dict[str, list[str]]:
    """The points of each component."""
    points: dict[str, list[str]] = defaultdict(list)
    for name, same in one_of.items():
        owner = name.rpartition(".")[0]
        if owner and same not in points[owner]:
            points[owner].append(same)
    return points


def _parts(flat: Any, points: Mapping[str, Array], one_of: Mapping[str, str]) -> Iterator[VisiblePart]:
    """Bars between the points of a component, faces of those with three or more, and joints at the ends."""
    owners = _owners(one_of)
    bars: dict[frozenset[str], VisiblePart] = {}
    rods = [o for o in owners if f"{o}.tension" in flat.groups or f"{o}.L" in flat.bindings]
    for owner in sorted(owners, key=lambda o: (-o.count("."), list(owners).index(o))):
        first, *others = owners[owner]
        colour = ROD_COLOURS[rods.index(owner) % len(ROD_COLOURS)] if owner in rods else ""
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
