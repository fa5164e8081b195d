"""Rank-revealing choice of dummy derivatives: the columns that each stage solves for, and hence the states."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..lang.source import ModelError, SourceLocation
from .flat import FlatModel
from .graph import largest_matching, neighbours_of, strong_components
from .structure import EquationStructure, remedy_of

# relative to the largest column: separates round-off of a consistent point (1e-12) from poor geometry (1e-5)
RANK_TOLERANCE = 1e-8
# relative to the largest entry of its row: a smaller entry is round-off of a consistent point (1e-12), or zero
ROUND_OFF = 1e-10


@dataclass(frozen=True)
class Stage:
    """Stage k: rows (equation numbers) with the unknown column each is matched to."""

    k: int
    rows: list[int]
    columns: list[int]
    matched: dict[int, int]


def choose(
    flat: FlatModel,
    structure: EquationStructure,
    jacobians: list[np.ndarray],
    preferred: frozenset[int],
    pattern: set[tuple[int, int]],
) -> list[Stage]:
    """Return the stages from positions (k = -max d) to k = 0 with their chosen columns.

    `jacobians` are d f_i^(c_i) / d x_j^(d_j) at several consistent points; the function selects the best conditioned
    choice.
    `pattern` holds the entries that do not vanish identically. Raises ModelError for a redundant constraint or an
    identically singular system, naming the equations of the left null vector.
    """
    lowest = -int(structure.d.max(initial=0))
    solved: list[int] = []
    stages: list[Stage] = []
    for k in range(lowest, 1):
        rows = [i for i in range(len(structure.c)) if structure.c[i] + k >= 0]
        cols = [j for j in range(len(structure.d)) if structure.d[j] + k >= 0]
        scaled = [_scaled(flat, structure, m, rows, cols) for m in jacobians if rows]
        groups = _groups(flat, structure, k, cols, solved, preferred)
        solved = _best(flat, structure, k, rows, cols, scaled, groups) if rows else []
        matched = match(rows, solved, pattern, structure)
        assert matched is not None, "a nonsingular matrix has a transversal"
        stages.append(Stage(k, rows, cols, matched))
    return stages


def chosen_columns(
    flat: FlatModel, structure: EquationStructure, jacobian: np.ndarray, preferred: frozenset[int]
) -> list[list[int]]:
    """Return the columns that `choose` would select at one point for each of the `stage_choices`; same errors."""
    result: list[list[int]] = []
    solved: list[int] = []
    for k in range(-int(structure.d.max(initial=0)), 1):
        rows = [i for i in range(len(structure.c)) if structure.c[i] + k >= 0]
        cols = [j for j in range(len(structure.d)) if structure.d[j] + k >= 0]
        if not rows:
            solved = []
            continue
        m = _scaled(flat, structure, jacobian, rows, cols)
        if len(cols) == len(rows) and _far_from_singular(m):
            solved = cols
        else:
            groups = _groups(flat, structure, k, cols, solved, preferred)
            solved = _best(flat, structure, k, rows, cols, [m], groups)
        if len(cols) > len(rows):
            result.append(solved)
    return result


def _far_from_singular(m: np.ndarray) -> bool:
    """Return whether elimination solves for all columns in any order."""
    largest = max(1.0, float(np.max(np.linalg.norm(m, axis=0), initial=0.0)))
    return _conditioning(m) > RANK_TOLERANCE * largest


def stage_choices(stages: list[Stage]) -> list[Stage]:
    """Return the stages with a choice: more columns than rows."""
    return [s for s in stages if s.rows and len(s.columns) > len(s.rows)]


def _scaled(
    flat: FlatModel, structure: EquationStructure, jacobian: np.ndarray, rows: list[int], cols: list[int]
) -> np.ndarray:
    nominal = np.array([flat.variables[structure.unknowns[j]].nominal for j in cols])
    m = jacobian[np.ix_(rows, cols)] * nominal
    size = np.max(np.abs(m), axis=1, keepdims=True)
    return m / np.where(size > 0, size, 1.0)


def _groups(
    flat: FlatModel, structure: EquationStructure, k: int, cols: list[int], solved: list[int], preferred: frozenset[int]
) -> list[list[int]]:
    """Return groups of columns in the order in which to solve for them: earlier choices, then low state preference,
    then higher derivatives first."""
    earlier = set(solved)
    first = [j for j in cols if j in earlier]
    rest = [j for j in cols if j not in earlier]

    def preference(j: int) -> tuple[int, int, int]:
        index = structure.unknowns[j]
        return (int(index in preferred), flat.variables[index].prefer, -int(structure.d[j]) - k)

    levels = sorted({preference(j) for j in rest})
    return [first, *[[j for j in rest if preference(j) == level] for level in levels]]


def _best(
    flat: FlatModel,
    structure: EquationStructure,
    k: int,
    rows: list[int],
    cols: list[int],
    scaled: list[np.ndarray],
    groups: list[list[int]],
) -> list[int]:
    best: list[int] = []
    quality = 0.0
    position = {j: n for n, j in enumerate(cols)}
    tested: set[tuple[int, ...]] = set()
    for m in scaled:
        chosen = _greedy(m, [[position[j] for j in g] for g in groups], len(rows))
        if len(chosen) < len(rows) or tuple(sorted(chosen)) in tested:
            continue
        tested.add(tuple(sorted(chosen)))
        worst = min(_conditioning(a[:, chosen]) for a in scaled)
        if worst > quality:
            best, quality = [cols[n] for n in chosen], worst
        if len(cols) == len(rows):
            break  # all columns are needed: other points can only change their order
    if quality > RANK_TOLERANCE:
        return best
    if any(np.linalg.matrix_rank(m, tol=RANK_TOLERANCE) == len(rows) for m in scaled) and best:
        return best
    if len(cols) == len(rows) and all(map(_regular_by_blocks, scaled)):
        return cols
    raise ModelError(*_redundant(flat, structure, k, rows, scaled))


def _regular_by_blocks(m: np.ndarray) -> bool:
    """Return whether the irreducible diagonal blocks of a square matrix are regular, each with rows scaled by itself.

    Entries outside these blocks, however large, do not affect the rank: 1e-9 x + y = 0, y = 1 determines x.
    """
    n = len(m)
    entries = list(zip(*(a.tolist() for a in np.nonzero(np.abs(m) > ROUND_OFF)), strict=True))
    neighbours = neighbours_of(n, entries)
    match = largest_matching(neighbours, n)
    if -1 in match:
        return False
    row_of = {match[i]: i for i in range(n)}
    blocks = strong_components(list(range(n)), lambda i: [row_of[j] for j in neighbours[i] if row_of[j] != i])
    for rows in blocks:
        block = m[np.ix_(rows, [match[i] for i in rows])]
        if _conditioning(block / np.max(np.abs(block), axis=1, keepdims=True)) <= RANK_TOLERANCE:
            return False
    return True


def _conditioning(m: np.ndarray) -> float:
    """Return the smallest singular value; rows are scaled, so that a single small entry counts too."""
    s = np.linalg.svd(m, compute_uv=False)
    return float(s[-1]) if s.size else 1.0


def _greedy(m: np.ndarray, groups: list[list[int]], count: int) -> list[int]:
    """Choose columns by pivoted elimination, group by group; ties go to the first declared column."""
    rest = m.T.copy()  # columns of m, each contiguous
    limit = RANK_TOLERANCE * max(1.0, float(np.max(np.linalg.norm(m, axis=0), initial=0.0)))
    size = np.sqrt(np.einsum("ij,ij->i", rest, rest))
    chosen: list[int] = []
    for group in groups:
        candidates = np.array(group, dtype=int)
        while candidates.size and len(chosen) < count:
            norms = size[candidates]
            top = float(norms.max())
            if top <= limit:
                break
            pick = int(np.argmax(norms >= top * (1 - 1e-9)))
            j = int(candidates[pick])
            candidates = candidates[candidates != j]
            q = rest[j] / norms[pick]
            shares = rest @ q
            touched = np.flatnonzero(shares)
            touched = touched[touched != j]
            rest[touched] -= shares[touched, None] * q
            size[touched] = np.sqrt(np.einsum("ij,ij->i", rest[touched], rest[touched]))
            chosen.append(j)
    return chosen


def _redundant(
    flat: FlatModel, structure: EquationStructure, k: int, rows: list[int], scaled: list[np.ndarray]
) -> tuple[str, SourceLocation | None]:
    """Return the message that names the equations of the left null vector, and the location of the first one."""
    ranks = [int(np.linalg.matrix_rank(a, tol=RANK_TOLERANCE)) for a in scaled]
    # if it is singular only at some points, as max(u, 0) for u < 0, use such a point
    select = max if max(ranks) < len(rows) else min
    m = scaled[ranks.index(select(ranks))]
    u, s, vt = np.linalg.svd(m)
    rank = int(np.sum(s > RANK_TOLERANCE * max(s[0], 1e-300)))
    null = u[:, rank:]
    weight = np.max(np.abs(null), axis=1)
    involved = [rows[i] for i in np.flatnonzero(weight > 1e-6)]
    labels = "; ".join(f"{structure.equations[i].label} ({structure.equations[i].where})" for i in involved[:8]) + (
        f"; and {len(involved) - 8} more" if len(involved) > 8 else ""
    )
    fault = "are redundant or contradict each other" if k < 0 else "leave some unknowns undetermined (singular)"
    flows = k == 0 and all(structure.equations[i].label.startswith("flow ") for i in involved)
    columns = [j for j in range(len(structure.d)) if structure.d[j] + k >= 0]
    free = [columns[n] for n in np.flatnonzero(np.max(np.abs(vt[rank:]), axis=0, initial=0.0) > 1e-6)]
    zeros = _dropped(flat, structure, involved, free)
    advice = zeros or "remove one, or make a part compliant"
    if k < 0:
        advice = remedy_of(flat, [structure.equations[i] for i in involved]) or advice
    if flows:
        advice = "connect a reference, such as a ground, to these ports"
    level = {0: "highest derivatives", -1: "velocities", -2: "positions"}.get(k, f"stage {k}")
    summary = f"{flat.title}: {len(rows)} equations have rank {rank} in stage {k} ({level})"
    sentence = f"{summary}; these {fault}: {labels}; {advice}"
    return sentence, structure.equations[involved[0]].where if involved else None


def _dropped(flat: FlatModel, structure: EquationStructure, rows: list[int], columns: list[int]) -> str:
    """Return a sentence if a derivative of these columns drops out of these equations because a parameter is 0."""
    unknowns = {structure.unknowns[j]: int(structure.d[j]) for j in columns}
    for i in rows:
        residual = structure.equations[i].residual
        for index, order in flat.scope.symbols_in(residual):
            if order == 0 or unknowns.get(index) != order:
                continue
            share = ca.jacobian(residual, flat.scope.symbol(index, order))
            for parameter in flat.parameters:
                at_zero = ca.substitute(share, parameter.symbol, 0) if parameter.value == 0 else share
                if ca.depends_on(share, parameter.symbol) and ca.simplify(at_zero).is_zero():
                    name = f"der({flat.variables[index].name}{f',{order}' if order > 1 else ''})"
                    return f"{name} drops out because {parameter.name} is 0; set {parameter.name} to another value"
    return ""


def match(
    rows: list[int], chosen: list[int], pattern: set[tuple[int, int]], structure: EquationStructure
) -> dict[int, int] | None:
    """Match rows to as many columns, None if it is not possible; an equation must contain the column at its leading
    order."""
    if not rows:
        return {}
    entries = [
        (a, b)
        for a, i in enumerate(rows)
        for b, j in enumerate(chosen)
        if (i, j) in pattern and structure.d[j] - structure.c[i] == structure.sigma[(i, j)]
    ]
    column = largest_matching(neighbours_of(len(rows), entries), len(chosen))
    return None if min(column, default=0) < 0 else {i: chosen[column[a]] for a, i in enumerate(rows)}
