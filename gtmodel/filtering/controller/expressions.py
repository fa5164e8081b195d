"""Expressions of a filter's kernels, with less to compute where errors of unit quaternions allow it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...cgen.text import GenerationError
from ..system import System
from .sparse import EntryMatrix

SAME = 1e-12  # of the largest: entries that differ by less at random points are equal
POINTS = 20


@dataclass(frozen=True, eq=False)
class KernelExpressions:
    """Expressions of symbols."""

    symbols: list[Any]
    results: list[Any]

    def __getitem__(self, k: int) -> Any:
        return self.results[k]


class ExpressionMaker:
    """Makes expressions of scalars from those of the system, which may hold functions."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.inputs = sum(system.dynamics.inputs.values())
        rng = np.random.default_rng(0)
        points = rng.normal(size=(POINTS, system.space.size))
        for part, at, _ in system.space.places():
            if part.kind != "vector":
                points[:, at] /= np.linalg.norm(points[:, at], axis=1)[:, None]
        self.points, self.rng = points, rng

    def kernel(
        self, name: str, sizes: Mapping[str, int], results: Callable[..., Any], upright: Sequence[int] = ()
    ) -> KernelExpressions:
        """Results of columns of these sizes; of those in `upright` entries that are the same in every attitude are
        taken where nothing is turned, which leaves less to compute."""
        own = [self.system.dynamics.symbol(key, size) for key, size in sizes.items()]
        try:
            function = ca.Function(name, own, list(results(*own))).expand()
        except RuntimeError as error:
            raise GenerationError(
                f"the model solves equations by iteration in '{name}', which C of a filter does not know"
            ) from error
        symbols = [ca.SX.sym(key, size) for key, size in sizes.items()]
        made: list[Any] = [ca.sparsify(r) for r in function.call(symbols)]
        for k in upright:
            made[k] = self._upright(made[k], symbols, [*sizes].index("x"))
        return KernelExpressions(symbols, made)

    def _upright(self, matrix: Any, symbols: list[Any], at_x: int) -> Any:
        x = symbols[at_x]
        still = ca.SX(x)
        for part, at, _ in self.system.space.places():
            if part.kind == "quaternion":
                still[at] = ca.SX([1.0, 0.0, 0.0, 0.0])
        other = ca.substitute(matrix, x, still)
        both = ca.Function("both", symbols, [ca.vec(ca.densify(matrix)), ca.vec(ca.densify(other))])
        rows = []
        for point in self.points:
            given = [point if k == at_x else self.rng.normal(size=s.numel()) for k, s in enumerate(symbols)]
            rows.append([np.asarray(r).ravel() for r in both.call([ca.DM(g) for g in given])])
        first, second = (np.array([row[k] for row in rows]) for k in (0, 1))
        scale = np.max(np.abs(first), initial=0.0) or 1.0
        same = np.max(np.abs(first - second), axis=0) <= SAME * scale
        steady = np.ptp(second, axis=0) <= SAME * scale
        entries = []
        flat, simple = ca.vec(ca.densify(matrix)), ca.vec(ca.densify(other))
        for k in range(flat.numel()):
            if not same[k]:
                entries.append(flat[k])
            elif steady[k]:
                value = float(second[0, k])
                entries.append(ca.SX(0.0 if abs(value) <= SAME * scale else value))
            else:
                entries.append(ca.simplify(simple[k]))
        return ca.sparsify(ca.reshape(ca.vertcat(*entries), *matrix.shape))

    def shared(self, made: KernelExpressions, H: EntryMatrix) -> EntryMatrix:
        """H, of (t, x, u, z). Entries that are, but for the sign, a part of the residual wherever quaternions are of
        unit length are taken from there: how what is measured follows a turn is often a cross product with what is
        computed anyway."""
        parts = _parts(made[0])
        both = ca.Function("both", made.symbols, [ca.vertcat(*parts), H.expressions])
        rows = []
        for point in self.points:
            given = [ca.DM(point if k == 1 else self.rng.normal(size=s.numel())) for k, s in enumerate(made.symbols)]
            rows.append([np.asarray(r).ravel() for r in both.call(given)])
        first, second = (np.array([row[k] for row in rows]) for k in (0, 1))
        entries = []
        for entry, own in zip(H.expressions.nonzeros(), second.T, strict=True):
            near = SAME * (np.max(np.abs(own)) or 1.0)
            signs = [(sign, np.max(np.abs(first - sign * own[:, None]), axis=0) <= near) for sign in (1, -1)]
            same_as = [(int(np.argmax(at)), sign) for sign, at in signs if np.any(at)]
            changes = not entry.is_constant() and len(same_as) > 0
            entries.append(same_as[0][1] * parts[same_as[0][0]] if changes else entry)
        return replace(H, expressions=ca.vertcat(*entries)) if entries else H


def _parts(column: Any) -> list[Any]:
    """What the entries of a column are computed of, each once, without constants."""
    seen, left, made = set[int](), list(column.nonzeros()), []
    while left:
        node = left.pop()
        if node.is_constant() or node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        made.append(node)
        left += [node.dep(k) for k in range(node.n_dep())]
    return made
