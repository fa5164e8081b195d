"""The operations of one stage and one iteration, as CasADi functions: Python evaluates them, C contains them.

A limit is sign * row >= bound. It has a distance t and a multiplier l, both positive; a soft one also has an excess e,
its multiplier v, and prices a, b. Residual: sign * y - bound + e - t. An iteration aims at t * l = e * v = centre
(Mehrotra 1992, SIAM J. Optim. 2, 575-601).

Eliminating these leaves a quadratic program with dynamics only: each row has a weight, added to the Hessian, and a
slope, added to the gradient. It is solved by the Riccati recursion (Rao, Wright, Rawlings 1998, J. Optim. Theory
Appl. 99, 723-757); the gains are of the step, dx and du, not of x and u.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from .stage import HorizonStage

SX = ca.SX
KERNELS = ("given", "grade", "pull", "move", "factor", "offset", "feed")
PIVOT = 1e-13  # least share of a diagonal entry of the Hessian of the inputs that is left after elimination


def kernels(stage: HorizonStage) -> dict[str, ca.Function]:
    """Return the functions of a stage by name.

    given    p                        -> bounds of the limits, state after x = 0, u = 0
    grade    p x u                    -> cost without prices, its derivatives by x and u
    pull     p slope by_x by_u g      -> derivatives by x and u, with g the one by the state after
    move     p dx du                  -> dy, dx after
    factor   p weight P               -> P K lower inverse pivot
    offset   g h K lower inverse      -> g k; h: derivatives by u
    feed     dx K k                   -> du

    p: data. P: upper triangle of the symmetric Hessian of what follows, by columns. Hessian of du: lower *
    diag(1 / inverse) * lower', unit lower triangle by columns; pivot: above zero if enough of the diagonal of the
    Hessian is left. The last stage has no input, and nothing follows it: the first five functions have the first
    arguments and results only, the others are missing.
    """
    M, p, x, n, ny = stage.matrices, stage.data, stage.x, stage.states, len(stage.rows)
    A, B, b, Q, R, S, q, r, C, D = (M[k] for k in ("A", "B", "b", "Q", "R", "S", "q", "r", "C", "D"))
    u = SX(0, 1) if stage.u is None else stage.u
    m, followed = u.numel(), stage.after is not None
    slope, weight, g, P = (SX.sym(k, size) for k, size in (
        ("slope", ny), ("weight", ny), ("g", n), ("P", n * (n + 1) // 2)
    ))  # fmt: skip
    by_x, by_u, dx, du = SX.sym("by_x", n), SX.sym("by_u", m), SX.sym("dx", n), SX.sym("du", m)
    r = ca.reshape(r, m, 1)
    to_x, to_u = ca.mtimes(Q, x) + ca.mtimes(S.T, u) + q, ca.mtimes(S, x) + ca.mtimes(R, u) + r
    cost = (ca.dot(x, to_x + q) + ca.dot(u, to_u + r)) / 2 + M["constant"]
    CW, DW = ca.mtimes(C.T, ca.diag(weight)), ca.mtimes(D.T, ca.diag(weight))
    H_xx, h_x = Q + ca.mtimes(CW, C), by_x + ca.mtimes(C.T, slope)
    bounds = _column([side.bound for side in stage.sides])
    moved = ca.mtimes(C, dx) + ca.mtimes(D, du)
    if not followed:
        return {
            "given": _function("given", [p], [bounds]),
            "grade": _function("grade", [p, x], [cost, to_x]),
            "pull": _function("pull", [p, slope, by_x], [h_x]),
            "move": _function("move", [p, dx], [moved]),
            "factor": _function("factor", [p, weight], [_upper(H_xx)]),
        }
    follows = _symmetric(P, n)
    PA, PB = ca.mtimes(follows, A), ca.mtimes(follows, B)
    H_xx += ca.mtimes(A.T, PA)
    H_ux = S + ca.mtimes(B.T, PA) + ca.mtimes(DW, C)
    H_uu = R + ca.mtimes(B.T, PB) + ca.mtimes(DW, D)
    L, d = _factored(H_uu)
    forward = _forward(L, H_ux)
    gains = -_backward(L, 1 / d, forward)
    before = H_xx - ca.mtimes(forward.T, ca.mtimes(ca.diag(1 / d), forward))
    below = _column([L[i, j] for j in range(m) for i in range(j + 1, m)])
    h, K, k = SX.sym("h", m), SX.sym("K", m, n), SX.sym("k", m)
    lower, inverse = SX.sym("lower", m * (m - 1) // 2), SX.sym("inverse", m)
    again = _unit_lower(lower, m)
    return {
        "given": _function("given", [p], [bounds, b]),
        "grade": _function("grade", [p, x, u], [cost, to_x, to_u]),
        "pull": _function(
            "pull", [p, slope, by_x, by_u, g],
            [h_x + ca.mtimes(A.T, g), by_u + ca.mtimes(D.T, slope) + ca.mtimes(B.T, g)],
        ),
        "move": _function("move", [p, dx, du], [moved, ca.mtimes(A, dx) + ca.mtimes(B, du)]),
        "factor": _function(
            "factor", [p, weight, P], [_upper(before), gains, below, 1 / d, d - PIVOT * ca.diag(H_uu)]
        ),
        "offset": _function(
            "offset", [g, h, K, lower, inverse],
            [g + ca.mtimes(K.T, h), -_backward(again, inverse, _forward(again, h))],
        ),
        "feed": _function("feed", [dx, K, k], [k + ca.mtimes(K, dx)]),
    }  # fmt: skip


def _function(name: str, arguments: Sequence[Any], results: Sequence[Any]) -> ca.Function:
    return ca.Function(name, list(arguments), [ca.densify(r) for r in results], {"cse": True})


def _column(entries: Sequence[Any]) -> Any:
    return ca.vertcat(SX(0, 1), *entries)


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
