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
KERNELS = ("given", "grade", "pull", "move", "factor")
# least share of a diagonal entry of the Hessian of the inputs left after elimination: GT_STAGE_QP_PIVOT. Two of three
# forces at their limits leave 2e-14 in a plan to 1e-11
PIVOT = 1e-14


def kernels(stage: HorizonStage) -> dict[str, ca.Function]:
    """Return the functions of a stage by name.

    given    p                        -> bounds of the limits, entries of the rows, state after x = 0, u = 0
    grade    p x u                    -> cost without prices, its derivatives by x and u
    pull     p slope by_x by_u g      -> derivatives by x and u, with g the one by the state after
    move     p dx du                  -> dy, dx after
    factor   p P                      -> Hessian of x and u without the rows

    p: data. P: upper triangle of the symmetric Hessian of what follows, by columns; the result is one too. The last
    stage has no input, and nothing follows it: its functions have the first arguments and results only.
    """
    M, p, x, n, ny = stage.matrices, stage.data, stage.x, stage.states, len(stage.rows)
    A, B, b, Q, R, S, q, r, C, D = (M[k] for k in ("A", "B", "b", "Q", "R", "S", "q", "r", "C", "D"))
    u = SX(0, 1) if stage.u is None else stage.u
    m, followed = u.numel(), stage.after is not None
    slope, g, P = SX.sym("slope", ny), SX.sym("g", n), SX.sym("P", n * (n + 1) // 2)
    by_x, by_u, dx, du = SX.sym("by_x", n), SX.sym("by_u", m), SX.sym("dx", n), SX.sym("du", m)
    r = ca.reshape(r, m, 1)
    to_x, to_u = ca.mtimes(Q, x) + ca.mtimes(S.T, u) + q, ca.mtimes(S, x) + ca.mtimes(R, u) + r
    cost = (ca.dot(x, to_x + q) + ca.dot(u, to_u + r)) / 2 + M["constant"]
    bounds, moved = _column([side.bound for side in stage.sides]), ca.mtimes(C, dx) + ca.mtimes(D, du)
    rows = ca.horzcat(C, D)
    entries = _column([rows[i, first + j] for i, (first, size) in enumerate(ranges(stage)) for j in range(size)])
    h_x = by_x + ca.mtimes(C.T, slope)
    if not followed:
        return {
            "given": _function("given", [p], [bounds, entries]),
            "grade": _function("grade", [p, x], [cost, to_x]),
            "pull": _function("pull", [p, slope, by_x], [h_x]),
            "move": _function("move", [p, dx], [moved]),
            "factor": _function("factor", [p], [_upper(Q)]),
        }
    G, follows = ca.horzcat(A, B), _symmetric(P, n)
    whole = ca.blockcat(Q, S.T, S, R) + ca.mtimes(G.T, ca.mtimes(follows, G))
    return {
        "given": _function("given", [p], [bounds, entries, b]),
        "grade": _function("grade", [p, x, u], [cost, to_x, to_u]),
        "pull": _function(
            "pull", [p, slope, by_x, by_u, g],
            [h_x + ca.mtimes(A.T, g), by_u + ca.mtimes(D.T, slope) + ca.mtimes(B.T, g)],
        ),
        "move": _function("move", [p, dx, du], [moved, ca.mtimes(A, dx) + ca.mtimes(B, du)]),
        "factor": _function("factor", [p, P], [_upper(whole)]),
    }  # fmt: skip


def ranges(stage: HorizonStage) -> list[tuple[int, int]]:
    """Return the first variable of each row (states, then inputs) and the number of those to its last one."""
    rows = ca.horzcat(stage.matrices["C"], stage.matrices["D"])
    across = [[j for j in range(rows.shape[1]) if not rows[i, j].is_zero()] or [0] for i in range(rows.shape[0])]
    return [(at[0], at[-1] - at[0] + 1) for at in across]


def loops(stage: HorizonStage) -> dict[str, ca.Function]:
    """Return what C does in loops (gt_stage_qp_factor.h, gt_stage_qp_riccati.h), for a stage as for the last one.

    thickened   H entries weight     -> H, with the rows times their weights
    least       H                    -> least pivots of the inputs
    pivot_J     H least              -> 1 / pivot of input J, pivot - least one
    left_J      H inverse            -> H without input J, its gains
    offset      h_x h_u gain inverse -> g, change of the inputs
    fed         dx gain offset       -> du

    CasADi would replace the product with an inverse by a division: hence pivot_J and left_J. An input has a gain for
    each state and each input before it, of the step dx, not of x.
    """
    n, m, across = stage.states, stage.inputs, ranges(stage)
    size = n + m
    H, weight = SX.sym("H", size * (size + 1) // 2), SX.sym("weight", len(across))
    entries = SX.sym("entries", sum(count for _, count in across))
    upper, at = _symmetric(H, size), 0
    for i, (first, count) in enumerate(across):
        own = entries[at : at + count]
        for j in range(count):
            by = own[j] * weight[i]
            for k in range(j + 1):
                upper[first + k, first + j] += by * own[k]
        at += count
    made = {"thickened": _function("thickened", [H, entries, weight], [_upper(upper)])}
    if not m:
        return made
    made["least"] = _function("least", [H], [ca.vertcat(*[PIVOT * _symmetric(H, size)[j, j] for j in range(n, size)])])
    least, inverse = SX.sym("least", m), SX.sym("inverse")
    for j in range(m):
        H = SX.sym("H", (n + j + 1) * (n + j + 2) // 2)
        upper = _symmetric(H, n + j + 1)
        column, pivot = upper[: n + j, n + j], upper[n + j, n + j]
        made[f"pivot_{j}"] = _function(f"pivot_{j}", [H, least], [1 / pivot, pivot - least[j]])
        by = column * inverse
        for i in range(n + j):
            for k in range(i + 1):
                upper[k, i] -= by[i] * column[k]
        made[f"left_{j}"] = _function(f"left_{j}", [H, inverse], [_upper(upper[: n + j, : n + j]), -by])
    h_x, h_u, gain, inverse = SX.sym("h_x", n), SX.sym("h_u", m), SX.sym("gain", gains_of(n, m)), SX.sym("inverse", m)
    own = ca.vertsplit(gain, [gains_of(n, j) for j in range(m + 1)])
    h, du = ca.vertcat(h_x, h_u), SX.zeros(m)
    for j in reversed(range(m)):
        du[j] = -(h[n + j] * inverse[j])
        h[: n + j] += own[j] * h[n + j]
    made["offset"] = _function("offset", [h_x, h_u, gain, inverse], [h[:n], du])
    dx, offset = SX.sym("dx", n), SX.sym("offset", m)
    z = dx
    for j in range(m):
        total = offset[j]
        for i in range(n + j):
            total += own[j][i] * z[i]
        z = ca.vertcat(z, total)
    made["fed"] = _function("fed", [dx, gain, offset], [z[n:]])
    return made


def gains_of(n: int, m: int) -> int:
    """Return the number of gains of a stage."""
    return n * m + m * (m - 1) // 2


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
