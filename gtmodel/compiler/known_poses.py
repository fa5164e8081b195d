"""Known rotation matrices and positions: they count as the degrees of freedom that they fix.

A known rotation matrix has nine numbers for three degrees of freedom. The matrix of the model becomes an unknown beside
the known one, and three equations say that no rotation is left between them. If position and rotation of a frame are
known and the mechanism has fewer degrees of freedom, as many equations are solved; the others are conditions on the
solution.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .alias import AliasResult, eliminate
from .blocks import Margin, SolvedBlock
from .consistency.home import starts_of
from .consistency.points import RESIDUAL_TOLERANCE, Sampler
from .flat import FlatEquation, FlatModel
from .relevance import CONDITION_TOLERANCE
from .states import RANK_TOLERANCE
from .tearing import determines

# points at which degrees of freedom are counted, away from singular poses, and their distances from the start values in
# nominals
POINTS = 3
SPREADS = (0.7, 0.3, 1.2, 0.7, 0.3, 0.1)
AXES = "xyz"
LAST = -9  # preference as a state of the model's values beside known ones

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Known:
    """A known variable: name, scalar indices, and the values of the model, in the same order."""

    name: str
    indices: list[int]
    model: ca.SX

    def column(self, flat: FlatModel) -> ca.SX:
        return ca.vertcat(*[flat.scope.symbol(i, 0) for i in self.indices])


@dataclass(frozen=True, eq=False)
class KnownPose:
    """A model with known rotations, rewritten.

    `flat`: the model with unknown copies of the known values. `exact`: equations between the two, element by element,
    for consistent points, where they stand for the equations `replaced`, by label. `left`: equations that are
    conditions on the solution, each with the size that it is compared with. `copies`: the known variables with a copy,
    `rotations` the rotation matrices among them.
    """

    flat: FlatModel
    exact: tuple[FlatEquation, ...]
    replaced: frozenset[str]
    left: tuple[tuple[FlatEquation, float], ...]
    copies: tuple[_Known, ...]
    rotations: tuple[_Known, ...]

    @property
    def known(self) -> frozenset[int]:
        """The known variables that have a copy."""
        return frozenset(i for c in self.copies for i in c.indices)

    @property
    def read(self) -> list[Pair]:
        """The symbols that the conditions on the solution read."""
        columns = [c.model for c in self.copies]
        columns += [c.column(self.flat) for c in self.copies] if self.left else []
        return list(self.flat.scope.symbols_in(ca.vertcat(*columns)))

    def at_points(self, alias: AliasResult, stages: list[ca.SX], pairs: Sequence[Pair]) -> list[ca.SX]:
        """Return the stages with equations, element by element, that exclude half turns and unreachable values."""
        residuals = [r for r in alias.rewrite_all(self.flat, [e.residual for e in self.exact]) if not r.is_zero()]
        inside, stages = set(pairs), list(stages)
        for m in range(len(stages)):
            residuals = [r for r in residuals if inside.issuperset(self.flat.scope.symbols_in(r))]
            if not residuals:
                break
            stages[m] = ca.vertcat(stages[m], *residuals)
            residuals = [self.flat.scope.derivative(r) for r in residuals]
        return stages

    def reflections(self) -> list[Margin]:
        """Return margins that are negative if a known matrix is a reflection."""
        matrices = [_matrix(r.column(self.flat)) for r in self.rotations]
        labels = [f"{r.name} is a rotation matrix ({self.flat.variables[r.indices[0]].where})" for r in self.rotations]
        return [
            Margin("condition", ca.dot(ca.cross(m[:, 0], m[:, 1]), m[:, 2]), label)
            for m, label in zip(matrices, labels, strict=True)
        ]

    def condition_blocks(self, alias: AliasResult, newton: bool) -> list[SolvedBlock]:
        """Return a block whose margins are negative if a solution does not satisfy what is left; none without any.

        newton: a solution may have been found on the wrong side of a rotation, turned by half a turn.
        """
        margins = [
            Margin("solution", (CONDITION_TOLERANCE * size) ** 2 - e.residual**2, f"{e.label} ({e.where})")
            for e, size in self.left
        ]
        for r in self.rotations if newton else ():
            trace = ca.dot(r.column(self.flat), r.model)  # 3 for equal matrices, at most 1 after half a turn
            margins.append(Margin("turn", trace - 2.0, f"{r.name}, but half a turn from it"))
        if not margins:
            return []
        expressions = alias.rewrite_all(self.flat, [m.expression for m in margins])
        margins = [replace(m, expression=e) for m, e in zip(margins, expressions, strict=True)]
        labels = [m.label for m in margins]
        return [SolvedBlock("condition", [], labels, [], margins, detail="condition on the solution")]


def known_pose(flat: FlatModel, known: Sequence[int]) -> KnownPose | None:
    """Return the model rewritten for its known rotation matrices; None if no whole rotation matrix is known."""
    key = "known pose", frozenset(known)
    if key not in flat.cache:
        if (old := flat.source) is not None:  # rewritten before, and now with other parameters
            variables = flat.variables[: len(old.variables)]
            return known_pose(replace(old, parameters=flat.parameters, variables=variables, cache={}), known)
        flat.cache[key] = pose = _known_pose(flat, frozenset(known))
        if pose is not None:
            pose.flat.cache[key] = pose
    return flat.cache[key]


def _known_pose(flat: FlatModel, known: frozenset[int]) -> KnownPose | None:
    whole = _rotations(flat, known)
    if not whole:
        return None
    fixed = degrees_of_freedom(flat, known)
    dropped = fixed.dropped
    scope = copy(flat.scope)  # the new variables are those of the new model alone
    scope.chains, scope.names = [*scope.chains], [*scope.names]
    variables, old, new = [*flat.variables], list[ca.SX](), list[ca.SX]()
    copies, rotations, left = list[_Known](), list[_Known](), list[tuple[FlatEquation, float]]()
    exact, rows = list[FlatEquation](), list[FlatEquation]()

    def reached(name: str, indices: list[int]) -> _Known:
        first = len(variables)
        for i in indices:
            v = flat.variables[i]
            scope.new_chain(f"reached {v.name}")
            variables.append(replace(v, name=f"reached {v.name}", index=len(variables), role="variable", prefer=LAST))
        symbols = [scope.symbol(first + k, 0) for k in range(len(indices))]
        for k, i in enumerate(indices):
            old.extend(scope.symbol(i, m) for m in range(len(scope.chains[i])))
            new.extend(scope.symbol(first + k, m) for m in range(len(scope.chains[i])))
        return _Known(name, indices, ca.vertcat(*symbols))

    def rows_of(group: _Known, residuals: ca.SX, labels: list[str], sizes: float) -> None:
        v = flat.variables[group.indices[0]]
        for k, label in enumerate(labels):
            equation = FlatEquation(residuals[k], label, v.component, v.where)
            if (group.name, k) in dropped:
                left.append((equation, sizes))
            else:
                rows.append(equation)

    for name, indices in fixed.groups:
        rotation = name in whole
        if not rotation and not any((name, k) in dropped for k in range(3)):
            continue
        group = reached(name, indices)
        copies.append(group)
        v = flat.variables[indices[0]]
        column = group.column(flat)
        for i, residual in zip(indices, ca.vertsplit(column - group.model), strict=True):
            label = f"{flat.variables[i].name} as known"
            exact.append(FlatEquation(residual, label, v.component, v.where))
        if rotation:
            rotations.append(group)
            error = _error(_matrix(group.model), _matrix(column))
            rows_of(group, error, [f"rotation of {name} about {axis}" for axis in AXES], 1.0)
            gram = _matrix(column).T @ _matrix(column) - ca.DM.eye(3)
            for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
                rows.append(FlatEquation(gram[i, j], f"{name} is a rotation matrix", v.component, v.where))
        else:
            labels = [f"{flat.variables[i].name} as known" for i in indices]
            rows_of(group, column - group.model, labels, fixed.reach(indices))
    residuals = ca.substitute([e.residual for e in flat.equations], [ca.vertcat(*old)], [ca.vertcat(*new)])
    equations = [replace(e, residual=r) for e, r in zip(flat.equations, residuals, strict=True)]
    changed = replace(flat, scope=scope, variables=variables, equations=[*equations, *rows], source=flat, cache={})
    labels = frozenset(e.label for e in rows)
    return KnownPose(changed, tuple(exact), labels, tuple(left), tuple(copies), tuple(rotations))


def _matrix(column: ca.SX) -> ca.SX:
    """Return the matrix of nine elements that are ordered by rows."""
    return ca.reshape(column, 3, 3).T


def _error(model: ca.SX, known: ca.SX) -> ca.SX:
    """Return the rotation from the known matrix to the model's in world axes: sin(angle) times the axis.

    It has the derivatives of the rotation vector where both are equal. If the known matrix moves on a straight line
    between two rotations, its zero moves along the shortest rotation between them.
    """
    turn = model @ known.T
    return ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2


def _rotations(flat: FlatModel, known: Collection[int]) -> frozenset[str]:
    """Return the names of known rotation matrices: those declared, and those that equal a declared one."""
    matrices = {n: g for n, (shape, g) in flat.groups.items() if shape == (3, 3) and set(g) <= set(known)}
    if not matrices.keys() - flat.rotations:
        return frozenset(matrices)
    alias = eliminate(flat, frozenset())
    declared = {tuple(alias.resolve(i, 0) for i in flat.groups[n][1]) for n in flat.rotations}
    equal = {n for n, g in matrices.items() if tuple(alias.resolve(i, 0) for i in g) in declared}
    return frozenset(equal | (matrices.keys() & flat.rotations))


class DegreesOfFreedom:
    """How many degrees of freedom of a mechanism known positions and rotations fix, at poses near the start values.

    `groups`: the positions of which coordinates are known, then the known rotations, by name and indices. `equations`:
    (name, number of the coordinate or of the axis of rotation) of what they fix; `chosen` and `dropped` are independent
    and dependent ones. `count`: the degrees of freedom of the mechanism that have equations with them. `alone`: nothing
    else that concerns these is known.
    """

    def __init__(self, flat: FlatModel, known: Collection[int]) -> None:
        self._flat = flat
        self._known = known = set(known)
        points = [(n, list(i)) for n, (s, i) in flat.groups.items() if s == (3,) and flat.variables[i[0]].unit == "m"]
        points = [(n, i) for n, i in points if not known.isdisjoint(i)]
        self.rotations = _rotations(flat, known)
        turned = [(n, list(flat.groups[n][1])) for n in flat.groups if n in self.rotations]
        self.groups = [*points, *turned]
        self.equations = [(n, k) for n, i in self.groups for k in range(3) if n in self.rotations or i[k] in known]
        self.chosen: list[tuple[str, int]] = []
        self.dropped: list[tuple[str, int]] = []
        self.count, self.alone = 0, True
        self._alias = eliminate(flat, frozenset())
        equations = _connected(flat, self._alias, [i for _, indices in self.groups for i in indices])
        if not equations:
            return
        self._residuals = equations
        residual = ca.vertcat(*equations)
        pairs = sorted(set(flat.scope.symbols_in(residual)))
        starts = {p: x for p, x in starts_of(flat, self._alias).items() if p in set(pairs)}
        self._sampler = Sampler(flat, pairs, [residual], starts)
        w = self._sampler.w
        jacobian = ca.Function("tangent", [w, flat.p], [ca.densify(ca.jacobian(residual, w))])
        self._points = _points(self._sampler)
        if not self._points:
            return
        self._tangents = [_null_space(jacobian(w, flat.p0).full()) for w in self._points]
        self.count = max(t.shape[1] for t in self._tangents)
        others = {self._alias.resolve(i, 0)[1] for i in known} - {
            self._alias.resolve(i, 0)[1] for _, indices in self.groups for i in indices
        }
        self.alone = not any((i, 0) in self._sampler.position for i in others)
        self._choose()

    def _choose(self) -> None:
        """Choose rows group by group, those that depend least on the ones before at the worst point first."""
        places = {(name, k): 3 * g + k for g, (name, _) in enumerate(self.groups) for k in range(3)}
        left = [np.vstack([self._rows(n, i, w, t) for n, i in self.groups])
                for w, t in zip(self._points, self._tangents, strict=True)]  # fmt: skip
        size = max(float(np.max(np.abs(m), initial=0.0)) for m in left)
        for name, indices in self.groups:
            todo = [e for e in self.equations if e[0] == name]
            while todo:
                norms = [min(float(np.linalg.norm(m[places[e]])) for m in left) for e in todo]
                best = int(np.argmax(np.array(norms) >= max(norms) * (1 - 1e-6)))
                if norms[best] <= RANK_TOLERANCE * max(size, 1.0):
                    break
                self.chosen.append(todo.pop(best))
                for n, m in enumerate(left):
                    row = m[places[self.chosen[-1]]]
                    unit = row / np.linalg.norm(row)
                    left[n] = m - np.outer(m @ unit, unit)
            if self.alone and self.rotations and self._known.issuperset(indices):
                self.dropped += todo

    @cached_property
    def joints(self) -> list[int]:
        """Indices of variables that determine the pose of all: those with the highest state preference."""
        flat, kept = self._flat, sorted({i for i, _ in self._sampler.pairs})
        free = [t.copy() for t in self._tangents]
        chosen: list[int] = []
        for i in sorted(kept, key=lambda i: (-flat.variables[i].prefer, i)):
            rows = [t[self._sampler.position[i, 0]] for t in free]
            if len(chosen) < self.count and min(map(np.linalg.norm, rows)) > RANK_TOLERANCE:
                chosen.append(i)
                units = [r / np.linalg.norm(r) for r in rows]
                free = [t - np.outer(t @ u, u) for t, u in zip(free, units, strict=True)]
        return sorted(chosen)

    @property
    def is_open(self) -> bool:
        """Whether positions and rotations follow from the joints one after the other: the mechanism has no loops."""
        pairs = self._sampler.pairs
        symbols = [self._flat.scope.symbol(*pair) for pair in pairs]
        return determines(self._residuals, symbols, [n for n, (i, _) in enumerate(pairs) if i in set(self.joints)])

    def _rows(self, name: str, indices: list[int], w: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Return the velocities (3, directions) of a position or a rotation along the free directions at a point."""
        places = [self._alias.resolve(i, 0) for i in indices]
        at = [self._sampler.position.get((kept, order)) for _, kept, order in places]
        rates = np.array([np.zeros(tangent.shape[1]) if n is None else s * tangent[n]
                          for (s, *_), n in zip(places, at, strict=True)])  # fmt: skip
        if name not in self.rotations:
            return rates
        R = np.array([0.0 if n is None else s * w[n] for (s, *_), n in zip(places, at, strict=True)]).reshape(3, 3)
        turn = np.einsum("ijf,kj->ikf", rates.reshape(3, 3, -1), R)
        return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2

    def pose(self) -> tuple[list[int], list[int]] | None:
        """Return the indices of position and rotation of a frame of which all or some numbers are known; None if its
        known numbers do not determine the mechanism, or if no frame is known."""
        flat = self._flat
        if len(self.groups) > 2 or not self.count or not self.alone or len(self.chosen) < self.count:
            return None
        rotation = next((i for n, i in self.groups if n in self.rotations), None)
        position = next((i for n, i in self.groups if n not in self.rotations), None)
        if position is None:
            return None
        if rotation is not None:
            return position, rotation
        places = [self._alias.resolve(i, 0) for i in position]
        for name in sorted(flat.rotations):
            _, origin = flat.groups.get(f"{name.removesuffix('R')}r", ((), []))
            if name.endswith("R") and [self._alias.resolve(i, 0) for i in origin] == places:
                return position, flat.groups[name][1]
        return None

    def reach(self, indices: list[int]) -> float:
        """Return the largest distance of a position from the origin at the points, to compare lengths with."""
        places = [self._sampler.position.get(self._alias.resolve(i, 0)[1:]) for i in indices]
        lengths = [float(np.linalg.norm([w[n] for n in places if n is not None])) for w in self._points]
        return float(f"{max([*lengths, 1e-3]):.3g}")

    @property
    def summary(self) -> str:
        """A sentence about the degrees of freedom that the known values fix; "" if they are those of the mechanism."""
        numbers, fixed = len(self.equations), len(self.chosen)
        if not self.count or not self.alone or fixed == numbers == self.count:
            return ""
        names = " and ".join(n for n, _ in self.groups)
        has, fix = ("has", "fixes") if len(self.groups) == 1 else ("have", "fix")
        if fixed == self.count:
            entries = ", ".join(f"'{self._element(*c)}'" for c in sorted(self.chosen) if c[0] not in self.rotations)
            text = f"{names} {has} {numbers} degrees of freedom, and the mechanism has {self.count}"
            return f"{text}: name {self.count} of them" + (f", such as {entries}" if entries else "")
        text = f"{names} {fix} {fixed} degrees of freedom, and the mechanism has {self.count}"
        return f"{text}: {self.count - fixed} more must be known" + (f", such as '{self._free}'" if self._free else "")

    def _element(self, name: str, k: int) -> str:
        indices = dict(self.groups)[name]
        return self._flat.variables[indices[k]].name

    @property
    def _free(self) -> str:
        """The name of a top-level variable that the known values leave free, "" if there is none: a joint first."""
        flat, (w, tangent) = self._flat, (self._points[0], self._tangents[0])
        rows = np.vstack([self._rows(n, i, w, tangent) for n, i in self.groups])
        free = tangent @ _null_space(rows)
        for v in sorted(flat.variables, key=lambda v: -v.prefer):
            place = self._sampler.position.get(self._alias.resolve(v.index, 0)[1:])
            if "." not in v.name and place is not None and np.linalg.norm(free[place]) > RANK_TOLERANCE:
                return v.name
        return ""


def degrees_of_freedom(flat: FlatModel, known: Collection[int]) -> DegreesOfFreedom:
    """Return the degrees of freedom that known variables fix; cached."""
    key = "degrees of freedom", frozenset(known)
    if key not in flat.cache:
        flat.cache[key] = DegreesOfFreedom(flat, known)
    return flat.cache[key]


@contextmanager
def counting_freedom(flat: FlatModel, known: Sequence[int]) -> Iterator[None]:
    """Put the degrees of freedom that known poses fix in front of a message on too many or too few knowns."""
    try:
        yield
    except ModelError as error:
        try:
            summary = degrees_of_freedom(flat, known).summary
        except ModelError:
            summary = ""
        if not summary:
            raise
        rest = str(error).removeprefix(f"{flat.title}: ")
        raise ModelError(f"{flat.title}: {summary}; {rest}", error.where) from error


def _connected(flat: FlatModel, alias: AliasResult, indices: Sequence[int]) -> list[ca.SX]:
    """Return the residuals of position equations that are connected to some variables: no flows, no rates."""
    inside = flat.scope.symbols_in_each([e.residual for e in alias.equations])
    flows = {v.index for v in flat.variables if v.role in ("flow", "input")}
    candidates = {n: s for n, s in enumerate(inside) if s and all(k == 0 and i not in flows for i, k in s)}
    reached, chosen = {alias.resolve(i, 0)[1:] for i in indices}, list[int]()
    while new := [n for n, s in candidates.items() if not reached.isdisjoint(s)]:
        for n in new:
            reached |= set(candidates.pop(n))
        chosen += new
    return [alias.equations[n].residual for n in sorted(chosen)]


def _points(sampler: Sampler) -> list[np.ndarray]:
    points = []
    for seed, spread in enumerate(SPREADS):
        w = sampler.near(np.random.default_rng(seed), spread)
        if sampler.correct(w) <= RESIDUAL_TOLERANCE:
            points.append(w)
        if len(points) == POINTS:
            break
    return points


def _null_space(jacobian: np.ndarray) -> np.ndarray:
    _, s, vt = np.linalg.svd(jacobian)
    rank = int(np.sum(s > RANK_TOLERANCE * max(float(s[0]), 1.0))) if s.size else 0
    return vt[rank:].T
