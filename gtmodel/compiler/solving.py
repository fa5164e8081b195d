"""Solution of one block of equations: linear by sparse elimination, in closed form, or with Newton's method."""

from __future__ import annotations

import casadi as ca
import numpy as np

from .blocks import DenseCore, Margin, NewtonBlock, SignAnalysis, SolvedBlock, pivot_cost
from .flat import FlatModel
from .matrices import difference, product, quotient, stacked, triplets
from .quadric import NoClosedForm, eliminate_explicit, solve_angle, solve_nonlinear
from .rewriting import is_nonsmooth, kinked_in
from .structure import EquationStructure
from .tearing import torn

# relative difference of constants below which it is round-off of zero: entries are short decimals, seldom 1e-12
CANCELLED = 1e-13
# threshold pivoting: a pivot with a smaller ratio to the largest entry of its column would cost more than three digits
MIN_PIVOT_RATIO = 1e-3
# largest number of unknowns of a core that is solved with determinants
SMALL_CORE = 3

Assignments = list[tuple[ca.SX, ca.SX]]


def solve_linear(
    residuals: list[ca.SX], unknowns: list[ca.SX], jacobian: ca.SX, signs: SignAnalysis, label: str
) -> tuple[Assignments, list[Margin], str, DenseCore | None]:
    """Solve residuals == 0, linear in the unknowns, with the Jacobian of the residuals.

    Returns assignments in order of computation, pivot margins of the dense core, a description, and the core if it is
    solved by QR. Pivots are constants, then parameters declared nonzero; never state-dependent expressions: equations
    without an allowed pivot form the core.
    """
    at_zero = ca.substitute(stacked(residuals), stacked(unknowns), ca.SX.zeros(len(unknowns), 1))
    rhs = [-at_zero[i] for i in range(len(residuals))]
    rows: dict[int, dict[int, ca.SX]] = {i: {} for i in range(len(residuals))}
    for i, j, value in triplets(jacobian):
        if not value.is_zero():
            rows[i][j] = value
    count: dict[int, int] = {}
    for row in rows.values():
        for j in row:
            count[j] = count.get(j, 0) + 1
    eliminated: list[tuple[int, dict[int, ca.SX], ca.SX, ca.SX]] = []
    entry = _Entries(signs)
    entry.learn([value for row in rows.values() for value in row.values()])
    while True:
        pick = _cheapest(rows, count, entry)
        if pick is None:
            break
        i, j = pick
        row = rows.pop(i)
        pivot = row.pop(j)
        for k in row:
            count[k] -= 1
        changed: list[ca.SX] = []
        for n, entries in rows.items():
            factor = entries.pop(j, None)
            if factor is None:
                continue
            factor = quotient(factor, pivot)
            rhs[n] = difference(rhs[n], product(factor, rhs[i]))
            for k, value in row.items():
                fresh = _difference(entries[k], product(factor, value)) if k in entries else product(-factor, value)
                if fresh.is_zero():
                    if k in entries:
                        del entries[k]
                        count[k] -= 1
                else:
                    count[k] += k not in entries
                    entries[k] = fresh
                    changed.append(fresh)
        del count[j]
        entry.learn(changed)
        eliminated.append((j, row, pivot, rhs[i]))
    assignments: Assignments = []
    margins: list[Margin] = []
    core: DenseCore | None = None
    size = len(rows)
    if size:
        core_rows = sorted(rows)
        core_cols = sorted(count)
        assignments, margins, core = _core(rows, core_rows, core_cols, rhs, unknowns, label)
    for j, row, pivot, b in reversed(eliminated):
        value = b
        for k in sorted(row):
            value = difference(value, product(row[k], unknowns[k]))
        assignments.append((unknowns[j], quotient(value, pivot)))
    detail = f"{len(eliminated)} pivots eliminated" + (f", dense core of {size}" if size else "")
    return assignments, margins, detail, core


class _Entries:
    """Kind and size of matrix entries, computed once for each; it keeps the entries alive.

    A state-dependent entry is not an allowed pivot, but its typical size shows which other entries of its column are
    too small.
    """

    def __init__(self, signs: SignAnalysis) -> None:
        self._signs = signs
        self.known: dict[int, tuple[ca.SX, str | None, float]] = {}

    def learn(self, entries: list[ca.SX]) -> None:
        new = {id(e): e for e in entries if id(e) not in self.known}
        for (key, e), size in zip(new.items(), self._signs.sizes(list(new.values())), strict=True):
            self.known[key] = (e, self._signs.kind(e), size)


def _difference(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a - b; exactly zero if two constants cancel up to round-off."""
    new = difference(a, b)
    if new.is_constant() and abs(float(new)) <= CANCELLED * abs(float(a)):
        return ca.SX(0)
    return new


def _cheapest(rows: dict[int, dict[int, ca.SX]], count: dict[int, int], entry: _Entries) -> tuple[int, int] | None:
    """Return row and column of the cheapest allowed pivot that is not tiny relative to its column."""
    known = entry.known
    largest: dict[int, float] = {}
    facts = {i: {j: known[id(value)] for j, value in row.items()} for i, row in rows.items()}
    for row in facts.values():
        for j, fact in row.items():
            if fact[2] > largest.get(j, 0.0):
                largest[j] = fact[2]
    best: tuple[float, int, int] | None = None
    for i in sorted(rows):
        row = facts[i]
        for j in sorted(row):
            fill = (len(row) - 1) * (count[j] - 1)
            if best is not None and fill >= best[0]:
                continue
            _, kind, size = row[j]
            if kind is None or not size >= MIN_PIVOT_RATIO * largest[j]:
                continue
            cost = pivot_cost(kind, fill, size, largest[j])
            if best is None or cost < best[0]:
                best = (cost, i, j)
    return None if best is None else best[1:]


def _core(
    rows: dict[int, dict[int, ca.SX]],
    core_rows: list[int],
    core_cols: list[int],
    rhs: list[ca.SX],
    unknowns: list[ca.SX],
    label: str,
) -> tuple[Assignments, list[Margin], DenseCore | None]:
    """Solve the dense core by division, determinants or QR; the diagonal of R shows how close to singular it is."""
    if len(core_rows) == 1:
        pivot = rows[core_rows[0]][core_cols[0]]
        return [(unknowns[core_cols[0]], rhs[core_rows[0]] / pivot)], [Margin("pivot", pivot, label)], None
    n = len(core_rows)
    a = ca.SX.zeros(n, n)
    for r, i in enumerate(core_rows):
        for c, j in enumerate(core_cols):
            if j in rows[i]:
                a[r, c] = rows[i][j]
    b = ca.vertcat(*[rhs[i] for i in core_rows])
    x, pivots = (_determinants if n <= SMALL_CORE else _gram_schmidt)(a, b)
    margins = [Margin("pivot", p, f"{label} ({unknowns[j].name()})") for j, p in zip(core_cols, pivots, strict=True)]
    core = DenseCore([unknowns[j] for j in core_cols], a, b) if n > SMALL_CORE else None
    return [(unknowns[j], x[c]) for c, j in enumerate(core_cols)], margins, core


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


Pair = tuple[int, int]


def solve_block(
    flat: FlatModel,
    structure: EquationStructure,
    derivatives: list[list[ca.SX]],
    nodes: list[Pair],
    unknown_of: dict[Pair, Pair],
    signs: SignAnalysis,
    uses: tuple[tuple[str, ...], ...],
    pose: bool = False,
    turns: bool = False,
) -> SolvedBlock:
    """Solve the block of these nodes (equation, derivative) for their unknowns.

    uses: see `SolvedBlock`. pose: a rotation is known, and the block may contain a chain of joints. turns: an angle may
    be limited to one turn about its start.
    """
    order = sorted(nodes, key=lambda n: unknown_of[n])  # canonical: by declaration of the unknowns
    rows = sorted(nodes)
    residuals = [derivatives[i][m] for i, m in rows]
    unknowns = [flat.scope.symbol(*unknown_of[n]) for n in order]
    names = [flat.symbol_name(*unknown_of[n]) for n in order]
    equations = [f"{structure.equations[i].label}{chr(39) * m} ({structure.equations[i].where})" for i, m in rows]
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1]}"
    jacobian = ca.jacobian(stacked(residuals), stacked(unknowns))
    kinked = is_nonsmooth(flat) and any(kinked_in(residuals, unknowns))
    keys = {s.element_hash() for s in unknowns}
    linear = jacobian.is_constant() or not any(s.element_hash() in keys for s in ca.symvar(jacobian))
    if not kinked and linear:
        assignments, margins, detail, core = solve_linear(residuals, unknowns, jacobian, signs, label)
        kind = "explicit" if len(nodes) == 1 and not margins else "linear"
        return SolvedBlock(kind, names, equations, assignments, margins, [], detail, None, uses, (), core)
    if pose:
        preference = [flat.variables[unknown_of[n][0]].prefer for n in order]
        cut = torn(residuals, unknowns, preference)
        if cut is not None:
            return _newton(flat, names, equations, residuals, cut.residuals, cut.unknowns, cut.assignments, uses)
    try:
        assignments, margins, roots, detail = solve_nonlinear(residuals, unknowns, signs, kinked)
    except NoClosedForm:
        reduced, implicit, explicit = eliminate_explicit(residuals, unknowns, signs, True, kinked)
        assigned = list(reversed(explicit))
        if turns and len(implicit) == 1 and not kinked and (middle := _middle(flat, implicit[0], signs)) is not None:
            label = implicit[0].name()
            try:
                core, margins, root = solve_angle(reduced[0], implicit[0], middle, signs, label)
            except NoClosedForm:
                pass
            else:
                detail = f"angle in {label}" + (f", {len(explicit)} explicit" if explicit else "")
                given = core + assigned
                return SolvedBlock(
                    "angle", names, equations, given, margins, [root], detail, None, uses, tuple(residuals)
                )
        return _newton(flat, names, equations, residuals, reduced, implicit, assigned, uses)
    kind = detail.split(" in ")[0]
    return SolvedBlock(kind, names, equations, assignments, margins, roots, detail, None, uses, tuple(residuals))


def _middle(flat: FlatModel, u: ca.SX, signs: SignAnalysis) -> float | None:
    """Return the middle of the limits of an angle, else its value at home; None if the unknown is not an angle."""
    owner = flat.scope.owner(u)
    v = None if owner is None or owner[1] else flat.variables[owner[0]]
    if v is None or v.unit != "rad":
        return None
    return (v.min + v.max) / 2 if np.isfinite(v.min) and np.isfinite(v.max) else round(signs.at_home(u), 2)


def _newton(
    flat: FlatModel,
    names: list[str],
    equations: list[str],
    residuals: list[ca.SX],
    reduced: list[ca.SX],
    implicit: list[ca.SX],
    assigned: Assignments,
    uses: tuple[tuple[str, ...], ...],
) -> SolvedBlock:
    """Return a block for Newton's method: reduced residuals of the implicit unknowns, which determine the others."""
    scale = np.array([flat.variables[p[0]].nominal for p in map(flat.scope.owner, implicit) if p is not None])
    labels = [u.name() for u in implicit]
    detail = f"Newton in {', '.join(labels)}" + (f", {len(assigned)} explicit" if assigned else "")
    newton = NewtonBlock(implicit, reduced, labels, scale)
    return SolvedBlock("Newton", names, equations, assigned, [], [], detail, newton, uses, tuple(residuals))
