"""Derivatives of rotation matrices by the angular velocity of their frame: der(R) = w x R.

An equation that is solved for an entry of R, such as R_b = R_a A(q), has long derivatives: all entries of R_a and A
follow, with theirs. The frame's angular velocity is known as well, and gives the same numbers by a cross product.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ..alias import AliasResult
from ..consistency.points import Sampler
from ..flat import FlatModel
from ..graph import largest_matching, neighbours_of
from ..matrices import triplets
from ..states import Stage, match
from ..structure import EquationStructure

# largest difference of der(R) and w x R at a consistent point, relative to the largest rate
SAME = 1e-8
# largest angular velocity [rad/s] at the consistent points below which they cannot be compared
TURNING = 1e-3

Pair = tuple[int, int]


def by_angular_rates(
    flat: FlatModel,
    alias: AliasResult,
    structure: EquationStructure,
    stages: list[Stage],
    system: ca.SX,
    sampler: Sampler,
    samples: np.ndarray,
) -> tuple[list[Stage], dict[Pair, ca.SX]]:
    """Return the stages with other matchings, and the residuals that replace derivatives (equation, order).

    Only where the angular velocity belongs to the unknowns anyway, and if it turns the matrix at the consistent points.
    """
    rates = _rates(flat, alias, structure, sampler, samples)
    column = {index: j for j, index in enumerate(structure.unknowns) if index in rates}
    if not column:
        return stages, {}
    solved = _solved_for(flat, structure, column)
    pattern = set(zip(*system.sparsity().get_triplet(), strict=True))
    replaced: dict[Pair, ca.SX] = {}
    result: list[Stage] = []
    for stage in stages:
        chosen = set(stage.matched.values())
        mine: dict[int, int] = {}
        for i in stage.rows:
            m, j = int(structure.c[i]) + stage.k, solved.get(i, -1)
            if m < 1 or j not in chosen or structure.d[j] != structure.c[i]:
                continue
            index = structure.unknowns[j]
            value = rates[index]
            for _ in range(m - 1):
                value = flat.scope.derivative(value)
            if all(pair in sampler.position for pair in flat.scope.symbols_in(value)):
                mine[i], replaced[i, m] = j, flat.scope.symbol(index, m) - value
        rest = [i for i in stage.rows if i not in mine]
        others = match(rest, sorted(chosen - set(mine.values())), pattern, structure)
        if others is None:
            return stages, {}
        result.append(replace(stage, matched={**mine, **others}))
    return result, replaced


def _solved_for(flat: FlatModel, structure: EquationStructure, column: dict[int, int]) -> dict[int, int]:
    """Return for each equation among rotations and angles the column of an entry with the factor 1 or -1."""
    entries: list[tuple[int, int]] = []
    within = flat.scope.symbols_in_each([e.residual for e in structure.equations])
    for i, (e, pairs) in enumerate(zip(structure.equations, within, strict=True)):
        mine = [index for index, order in pairs if index in column and not order]
        if not mine or any(flat.variables[index].unit not in ("1", "rad") for index, _ in pairs):
            continue
        slopes = ca.jacobian(e.residual, ca.vertcat(*[flat.scope.symbol(index, 0) for index in mine]))
        entries += [(i, column[mine[n]]) for _, n, s in triplets(slopes) if s.is_constant() and abs(float(s)) == 1.0]
    pairs = largest_matching(neighbours_of(len(structure.equations), entries), len(structure.unknowns))
    return {i: j for i, j in enumerate(pairs) if j >= 0}


def _rates(
    flat: FlatModel, alias: AliasResult, structure: EquationStructure, sampler: Sampler, samples: np.ndarray
) -> dict[int, ca.SX]:
    """Return (w x R)[r, k] by the index of the variable R[r, k]."""
    used = flat.scope.symbols_in_each([e.residual for e in structure.equations])
    given = {index for pairs in used for index, order in pairs if order}  # the model itself uses these rates

    def symbol(index: int) -> ca.SX:
        sign, kept, order = alias.resolve(index, 0)
        s = flat.scope.symbol(kept, order)
        return s if sign > 0 else -s

    rates: dict[int, ca.SX] = {}
    for name in sorted(flat.rotations):
        R, (shape, w) = flat.groups[name][1], flat.groups.get(f"{name[:-1]}w", ((), []))
        kept = [n for n, index in enumerate(R) if index not in alias.removed]
        if not name.endswith("R") or shape != (3,) or flat.variables[w[0]].unit != "rad/s" or given.intersection(R):
            continue
        for n in kept:
            r, k = divmod(n, 3)
            y, z = (r + 1) % 3, (r + 2) % 3
            rates[R[n]] = symbol(w[y]) * symbol(R[3 * z + k]) - symbol(w[z]) * symbol(R[3 * y + k])
    used = flat.scope.symbols_in_each(list(rates.values()))
    inside = [
        all(p in sampler.position for p in [(index, 1), *pairs]) for index, pairs in zip(rates, used, strict=True)
    ]
    places = [index for index, good in zip(rates, inside, strict=True) if good]
    if not places:
        return {}
    f = ca.Function("rates", [sampler.w], [ca.vertcat(*[rates[index] for index in places])])
    computed = np.array([np.asarray(f(w)).reshape(-1) for w in samples])
    exact = samples[:, [sampler.position[index, 1] for index in places]]
    largest = np.max(np.abs(exact))
    turned = (largest > TURNING) & np.all(np.abs(computed - exact) <= SAME * largest, axis=0)
    return {index: rates[index] for index, good in zip(places, turned, strict=True) if good}
