"""Solution of a linear block by sparse elimination; what has no allowed pivot, the core, by LDL^T, determinants or QR.

Allowed pivots are constants and parameters declared nonzero, never state-dependent expressions, with one exception. A
core that is symmetric and positive definite at the consistent points, as a mass matrix or the matrix of constraint
forces, stays positive definite until it is singular. None of its diagonal pivots can vanish before, in any order. So it
needs no QR; and its pivots may be taken among the others where they cause least fill-in. Along a tree of bodies this
is the recursion of articulated bodies, with operations linear in their number.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..blocks import DenseCore, Margin, SignAnalysis
from ..graph import strong_components
from ..matrices import difference, nonzeros, product, quotient, stacked, triplets
from ..rewriting import of_expression
from .sparse import SMALL_CORE, Constants, Elimination, Entry, Mixed, SolvedRow, Values, entry_of

# largest number of unknowns of a full symmetric core that is tried where its pivots can be taken among the others
LARGE_CORE = 30
# number of random points, and the largest value of their symbols, which is no angle near a quarter turn
GENERAL_POINTS, GENERAL = 4, 2.0
# operations whose values at some points tell whether two expressions are equal
ANALYTIC = frozenset(
    getattr(ca, f"OP_{name}")
    for name in ("INPUT", "OUTPUT", "CONST", "ASSIGN", "ADD", "SUB", "MUL", "DIV", "NEG", "TWICE", "SQ", "INV", "SQRT",
                 "SIN", "COS")
)  # fmt: skip

Assignments = list[tuple[ca.SX, ca.SX]]
Solution = tuple[Assignments, list[Margin], str, DenseCore | None]


def solve_linear(
    residuals: list[ca.SX],
    unknowns: list[ca.SX],
    jacobian: ca.SX,
    signs: SignAnalysis,
    label: str,
    held: Collection[int] = (),
    own: Mapping[int, tuple[int, int]] | None = None,
    shared: bool = False,
) -> Solution:
    """Solve residuals == 0, linear in the unknowns, with the Jacobian of the residuals.

    held: positions of unknowns that are eliminated last, as the accelerations of states, which make a symmetric core.
    own: for equations of bodies in their axes, by row: see `Constants`; then the right-hand side of a core is found by
    solving the others with zeros in place of its unknowns. shared: the Jacobian depends only on symbols that are
    known or states, so that equal entries can be found.
    Returns assignments in order of computation, pivot margins of the core, a description, and the core if it has four
    or more unknowns and is solved apart from the rest.
    """
    at_zero = ca.substitute(stacked(residuals), stacked(unknowns), ca.SX.zeros(len(unknowns), 1))
    rhs = [-at_zero[i] for i in range(len(residuals))]
    filled = [(i, j, value) for i, j, value in triplets(jacobian) if not value.is_zero()]
    matrix = [value for *_, value in filled]
    points = signs.values(matrix)
    values = Values(signs.count) if shared and _is_analytic(jacobian) else None
    if values is not None:
        points = np.vstack([points, _at_general_points(matrix)])
    entries: list[tuple[int, int, Entry]] = []
    for (i, j, value), point in zip(filled, points.T.tolist(), strict=True):
        entry = entry_of(value if values is None else values.shared(value, point, point), point, signs)
        entries += [] if entry.value.is_zero() else [(i, j, entry)]
    # for a few unknowns of a core their columns cost less than inertias of composite bodies
    ranks = {i: r for i, r in (own or {}).items() if len(held) > SMALL_CORE or r[0] < 0}
    chosen = Elimination(entries, rhs, signs, Constants(held, ranks), values)
    pairs = chosen.definite_pairs()
    core = {*held, *[j for j, inside in chosen.columns.items() if inside]}
    start = None if own is None else _start(chosen, entries, rhs, core)
    if start is not None:
        rhs = start.rest
        chosen.with_right(rhs)
    if pairs is None:
        return _solution(chosen, None, unknowns, label, start)
    mixed = Elimination(entries, rhs, signs, Mixed(chosen, pairs), values)
    kinds = [mixed] if not mixed.rows else []
    if not kinds or len(pairs) <= LARGE_CORE or 2 * sum(map(len, chosen.rows.values())) < len(pairs) ** 2:
        kinds.append(chosen)
    return min([_solution(k, pairs, unknowns, label, start) for k in kinds], key=_operations)


def _is_analytic(expression: ca.SX) -> bool:
    return all(i.op in ANALYTIC for i in of_expression(stacked(nonzeros(expression)))[0])


def _at_general_points(expressions: list[ca.SX]) -> np.ndarray:
    """Return the values (points, expressions) at random numbers for the symbols."""
    column = stacked(expressions)
    symbols = stacked(ca.symvar(column))
    f = ca.Function("general", [symbols], [ca.densify(column)])
    draws = np.random.default_rng(0).uniform(-GENERAL, GENERAL, (GENERAL_POINTS, symbols.numel()))
    return np.array([np.asarray(f(x)).ravel() for x in draws])


class _Start(NamedTuple):
    """A solution of all equations but those of a core, with zeros in place of the unknowns of the core.

    rest: the right-hand sides that remain for the differences from it; steps: each other unknown from those before it.
    """

    core: set[int]
    rest: list[ca.SX]
    steps: list[SolvedRow]


def _start(
    chosen: Elimination, entries: Sequence[tuple[int, int, Entry]], rhs: list[ca.SX], core: set[int]
) -> _Start | None:
    """Return the start; None if the pivots do not solve the other equations one after the other."""
    row_of = {j: i for j, i in chosen.pivots.items() if j not in core}
    original: list[dict[int, ca.SX]] = [{} for _ in rhs]
    for i, j, entry in entries:
        original[i][j] = entry.value
    order = strong_components(sorted(row_of), lambda j: [k for k in original[row_of[j]] if k != j and k not in core])
    if any(len(c) > 1 or c[0] not in original[row_of[c[0]]] for c in order):
        return None
    values: dict[int, ca.SX] = {}
    steps: list[SolvedRow] = []

    def rest(i: int) -> ca.SX:
        value = rhs[i]
        for k, a in original[i].items():
            if k in values:
                value = difference(value, product(a, values[k]))
        return value

    for (j,) in order:
        i = row_of[j]
        row = dict(original[i])
        pivot = row.pop(j)
        values[j] = quotient(rest(i), pivot)
        steps.append(SolvedRow(j, row, pivot, rhs[i]))
    solved = set(row_of.values())
    return _Start(core, [ca.SX(0) if i in solved else rest(i) for i in range(len(rhs))], steps)


def _operations(solution: Solution) -> int:
    return ca.n_nodes(ca.vertcat(*[value for _, value in solution[0]]))


def _solution(
    of: Elimination, pairs: Mapping[int, int] | None, unknowns: list[ca.SX], label: str, start: _Start | None = None
) -> Solution:
    """Solve what remains, `pairs` if it is definite, and return the assignments of all unknowns."""
    done = [Margin("pivot", pivot, f"{label} ({unknowns[j].name()})") for j, pivot in sorted(of.varying.items())]
    core: DenseCore | None = None
    first: Assignments = []
    detail = f"{len(of.steps)} pivots eliminated"
    if of.rows:
        first, done, core = _core(of, pairs, unknowns, label)
        detail += f", {'dense' if pairs is None else 'symmetric'} core of {len(of.rows)}"
    elif of.varying:
        detail += f", {len(of.varying)} of them state-dependent"
    if start is None:
        return [*first, *_backwards(of.steps, unknowns)], done, detail, core
    shifted = [u if k in start.core else ca.SX.sym(f"{u.name()} from start") for k, u in enumerate(unknowns)]
    first += _backwards(of.steps, shifted)
    return [*first, *_backwards(start.steps[::-1], unknowns)], done, detail, core


def _backwards(steps: Sequence[SolvedRow], unknowns: Sequence[ca.SX]) -> Assignments:
    """Return the unknowns of the steps, from the last one."""
    result: Assignments = []
    for j, row, pivot, value in reversed(steps):
        for k in sorted(row):
            value = difference(value, product(row[k], unknowns[k]))
        result.append((unknowns[j], quotient(value, pivot)))
    return result


def _core(
    of: Elimination, pairs: Mapping[int, int] | None, unknowns: list[ca.SX], label: str
) -> tuple[Assignments, list[Margin], DenseCore | None]:
    """Solve what remains by division, determinants, LDL^T or QR; their pivots show how near it is to singular."""
    rows = sorted(of.rows) if pairs is None else list(pairs)
    columns = sorted(of.columns)
    n = len(rows)
    if n == 1:
        j, (pivot, *_) = next(iter(of.rows[rows[0]].items()))
        return [(unknowns[j], of.rhs[rows[0]] / pivot)], [Margin("pivot", pivot, label)], None
    a, b = ca.SX.zeros(n, n), ca.vertcat(*[of.rhs[i] for i in rows])
    for r, i in enumerate(rows):
        for c, j in enumerate(columns):
            if j in of.rows[i]:
                a[r, c] = of.rows[i][j].value
        if pairs is not None and of.rows[i][pairs[i]].points[0] < 0:
            a[r, :], b[r] = -a[r, :], -b[r]
    x, pivots = (_definite if pairs is not None else _determinants if n <= SMALL_CORE else _gram_schmidt)(a, b)
    named = zip(columns, pivots, strict=True)
    margins = [Margin("pivot", p, f"{label} ({unknowns[j].name()})") for j, p in named]
    core = DenseCore([unknowns[j] for j in columns], a, b, pairs is not None) if n > SMALL_CORE else None
    return [(unknowns[j], x[c]) for c, j in enumerate(columns)], margins, core


def _definite(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve by LDL^T for a symmetric definite matrix, and return D; the next unknown has the fewest others in its row.

    Of two equal entries one is computed: those of the triangle that needs fewer operations.
    """
    n = a.shape[0]
    lower = [(i, j) for i in range(n) for j in range(i)]
    nodes = [ca.n_nodes(ca.vertcat(*[a[p] for p in half])) for half in (lower, [(j, i) for i, j in lower])]
    rest: dict[int, dict[int, ca.SX]] = {i: {i: a[i, i]} for i in range(n)}
    for i, j in lower:
        if not a[i, j].is_zero() and not a[j, i].is_zero():
            rest[i][j] = rest[j][i] = a[i, j] if nodes[0] <= nodes[1] else a[j, i]
    right = ca.vertsplit(b)
    steps: list[tuple[int, dict[int, ca.SX], ca.SX]] = []
    pivots = [ca.SX(0)] * n
    while rest:
        i = min(rest, key=lambda i: (len(rest[i]), i))
        row = rest.pop(i)
        pivots[i] = row.pop(i)
        inverse = quotient(ca.SX(1), pivots[i])
        for p in sorted(row):
            del rest[p][i]
            factor = product(row[p], inverse)
            right[p] = difference(right[p], product(factor, right[i]))
            for q in sorted(k for k in row if k >= p):
                rest[p][q] = rest[q][p] = difference(rest[p].get(q, ca.SX(0)), product(factor, row[q]))
        steps.append((i, row, inverse))
    x = [ca.SX(0)] * n
    for i, row, inverse in reversed(steps):
        value = right[i]
        for k in sorted(row):
            value = difference(value, product(row[k], x[k]))
        x[i] = product(value, inverse)
    return x, pivots


def _determinants(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve for two or three unknowns with determinants, and return the diagonal of R: two thirds of QR's operations.

    Any column may come first in R; with this order gcc uses registers best. Near a loss of rank the error grows with
    the condition number, as for QR; with its square only if three columns are nearly parallel.
    """
    if a.shape[0] == 2:
        first = ca.norm_2(a[:, 0])
        d = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
        x = [b[0] * a[1, 1] - a[0, 1] * b[1], a[0, 0] * b[1] - b[0] * a[1, 0]]
        return [value / d for value in x], [first, d / first]
    last, first, second = ca.horzsplit(a)
    normal, moment = ca.cross(first, second), ca.cross(last, b)
    length, area, d = ca.norm_2(first), ca.norm_2(normal), ca.dot(normal, last)
    x = [ca.dot(normal, b), ca.dot(second, moment), -ca.dot(first, moment)]
    return [value / d for value in x], [d / area, length, area / length]


def _gram_schmidt(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve for any number of unknowns, and return the diagonal of R.

    The right-hand side is reduced like another column. Computing Q^T b instead would include the loss of orthogonality
    of Q, an error of cond^2 instead of cond.
    """
    rest = ca.horzcat(a, b)
    rows: list[ca.SX] = []
    pivots: list[ca.SX] = []
    for _ in range(a.shape[0]):
        pivots.append(ca.norm_2(rest[:, 0]))
        q = rest[:, 0] / pivots[-1]
        rows.append(q.T @ rest[:, 1:])
        rest = rest[:, 1:] - q @ rows[-1]
    x: list[ca.SX] = []
    for pivot, row in zip(reversed(pivots), reversed(rows), strict=True):
        value = row[-1]
        for k, known in enumerate(x):
            value = value - row[k] * known
        x.insert(0, value / pivot)
    return x, pivots
