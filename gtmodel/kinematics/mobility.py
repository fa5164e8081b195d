"""Mobility of a mechanism: its degrees of freedom, redundant constraints and idle motions, and what they depend on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.flat import FlatModel, flatten
from ..compiler.loops import (
    Excursion,
    Redundancy,
    Undetermined,
    excursion,
    listed,
    not_assembled,
    null_space,
    rank_of,
    redundancy_of,
    redundant_constraints,
    undetermined_reactions,
)
from ..compiler.positions import CLOSED, Positions, positions_of
from ..compiler.trees import loop_of
from ..geometry.rotations import rotation_by
from ..lang import Builder, Connector, Model, ModelError
from ..lang.connect import place_of
from ..lang.slips import named
from ..mechanics.frames import Frame

DISTURBANCE = 1e-3  # of each joint frame, in rad, and of lengths relative to the size of the mechanism
DISTURBED = 2  # disturbed mechanisms
SHORT = 0.01  # step whose directions are counted; its curvature is a hundredth of it
COUNTED = 0.1  # part of a short step: smaller singular values of the steps are curvature
STILL = 1e-7  # of a motion of one nominal: slower variables stand still
DEFINITE = 1e-6  # relative to the largest second derivative: smaller forms vanish
STARTS = 40  # of the search for a motion of second order

_CONNECTED = re.compile(r"^connection (?P<first>.+)\.(?P<what>[rR])\[[\d,]+\] ~ (?P<other>.+)\.[rR]\[[\d,]+\]$")


@dataclass(frozen=True)
class Idle:
    """Motions of one part between two joints that move nothing else, such as the spin of a ball-ended rod."""

    part: str
    count: int

    def __str__(self) -> str:
        return f"'{self.part}' turns by itself" + (f" ({self.count} ways)" if self.count > 1 else "")


@dataclass(frozen=True)
class Mobility:
    """What `model.mobility()` returns.

    Attributes:
        mobility: degrees of freedom of finite motions, without idle ones. idle: the idle ones, by part.
        instantaneous: degrees of freedom by the rank of the constraints at the assembled start position, without idle
            ones. It exceeds `mobility` where the mechanism is shaky or where branches meet; `second_order` says which:
            "rigid" (no motion exists to second order), "branches" (several do), "" if the second order does not decide.
        redundant: number of redundant constraints. constraints: those that may be dropped, by joint and direction.
        reactions: the reactions that the redundant constraints leave undetermined, by joint and direction.
        generic: True if the mobility remains for slightly disturbed joint frames and lengths; False if it needs these
            exact dimensions. disturbed_gap: largest gap [m or rad] left by disturbances of 1e-3, and
            disturbed_mobility: the smallest mobility with them, None if none could be assembled.
        distance: of the farthest position reached in the test [m or rad]. gap: largest residual there.
        coordinates, equations, rank: of the position constraints in joint coordinates.
        loops: joints of each loop; the last one of each closes it.
    """

    title: str
    mobility: int
    idle: tuple[Idle, ...]
    instantaneous: int
    second_order: str
    redundant: int
    constraints: tuple[Undetermined, ...]
    reactions: tuple[Undetermined, ...]
    generic: bool
    disturbed_gap: float
    disturbed_mobility: int | None
    distance: float
    gap: float
    coordinates: int
    equations: int
    rank: int
    loops: tuple[str, ...]

    def __str__(self) -> str:
        idle = sum(i.count for i in self.idle)
        lines = [
            f"{self.title}: mobility {self.mobility}"
            + (f", and {idle} idle motion{'s' if idle > 1 else ''}" if idle else "")
            + f"; {self.coordinates} coordinates, {self.equations} constraints of rank {self.rank}"
        ]
        lines += [f"  loop {loop}" for loop in self.loops]
        lines += [f"  idle: {', '.join(map(str, self.idle))}"] if self.idle else []
        if self.redundant:
            lines.append(f"  redundant: {self.redundant} constraints: {listed(self.constraints)}")
        if self.reactions:
            lines.append(f"  reactions not determined: {listed(self.reactions)}")
        if self.instantaneous > self.mobility:
            why = {
                "rigid": "no motion exists to second order: it is shaky",
                "branches": "several motions begin here: branches meet",
                "": "the second order does not exclude a motion, but none was entries"
                if not self.mobility
                else "shaky",
            }[self.second_order]
            lines.append(f"  {self.instantaneous} instantaneous degrees of freedom at the start position; {why}")
        if self.redundant or not self.generic:
            lines.append(f"  {self._dimensions()}")
        lines.append(f"  tested up to {self.distance:.2g} m or rad from the start position, gap {self.gap:.1g}")
        return "\n".join(lines)

    def _dimensions(self) -> str:
        if self.generic:
            return "generic: joint frames disturbed by 0.001 leave the same mobility"
        if self.disturbed_mobility is None:
            return (
                f"of these exact dimensions only: with joint frames disturbed by {DISTURBANCE:g} it cannot be "
                f"assembled (gap {self.disturbed_gap:.1g})"
            )
        return (
            f"of these exact dimensions only: with joint frames disturbed by {DISTURBANCE:g} the mobility is "
            f"{self.disturbed_mobility}"
        )


@named
def mobility(model: Model | Builder, outputs: str | Sequence[str] = ()) -> Mobility:
    """Return the mobility of a mechanism: degrees of freedom, redundant constraints, idle motions.

    Ranks are judged by singular values at the assembled position nearest to the start values and at positions that
    steps from there reach, so that a singular start position does not mislead. All inputs and motors are free.

    Args:
        outputs: names of variables; motions that move none of them are idle. By default idle are motions that move
            nothing but one body between two or more joints.

    Raises ModelError for a parameter without a value, for a link between ball joints whose orientation nothing
    determines, and for a mechanism that cannot be assembled, naming the joint that closes the loop of the largest gap.

    >>> class FourBar(gt.Model):
    ...     ground = gt.part(gt.mechanics.Ground)
    ...     crank, elbow, rocker, tip = (gt.part(gt.mechanics.Revolute) for _ in range(4))
    ...     bar, arm = (gt.part(gt.mechanics.FixedTranslation, d=[d, 0.0, 0.0]) for d in (0.3, 0.6))
    ...     top, base = (gt.part(gt.mechanics.FixedTranslation, d=[d, 0.0, 0.0]) for d in (0.7, 0.8))
    ...     def equations(self):
    ...         ground, crank, elbow, rocker, tip = self.ground, self.crank, self.elbow, self.rocker, self.tip
    ...         yield gt.connect([ground.frame, crank.b, self.bar.b], [crank.a, self.bar.a, elbow.a])
    ...         yield gt.connect(elbow.b, self.top.a)
    ...         yield gt.connect([ground.frame, self.base.b, rocker.b], [self.base.a, rocker.a, self.arm.a])
    ...         yield gt.connect([self.top.b, self.arm.b], [tip.a, tip.b])
    >>> m = FourBar().mobility()
    >>> m.mobility, m.redundant, m.generic
    (1, 3, False)
    >>> print(m.constraints[0])
    'tip' (position along z, rotation about x, rotation about y)
    """
    flat = flatten(model)
    if flat.loops.floating:
        link = flat.loops.floating[0]
        raise ModelError(
            f"{flat.title}: nothing determines the orientation of '{link._path}', which ball joints alone connect to "
            "the rest; connect a FreeBody to it, or use a Universal joint at one end",
            place_of(link),
        )
    r = redundancy_of(flat)
    if r.gap > CLOSED:
        raise not_assembled(flat, r.system, r.home, r.gap)
    test = _Test(r.system, _watched(flat, outputs))
    at_home = test.dimension(r.home)
    still = test.idle(r.home, bool(outputs))
    finite, reached = test.finite(r.home, still)
    instantaneous = at_home - still.shape[1]
    gaps, others = [], []
    for seed in range(DISTURBED):
        gap, count = _disturbed(flat, r, seed, bool(outputs), outputs)
        gaps.append(gap)
        others += [] if count is None else [count]
    return Mobility(
        title=flat.title,
        mobility=finite,
        idle=test.named_idle(r.home, bool(outputs)),
        instantaneous=instantaneous,
        second_order=_second_order(r.system, r.home, still, finite) if instantaneous > finite else "",
        redundant=r.count,
        constraints=tuple(redundant_constraints(r)) if r.count else (),
        reactions=tuple(undetermined_reactions(r)),
        generic=len(others) == DISTURBED and all(f == finite for f in others),
        disturbed_gap=max(gaps),
        disturbed_mobility=min(others, default=None),
        distance=reached.distance,
        gap=max(r.gap, reached.gap),
        coordinates=len(r.system.coordinates),
        equations=len(r.system.rows),
        rank=r.rank,
        loops=tuple(loop_of(c.component, c.cut) for c in flat.loops.closings),
    )


def _watched(flat: FlatModel, outputs: str | Sequence[str]) -> list[int]:
    """Return the indices of the outputs; without outputs those of all ports, of all variables if there are none."""
    names = [outputs] if isinstance(outputs, str) else list(outputs)
    if names:
        return [i for name in names for i in flat.lookup(name)[1]]
    ports = {p._path for p in flat.tree.ports}
    watched = [i for name, (_, indices) in flat.groups.items() if name.rpartition(".")[0] in ports for i in indices]
    return watched or [v.index for v in flat.variables]


class _Test:
    """Motions of a system of positions; only those count that move `watched` variables."""

    def __init__(self, system: Positions, watched: Sequence[int]) -> None:
        self._system = system
        place = {i: n for n, i in enumerate(system.variables)}
        self._watched = [place[i] for i in watched if i in place]
        self._trees = _free_trees(system.flat, place)

    def dimension(self, x: np.ndarray) -> int:
        return null_space(self._system.residual(x)[1]).shape[1]

    def idle(self, x: np.ndarray, by_outputs: bool) -> np.ndarray:
        """Return an orthonormal basis (n, k) of the idle motions at a point."""
        basis = null_space(self._system.residual(x)[1])
        moves = self._system.moves(x) @ basis
        # what moves no watched variable, such as the length of a quaternion
        entries = [basis @ _kernel(moves[self._watched])]
        if not by_outputs:
            entries += [basis @ _kernel(moves[outside]) for _, outside in self._trees]
        every = np.hstack(entries)
        u, s, _ = np.linalg.svd(every, full_matrices=False)
        return u[:, s > 1e-6]

    def named_idle(self, x: np.ndarray, by_outputs: bool) -> tuple[Idle, ...]:
        basis = null_space(self._system.residual(x)[1])
        moves = self._system.moves(x) @ basis
        if by_outputs:
            free = basis @ _kernel(moves[self._watched])
            flat = self._system.flat
            names = [
                flat.variables[i].component
                for i, row in zip(self._system.coordinates, np.abs(free), strict=True)
                if row.max(initial=0.0) > 1e-6
            ]
            joined = "', '".join(dict.fromkeys(n.rpartition(".")[0] or n for n in names))
            return (Idle(joined, free.shape[1]),) if free.shape[1] else ()
        counts = [(name, _kernel(moves[outside]).shape[1]) for name, outside in self._trees]
        return tuple(Idle(name, count) for name, count in counts if count)

    def finite(self, home: np.ndarray, idle: np.ndarray) -> tuple[int, Excursion]:
        """Return the number of independent finite motions, without idle ones, and the points that were reached."""
        reached = excursion(self._system, home, idle)
        if not reached.points:
            return 0, reached
        at = max([home, *reached.points], key=lambda x: rank_of(self._system.residual(x)[1]))
        basis = null_space(self._system.residual(at)[1])
        still = self.idle(at, False) if idle.shape[1] else idle
        rng = np.random.default_rng(1)
        steps = []
        for _ in range(basis.shape[1] + 2):
            v = basis @ rng.standard_normal(basis.shape[1])
            v -= still @ (still.T @ v)
            nominal = self._system.nominal
            x, gap = self._system.assembled(at + SHORT * v / max(np.linalg.norm(v), 1e-9) * nominal)
            if gap <= CLOSED:
                step = (x - at) / nominal / SHORT
                steps.append(step - still @ (still.T @ step))
        s = np.linalg.svd(np.array(steps), compute_uv=False) if steps else np.zeros(0)
        return int(np.sum(s > COUNTED)), reached


def _kernel(moves: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (k, d) of the combinations that move nothing."""
    if not moves.size:
        return np.eye(moves.shape[1])
    _, s, vt = np.linalg.svd(moves)
    return vt[int(np.sum(s > STILL)) :].T


def _free_trees(flat: FlatModel, place: dict[int, int]) -> list[tuple[str, list[int]]]:
    """Return the bodies, with their rigid parts and inner joints, that two or more joints without orientation hold.

    Each is (name, places of the position variables that do not belong to it). Bodies fixed in the world are left out:
    these have no coordinates of their own.
    """
    frames = [p for p in flat.tree.ports if p.overdetermined]
    group = {id(p): n for n, p in enumerate(frames)}

    def join(a: Connector, b: Connector) -> None:
        old, new = group[id(b)], group[id(a)]
        for key, value in group.items():
            if value == old:
                group[key] = new

    for a, b in _edges(flat, frames):
        join(a, b)
    entries = []
    for number in dict.fromkeys(group.values()):
        inside = [p for p in frames if group[id(p)] == number]
        owners = {id(p._parent): p._parent for p in inside}
        roots = [c for c in owners.values() if c is not None and hasattr(c, "attitude")]
        if not roots:
            continue
        holding = 0
        for component in owners.values():
            others = [p for p in flat.tree.ports if p._parent is component and group.get(id(p)) != number]
            holding += sum(type(p).__name__ in ("Frame", "PointFrame") for p in others)
        if holding < 2:
            continue
        paths = tuple(f"{p._path}." for p in inside)
        own = (*paths, f"{roots[0]._path}.attitude.")
        names = {n: v.name for v in flat.variables if (n := place.get(v.index)) is not None}
        entries.append((roots[0]._path, [n for n, name in names.items() if not name.startswith(own)]))
    return entries


def _edges(flat: FlatModel, frames: Sequence[Connector]) -> list[tuple[Connector, Connector]]:
    """Return the pairs of frames whose orientations are tied to each other: by a connection or a component."""
    by_path = {p._path: p for p in frames}
    pairs = {}
    for e in flat.equations:
        m = _CONNECTED.match(e.label)
        if m is not None and m["first"] in by_path and m["other"] in by_path:
            pairs[m["first"], m["other"]] = by_path[m["first"]], by_path[m["other"]]
    return [*pairs.values(), *[(e.a, e.b) for e in flat.loops.edges if e.a is not None]]


def _depth(flat: FlatModel) -> dict[str, int]:
    """Return the number of edges and connections from the root to each frame, by path, along the tree."""
    cut = {id(c.cut.edge) for c in flat.loops.closings if c.cut is not None}
    neighbours: dict[str, list[str]] = {}
    roots = [e.b._path for e in flat.loops.edges if e.a is None]
    links = [(e.a._path, e.b._path) for e in flat.loops.edges if e.a is not None and id(e) not in cut]
    for e in flat.equations:
        m = _CONNECTED.match(e.label)
        links += [(m["first"], m["other"])] if m is not None and e.label.count("r[0]") == 2 else []
    for a, b in links:
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    depth = dict.fromkeys(roots, 0)
    queue = list(roots)
    for path in queue:
        for other in neighbours.get(path, []):
            if other not in depth:
                depth[other] = depth[path] + 1
                queue.append(other)
    return depth


def _disturbed(
    flat: FlatModel, r: Redundancy, seed: int, by_outputs: bool, outputs: str | Sequence[str]
) -> tuple[float, int | None]:
    """Return the gap of a disturbed mechanism, and its mobility if it can be assembled."""
    other = _with_disturbed_frames(flat, r, seed)
    at_home = r.system.positions(r.home)
    started = replace(other, variables=[replace(v, start=None) for v in other.variables], cache={})
    system = positions_of(started, at_home)
    home, gap = system.home(tries=1)
    for x in r.moved.points if gap > CLOSED else ():  # farther along, where a closed position may be
        start = np.array([r.system.positions(x)[i] for i in system.coordinates])
        home, gap = min((home, gap), system.assembled(start), key=lambda entries: entries[1])
    if gap > CLOSED:
        return gap, None
    test = _Test(system, _watched(flat, outputs))
    count, _ = test.finite(home, test.idle(home, by_outputs))
    return gap, count


def _with_disturbed_frames(flat: FlatModel, r: Redundancy, seed: int) -> FlatModel:
    """Return the model with every connection of frames, and every length, disturbed at random."""
    rng = np.random.default_rng(seed)
    by_path = {p._path: p for p in flat.tree.ports if isinstance(p, Frame)}
    depth = _depth(flat)
    at = r.system.positions(r.home)
    origins = np.array([[at[i] for i in flat.groups[f"{path}.r"][1]] for path in by_path if _has(flat, path, at)])
    size = float(np.max(np.ptp(origins, axis=0))) if len(origins) else 0.0
    size = size or 1.0
    shifts: dict[tuple[str, str], Any] = {}
    equations = []
    for e in flat.equations:
        m = _CONNECTED.match(e.label)
        if m is None or m["first"] not in by_path or m["other"] not in by_path:
            equations.append(e)
            continue
        key = m["first"], m["other"]
        first, other = (by_path[name] for name in key)
        if key not in shifts:
            turn = DISTURBANCE * rng.standard_normal(3)
            shifts[key] = DISTURBANCE * size * rng.standard_normal(3), rotation_by(turn)
        d, E = shifts[key]
        place = [int(k) for k in re.findall(r"\d+", e.label.rpartition("[")[2])]
        if depth.get(key[1], 0) < depth.get(key[0], 0):
            first, other = other, first  # from the root on, so that the equation defines the frame behind it
        if m["what"] == "r":
            residual = first.r.sx[place[0]] + (first.R.sx @ d)[place[0]] - other.r.sx[place[0]]
        else:
            residual = (first.R.sx @ ca.DM(E))[place[0], place[1]] - other.R.sx[place[0], place[1]]
        equations.append(replace(e, residual=residual))
    parameters = [
        replace(q, value=q.value * (1 + DISTURBANCE * rng.standard_normal())) if q.unit == "m" else q
        for q in flat.parameters
    ]
    return replace(flat, equations=equations, parameters=parameters, cache={})


def _has(flat: FlatModel, path: str, at: dict[int, float]) -> bool:
    return all(i in at for i in flat.groups[f"{path}.r"][1])


def _second_order(system: Positions, x: np.ndarray, idle: np.ndarray, finite: int) -> str:
    """Return whether motions exist to second order: l.H(v, v) == 0 for all left null vectors l, v in the null space.

    Connelly and Whiteley, SIAM J. Discrete Math. 9(3), 1996: "rigid" if there is none; "branches" if there are some but
    not in all directions, and the mechanism moves (`finite` degrees of freedom); "" otherwise.
    """
    _, jacobian = system.residual(x)
    basis = null_space(jacobian)
    basis = basis @ _kernel(idle.T @ basis) if idle.shape[1] else basis
    left = np.linalg.svd(jacobian)[0][:, rank_of(jacobian) :]
    k = basis.shape[1]
    forms = np.zeros((left.shape[1], k, k))
    for i in range(k):
        for j in range(i + 1):
            both, apart = (left.T @ system.second(x, basis[:, i] + sign * basis[:, j]) for sign in (1, -1))
            forms[:, i, j] = forms[:, j, i] = (both - apart) / 4
    largest = float(np.abs(forms).max(initial=0.0))
    if largest <= DEFINITE:
        return ""
    rng = np.random.default_rng(0)
    best = np.inf
    for _ in range(STARTS):
        v = rng.standard_normal(k)
        v /= np.linalg.norm(v)
        for _ in range(50):
            rows = np.vstack([2 * forms @ v, 2 * largest * v])
            value = np.append(np.einsum("sij,i,j->s", forms, v, v), largest * (v @ v - 1))
            v = v - np.linalg.lstsq(rows, value, rcond=1e-9)[0]
            v /= max(float(np.linalg.norm(v)), 1e-9)
        best = min(best, float(np.abs(np.einsum("sij,i,j->s", forms, v, v)).max()))
    return "rigid" if best > DEFINITE * largest else "branches" if finite else ""
