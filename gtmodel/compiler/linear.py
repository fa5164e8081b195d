"""Linear blocks: sparse elimination on the Jacobian's entries, a small dense core by QR."""

from __future__ import annotations

import casadi as ca

from .blocks import Margin
from .pivots import SignAnalysis

PARAMETER_PIVOT_COST = 50  # constants first: dividing by a parameter costs an operation and an assumption

Assignments = list[tuple[ca.SX, ca.SX]]


def solve_linear(
    residuals: list[ca.SX], unknowns: list[ca.SX], signs: SignAnalysis, label: str
) -> tuple[Assignments, list[Margin], str]:
    """Solve residuals == 0, linear in the unknowns.

    Returns assignments in order of computation, pivot margins of the dense core, and a sentence on how.
    Constant pivots, then parameters declared nonzero; never a state-dependent one: what has no allowed pivot
    is the core.
    """
    u = ca.vertcat(*unknowns)
    r = ca.vertcat(*residuals)
    jacobian = ca.jacobian(r, u)
    at_zero = ca.substitute([r], [u], [ca.SX.zeros(len(unknowns), 1)])[0]
    rhs = [-at_zero[i] for i in range(len(residuals))]
    rows: dict[int, dict[int, ca.SX]] = {i: {} for i in range(len(residuals))}
    for i, j, value in zip(*jacobian.sparsity().get_triplet(), jacobian.nonzeros(), strict=True):
        if not value.is_zero():
            rows[i][j] = value
    count: dict[int, int] = {}
    for row in rows.values():
        for j in row:
            count[j] = count.get(j, 0) + 1
    eliminated: list[tuple[int, dict[int, ca.SX], ca.SX, ca.SX]] = []
    kinds: dict[int, str | None] = {}
    while True:
        pick = _cheapest(rows, count, signs, kinds)
        if pick is None:
            break
        i, j = pick
        row = rows.pop(i)
        pivot = row.pop(j)
        for k in row:
            count[k] -= 1
        for other, entries in rows.items():
            factor = entries.pop(j, None)
            if factor is None:
                continue
            factor = factor / pivot
            rhs[other] = rhs[other] - factor * rhs[i]
            for k, value in row.items():
                new = entries[k] - factor * value if k in entries else -factor * value
                if new.is_zero():
                    del entries[k]
                    count[k] -= 1
                else:
                    count[k] += k not in entries
                    entries[k] = new
        del count[j]
        eliminated.append((j, row, pivot, rhs[i]))
    assignments: Assignments = []
    margins: list[Margin] = []
    size = len(rows)
    if size:
        core_rows = sorted(rows)
        core_cols = sorted(count)
        assignments, margins = _core(rows, core_rows, core_cols, rhs, unknowns, label)
    for j, row, pivot, b in reversed(eliminated):
        value = b
        for k in sorted(row):
            value = value - row[k] * unknowns[k]
        assignments.append((unknowns[j], value / pivot))
    how = f"{len(eliminated)} pivots eliminated" + (f", dense core of {size}" if size else "")
    return assignments, margins, how


def _cheapest(
    rows: dict[int, dict[int, ca.SX]], count: dict[int, int], signs: SignAnalysis, kinds: dict[int, str | None]
) -> tuple[int, int] | None:
    best: tuple[int, int, int] | None = None
    for i in sorted(rows):
        row = rows[i]
        for j in sorted(row):
            cost = (len(row) - 1) * (count[j] - 1)
            if best is not None and cost >= best[0]:
                continue
            key = row[j].element_hash()
            if key not in kinds:
                kinds[key] = signs.kind(row[j])
            kind = kinds[key]
            if kind is None:
                continue
            cost += PARAMETER_PIVOT_COST * (kind == "parameter")
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
) -> tuple[Assignments, list[Margin]]:
    """The dense rest: one division, or QR, whose diagonal shows how near to singular it is."""
    if len(core_rows) == 1:
        pivot = rows[core_rows[0]][core_cols[0]]
        return [(unknowns[core_cols[0]], rhs[core_rows[0]] / pivot)], [Margin("pivot", pivot, label)]
    n = len(core_rows)
    a = ca.SX.zeros(n, n)
    for r, i in enumerate(core_rows):
        for c, j in enumerate(core_cols):
            if j in rows[i]:
                a[r, c] = rows[i][j]
    b = ca.vertcat(*[rhs[i] for i in core_rows])
    q, upper = ca.qr(a)
    y = q.T @ b
    x: list[ca.SX] = [ca.SX(0)] * n
    for r in reversed(range(n)):
        value = y[r]
        for c in range(r + 1, n):
            value = value - upper[r, c] * x[c]
        x[r] = value / upper[r, r]
    margins = [Margin("pivot", upper[r, r], f"{label} ({unknowns[core_cols[r]].name()})") for r in range(n)]
    return [(unknowns[j], x[c]) for c, j in enumerate(core_cols)], margins
