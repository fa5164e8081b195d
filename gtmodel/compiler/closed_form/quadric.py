"""Nonlinear blocks with a closed form: explicit unknowns, one quadratic, a pencil of spheres (trilateration), an angle
whose sine and cosine lie on a line."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..blocks import Margin, Root, SignAnalysis, pivot_cost
from ..matrices import elements, triplets
from ..rewriting import applied, kinked_in, of_expression, walked

NONLINEAR_ROW = 1000  # costs more than any fill-in, so that it is used last

Assignments = list[tuple[ca.SX, ca.SX]]


class NoClosedForm(Exception):
    """The block is neither a quadratic nor a pencil of proportional quadrics."""


def solve_nonlinear(
    residuals: list[ca.SX], unknowns: list[ca.SX], signs: SignAnalysis, kinked: bool = False
) -> tuple[Assignments, list[Margin], list[Root], str]:
    """Solve a nonlinear block in closed form; return assignments in order, margins, roots and a description.

    `kinked`: some unknown is inside sign(), an absolute value or the like. Raises NoClosedForm if the equations that
    remain after the explicit unknowns are neither one quadratic nor a pencil of two or three quadrics with
    proportional Hessians.
    """
    residuals, implicit, explicit = eliminate_explicit(residuals, unknowns, signs, kinked=kinked)
    n = len(implicit)
    if kinked and any(kinked_in(residuals, implicit)):
        raise NoClosedForm
    label = ", ".join(s.name() for s in implicit)
    if n == 1:
        core, margins, root = _quadratic(residuals[0], implicit[0], signs, label)
        kind = "quadratic"
    elif n in (2, 3):
        core, margins, root = _pencil(residuals, implicit, signs, label)
        kind = "sphere pencil"
    else:
        raise NoClosedForm
    detail = f"{kind} in {label}"
    if explicit:
        detail += f", {len(explicit)} explicit"
    return core + list(reversed(explicit)), margins, [root], detail


def eliminate_explicit(
    residuals: list[ca.SX],
    unknowns: list[ca.SX],
    signs: SignAnalysis,
    nonlinear_rows: bool = False,
    kinked: bool = False,
) -> tuple[list[ca.SX], list[ca.SX], Assignments]:
    """Eliminate unknowns that occur linearly, with an allowed pivot, in some row.

    Rows that are nonlinear in other unknowns are kept unless `nonlinear_rows`: they may be a quadric. `kinked`: an
    unknown inside a nonsmooth operation of a row is not eliminated with this row. Returns the remaining residuals and
    unknowns, and the assignments in reverse order of computation.
    """
    residuals, unknowns = list(residuals), list(unknowns)
    assignments: Assignments = []
    rows: list[_Row | None] = [None] * len(residuals)  # None: to be read
    while len(unknowns) > 1:
        _read_rows(rows, residuals, unknowns, signs)
        entries = [(i, key, *fact) for i, row in enumerate(rows) if row for key, fact in row.entries.items()]
        position = {u.element_hash(): j for j, u in enumerate(unknowns)}
        col_count = Counter(key for _, key, *_ in entries)
        largest: dict[int, float] = {}
        for _, key, _, size in entries:
            largest[key] = max(largest.get(key, 0.0), size)
        best = None
        inside = kinked_in(residuals, unknowns) if kinked else [set()] * len(residuals)
        for i, key, value, size in sorted(entries, key=lambda e: (position[e[1]], e[0])):
            row, j = rows[i], position[key]
            assert row is not None
            fill = (len(row.entries) - 1) * (col_count[key] - 1)
            if best is not None and fill >= best[0]:
                continue
            kind = signs.kind(value)
            if kind is None or j in inside[i]:
                continue
            cost = pivot_cost(kind, fill, size, largest[key]) + NONLINEAR_ROW * row.nonlinear
            if best is None or cost < best[0]:
                best = (cost, i, j, value)
        if best is None or (best[0] >= NONLINEAR_ROW and not nonlinear_rows):
            break
        _, i, j, pivot = best
        x = unknowns.pop(j)
        rows.pop(i)
        value = -ca.substitute([residuals.pop(i)], [x], [ca.SX(0)])[0] / pivot
        with_x = [n for n, other in enumerate(rows) if other is not None and x.element_hash() in other.entries]
        for n, changed in zip(with_x, ca.substitute([residuals[n] for n in with_x], [x], [value]), strict=True):
            residuals[n], rows[n] = changed, None
        assignments.append((x, value))
    return residuals, unknowns, assignments


class _Row(NamedTuple):
    """Slopes of a residual, with typical sizes, by unknown; and whether they contain unknowns."""

    entries: dict[int, tuple[ca.SX, float]]
    nonlinear: bool


def _read_rows(rows: list[_Row | None], residuals: list[ca.SX], unknowns: list[ca.SX], signs: SignAnalysis) -> None:
    """Read the residuals whose row is None."""
    new = [n for n, row in enumerate(rows) if row is None]
    if not new:
        return
    u = ca.vertcat(*unknowns)
    entries = triplets(ca.jacobian(ca.vertcat(*[residuals[n] for n in new]), u))
    within = ca.jacobian_sparsity(ca.vertcat(*[v for _, _, v in entries]), u).row() if entries else []
    nonlinear = {entries[k][0] for k in within}
    slopes: list[dict[int, tuple[ca.SX, float]]] = [{} for _ in new]
    for (i, j, value), size in zip(entries, signs.sizes([value for *_, value in entries]), strict=True):
        slopes[i][unknowns[j].element_hash()] = value, size
    for i, n in enumerate(new):
        rows[n] = _Row(slopes[i], i in nonlinear)


def _quadratic(residual: ca.SX, u: ca.SX, signs: SignAnalysis, label: str) -> tuple[Assignments, list[Margin], Root]:
    slope = ca.gradient(residual, u)
    curvature = ca.gradient(slope, u)
    if _depends(curvature, [u]) or curvature.is_zero():
        raise NoClosedForm
    zero = ca.SX(0)
    qa = curvature / 2
    qb, qc = (ca.substitute([e], [u], [zero])[0] for e in (slope, residual))
    if signs.kind(qa) is None:
        t, margins, root = _root(qa, qb, qc, u, signs, label)
        return [(u, t)], margins, root
    # relative to the vertex: far from the origin qb^2 and 4 qa qc would cancel
    vertex = -qb / 2 / qa
    discriminant = -qa * ca.substitute([residual], [u], [vertex])[0]
    s = ca.SX.sym("sign")
    value = vertex + s * ca.sqrt(discriminant) / qa
    return [(u, value)], [Margin("discriminant", discriminant, label)], Root(s, qa * (u - vertex), label)


def _root(
    qa: ca.SX, qb: ca.SX, qc: ca.SX, t: ca.SX, signs: SignAnalysis, label: str
) -> tuple[ca.SX, list[Margin], Root]:
    """Return t = (-qb + s sqrt(qb^2 - 4 qa qc)) / (2 qa), with half coefficients to save operations."""
    half = qb / 2
    discriminant = half * half - qa * qc
    s = ca.SX.sym("sign")
    margins = [Margin("discriminant", discriminant, label)]
    if signs.kind(qa) is None:
        margins.append(Margin("pivot", qa, label))
    value = (s * ca.sqrt(discriminant) - half) / qa
    return value, margins, Root(s, qa * t + half, label)


def _pencil(
    residuals: list[ca.SX], unknowns: list[ca.SX], signs: SignAnalysis, label: str
) -> tuple[Assignments, list[Margin], Root]:
    """Solve quadrics with proportional Hessians: their differences are planes, one quadric gives a quadratic.

    The unknowns lie on V0 + t N with N parallel to all planes; the sense of N follows the declared order of rows.
    """
    n = len(unknowns)
    v = ca.vertcat(*unknowns)
    hessians = []
    for r in residuals:
        h = ca.hessian(r, v)[0]
        if _depends(h, unknowns):
            raise NoClosedForm
        hessians.append(ca.densify(h))
    curved = [i for i, h in enumerate(hessians) if not all(x.is_zero() for x in elements(h))]
    if not curved:
        raise NoClosedForm
    reference = curved[0]
    mu = [_ratio(h, hessians[reference]) for h in hessians]
    others = [i for i in range(n) if i != reference]
    row, hessian = residuals[reference], hessians[reference]
    centre, central = _centre(row, v, hessian, signs)
    planes = [residuals[i] - mu[i] * row for i in others]
    gradients = [ca.substitute([ca.gradient(p, v)], [v], [centre])[0] for p in planes]
    offsets = [-ca.substitute([p], [v], [centre])[0] for p in planes]
    if n == 2:
        b = gradients[0]
        normal = ca.vertcat(-b[1], b[0])
        square = ca.dot(b, b)
        start = b * (offsets[0] / square)
    else:
        b1, b2 = gradients
        normal = ca.cross(b1, b2)
        square = ca.dot(normal, normal)
        # the point of both planes nearest to the centre
        start = (offsets[0] * ca.cross(b2, normal) + offsets[1] * ca.cross(normal, b1)) / square
    value, slope = ca.substitute([row, ca.gradient(row, v)], [v], [centre])
    slope = ca.vertcat(*[ca.SX(0) if central[k] else slope[k] for k in range(n)])
    qc = value + ca.dot(slope, start) + ca.dot(start, hessian @ start) / 2
    # for a sphere, the gradient at the foot of the perpendicular is perpendicular to the line
    is_sphere = all(central) and all((hessian[k, k] - hessian[0, 0]).is_zero() for k in range(n))
    qb = ca.SX(0) if is_sphere else ca.dot(slope + hessian @ start, normal)
    qa = ca.dot(normal, hessian @ normal) / 2
    line = ca.dot(v - centre - start, normal) / square
    t, margins, root = _root(qa, qb, qc, line, signs, label)
    margins = [m for m in margins if m.kind != "pivot"] + [Margin("pivot", square, label)]
    return [(u, centre[k] + (start[k] + t * normal[k])) for k, u in enumerate(unknowns)], margins, root


def _centre(row: ca.SX, v: ca.SX, hessian: ca.SX, signs: SignAnalysis) -> tuple[ca.SX, list[bool]]:
    """Return the centre of a quadric, 0 along axes without a centre or an allowed pivot, and which axes have one.

    Coordinates relative to the centre avoid cancellation of their squares far from the origin.
    """
    n = v.numel()
    slope = ca.substitute([ca.gradient(row, v)], [v], [ca.SX.zeros(n, 1)])[0]
    diagonal = all(hessian[i, j].is_zero() for i in range(n) for j in range(n) if i != j)
    central = [diagonal and not hessian[k, k].is_zero() and signs.kind(hessian[k, k]) is not None for k in range(n)]
    return ca.vertcat(*[-slope[k] / hessian[k, k] if central[k] else ca.SX(0) for k in range(n)]), central


def _ratio(h: ca.SX, reference: ca.SX) -> ca.SX:
    """Return mu with h == mu * reference, 0 for a zero h (a plane). Raises NoClosedForm if not proportional."""
    pairs = list(zip(elements(h), elements(reference), strict=True))
    if all(a.is_zero() for a, _ in pairs):
        return ca.SX(0)
    mu = next((a / b for a, b in pairs if not b.is_zero()), None)
    if mu is None:
        raise NoClosedForm
    difference = ca.vertcat(*[a - mu * b for a, b in pairs])
    symbols = ca.symvar(difference)
    if not symbols:
        if any(abs(float(x)) > 0 for x in ca.DM(difference).elements()):
            raise NoClosedForm
        return mu
    # several parameter values: at one point the matrices may be proportional by chance
    f = ca.Function("ratio", [ca.vertcat(*symbols)], [difference])
    rng = np.random.default_rng(0)
    for _ in range(3):
        if np.max(np.abs(np.asarray(f(rng.uniform(0.5, 1.5, len(symbols)))))) > 1e-12:
            raise NoClosedForm
    return mu


def solve_angle(
    residual: ca.SX, u: ca.SX, middle: float, signs: SignAnalysis, label: str
) -> tuple[Assignments, list[Margin], Root]:
    """Solve a cos u + b sin u + k == 0, also if the squares of both occur with one factor; u is within half a turn of
    `middle`. Raises NoClosedForm for another equation.

    The end of an arm at the distance of a rod from a point gives such an equation.
    """
    c, s = ca.SX.sym("cos"), ca.SX.sym("sin")
    (p,) = walked(*of_expression(residual), _SineAndCosine(u, c, s))
    v = ca.vertcat(c, s)
    h, g = ca.hessian(p, v)
    if _depends(p, [u]) or _depends(h, [c, s]):
        raise NoClosedForm
    h = ca.densify(h)
    if not signs.holds(ca.vertcat(h[0, 0] - h[1, 1], h[0, 1]), h[0, 0]):
        raise NoClosedForm
    k, g = ca.substitute([p, g], [v], [ca.SX.zeros(2, 1)])
    a, b, k = g[0], g[1], k + h[0, 0] / 2
    square = a * a + b * b
    discriminant = square - k * k
    sign = ca.SX.sym("sign")
    across = sign * ca.sqrt(discriminant)
    value = ca.atan2(across * a - k * b, -(across * b + k * a))
    margins = [Margin("discriminant", discriminant, label), Margin("pivot", square, label)]
    root = Root(sign, a * ca.sin(u) - b * ca.cos(u), label)
    return [(u, nearest_turn(value, middle))], margins, root


class _SineAndCosine:
    """Forms in which sine and cosine of u are symbols."""

    def __init__(self, u: ca.SX, c: ca.SX, s: ca.SX) -> None:
        self._key, self._c, self._s = u.element_hash(), c, s

    def leaf(self, x: ca.SX) -> ca.SX:
        return x

    def operation(self, k: int, op: int, given: list[ca.SX]) -> ca.SX:
        if op == ca.OP_CALL:
            raise NoClosedForm
        if op in (ca.OP_COS, ca.OP_SIN):
            back = not given[0].is_leaf() and given[0].op() == ca.OP_NEG
            if (given[0].dep(0) if back else given[0]).element_hash() == self._key:
                return self._c if op == ca.OP_COS else -self._s if back else self._s
        return given[0] if op == ca.OP_ASSIGN else applied(op, given)

    def whole(self, form: ca.SX) -> ca.SX:
        return form


def nearest_turn(angle: ca.SX, middle: float) -> ca.SX:
    """Return an angle in (-pi, pi] with the full turns that bring it within half a turn of `middle`."""
    return angle if middle == 0.0 else angle + 2 * np.pi * ca.floor((middle - angle) / (2 * np.pi) + 0.5)


def _depends(expression: ca.SX, symbols: list[ca.SX]) -> bool:
    keys = {s.element_hash() for s in symbols}
    return any(s.element_hash() in keys for s in ca.symvar(expression))
