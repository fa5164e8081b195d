"""Equations of rigid bodies in the axes of the bodies instead of the world's.

A mechanical equation does not depend on the choice of the world's axes: if all vectors in it turn, its value turns with
them. So it may be read in axes that coincide with those of a body at that instant. There the rotation of the body is
the identity, its inertia is constant, and the rotation of a neighbour is that of the joint between them. Nor does it
change if all accelerations and gravity change by the same vector, so it may be read in a frame that falls freely. Then
the equations of a tree of bodies have the operations of recursions written by hand, and most rotations to the world are
not needed at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..alias import AliasResult
from ..blocks import SolvedBlock
from ..consistency.points import Sampler
from ..flat import FlatModel
from ..graph import largest_matching
from ..matrices import stacked
from ..structure import EquationStructure
from .angular_rates import SAME as SAME_RATE, TURNING
from .bodies import SAME, BodyTree, Matrix, Triple

Pair = tuple[int, int]
Node = tuple[int, int]  # equation, derivative
Timed = tuple[Triple, int]  # a vector and the order of its derivative

HIGHEST = 3  # order of derivatives


class Turned(NamedTuple):
    """Symbols of a vector in the axes of R: in the world's they are R times it plus `fall`."""

    pairs: list[Pair]
    R: ca.SX
    fall: ca.SX


class Own(NamedTuple):
    """The unknown in an equation of bodies that has the factor 1, None for the component of a vector along an axis; and
    the rank of the equation, by which pivots are taken from the ends of a tree to its root."""

    pair: Pair | None
    rank: int


@dataclass(frozen=True, eq=False)
class BodyAxes:
    """Equations in the axes of bodies: residuals by node, in which the symbols of `turned` have another meaning.

    `samples` are consistent points with this meaning.
    """

    flat: FlatModel
    residuals: dict[Node, ca.SX]
    turned: list[Turned]
    samples: np.ndarray
    own: dict[Node, Own]
    forces: frozenset[Node]

    def among(self, wanted: Collection[Pair]) -> list[Turned]:
        """Return the turned vectors that have one of these symbols."""
        return [t for t in self.turned if not set(wanted).isdisjoint(t.pairs)]

    def rotations(self, wanted: Collection[Pair]) -> list[Pair]:
        """Return the entries of rotation matrices by which these symbols turn back."""
        owners = [self.flat.scope.owner(s) for t in self.among(wanted) for s in ca.symvar(t.R)]
        return list(dict.fromkeys(pair for pair in owners if pair is not None))

    def suit(self, components: Sequence[Sequence[Node]], blocks: Sequence[SolvedBlock]) -> bool:
        """Return whether these blocks, one for each component, have forces among the unknowns, and no other pivots that
        depend on the state than those of definite matrices and of small ones."""
        turned = [(c, b) for c, b in zip(components, blocks, strict=True) if not self.residuals.keys().isdisjoint(c)]
        return any(n in self.forces for c, _ in turned for n in c) and all(
            b.kind in ("explicit", "linear") and not (len(c) == 1 and b.margins) and (b.core is None or b.core.definite)
            for c, b in turned
        )

    def in_world(self, blocks: Sequence[SolvedBlock], wanted: Collection[Pair]) -> list[SolvedBlock]:
        """Return blocks solved from these residuals, and one that turns the wanted unknowns to the world's axes."""
        symbol = self.flat.scope.symbol
        outer = [symbol(*p) for t in self.turned for p in t.pairs]
        inner = [ca.SX.sym(f"{s.name()} in body axes") for s in outer]
        old, new = stacked(outer), stacked(inner)

        def renamed(expressions: Sequence[ca.SX]) -> list[ca.SX]:
            return ca.substitute(list(expressions), [old], [new]) if expressions else []

        result: list[SolvedBlock] = []
        for b in blocks:
            symbols, values = (renamed([a[k] for a in b.assignments]) for k in (0, 1))
            margins = zip(b.margins, renamed([m.expression for m in b.margins]), strict=True)
            core = b.core
            if core is not None:
                matrix, right, *unknowns = renamed([core.matrix, core.right, *core.unknowns])
                core = replace(core, unknowns=unknowns, matrix=matrix, right=right)
            assignments = list(zip(symbols, values, strict=True))
            result.append(
                replace(b, assignments=assignments, margins=[replace(m, expression=e) for m, e in margins], core=core)
            )
        of_outer = {s.element_hash(): i for s, i in zip(outer, inner, strict=True)}
        back: list[tuple[ca.SX, ca.SX]] = []
        for t in self.among(wanted):
            of = [symbol(*p) for p in t.pairs]
            mine = ca.vertcat(*[of_outer[s.element_hash()] for s in of])
            back += zip(of, ca.vertsplit(t.R @ mine + t.fall), strict=True)
        if not back:
            return result
        names = [s.name() for s, _ in back]
        return [*result, SolvedBlock("explicit", names, [], back, detail="turned from the axes of bodies")]


def in_body_axes(
    flat: FlatModel, alias: AliasResult, structure: EquationStructure, derivatives: list[list[ca.SX]],
    solved: Mapping[Node, Pair], needed: Iterable[Node], rates: Collection[Node], sampler: Sampler, samples: np.ndarray,
) -> BodyAxes | None:  # fmt: skip
    """Return the equations of all nodes in the axes of bodies; None if the model is no tree of moving bodies, or if the
    targets need no force.

    solved: nodes with the symbols that they are solved for; all other symbols keep their meaning. needed: those of them
    that the targets need. rates: nodes with the rates of rotation matrices by angular velocities.
    """
    if flat.loops.closings or not flat.rotations:
        return None
    flows = {alias.resolve(i, 0)[1] for i, v in enumerate(flat.variables) if v.role == "flow"}
    if flows.isdisjoint(solved[n][0] for n in needed):
        return None
    bodies = BodyTree(flat, alias)
    if not bodies:
        return None
    rows = _rows_of(flat, structure, bodies)
    inside = dict(zip(solved, flat.scope.symbols_in_each([derivatives[i][m] for i, m in solved]), strict=True))
    group_of = {
        (i, m): tuple((k, m) for k in rows.group[i])
        for i, m in solved
        if i in rows.group and all((k, m) in solved for k in rows.group[i])
    }
    # vectors in other equations keep their meaning
    other = {p for node, pairs in inside.items() if node not in group_of and node not in rates for p in pairs}
    unknown = set(solved.values())
    axes: dict[Timed, Matrix] = {}
    for triple, vector in bodies.vectors.items():
        body = bodies.axes_of(triple)
        if body is None:
            continue
        for order in range(HIGHEST):
            pairs = [(i, order) for i in triple]
            moving = vector.through or order or flat.variables[triple[0]].unit == "rad/s"
            moving = moving and all((i, 0) in sampler.position for i in body)
            if moving and all(p in unknown and p in sampler.position and p not in other for p in pairs):
                axes[triple, order] = body
    if not axes:
        return None
    groups = list(dict.fromkeys(group_of.values()))
    reading = _Reading(flat, bodies, axes, rows.gravity, sampler, samples)
    falling = reading.unchanged_in_fall(derivatives, groups, inside)
    residuals: dict[Node, ca.SX] = {}
    options: dict[tuple[Node, ...], list[Timed]] = {}
    along: list[Node] = []
    crossing: set[Timed] = set()  # forces that also act on the body before
    forces: set[Node] = set()
    for group in groups:
        pairs = sorted({p for node in group for p in inside[node]})
        place = reading.place_of(pairs)
        if place is None:
            continue
        if not place.framed:
            return None
        column = ca.vertcat(*[derivatives[i][m] for i, m in group])
        residuals |= zip(group, ca.vertsplit(reading.turned(column, pairs, place.body, group in falling)), strict=True)
        if any(bodies.vectors[t].through for t, _ in place.own):
            forces |= set(group)
        if len(group) == 3:
            options[group] = place.own
            crossing |= {v for v in reading.vectors_in(pairs) if axes.get(v, place.body) != place.body}
        else:
            along += group
    turning = sorted(set(rates).intersection(inside))
    symbols = sorted({p for node in turning for p in inside[node]})
    residuals |= zip(turning, reading.in_world([derivatives[i][m] for i, m in turning], symbols), strict=True)
    vectors = list(axes)
    number = {v: n for n, v in enumerate(vectors)}
    deepest = max(bodies.rank(b)[0] for b in axes.values())
    own: dict[Node, Own] = {node: Own(None, 0) for node in along}
    matching = largest_matching([[number[v] for v in vs] for vs in options.values()], len(vectors))
    for group, n in zip(options, matching, strict=True):
        if n >= 0:
            (triple, order), body = vectors[n], axes[vectors[n]]
            # of a body: its own forces, accelerations of points before those of turns, then forces on the body before
            kind = HIGHEST - order if not bodies.vectors[triple].through else HIGHEST if vectors[n] in crossing else 0
            rank = (HIGHEST + 1) * (deepest - bodies.rank(body)[0]) + kind
            own |= {node: Own((i, order), rank) for node, i in zip(group, triple, strict=True)}
    return BodyAxes(flat, residuals, [reading.back(v) for v in axes], reading.samples(samples), own, frozenset(forces))


class _Rows(NamedTuple):
    """The equations that turn with the axes by number: three as a vector, or one that stays as it is; and the
    numbers of the parameters that are the vector of gravity."""

    group: dict[int, tuple[int, ...]]
    gravity: tuple[int, ...]


def _rows_of(flat: FlatModel, structure: EquationStructure, bodies: BodyTree) -> _Rows:
    """Find equations that turn with the axes by turning all vectors at random numbers."""
    residuals = [e.residual for e in structure.equations]
    inside = flat.scope.symbols_in_each(residuals)
    pairs = sorted({p for each in inside for p in each})
    position = {p: n for n, p in enumerate(pairs)}
    symbols = ca.vertcat(*[flat.scope.symbol(*p) for p in pairs])
    f = ca.Function("rows", [symbols, flat.p, flat.scope.time], [ca.densify(ca.vertcat(*residuals))])
    rng = np.random.default_rng(0)
    x, p, time = rng.normal(size=len(pairs)), rng.uniform(0.5, 1.5, flat.p.numel()), 0.3
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = x.copy()
    vectors = [*bodies.vectors, *[m[c::3] for m in set(bodies.matrix_of.values()) for c in range(3)]]
    for indices in vectors:
        for order in range(HIGHEST):
            at = [position.get((i, order), -1) for i in indices]
            values = turn @ [x[n] if n >= 0 else 0.0 for n in at]
            for n, value in zip(at, values, strict=True):
                if n >= 0:
                    moved[n] = value
    before = np.array(f(x, p, time)).ravel()
    lines = [(e.component, str(e.where)) for e in structure.equations]
    with_vectors = [any(i in bodies.vector_of for i, _ in each) for each in inside]
    windows = [
        (k, k + 1, k + 2)
        for k in range(len(residuals) - 2)
        if lines[k] == lines[k + 1] == lines[k + 2] and any(with_vectors[k : k + 3])
    ]

    def good(p_turned: np.ndarray) -> tuple[list[tuple[int, int, int]], set[int]]:
        """Return the windows that turn and the equations that stay."""
        after = np.array(f(moved, p_turned, time)).ravel()
        limit = SAME * np.maximum(1.0, np.abs(before))
        stays = {k for k, fits in enumerate(np.abs(after - before) <= limit) if fits and with_vectors[k]}
        turned = [w for w in windows if np.all(np.abs(turn @ before[list(w)] - after[list(w)]) <= max(limit[list(w)]))]
        return turned, stays

    turned, stays = good(p)
    covered = {k for w in turned for k in w} | stays
    left = {k for w in windows for k in w} - covered
    used = {s.element_hash() for k in left for s in ca.symvar(residuals[k])}
    gravity: tuple[int, ...] = ()
    for r in flat.tree.parameters:
        if r.item.shape != (3,) or not any(flat.parameters[k].symbol.element_hash() in used for k in r.indices):
            continue
        q = p.copy()
        q[list(r.indices)] = turn @ p[list(r.indices)]
        more, also = good(q)
        if len(more) > len(turned):
            gravity, turned, stays = tuple(r.indices), more, also
            break
    group: dict[int, tuple[int, ...]] = {}
    for w in turned:
        if not any(k in group for k in w) and not stays.issuperset(w):
            group |= dict.fromkeys(w, w)
    return _Rows({**{k: (k,) for k in stays}, **group}, gravity)


class _Place(NamedTuple):
    """The body in whose axes an equation is read, whether all its vectors belong to bodies, and those for which it may
    be solved."""

    body: Matrix
    framed: bool
    own: list[Timed]


class _Reading:
    """Reads equations in the axes of bodies; `axes`: the vectors that are written in those of a body."""

    def __init__(
        self, flat: FlatModel, bodies: BodyTree, axes: dict[Timed, Matrix], gravity: tuple[int, ...], sampler: Sampler,
        samples: np.ndarray,
    ) -> None:  # fmt: skip
        self._flat, self._bodies, self._axes, self._gravity = flat, bodies, axes, list(gravity)
        self._sampler = sampler
        self._turning = {m for m, w in bodies.rates.items() if self._turns(m, w, samples)}

    def _turns(self, matrix: Matrix, w: Triple, samples: np.ndarray) -> bool:
        """Return whether w is the angular velocity of a matrix at the consistent points."""
        position = self._sampler.position
        pairs = [*[(i, order) for order in (1, 0) for i in matrix], *[(i, 0) for i in w]]
        if any(p not in position for p in pairs):
            return False
        rate, R, turn = np.split(samples[:, [position[p] for p in pairs]], [9, 18], axis=1)
        expected = np.cross(turn[:, :, None], R.reshape(-1, 3, 3), axis=1).reshape(rate.shape)
        largest = np.abs(rate).max()
        return bool(largest > TURNING and np.all(np.abs(rate - expected) <= SAME_RATE * largest))

    def _falls(self, vector: Timed) -> bool:
        """Return whether a vector is the acceleration of a point."""
        triple, order = vector
        through, unit = self._bodies.vectors[triple].through, self._flat.variables[triple[0]].unit
        return bool(self._gravity) and order == 2 and not through and unit == "m"

    def _g(self) -> ca.SX:
        return ca.vertcat(*[self._flat.p[k] for k in self._gravity])

    def unchanged_in_fall(
        self, derivatives: list[list[ca.SX]], groups: Sequence[tuple[Node, ...]], inside: Mapping[Node, Sequence[Pair]]
    ) -> set[tuple[Node, ...]]:
        """Return the groups of nodes that do not change if all accelerations and gravity change by the same vector."""
        vector_of = self._bodies.vector_of
        place = {(i, 2): vector_of[i].index(i) for i in vector_of if self._falls((vector_of[i], 2))}
        groups = [g for g in groups if any(p in place for node in g for p in inside[node])]
        if not groups:
            return set()
        pairs = sorted({p for g in groups for node in g for p in inside[node]})
        symbols = ca.vertcat(*[self._flat.scope.symbol(*p) for p in pairs])
        column = ca.vertcat(*[derivatives[i][m] for g in groups for i, m in g])
        f = ca.Function("f", [symbols, self._flat.p, self._flat.scope.time], [ca.densify(column)])
        rng = np.random.default_rng(1)
        x, p, c = rng.normal(size=len(pairs)), rng.uniform(0.5, 1.5, self._flat.p.numel()), rng.normal(size=3)
        before = np.array(f(x, p, 0.3)).ravel()
        x += [c[place[pair]] if pair in place else 0.0 for pair in pairs]
        p[self._gravity] += c
        good = iter(np.abs(np.array(f(x, p, 0.3)).ravel() - before) <= SAME * np.maximum(1.0, np.abs(before)))
        return {g for g in groups if all([next(good) for _ in g])}

    def vectors_in(self, pairs: Sequence[Pair]) -> list[Timed]:
        return sorted({(self._bodies.vector_of[i], order) for i, order in pairs if i in self._bodies.vector_of})

    def place_of(self, pairs: Sequence[Pair]) -> _Place | None:
        """Return the place of an equation with these symbols: with forces, the body nearest to the root, else the
        farthest one. None if no symbol has another meaning."""
        vectors = self.vectors_in(pairs)
        turned = [v for v in vectors if v in self._axes]
        if not turned:
            return None
        forces = [v for v in turned if self._bodies.vectors[v[0]].through]
        choose = min if forces else max
        body = choose([self._axes[v] for v in forces or turned], key=self._bodies.rank)
        free = [v for v in vectors if v not in self._axes and not self._bodies.vectors[v[0]].matrices]
        return _Place(body, not free, [v for v in forces or turned if self._axes[v] == body])

    def turned(self, column: ca.SX, pairs: Sequence[Pair], body: Matrix, in_fall: bool) -> ca.SX:
        """Return a residual in the axes of a body, and in a falling frame if it does not change there."""
        bodies, symbol = self._bodies, self._flat.scope.symbol
        old: list[ca.SX] = []
        new: list[ca.SX] = []
        world = bodies.symbols(body).T
        for vector in self.vectors_in(pairs):
            value = self._vector(vector, body)
            if self._falls(vector) and (vector in self._axes) != in_fall:
                value = value + (-1 if in_fall else 1) * (world @ self._g())
            old += [symbol(i, vector[1]) for i in vector[0]]
            new += ca.vertsplit(ca.densify(value))
        for matrix, order in sorted({(bodies.matrix_of[i], o) for i, o in pairs if i in bodies.matrix_of}):
            symbols = ca.vertcat(*[symbol(i, order) for i in matrix])
            along = _along(column, symbols)
            if along is not None:  # R^(m) d: R d in the axes of the body first
                column = ca.substitute([column], [symbols], [ca.SX.zeros(9, 1)])[0]
                column = column + self._rotated(matrix, order, body, along)
            else:
                old += ca.vertsplit(symbols)
                new += ca.vertsplit(ca.densify(ca.vec(self._rotated(matrix, order, body, ca.SX.eye(3)).T)))
        if self._gravity:
            old += ca.vertsplit(self._g())
            new += ca.vertsplit(ca.SX.zeros(3) if in_fall else world @ self._g())
        return ca.substitute([column], [stacked(old)], [stacked(new)])[0]

    def _vector(self, vector: Timed, body: Matrix) -> ca.SX:
        """Return a vector in the axes of a body."""
        triple, order = vector
        v = ca.vertcat(*[self._flat.scope.symbol(i, order) for i in triple])
        axes = self._axes.get(vector)
        return self._bodies.symbols(body).T @ v if axes is None else self._bodies.between(body, axes) @ v

    def _rotated(self, matrix: Matrix, order: int, body: Matrix, d: ca.SX) -> ca.SX:
        """Return R^(order) d in the axes of a body."""
        of, C = self._bodies.of(matrix)
        if order and (matrix not in self._turning or order > 2):
            return self._bodies.symbols(body).T @ (self._bodies.symbols(matrix, order) @ d)
        arm = self._bodies.direction(body, of, C @ d)
        if not order:
            return arm
        w = self._bodies.rates[matrix]
        turn = ca.skew(self._vector((w, 0), body))
        return turn @ arm if order == 1 else (ca.skew(self._vector((w, 1), body)) + turn @ turn) @ arm

    def in_world(self, residuals: list[ca.SX], pairs: Sequence[Pair]) -> list[ca.SX]:
        """Return residuals of these symbols in the axes of the world, for symbols with their other meaning."""
        turned = [self.back(v) for v in self.vectors_in(pairs) if v in self._axes]
        old = [ca.vertcat(*[self._flat.scope.symbol(*p) for p in t.pairs]) for t in turned]
        new = [t.R @ v for t, v in zip(turned, old, strict=True)]
        return ca.substitute(residuals, [ca.vertcat(*old)], [ca.vertcat(*new)]) if turned and residuals else residuals

    def back(self, vector: Timed) -> Turned:
        triple, order = vector
        fall = self._g() if self._falls(vector) else ca.SX.zeros(3)
        return Turned([(i, order) for i in triple], self._bodies.symbols(self._axes[vector]), fall)

    def samples(self, samples: np.ndarray) -> np.ndarray:
        """Return consistent points with the other meaning of symbols."""
        result, position = samples.copy(), self._sampler.position
        for (triple, order), matrix in self._axes.items():
            columns = [position[i, order] for i in triple]
            fall = self._flat.p0[self._gravity] if self._falls((triple, order)) else 0.0
            R = samples[:, [position[i, 0] for i in matrix]].reshape(-1, 3, 3)
            result[:, columns] = np.einsum("nij,ni->nj", R, samples[:, columns] - fall)
        return result


def _along(column: ca.SX, matrix: ca.SX) -> ca.SX | None:
    """Return d if a column is R d + ... with the entries of R row by row, and d does not contain them."""
    if column.numel() != 3:
        return None
    slopes = ca.densify(ca.jacobian(column, matrix))
    d = slopes[0, :3].T
    same = ca.is_equal(slopes, ca.densify(ca.kron(ca.SX.eye(3), d.T)), 20)
    return d if same and not ca.depends_on(d, matrix) else None
