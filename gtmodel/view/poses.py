"""The poses of a robot that a scene shows: those of a motion, or each coordinate moved to and fro about home."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, Status, Trajectory

Array = np.ndarray
FRAMES = 240  # most instants of a page
PER_DRIVE, PERIOD = 24, 2.0  # instants and seconds in which a drive moves to and fro
TURN, TRAVEL = 0.35, 0.1  # rad, and part of the robot's size, by which it moves
KNOWN = (("q",), ("T",), ("T", "e"), ("T", "R"))  # what may determine the pose
# coordinates, the units of those that move, and the function of them
_Start = tuple[dict[str, Any], list[str | None], CausalFunction]


def poses_of(
    robot: Model, targets: Sequence[str], motion: Trajectory | None, still: bool
) -> tuple[Array, list[Array], Any]:
    """Times (n,), the targets (n, ...), and the signals at these times."""
    if motion is None:
        time, values = _to_and_fro(robot, targets)
        return (time[:1], [v[:1] for v in values], None) if still else (time, values, None)
    rows = np.unique(np.linspace(0, len(motion.time) - 1, min(FRAMES, len(motion.time))).round().astype(int))
    for function in _functions(robot, targets, motion.names):
        *values, status = function(*(np.asarray(motion[signal.name])[rows] for signal in function.inputs))
        if np.all(np.asarray(status) == Status.OK):
            signals = {name: np.asarray(motion[name])[rows] for name in motion.names}
            units = {name: motion.units[name] for name in motion.names if name in motion.units}
            return motion.time[rows], values, Trajectory(motion.time[rows], signals, units, title=motion.title)
    raise ArgumentError(
        "the motion does not determine the poses of the robot; it needs q, or T, within the robot's reach; it has "
        f"{', '.join(motion.names)}", "motion",
    )  # fmt: skip


def _functions(robot: Model, targets: Sequence[str], names: Sequence[str]) -> Iterator[CausalFunction]:
    """Functions from variables with these names to the targets: of q or T of the robot or of a part of it, then of all
    free coordinates."""
    parts = dict.fromkeys(["", *(n[:-1] for n in names if n.endswith((".q", ".T")))])
    for known in ([f"{part}{n}" for n in known] for part in parts for known in KNOWN):
        if set(known) <= set(names) and (function := _compiled(robot, known, targets)) is not None:
            yield function
    try:
        free = compile_causal(robot, targets=list(targets))
    except ModelError:
        return
    if {signal.name for signal in free.inputs} <= set(names):
        yield free


def _compiled(robot: Model, known: Sequence[str], targets: Sequence[str]) -> CausalFunction | None:
    """The function from `known` alone to the targets; None if they do not follow from it."""
    try:
        function = compile_causal(robot, known=list(known), targets=list(targets))
    except ModelError:
        return None
    return function if len(function.inputs) == len(known) else None


def _to_and_fro(robot: Model, targets: Sequence[str]) -> tuple[Array, list[Array]]:
    """The home pose, and each drive or free coordinate in turn moved to and fro, as far as the robot reaches."""
    start = _home(robot, targets) or _free(robot, targets)
    if start is None:
        raise ArgumentError(f"no home pose of {type(robot).__name__} is known; pass a motion with q", "robot")
    values, units, function = start
    if not values:
        *at_home, _ = function()
        return np.zeros(1), [np.asarray(v, float)[None] for v in at_home]
    first = np.concatenate([np.ravel(v) for v in values.values()])
    *at_home, _ = function(*values.values())
    size = size_of({str(k): np.asarray(v)[None] for k, v in enumerate(at_home) if np.shape(v) == (3,)})
    shift = np.sin(2 * np.pi * np.arange(PER_DRIVE) / PER_DRIVE)
    moves = [first[None]]
    for k, unit in enumerate(units):
        far = TRAVEL * size if unit == "m" else TURN
        moves.append(first + np.outer(far * shift, np.eye(len(first))[k]))
    rows = np.vstack([*moves, first])
    ends = np.cumsum([np.size(v) for v in values.values()])[:-1]
    columns = [c.reshape(len(rows), *np.shape(v)) for c, v in
               zip(np.split(rows, ends, axis=1), values.values(), strict=True)]  # fmt: skip
    *poses, status = function(*columns)
    good = np.asarray(status) == Status.OK
    time = PERIOD / PER_DRIVE * np.arange(int(good.sum()))
    return time, [np.asarray(v)[good] for v in poses]


def _free(robot: Model, targets: Sequence[str]) -> _Start | None:
    """The free coordinates of a mechanism without drives, from which all else follows, at their start values."""
    flat = flat_of(robot)
    inputs = [n for n, (_, own) in flat.groups.items() if own and flat.variables[own[0]].role == "input"]
    try:
        function = compile_causal(robot, known=inputs, targets=list(targets))
    except ModelError as error:
        raise ArgumentError(
            f"no home pose of {type(robot).__name__} is known; pass a motion with q; {error}", "robot"
        ) from error
    values, units = dict[str, Any](), list[str | None]()
    for signal in function.inputs:
        indices = flat.lookup(signal.name)[1]
        starts = [flat.variables[k].start or 0.0 for k in indices]
        values[signal.name] = np.array(starts).reshape(signal.shape) if signal.shape else starts[0]
        units += [flat.variables[k].unit for k in indices if signal.name not in inputs]  # which come last
    return (values, units, function) if function(*values.values())[-1] == Status.OK else None


def _home(robot: Model, targets: Sequence[str]) -> _Start | None:
    """What determines the home pose, of the robot or of the one robot in it, and its first variable's units, which
    moves."""
    flat = flat_of(robot)
    point = np.asarray(getattr(robot, "home", ()), float)
    for part in dict.fromkeys(["", *(n[:-1] for n in flat.groups if n.endswith(".q"))]):
        starts = dict[str, Array]()
        for name in ("q", "T", "e", "R"):
            shape, indices = flat.groups.get(part + name, ((), []))
            known = [flat.variables[k].start for k in indices]
            if known and (name == "q" or None not in known):
                starts[part + name] = np.array([x or 0.0 for x in known]).reshape(shape)
        if not part and point.shape == (3,) and "T" in flat.groups:
            starts["T"] = point
            # a home that is a point tells q better than starts that nobody set
            inverse = _compiled(robot, ("T",), ("q",)) if "q" in starts and not starts["q"].any() else None
            if inverse is not None and (q := inverse(point))[1] == Status.OK:
                starts["q"] = np.asarray(q[0])
        for known in ([part + n for n in known] for known in KNOWN):
            if set(known) <= set(starts) and (function := _compiled(robot, known, targets)) is not None:
                values = {name: starts[name] for name in known}
                if function(*values.values())[-1] == Status.OK:
                    return values, [flat.variables[k].unit for k in flat.groups[known[0]][1]], function
    return None


def size_of(points: Mapping[str, Array]) -> float:
    """Extent of the points at the first instant [m]."""
    first = np.array([p[0] for p in points.values()])
    return float(np.linalg.norm(np.ptp(first, axis=0))) or 1.0
