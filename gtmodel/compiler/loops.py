"""Loops of joints: which constraints of the joints that close them are redundant, and what becomes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..lang.connect import place_of
from ..lang.model import Connector, Model
from ..lang.source import ModelError
from .flat import FlatClosing, FlatConstraint, FlatEquation, FlatModel
from .positions import CLOSED, RANK_TOLERANCE, Positions, positions_of
from .trees import loop_of

MOVES = (0.2, 0.05, 0.01)  # sizes of steps in the null space, in nominals, the largest first
MOVED = 0.3  # part of a step that must remain after reassembly; less is a return to the start
SAMPLES = 4  # moved points
DIRECTIONS = 6  # random directions of the null space for each size of step
SHARE = 1e-6  # of the largest entry of a reaction pattern: smaller ones are round-off
ALIGNED = 1e-9  # of a direction from a coordinate axis
AXES = "xyz"
SHOWN = 8  # joints in one message


@dataclass(frozen=True, eq=False)
class Excursion:
    """Assembled points reached from a home point: `points` (n each), `distance` of the farthest in nominals, and `gap`,
    the largest residual among the points."""

    points: list[np.ndarray]
    distance: float
    gap: float


def rank_of(jacobian: np.ndarray) -> int:
    """Return the numerical rank of derivatives at an assembled point."""
    s = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.zeros(0)
    return int(np.sum(s > RANK_TOLERANCE * max(1.0, s[0]))) if s.size else 0


def null_space(jacobian: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, k) of the motions that no constraint prevents."""
    if not jacobian.size:
        return np.eye(jacobian.shape[1])
    return np.linalg.svd(jacobian)[2][rank_of(jacobian) :].T


def excursion(system: Positions, home: np.ndarray, idle: np.ndarray | None = None) -> Excursion:
    """Return points that small steps in the null space and a reassembly reach.

    A step counts only if a part of it remains: reassembly may fall back to the start, where a mechanism is rigid in
    spite of its rank. idle: directions (n, k), orthonormal, that do not count.
    """
    still = np.zeros((len(home), 0)) if idle is None else idle

    def counted(v: np.ndarray) -> np.ndarray:
        return v - still @ (still.T @ v)

    points: list[np.ndarray] = []
    farthest, gap = 0.0, 0.0
    rng = np.random.default_rng(0)
    for step in MOVES:
        for n in range(DIRECTIONS):
            start = points[-1] if points and n % 2 else home
            basis = null_space(system.residual(start)[1])
            if not basis.shape[1]:
                return Excursion(points, farthest, gap)
            v = counted(basis @ rng.standard_normal(basis.shape[1]))
            if np.linalg.norm(v) <= MOVED * 1e-3:
                return Excursion(points, farthest, gap)
            x, left = system.assembled(start + step * v / np.linalg.norm(v) * system.nominal)
            moved = float(np.linalg.norm(counted((x - start) / system.nominal)))
            if left <= CLOSED and moved >= MOVED * step:
                points.append(x)
                farthest = max(farthest, float(np.linalg.norm((x - home) / system.nominal)))
                gap = max(gap, left)
            if len(points) == SAMPLES:
                return Excursion(points, farthest, gap)
        if points:
            break
    return Excursion(points, farthest, gap)


@dataclass(frozen=True, eq=False)
class Redundancy:
    """The redundant constraints of a model at its best conditioned point.

    Attributes:
        system, home, gap: the position constraints, the assembled point nearest to the start values, its residual.
        moved: the points reached from there. point: the point of full rank that the rest is judged at.
        rank: of the constraints. dropped: the constraints (positions in system.rows) that may be dropped.
        stresses: (m, k) forces in the constraints without any load, one column each.
    """

    system: Positions
    home: np.ndarray
    gap: float
    moved: Excursion
    point: np.ndarray
    rank: int
    dropped: list[int]
    stresses: np.ndarray

    @property
    def count(self) -> int:
        return len(self.system.rows) - self.rank

    @property
    def mobility(self) -> int:
        """Degrees of freedom at the point of full rank, idle ones included."""
        return len(self.system.coordinates) - self.rank

    @property
    def instantaneous(self) -> int:
        """Degrees of freedom by the rank at the home point."""
        return len(self.system.coordinates) - rank_of(self.system.residual(self.home)[1])


def redundancy_of(flat: FlatModel) -> Redundancy:
    """Return the redundant constraints of a model. Raises ModelError for a parameter without a value."""
    system = positions_of(flat)
    home, gap = system.home()
    moved = excursion(system, home) if gap <= CLOSED else Excursion([], 0.0, gap)
    points = [home, *moved.points]
    jacobians = [system.residual(x)[1] for x in points]
    ranks = [rank_of(j) for j in jacobians]
    rank = max(ranks)
    best = [n for n, r in enumerate(ranks) if r == rank]
    held = {c.equation for closing in flat.loops.closings for c in closing.constraints}
    loose = [n for n, row in enumerate(system.rows) if row in held]
    dropped = _dropped([jacobians[n] for n in best], loose, rank) if len(system.rows) > rank else []
    u = np.linalg.svd(jacobians[best[0]])[0] if jacobians[0].size else np.eye(len(system.rows))
    return Redundancy(system, home, gap, moved, points[best[0]], rank, dropped, u[:, rank:])


def _dropped(jacobians: Sequence[np.ndarray], loose: list[int], rank: int) -> list[int]:
    """Return the loose rows without which the others have full rank, as well conditioned as possible at all points."""
    rows = len(jacobians[0])
    firm = [n for n in range(rows) if n not in set(loose)]
    best: tuple[float, list[int]] = -1.0, []
    for jacobian in jacobians:
        kept = _independent(jacobian, firm, loose, rank)
        worst = min(np.linalg.svd(j[kept], compute_uv=False)[-1] if kept else 1.0 for j in jacobians)
        if worst > best[0] * (1 + 1e-9):
            best = float(worst), [n for n in loose if n not in set(kept)]
    return best[1]


def _independent(jacobian: np.ndarray, firm: list[int], loose: list[int], rank: int) -> list[int]:
    """Return firm rows, then loose ones by pivoted elimination, up to the rank; ties go to the first row."""
    rest = jacobian.copy()
    kept: list[int] = []
    for group in (firm, loose):
        candidates = list(group)
        while candidates and len(kept) < rank:
            norms = np.linalg.norm(rest[candidates], axis=1)
            if norms.max() <= RANK_TOLERANCE * max(1.0, float(np.abs(jacobian).max())):
                break
            row = candidates[int(np.argmax(norms >= norms.max() * (1 - 1e-9)))]
            q = rest[row] / np.linalg.norm(rest[row])
            rest = rest - np.outer(rest @ q, q)
            kept.append(row)
            candidates.remove(row)
    return kept


def direction_name(direction: np.ndarray) -> str:
    """Return "x" for a coordinate axis of either sense, else its coordinates, such as "(0, 0.6, 0.8)"."""
    k = int(np.argmax(np.abs(direction)))
    if abs(abs(direction[k]) - np.linalg.norm(direction)) <= ALIGNED:
        return AXES[k]
    return f"({', '.join(f'{x:.3g}' for x in direction + 0.0)})"


class Naming:
    """Names of constraints and reactions at one assembled point."""

    def __init__(self, system: Positions, point: np.ndarray) -> None:
        self._flat, self._at = system.flat, system.positions(point)

    def potential(self, port: Connector, name: str) -> np.ndarray:
        """Return a position or a matrix of a port."""
        _, indices = self._flat.groups[f"{port._path}.{name}"]
        values = np.array([self._at[i] for i in indices])
        return values.reshape(3, 3) if name == "R" else values

    def acting(self, c: FlatConstraint) -> tuple[np.ndarray, np.ndarray]:
        """Return force and torque on port b, in the world, for a reaction of one."""
        port = c.item.ports[1]
        flows = [self._flat.groups[f"{port._path}.{name}"][1] for name in "ft"]
        scope = self._flat.scope
        symbols = ca.vertcat(*[scope.symbol(i, 0) for group in flows for i in group])
        gradient = ca.substitute(ca.jacobian(c.reaction, symbols), self._flat.p, ca.DM(self._flat.p0))
        free = [i for i, _ in scope.symbols_in(gradient)]
        at = ca.vertcat(*[scope.symbol(i, 0) for i in free]) if free else ca.SX(0, 1)
        f = ca.Function("acting", [at], [ca.densify(gradient)])
        v = np.array(f(np.array([self._at[i] for i in free]))).reshape(-1)
        return v[:3], v[3:]

    def constraint(self, c: FlatConstraint) -> str:
        """Return what a constraint fixes, such as "position along z", in coordinates of the joint's frame a."""
        force, torque = self.acting(c)
        R = self.potential(c.item.ports[0], "R")
        return f"{c.item.direction} {direction_name(R.T @ (force + torque))}"

    def reactions(self, closings: Sequence[FlatClosing], rows: dict[int, np.ndarray]) -> list[tuple[Model, list[str]]]:
        """Return the reactions that load-free patterns leave undetermined, by component, in frame a's coordinates.

        rows: the entries (k,) of the patterns in each constraint, by its equation.
        """
        total: dict[int, tuple[Model, Connector, np.ndarray]] = {}
        patterns = next(iter(rows.values())).shape[0] if rows else 0
        for closing in closings:
            wrench, origin = np.zeros((6, patterns)), np.zeros(3)
            for c in closing.constraints:
                origin = self.potential(c.item.ports[1], "r")
                wrench += np.outer(np.concatenate(self.acting(c)), rows.get(c.equation, np.zeros(patterns)))
            first = closing.constraints[0].item.ports[0]
            _add(total, closing.component, first, wrench)
            for step in closing.cut.steps if closing.cut is not None else ():
                if step.edge.closing is None or step.edge.a is None:
                    continue
                arm = origin - self.potential(step.edge.b, "r")
                moved = wrench.copy()
                moved[3:] += np.cross(arm, wrench[:3].T).T
                _add(total, step.component, step.edge.a, moved if step.forward else -moved)
        largest = max((float(np.abs(w).max(initial=0.0)) for _, _, w in total.values()), default=0.0)
        entries = []
        for component, port, wrench in total.values():
            R = self.potential(port, "R")
            local = [np.abs(R.T @ part).max(axis=1, initial=0.0) > SHARE * largest for part in (wrench[:3], wrench[3:])]
            names = [f"force along {AXES[k]}" for k in range(3) if local[0][k]]
            names += [f"torque about {AXES[k]}" for k in range(3) if local[1][k]]
            if names:
                entries.append((component, names))
        return entries


def _add(
    total: dict[int, tuple[Model, Connector, np.ndarray]], component: Model, port: Connector, wrench: np.ndarray
) -> None:
    before = total.get(id(component))
    total[id(component)] = component, port, wrench if before is None else before[2] + wrench


@dataclass(frozen=True)
class Undetermined:
    """One joint's constraints that are redundant, or its reactions that are not determined, in words."""

    joint: str
    names: tuple[str, ...]
    where: str

    def __str__(self) -> str:
        return f"'{self.joint}' ({', '.join(self.names)})"


def listed(entries: Sequence[Undetermined]) -> str:
    """Return one text: joints with the same names together."""
    joints: dict[tuple[str, ...], list[str]] = {}
    for u in entries:
        joints.setdefault(u.names, []).append(f"'{u.joint}'")
    shown = ((p[:SHOWN], len(p) - SHOWN, names) for names, p in joints.items())
    return "; ".join(
        f"{', '.join(parts)}{f' and {more} more' if more > 0 else ''} ({', '.join(names)})"
        for parts, more, names in shown
    )


def redundant_constraints(r: Redundancy) -> list[Undetermined]:
    """Return the redundant constraints by joint, those that may be dropped; other equations by their labels."""
    flat, naming = r.system.flat, Naming(r.system, r.point)
    chosen = {r.system.rows[n] for n in r.dropped}
    entries = []
    for closing in flat.loops.closings:
        names = [naming.constraint(c) for c in closing.constraints if c.equation in chosen]
        if names:
            entries.append(Undetermined(closing.component._path, tuple(names), str(place_of(closing.component) or "")))
    if r.count > len(r.dropped):
        held = {c.equation for closing in flat.loops.closings for c in closing.constraints}
        weight = np.max(np.abs(r.stresses), axis=1, initial=0.0)
        labels: dict[tuple[str, str], list[str]] = {}
        for n, row in enumerate(r.system.rows):
            if row not in held and weight[n] > SHARE:
                e = flat.equations[row]
                labels.setdefault((e.component, str(e.where)), []).append(e.label)
        entries += [Undetermined(c or flat.title, tuple(names), where) for (c, where), names in labels.items()]
    return entries


def undetermined_reactions(r: Redundancy) -> list[Undetermined]:
    """Return the reactions of joints that the redundant constraints leave undetermined."""
    if not r.count:
        return []
    flat = r.system.flat
    rows = {row: r.stresses[n] for n, row in enumerate(r.system.rows)}
    entries = Naming(r.system, r.point).reactions(flat.loops.closings, rows)
    return [Undetermined(c._path, tuple(names), str(place_of(c) or "")) for c, names in entries]


def settled(flat: FlatModel) -> FlatModel:
    """Return the model with its redundant constraints dropped, if the user says so.

    Raises ModelError for redundant constraints otherwise, for a loop that cannot be assembled, and for one that is
    singular at the start position; all name the joint that closes it.
    """
    cut = [c for c in flat.loops.closings if c.cut is not None]
    if not flat.loops.closings or not (cut or flat.loops.drop) or not np.all(np.isfinite(flat.p0)):
        return flat
    r = redundancy_of(flat)
    if r.gap > CLOSED:
        raise not_assembled(flat, r.system, r.home, r.gap)
    still = r.instantaneous and not r.moved.points
    if r.dropped and not flat.loops.drop and not still:
        raise _redundant(flat, r)
    if still or r.instantaneous > r.mobility:
        raise _singular(flat, r)
    flat = _started(flat, r)
    if not r.dropped:
        return flat
    equations, dropped = list(flat.equations), list[FlatEquation]()
    reactions = {c.equation: c.reaction for closing in flat.loops.closings for c in closing.constraints}
    for row in (r.system.rows[n] for n in r.dropped):
        e = equations[row]
        dropped.append(e)
        equations[row] = replace(e, residual=reactions[row], label=f"{e.label} (redundant: its reaction is zero)")
    loose = undetermined_reactions(r)
    notes = (
        f"redundant constraints, whose reactions are set to zero: {listed(redundant_constraints(r))}",
        f"reactions that depend on this choice: {listed(loose)}",
    )
    loops = replace(flat.loops, dropped=dropped, loose=frozenset(u.joint for u in loose), notes=notes)
    return replace(flat, equations=equations, loops=loops, cache=dict(flat.cache))


def _started(flat: FlatModel, r: Redundancy) -> FlatModel:
    """Return the model with the assembled position nearest to its start values as a guess of coordinates without one.

    Without it a random start would select the assembly mode and the turns of the joints.
    """
    loose = np.isnan(r.system.starts)
    values = {i: x for i, x, free in zip(r.system.coordinates, r.home.tolist(), loose, strict=True) if free}
    variables = [replace(v, start=values[v.index]) if v.index in values else v for v in flat.variables]
    loops = replace(flat.loops, mobility=r.mobility)
    return replace(flat, variables=variables, loops=loops, cache={"home": r.system.positions(r.home)})


def _loop(closing: FlatClosing) -> str:
    return loop_of(closing.component, closing.cut)


def _redundant(flat: FlatModel, r: Redundancy) -> ModelError:
    chosen = {r.system.rows[n] for n in r.dropped}
    closing = next(c for c in flat.loops.closings if any(k.equation in chosen for k in c.constraints))
    names = listed(redundant_constraints(r))
    advice = getattr(type(closing.component), "if_redundant", "")
    return ModelError(
        f"{flat.title}: the loop {_loop(closing)} is closed by '{closing.component._path}', and "
        f"{r.count} of the constraints are redundant: {names}; the mobility is {r.mobility}. Yield "
        'gt.loops(redundant="drop"), which sets the reactions of these constraints to zero, or free them by other '
        f"joints, such as a spherical or a cylindrical one{advice and f'; {advice}'}",
        place_of(closing.component),
    )


def _singular(flat: FlatModel, r: Redundancy) -> ModelError:
    """Return the error for a start position with more degrees of freedom by its rank than by its motions."""
    jacobian = r.system.residual(r.home)[1]
    stress = np.linalg.svd(jacobian)[0][:, rank_of(jacobian) :]
    if r.moved.points:  # only what the moved points do not have
        stress -= r.stresses @ (r.stresses.T @ stress)
    weight = dict(zip(r.system.rows, np.abs(stress).max(axis=1), strict=True))
    closing = max(flat.loops.closings, key=lambda c: max(weight.get(k.equation, 0.0) for k in c.constraints))
    count = f"{r.instantaneous} instantaneous degree{'' if r.instantaneous == 1 else 's'} of freedom"
    cause = (
        f"{count} and the mobility {r.mobility}: several motions meet there; set start values of its joints elsewhere"
        if r.moved.points
        else f"{count} and the mobility 0, for no motion leads away from it: the mechanism is rigid there; set other "
        "start values, lengths or directions"
    )
    return ModelError(
        f"{flat.title}: the start position of the loop {_loop(closing)}, closed by '{closing.component._path}', is "
        f"singular: it has {cause}",
        place_of(closing.component),
    )


def not_assembled(flat: FlatModel, system: Positions, x: np.ndarray, gap: float) -> ModelError:
    """Return the error for a mechanism with a gap at the best position x entries; it names the joint there."""
    g, _ = system.residual(x)
    row = system.rows[int(np.argmax(np.abs(g)))]
    closing = next((c for c in flat.loops.closings if any(k.equation == row for k in c.constraints)), None)
    advice = "correct the lengths and directions, or set start values near an assembled position"
    if closing is None:
        e = flat.equations[row]
        return ModelError(f"{flat.title} cannot be assembled: {e.label} is off by {gap:.2g}; {advice}", e.where)
    return ModelError(
        f"{flat.title}: the loop {_loop(closing)} cannot be assembled: a gap of {gap:.2g} m or rad remains at "
        f"'{closing.component._path}', which closes it; {advice}",
        place_of(closing.component),
    )
