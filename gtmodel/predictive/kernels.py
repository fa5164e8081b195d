"""The operations of one stage and one iteration, as CasADi functions: Python evaluates them, C contains them.

A side is one limit, sign * row >= bound. It has a distance t and a multiplier l, both positive; a soft one also has an
excess e and its multiplier v. They stand in one column s = [t; l; e; v] per stage. The residual of a side is
sign * y - bound + e - t; an iteration aims at t * l = e * v = centre (Mehrotra 1992, SIAM J. Optim. 2, 575-601).

Eliminating the sides leaves a quadratic program with dynamics only: each row has a weight, added to the Hessian, and a
slope, added to the gradient. It is solved by the Riccati recursion (Rao, Wright, Rawlings 1998, J. Optim. Theory
Appl. 99, 723-757); the gains are of the step, dx and du, not of x and u.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from .stage import HorizonStage

SX = ca.SX
KERNELS = ("begin", "push", "weigh", "change", "judge", "ahead", "follow", "factor", "vector", "move", "adjoint")
PIVOT = 1e-13  # least share of a diagonal entry of the Hessian of the inputs that is left after elimination
COLD = 1.0  # distance and product of distance and multiplier at the beginning
WARM = 0.01  # the same, at least, with a start


def kernels(stage: HorizonStage) -> dict[str, ca.Function]:
    """Return the functions of a stage by name; arguments and results are listed with each of them below.

    p: data. P: upper triangle of the symmetric Hessian of what follows, by columns; g: its gradient. The last stage has
    no input, and nothing follows it: its functions have the same names with fewer arguments.
    """
    return _of_sides(stage) | (_of_the_end(stage) if stage.after is None else _of_the_dynamics(stage))


def _function(name: str, arguments: Sequence[Any], results: Sequence[Any]) -> ca.Function:
    return ca.Function(name, list(arguments), [ca.densify(r) for r in results], {"cse": True})


def _column(entries: Sequence[Any]) -> Any:
    return ca.vertcat(SX(0, 1), *entries)


def _of_sides(stage: HorizonStage) -> dict[str, ca.Function]:
    """First sides, weights and slopes of the rows, steps of the sides, residuals, gap.

    begin    p y                       -> s at the beginning
    push     s                         -> s, away from zero
    weigh    p y s centre product      -> weight slope
    change   p y s centre product dy   -> ds new_product
    judge    p y s                     -> gap residual excess_residual excess_cost
    ahead    s ds length               -> gap after a step of this length

    product: dt * dl and de * dv of a predictor, 0 before it.
    """
    sides, soft, p = stage.sides, stage.soft, stage.data
    n, m, ny = len(sides), len(soft), len(stage.rows)
    y, s, ds, dy = SX.sym("y", ny), SX.sym("s", 2 * (n + m)), SX.sym("ds", 2 * (n + m)), SX.sym("dy", ny)
    centre, product, length = SX.sym("centre"), SX.sym("product", n + m), SX.sym("length")
    t, l, e, v = ca.vertsplit(s, [0, n, 2 * n, 2 * n + m, 2 * (n + m)])
    weight, slope = [SX(0)] * ny, [SX(0)] * ny
    steps: list[list[Any]] = [[], [], [], []]
    residuals, excess, cost, gap = [], [], SX(0), SX(0)
    for j, side in enumerate(sides):
        i, sign, k = side.row, side.sign, soft.index(j) if side.price is not None else None
        residual = sign * y[i] - side.bound - t[j] + (0 if k is None else e[k])
        ratio, aim = l[j] / t[j], (centre - product[j]) / t[j]
        gap += t[j] * l[j]
        residuals.append(residual)
        if k is None or side.price is None:
            weight[i] += ratio
            slope[i] += sign * (ratio * residual - aim)
            dt = sign * dy[i] + residual
            dl = aim - ratio * dt - l[j]
        else:
            # the excess eliminated: price[0] + price[1] * e = l + v
            own, wanted = v[k] / e[k], (centre - product[n + k]) / e[k]
            total = side.price[1] + ratio + own
            rest = aim + wanted - side.price[0] - side.price[1] * e[k] - ratio * residual
            weight[i] += ratio * (side.price[1] + own) / total
            slope[i] += sign * (ratio * residual + ratio * rest / total - aim)
            de = (rest - ratio * sign * dy[i]) / total
            dt = sign * dy[i] + de + residual
            dl = aim - ratio * dt - l[j]
            steps[2].append(de)
            steps[3].append(wanted - own * de - v[k])
            excess.append(side.price[0] + side.price[1] * e[k] - l[j] - v[k])
            cost += side.price[0] * e[k] + side.price[1] * e[k] ** 2 / 2
            gap += e[k] * v[k]
        steps[0].append(dt)
        steps[1].append(dl)
    dt, dl, de, dv = (_column(c) for c in steps)
    moved = s + length * ds
    t1, l1, e1, v1 = ca.vertsplit(moved, [0, n, 2 * n, 2 * n + m, 2 * (n + m)])
    size = lambda entries: sum((ca.fabs(x) for x in entries), SX(0))  # noqa: E731
    far = [ca.fmax(d.sign * y[d.row] - d.bound, COLD) for d in sides]
    # as if nearly all of the price were the multiplier of the excess
    little = [COLD / sum(d.price) for d in sides if d.price is not None]
    begun = [*far, *[COLD / x for x in far], *little, *[COLD / x for x in little]]
    t2, e2 = ca.fmax(t, WARM), ca.fmax(e, WARM)
    pushed = ca.vertcat(t2, ca.fmax(l, WARM / t2), e2, ca.fmax(v, WARM / e2))
    return {
        "begin": _function("begin", [p, y], [_column(begun)]),
        "push": _function("push", [s], [pushed]),
        "weigh": _function("weigh", [p, y, s, centre, product], [_column(weight), _column(slope)]),
        "change": _function(
            "change", [p, y, s, centre, product, dy], [ca.vertcat(dt, dl, de, dv), ca.vertcat(dt * dl, de * dv)]
        ),
        "judge": _function("judge", [p, y, s], [gap, size(residuals), size(excess), cost]),
        "ahead": _function("ahead", [s, ds, length], [ca.dot(t1, l1) + ca.dot(e1, v1)]),
    }


def _slope_of(stage: HorizonStage, s: Any) -> Any:
    """Slope of the rows by the multipliers as they are."""
    slope = [SX(0)] * len(stage.rows)
    for j, side in enumerate(stage.sides):
        slope[side.row] -= side.sign * s[len(stage.sides) + j]
    return _column(slope)


def _of_the_end(stage: HorizonStage) -> dict[str, ca.Function]:
    """Functions of the last stage.

    follow   p x                -> y cost
    factor   p x weight slope   -> P g
    vector   p x slope          -> g
    move     p dx               -> dy
    adjoint  p x s              -> g
    """
    M, p, x = stage.matrices, stage.data, stage.x
    ny, s = len(stage.rows), SX.sym("s", stage.positives)
    weight, slope, dx = SX.sym("weight", ny), SX.sym("slope", ny), SX.sym("dx", stage.states)
    gradient = ca.mtimes(M["Q"], x) + M["q"]
    cost = ca.dot(x, ca.mtimes(M["Q"], x)) / 2 + ca.dot(M["q"], x) + M["constant"]
    P = M["Q"] + ca.mtimes(M["C"].T, ca.mtimes(ca.diag(weight), M["C"]))
    g = gradient + ca.mtimes(M["C"].T, slope)
    return {
        "follow": _function("follow", [p, x], [ca.mtimes(M["C"], x), cost]),
        "factor": _function("factor", [p, x, weight, slope], [_upper(P), g]),
        "vector": _function("vector", [p, x, slope], [g]),
        "move": _function("move", [p, dx], [ca.mtimes(M["C"], dx)]),
        "adjoint": _function("adjoint", [p, x, s], [gradient + ca.mtimes(M["C"].T, _slope_of(stage, s))]),
    }


def _of_the_dynamics(stage: HorizonStage) -> dict[str, ca.Function]:
    """Functions of a stage with an input.

    follow   x p u                          -> after y cost
    factor   P g p x u weight slope         -> P g K k lower inverse pivot
    vector   g p x u slope K lower inverse  -> g k
    move     dx p K k                       -> dx_after du dy
    adjoint  g p x u s                      -> g, sum of the absolute gradients of u

    Hessian of du: lower * diag(1 / inverse) * lower', unit lower triangle by columns; pivot: above
    zero if enough of the diagonal of the Hessian is left.
    """
    A, B, b, Q, R, S, q, r, C, D, constant = (
        stage.matrices[k] for k in ("A", "B", "b", "Q", "R", "S", "q", "r", "C", "D", "constant")
    )
    p, x, u, n, m, ny = stage.data, stage.x, stage.u, stage.states, stage.inputs, len(stage.rows)
    P, g, dx = SX.sym("P", n * (n + 1) // 2), SX.sym("g", n), SX.sym("dx", n)
    weight, slope = SX.sym("weight", ny), SX.sym("slope", ny)
    s = SX.sym("s", stage.positives)
    K, k, lower, inverse = SX.sym("K", m, n), SX.sym("k", m), SX.sym("lower", m * (m - 1) // 2), SX.sym("inverse", m)
    cost = ca.dot(x, ca.mtimes(Q, x)) / 2 + ca.dot(u, ca.mtimes(R, u)) / 2 + ca.dot(u, ca.mtimes(S, x))
    cost += ca.dot(q, x) + ca.dot(r, u) + constant
    by_x = ca.mtimes(Q, x) + ca.mtimes(S.T, u) + q
    by_u = ca.mtimes(S, x) + ca.mtimes(R, u) + r
    follows = _symmetric(P, n)
    PA, PB = ca.mtimes(follows, A), ca.mtimes(follows, B)
    CW, DW = ca.mtimes(C.T, ca.diag(weight)), ca.mtimes(D.T, ca.diag(weight))
    H_xx = Q + ca.mtimes(A.T, PA) + ca.mtimes(CW, C)
    H_ux = S + ca.mtimes(B.T, PA) + ca.mtimes(DW, C)
    H_uu = R + ca.mtimes(B.T, PB) + ca.mtimes(DW, D)
    h_x = by_x + ca.mtimes(C.T, slope) + ca.mtimes(A.T, g)
    h_u = by_u + ca.mtimes(D.T, slope) + ca.mtimes(B.T, g)
    L, d = _factored(H_uu)
    forward = _forward(L, H_ux)
    gains = -_backward(L, 1 / d, forward)
    before = H_xx - ca.mtimes(forward.T, ca.mtimes(ca.diag(1 / d), forward))
    steps = -_backward(L, 1 / d, _forward(L, h_u))
    again = _unit_lower(lower, m)
    steps_again = -_backward(again, inverse, _forward(again, h_u))
    du = ca.mtimes(K, dx) + k
    fixed = _slope_of(stage, s)
    at_x = by_x + ca.mtimes(C.T, fixed) + ca.mtimes(A.T, g)
    at_u = by_u + ca.mtimes(D.T, fixed) + ca.mtimes(B.T, g)
    below = _column([L[i, j] for j in range(m) for i in range(j + 1, m)])
    return {
        "follow": _function(
            "follow", [x, p, u], [ca.mtimes(A, x) + ca.mtimes(B, u) + b, ca.mtimes(C, x) + ca.mtimes(D, u), cost]
        ),
        "factor": _function(
            "factor", [P, g, p, x, u, weight, slope],
            [_upper(before), h_x + ca.mtimes(gains.T, h_u), gains, steps, below, 1 / d, d - PIVOT * ca.diag(H_uu)],
        ),
        "vector": _function(
            "vector", [g, p, x, u, slope, K, lower, inverse], [h_x + ca.mtimes(K.T, h_u), steps_again]
        ),
        "move": _function(
            "move", [dx, p, K, k], [ca.mtimes(A, dx) + ca.mtimes(B, du), du, ca.mtimes(C, dx) + ca.mtimes(D, du)]
        ),
        "adjoint": _function("adjoint", [g, p, x, u, s], [at_x, ca.sum1(ca.fabs(at_u))]),
    }  # fmt: skip


def _upper(P: Any) -> Any:
    return _column([P[i, j] for j in range(P.shape[1]) for i in range(j + 1)])


def _symmetric(entries: Any, n: int) -> Any:
    P, k = SX(n, n), 0
    for j in range(n):
        for i in range(j + 1):
            P[i, j] = P[j, i] = entries[k]
            k += 1
    return P


def _unit_lower(entries: Any, m: int) -> Any:
    L, k = SX.eye(m), 0
    for j in range(m):
        for i in range(j + 1, m):
            L[i, j] = entries[k]
            k += 1
    return L


def _factored(H: Any) -> tuple[Any, Any]:
    """Unit lower triangle L and diagonal d of L diag(d) L'."""
    m = H.shape[0]
    L, d = SX.eye(m), SX.zeros(m)
    for j in range(m):
        d[j] = H[j, j] - sum((L[j, k] ** 2 * d[k] for k in range(j)), SX(0))
        for i in range(j + 1, m):
            L[i, j] = (H[i, j] - sum((L[i, k] * L[j, k] * d[k] for k in range(j)), SX(0))) / d[j]
    return L, d


def _forward(L: Any, X: Any) -> Any:
    X = SX(X)
    for i in range(L.shape[0]):
        for k in range(i):
            X[i, :] -= L[i, k] * X[k, :]
    return X


def _backward(L: Any, inverse: Any, X: Any) -> Any:
    m = L.shape[0]
    X = SX(X)
    for i in range(m):
        X[i, :] *= inverse[i]
    for i in reversed(range(m)):
        for k in range(i + 1, m):
            X[i, :] -= L[k, i] * X[k, :]
    return X
