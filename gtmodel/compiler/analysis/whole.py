"""A causality as one ca.Function that says with its values whether they are an answer."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import casadi as ca

from ...results.status import Status
from ..blocks import VERDICTS, Margin
from ..newton import CORNER, CORRECTIONS, REACH, SINGULAR, TRUST, NewtonKernel
from ..rows import PIVOT_TOLERANCE
from .sizes import Sizes

# steps of equal length from the home pose: the call of a CausalFunction takes as many as it needs
STRIDES = 16
# a Newton step that is left, in nominals, where the iteration has converged
LEFT = 1e-9


def judged(
    inputs: Sequence[ca.SX],
    targets: Sequence[ca.SX],
    margins: ca.SX,
    facts: Sequence[Margin],
    sizes: Sizes | None = None,
    iteration: ca.SX | int = 0,
) -> ca.SX:
    """Code of `Status`, decided as `rows.status_codes` does: inputs and their sizes, iterations (`iteration`), margins,
    targets."""
    code = ca.if_else(_finite(targets), ca.SX(Status.OK), ca.SX(Status.NOT_FINITE))
    for k, m in reversed(list(enumerate(facts))):
        if m.kind in ("pivot", "branch"):
            good = (ca.fabs(margins[k]) if m.kind == "pivot" else margins[k]) > PIVOT_TOLERANCE * m.scale
        else:
            good = margins[k] >= 0
        code = ca.if_else(good, code, ca.SX(VERDICTS[m.kind]))
    code = ca.if_else(ca.SX(iteration) == 0, code, ca.SX(iteration))
    if sizes is not None and inputs:
        code = ca.if_else(sizes.norm(inputs) <= sizes.most, code, ca.SX(Status.OUT_OF_RANGE))
    return ca.if_else(_finite(inputs), code, ca.SX(Status.NOT_FINITE))


def _finite(columns: Sequence[ca.SX]) -> ca.SX:
    good = ca.SX(1)
    for x in ca.vertsplit(ca.SX(ca.densify(ca.vertcat(*[ca.vec(c) for c in columns])))) if columns else []:
        good = ca.logic_and(good, ca.fabs(x) <= sys.float_info.max)
    return good


def whole(
    closed: ca.Function,
    kernels: Sequence[NewtonKernel],
    facts: Sequence[Margin],
    sizes: Sizes | None,
    name: str,
    names_in: Sequence[str],
    names_out: Sequence[str],
) -> ca.Function:
    """MX function of the inputs alone: targets, status, margins.

    Each Newton block is followed from the home pose in STRIDES steps, under the tests of `NewtonKernel.solve`; the
    status is NOT_CONVERGED where one of them fails, also where shorter steps would have led there.
    """
    count = len(names_in)
    inputs: list[Any] = [ca.MX.sym(n, closed.sparsity_in(k)) for k, n in enumerate(names_in)]
    zs: list[Any] = []
    iteration: Any = ca.MX(0)
    for k, kernel in enumerate(kernels):
        z, code = _followed(kernel, ca.vertcat(*inputs, *zs), f"{name}_{k}")
        zs.append(z)
        iteration = ca.if_else(iteration == 0, code, iteration)
    results = closed.call([*inputs, *zs])
    args = [ca.SX.sym(n, closed.sparsity_in(k)) for k, n in enumerate(names_in)]
    outs = [ca.SX.sym(f"y{k}", closed.sparsity_out(k)) for k in range(closed.n_out())]
    code = ca.SX.sym("iteration")
    status = judged(args[:count], outs[:-1], outs[-1], facts, sizes, code)
    judge = ca.Function(f"{name}_judge", [*args, *outs, code], [status])
    said = judge.call([*inputs, *results, iteration])[0]
    return ca.Function(name, inputs, [*results[:-1], said, results[-1]], list(names_in), list(names_out))


def _followed(kernel: NewtonKernel, a: Any, name: str) -> tuple[Any, Any]:
    """Unknowns of a block at `a`, and a code of `Status` for the iteration."""
    z, p = ca.SX.sym("z", len(kernel.z0)), ca.SX.sym("p", len(kernel.a0))
    residual, jacobian = kernel.residual.call([z, p])
    options = {"error_on_fail": False, "abstol": 1e-13, "max_iter": CORRECTIONS, "show_eval_warnings": False}
    problem = {"x": z, "p": p, "g": residual}
    finder = ca.rootfinder(f"{name}_find", "newton", problem, options)
    # what is left of a Newton step, and the smallest part of the largest pivot, as numbers of one solution
    _, r = ca.qr(jacobian * ca.repmat(ca.DM(kernel.scale).T, len(kernel.z0), 1))
    pivots = ca.fabs(ca.diag(r))
    least = ca.mmin(pivots) / ca.mmax(pivots)
    at = ca.Function(f"{name}_at", [z, p], [residual, jacobian, kernel.sensitivity(z, p), least])
    home, start, scale = ca.MX(ca.DM(kernel.a0)), ca.MX(ca.DM(kernel.z0)), ca.MX(ca.DM(kernel.scale))
    for places in map(list, kernel.even):
        sign = ca.DM.ones(len(kernel.a0))
        sign[places] = -1.0
        a = ca.if_else(ca.dot(ca.DM(kernel.a0[places]), a[places]) < 0, sign * a, a)
    way = a - home
    here = start
    _, slope, by_a, _ = at.call([here, home])
    tangent = -ca.solve(slope, by_a @ way)
    good: Any = ca.MX(1)
    singular: Any = ca.MX(0)
    h = 1.0 / STRIDES
    for k in range(1, STRIDES + 1):
        there = a if k == STRIDES else home + k * h * way
        ahead = h * tangent
        z_there = finder(x0=here + ahead, p=there)["x"]
        rest, slope, by_a, least_here = at.call([z_there, there])
        behind = -ca.solve(slope, by_a @ way)
        left = ca.solve(slope, rest)
        gone = (z_there - here) / scale
        off = gone - h / 2 * (tangent + behind) / scale
        # written so that NaN fails
        near = ca.mmax(ca.fabs(ahead / scale)) <= REACH
        straight = ca.mmax(ca.fabs(off)) <= TRUST * ca.mmax(ca.fabs(gone)) + CORNER
        converged = ca.sum1(ca.fabs(left / scale)) <= LEFT
        good = good * near * straight * converged
        here, tangent, singular = z_there, behind, ca.logic_not(least_here > SINGULAR)
    code = ca.if_else(good == 1, ca.if_else(singular, int(Status.SINGULAR), int(Status.OK)), int(Status.NOT_CONVERGED))
    return here, code
