"""Rigid bodies of a flat model: the rotation matrices of its connectors, the joints between them, and their vectors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import cast

import casadi as ca
import numpy as np

from ..alias import AliasResult
from ..flat import FlatModel

Triple = tuple[int, int, int]  # kept indices of the entries of a vector
Matrix = tuple[int, ...]  # kept indices of the entries of a rotation matrix, row by row

# largest difference between an equation and the one it is compared with, relative to its size
SAME = 1e-9
# number of bodies on the longest way of joints along which rotations are multiplied: two joints without a body between
NEAR = 3


def unique(tuples: Iterable[tuple[int, ...]]) -> dict[int, tuple[int, ...]]:
    """Return the tuple of each entry, without tuples that share an entry with another one."""
    owner: dict[int, tuple[int, ...]] = {}
    shared: set[tuple[int, ...]] = set()
    for each in dict.fromkeys(tuples):
        for i in each:
            if owner.setdefault(i, each) != each:
                shared |= {each, owner[i]}
    return {i: each for i, each in owner.items() if each not in shared}


@dataclass
class Vector:
    """A vector of connectors: the rotation matrices of those that have one, and whether it is a force or a torque."""

    through: bool
    matrices: set[Matrix] = field(default_factory=set)


class BodyTree:
    """Rotation matrices and vectors of connectors by kept indices; matrices that joints connect belong to bodies.

    A body is a set of matrices with constant rotations between them, represented by the one that most equations use.
    """

    def __init__(self, flat: FlatModel, alias: AliasResult) -> None:
        self.flat, self._alias = flat, alias
        resolved = {name: [alias.resolve(i, 0) for i in flat.groups[name][1]] for name in sorted(flat.rotations)}
        named = {
            name: tuple(kept for _, kept, _ in entries)
            for name, entries in resolved.items()
            if all(sign > 0 and not order for sign, _, order in entries)
        }
        self.matrix_of: dict[int, Matrix] = unique(named.values())
        self.named = {name: matrix for name, matrix in named.items() if matrix[0] in self.matrix_of}
        self.rates: dict[Matrix, Triple] = {}
        self.vectors = self._vectors()
        self.vector_of = cast("dict[int, Triple]", unique(self.vectors))
        parents = self._parents()
        self._body: dict[Matrix, tuple[Matrix, ca.SX]] = {}
        self._before: dict[Matrix, tuple[Matrix, ca.SX]] = {}
        self._join(parents)
        self._relative: dict[tuple[Matrix, Matrix], ca.SX] = {}

    def __bool__(self) -> bool:
        """Whether a joint moves any body."""
        return bool(self._before)

    def _vectors(self) -> dict[Triple, Vector]:
        vectors: dict[Triple, Vector] = {}
        for name, (shape, indices) in sorted(self.flat.groups.items()):
            variable = self.flat.variables[indices[0]] if shape == (3,) else None
            if variable is None or variable.role not in ("potential", "flow"):
                continue
            entries = [self._alias.resolve(i, 0) for i in indices]
            (sign, _, order), *_ = entries
            if order or any((s, o) != (sign, order) for s, _, o in entries):
                continue
            triple = cast("Triple", tuple(kept for _, kept, _ in entries))
            vector = vectors.setdefault(triple, Vector(variable.role == "flow"))
            connector, dot, last = name.rpartition(".")
            matrix = self.named.get(f"{connector}{dot}R")
            if matrix is not None:
                vector.matrices.add(matrix)
                if last == "w" and variable.unit == "rad/s" and sign > 0:
                    self.rates[matrix] = triple
        alone = unique(vectors)
        return {t: v for t, v in vectors.items() if t[0] in alone}

    def _parents(self) -> dict[Matrix, tuple[Matrix, ca.SX, bool]]:
        """Return for each matrix R = R_before A the one before, A, and whether A is constant, from nine equations."""
        flat, scope = self.flat, self.flat.scope
        raw = {i: name for name in self.named for i in flat.groups[name][1]}
        lines: dict[tuple[str, str], list[int]] = {}
        for k, e in enumerate(flat.equations):
            lines.setdefault((e.component, str(e.where)), []).append(k)
        parents: dict[Matrix, tuple[Matrix, ca.SX, bool]] = {}
        rng = np.random.default_rng(0)
        for numbers in lines.values():
            if len(numbers) != 9:
                continue
            column = ca.vertcat(*[flat.equations[k].residual for k in numbers])
            pairs = scope.symbols_in(column)
            names = sorted({raw[i] for i, _ in pairs if i in raw})
            if len(names) != 2 or any(order for _, order in pairs):
                continue
            rest = [scope.symbol(i, 0) for i, _ in pairs if i not in raw]
            of_names = [ca.vertcat(*[scope.symbol(i, 0) for i in flat.groups[n][1]]) for n in names]
            factor = _factor(column, of_names, [ca.vertcat(ca.SX(0, 1), *rest), flat.p, scope.time], rng)
            if factor is None:
                continue
            child, A = factor
            matrix, before = self.named[names[child]], self.named[names[1 - child]]
            if matrix != before and matrix not in parents:
                parents[matrix] = before, self._alias.rewrite(flat, A), not rest
        return parents

    def _join(self, parents: dict[Matrix, tuple[Matrix, ca.SX, bool]]) -> None:
        uses = dict.fromkeys(self.named.values(), 0)
        for pairs in self.flat.scope.symbols_in_each([e.residual for e in self.flat.equations]):
            for matrix in {self.matrix_of.get(self._alias.resolve(i, 0)[1]) for i, _ in pairs} - {None}:
                uses[cast("Matrix", matrix)] += 1
        together: dict[Matrix, dict[Matrix, ca.SX]] = {}  # R = R_first C, by the first matrix of each body
        for matrix in uses:
            first, C, seen = matrix, ca.SX.eye(3), {matrix}
            while first in parents and parents[first][2] and parents[first][0] not in seen:
                first, A, _ = parents[first]
                C = A @ C
                seen.add(first)
            together.setdefault(first, {})[matrix] = C
        of_first = {first: max(inside, key=lambda m: (uses[m], m)) for first, inside in together.items()}
        for first, inside in together.items():
            body = of_first[first]
            for matrix, C in inside.items():
                self._body[matrix] = body, ca.SX.eye(3) if matrix == body else inside[body].T @ C
        for first, body in of_first.items():
            if first in parents:
                parent, A, _ = parents[first]
                before, C = self._body[parent]
                if before != body:
                    self._before[body] = before, C @ A @ together[first][body]

    def symbols(self, matrix: Matrix, order: int = 0) -> ca.SX:
        """Return a rotation matrix, or its derivative, as symbols."""
        return ca.reshape(ca.vertcat(*[self.flat.scope.symbol(i, order) for i in matrix]), 3, 3).T

    def of(self, matrix: Matrix) -> tuple[Matrix, ca.SX]:
        """Return the body of a matrix and C in R = R_body C."""
        return self._body[matrix]

    def axes_of(self, triple: Triple) -> Matrix | None:
        """Return the body in whose axes a vector is written, None if it has none: of the bodies that it belongs to, a
        force is written in the axes of the last one, a velocity in those of the first."""
        vector = self.vectors[triple]
        bodies = sorted({self._body[m][0] for m in vector.matrices}, key=self.rank)
        return bodies[-1 if vector.through else 0] if bodies else None

    def rank(self, body: Matrix) -> tuple[int, Matrix]:
        """Return the number of joints from the root to a body, and what orders bodies with equal numbers."""
        return len(self._way(body)) - 1, body

    def _way(self, body: Matrix) -> list[Matrix]:
        way = [body]
        while body in self._before and self._before[body][0] not in way:
            body = self._before[body][0]
            way.append(body)
        return way

    def between(self, body: Matrix, other: Matrix) -> ca.SX:
        """Return the rotation of another body in the axes of a body."""
        if body == other:
            return ca.SX.eye(3)
        if (body, other) not in self._relative:
            inwards, outwards = self._way(body)[1:NEAR], self._way(other)[1:NEAR]
            if other in inwards:
                before, M = self._before[body]
                value = M.T @ self.between(before, other)
            elif body in outwards:
                before, M = self._before[other]
                value = self.between(body, before) @ M
            else:
                value = self.symbols(body).T @ self.symbols(other)
            self._relative[body, other] = value
        return self._relative[body, other]

    def direction(self, body: Matrix, other: Matrix, d: ca.SX) -> ca.SX:
        """Return d, in the axes of another body, in those of a body; along the axis of the joint between them it is the
        same at all angles."""
        T = self.between(body, other)
        parameters = {s.element_hash() for s in ca.vertsplit(self.flat.p)}
        angles = [s for s in ca.symvar(T) if s.element_hash() not in parameters]
        if d.shape != (3, 1) or len(angles) != 1:
            return T @ d
        symbols = ca.vertcat(*ca.symvar(ca.vertcat(ca.vec(T), d)))
        slope = ca.jacobian(T, angles[0])
        f = ca.Function("f", [symbols], [ca.densify(ca.reshape(slope, 3, 3) @ d), ca.densify(d)])
        moved, size = (np.array(v) for v in f(np.random.default_rng(2).uniform(0.5, 1.5, symbols.numel())))
        fixed = np.all(np.abs(moved) <= SAME * np.abs(size).max())
        return (ca.substitute([T], [angles[0]], [ca.SX(0)])[0] if fixed else T) @ d


def _factor(
    column: ca.SX, matrices: Sequence[ca.SX], others: Sequence[ca.SX], rng: np.random.Generator
) -> tuple[int, ca.SX] | None:
    """Return the place of the matrix R = R_before A, the other one of two, and A; None for other equations."""
    numbers = [rng.normal(size=9), rng.normal(size=9), *[rng.uniform(0.5, 1.5, o.numel()) for o in others]]
    one = ca.SX(ca.DM(np.eye(3).ravel()))
    for child in (0, 1):
        R, before = matrices[child], matrices[1 - child]
        at = ca.reshape(ca.substitute([column], [R, before], [ca.SX.zeros(9, 1), one])[0], 3, 3).T
        f = ca.Function("f", [*matrices, *others], [ca.densify(column), ca.densify(at)])
        value, a = (np.array(v) for v in f(*numbers))
        for sign in (1.0, -1.0):
            expected = sign * numbers[child].reshape(3, 3) + numbers[1 - child].reshape(3, 3) @ a
            if np.all(np.abs(value.reshape(3, 3) - expected) <= SAME * np.abs(expected).max()):
                return child, -sign * at
    return None
