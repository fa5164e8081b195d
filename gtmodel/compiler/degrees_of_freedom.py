"""Degrees of freedom: how many a mechanism has, and how many of them known positions and rotations fix."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .alias import AliasResult, eliminate
from .consistency.home import starts_of
from .consistency.points import RESIDUAL_TOLERANCE, Sampler
from .flat import FlatModel
from .states import RANK_TOLERANCE
from .tearing import determines

# points at which degrees of freedom are counted, away from singular poses, and their distances from the start values in
# nominals
POINTS = 3
SPREADS = (0.7, 0.3, 1.2, 0.7, 0.3, 0.1)


def known_rotations(flat: FlatModel, known: Collection[int]) -> frozenset[str]:
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
    else that concerns these is known, except joints of an open chain, `locked`.
    """

    def __init__(self, flat: FlatModel, known: Collection[int]) -> None:
        self._flat = flat
        self._known = known = set(known)
        points = [(n, list(i)) for n, (s, i) in flat.groups.items() if s == (3,) and flat.variables[i[0]].unit == "m"]
        points = [(n, i) for n, i in points if not known.isdisjoint(i)]
        self.rotations = known_rotations(flat, known)
        turned = [(n, list(flat.groups[n][1])) for n in flat.groups if n in self.rotations]
        self.groups = [*points, *turned]
        self.equations = [(n, k) for n, i in self.groups for k in range(3) if n in self.rotations or i[k] in known]
        self.chosen: list[tuple[str, int]] = []
        self.dropped: list[tuple[str, int]] = []
        self.count, self.alone, self.locked = 0, True, list[int]()
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
        others = {i for i in others if (i, 0) in self._sampler.position}
        self.locked = [i for i in self.joints if self._alias.resolve(i, 0)[1] in others] if others else []
        self.alone = len(self.locked) == len(others) and (not others or self.is_open)
        held = [self._sampler.position[i, 0] for i in others] if self.alone else []
        self._moving = [t @ _null_space(t[held]) if held else t for t in self._tangents]
        self._choose()

    def _choose(self) -> None:
        """Choose rows group by group, those that depend least on the ones before at the worst point first."""
        places = {(name, k): 3 * g + k for g, (name, _) in enumerate(self.groups) for k in range(3)}
        left = [np.vstack([self._rows(n, i, w, t) for n, i in self.groups])
                for w, t in zip(self._points, self._moving, strict=True)]  # fmt: skip
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
        known numbers and known joints do not determine the mechanism, or if no frame is known."""
        flat = self._flat
        if len(self.groups) > 2 or not self.count or not self.alone:
            return None
        if len(self.locked) + len(self.chosen) < self.count:
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
        if not self.count or not self.alone or self.locked or fixed == numbers == self.count:
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
