"""A plan as functions: one closed SX function, a kernel for each Newton block, and one ca.Function with values and
status."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..results.status import Status
from .analysis.sizes import Sizes, sizes_of
from .blocks import VERDICTS, Margin
from .emission import express
from .newton import CORNER, CORRECTIONS, REACH, SINGULAR, TRUST, NewtonKernel
from .plan import CausalPlan
from .rows import PIVOT_TOLERANCE

# steps of equal length from the home pose; the call of a CausalFunction takes as many as it needs
STRIDES = 16
# largest remaining Newton step, in nominals, at convergence
REMAINING = 1e-9


def judged(
    inputs: Sequence[ca.SX],
    targets: Sequence[ca.SX],
    margins: ca.SX,
    facts: Sequence[Margin],
    sizes: Sizes | None = None,
    iteration: ca.SX | int = 0,
) -> ca.SX:
    """Return the code of `Status` as in `rows.status_codes`, from inputs and their sizes, the `iteration` code, margins
    and targets."""
    code = ca.if_else(_finite(targets), ca.SX(Status.OK), ca.SX(Status.NOT_FINITE))
    for k, m in reversed(list(enumerate(facts))):
        if m.kind in ("pivot", "branch"):
            good = (ca.fabs(margins[k]) if m.kind == "pivot" else margins[k]) > PIVOT_TOLERANCE * m.scale
        else:
            good = margins[k] >= 0
        code = ca.if_else(good, code, ca.SX(VERDICTS[m.kind]))
    code = ca.if_else(ca.SX(iteration) == 0, code, ca.SX(iteration))
    for k, m in enumerate(facts):
        if m.kind == "condition":  # on known values: it counts before the iteration
            code = ca.if_else(margins[k] >= 0, code, ca.SX(VERDICTS[m.kind]))
    if sizes is not None and inputs:
        code = ca.if_else(sizes.norm(inputs) <= sizes.most, code, ca.SX(Status.OUT_OF_RANGE))
    return ca.if_else(_finite(inputs), code, ca.SX(Status.NOT_FINITE))


def _finite(columns: Sequence[ca.SX]) -> ca.SX:
    good = ca.SX(1)
    for x in ca.vertsplit(ca.SX(ca.densify(ca.vertcat(*[ca.vec(c) for c in columns])))) if columns else []:
        good = ca.logic_and(good, ca.fabs(x) <= sys.float_info.max)
    return good


def guarded(
    closed: ca.Function,
    kernels: Sequence[NewtonKernel],
    facts: Sequence[Margin],
    sizes: Sizes | None,
    name: str,
    names_in: Sequence[str],
    names_out: Sequence[str],
) -> ca.Function:
    """Return the MX function inputs -> targets, status, margins.

    Each Newton block is continued from the home pose in STRIDES steps with the tests of `NewtonKernel.solve`. The
    status is NOT_CONVERGED if a test fails, even if shorter steps would have succeeded.
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
    code = judge.call([*inputs, *results, iteration])[0]
    return ca.Function(name, inputs, [*results[:-1], code, results[-1]], list(names_in), list(names_out))


def _followed(kernel: NewtonKernel, a: Any, name: str) -> tuple[Any, Any]:
    """Return the unknowns of a block at `a`, and a code of `Status` for the iteration."""
    z, p = ca.SX.sym("z", len(kernel.z0)), ca.SX.sym("p", len(kernel.a0))
    residual, jacobian = kernel.residual.call([z, p])
    options = {"error_on_fail": False, "abstol": 1e-13, "max_iter": CORRECTIONS, "show_eval_warnings": False}
    problem = {"x": z, "p": p, "g": residual}
    finder = ca.rootfinder(f"{name}_find", "newton", problem, options)
    # residual, derivatives, and the ratio of the smallest to the largest pivot, at one solution
    _, r = ca.qr(jacobian * ca.repmat(ca.DM(kernel.scale).T, len(kernel.z0), 1))
    pivots = ca.fabs(ca.diag(r))
    least = ca.mmin(pivots) / ca.mmax(pivots)
    at = ca.Function(f"{name}_at", [z, p], [residual, jacobian, kernel.sensitivity(z, p), least])
    home, start, scale = ca.MX(ca.DM(kernel.a0)), ca.MX(ca.DM(kernel.z0)), ca.MX(ca.DM(kernel.scale))
    for entries in map(list, kernel.even):
        sign = ca.DM.ones(len(kernel.a0))
        sign[entries] = -1.0
        a = ca.if_else(ca.dot(ca.DM(kernel.a0[entries]), a[entries]) < 0, sign * a, a)
    way = a - home
    here = start
    _, slope, by_a, _ = at.call([here, home])
    tangent = -ca.solve(slope, by_a @ way)
    good: Any = ca.MX(1)
    singular: Any = ca.MX(0)
    h = 1.0 / STRIDES
    for k in range(1, STRIDES + 1):
        target = a if k == STRIDES else home + k * h * way
        prediction = h * tangent
        solution = finder(x0=here + prediction, p=target)["x"]
        rest, slope, by_a, least_here = at.call([solution, target])
        new_tangent = -ca.solve(slope, by_a @ way)
        correction = ca.solve(slope, rest)
        step = (solution - here) / scale
        deviation = step - h / 2 * (tangent + new_tangent) / scale
        # comparisons fail for NaN
        near = ca.mmax(ca.fabs(prediction / scale)) <= REACH
        straight = ca.mmax(ca.fabs(deviation)) <= TRUST * ca.mmax(ca.fabs(step)) + CORNER
        converged = ca.sum1(ca.fabs(correction / scale)) <= REMAINING
        good = good * near * straight * converged
        here, tangent, singular = solution, new_tangent, ca.logic_not(least_here > SINGULAR)
    code = ca.if_else(good == 1, ca.if_else(singular, int(Status.SINGULAR), int(Status.OK)), int(Status.NOT_CONVERGED))
    return here, code


Pair = tuple[int, int]


@dataclass(frozen=True)
class CausalSignal:
    """A named input or output: shape () or (n,), unit, and its scalar chain symbols."""

    name: str
    shape: tuple[int, ...]
    unit: str
    pairs: tuple[Pair, ...]

    @property
    def size(self) -> int:
        return len(self.pairs)


def c_name(name: str) -> str:
    """Return a name as a C identifier: der(T,2) -> d2_T, arm[0].rod -> arm_0_rod."""
    order = 0
    while name.startswith("der("):
        inner = name[4:-1]
        base, comma, k = inner.rpartition(",")
        name, order = (base, order + int(k)) if comma and k.strip().isdigit() else (inner, order + 1)
    letters = (c if c.isascii() else f"u{ord(c):04x}" for c in name)
    text = "".join(c if c.isalnum() else "_" for c in letters).strip("_") or "f"
    while "__" in text:
        text = text.replace("__", "_")
    prefix = "" if order == 0 else ("d_" if order == 1 else f"d{order}_")
    text = prefix + text
    # CasADi refuses some words, and neither CasADi nor C allows a leading digit
    return f"f_{text}" if text in ("jac", "null", "hess") or text[0].isdigit() else text


@dataclass(frozen=True, eq=False)
class Built:
    """closed: (inputs..., z of each Newton block...) -> (targets..., margins). whole: (inputs...) -> (targets...,
    status, margins)."""

    closed: ca.Function
    kernels: list[NewtonKernel]
    whole: ca.Function


def build(
    plan: CausalPlan,
    inputs: Sequence[tuple[str, Sequence[Pair]]],
    outputs: Sequence[tuple[str, Sequence[Pair]]],
    name: str,
    parametric: bool = False,
) -> Built:
    """Build the functions of a plan; inputs and outputs are (C name, chain symbols).

    parametric: the parameter vector is the last input; otherwise the plan must contain numbers as parameters.
    """
    flat = plan.flat
    args = [ca.vertcat(*[flat.scope.symbol(*p) for p in pairs]) for _, pairs in inputs]
    names_in = [n for n, _ in inputs]
    if plan.uses_time:
        args.append(flat.scope.time)
        names_in.append("time")
    if parametric:
        args.append(flat.p)
        names_in.append("parameters")
    out = [ca.vertcat(*[plan.symbol(*p) for p in pairs]) for _, pairs in outputs]
    names_in = _distinct(names_in)
    z_names = _distinct([f"z{k}" for k in range(len(plan.newton))], names_in)
    names_out = [f"out_{n}" if n in names_in else n for n in [*(n for n, _ in outputs), "margins", "status"]]
    *names_out, status_name = _distinct(names_out, [*names_in, *z_names])
    with_status = [*names_out[:-1], status_name, names_out[-1]]
    facts = plan.margins
    # limits of sizes hold for one set of parameters only
    sizes = None if parametric else sizes_of(plan, [*[pairs for _, pairs in inputs], *([()] if plan.uses_time else [])])
    margins = [m.expression for m in facts]
    results = express(plan, [*out, ca.vertcat(*margins) if margins else ca.SX(0, 1)])
    if not plan.newton:
        status = judged(args, results[:-1], results[-1], facts, sizes)
        whole = ca.Function(name, args, [*results[:-1], status, results[-1]], names_in, with_status)
        return Built(ca.Function(name, args, results, names_in, names_out), [], whole)
    unknowns = [ca.vertcat(*b.unknowns) for b in plan.newton]
    closed = ca.Function(f"{name}_closed", [*args, *unknowns], results, [*names_in, *z_names], names_out)
    residuals = express(plan, [ca.vertcat(*b.residuals) for b in plan.newton])
    # kernels take their arguments as one column: inputs, then the unknowns of earlier blocks
    kernels, quaternions = [], _quaternions(plan, [p for _, pairs in inputs for p in pairs])
    for k, (block, r) in enumerate(zip(plan.newton, residuals, strict=True)):
        a, z = ca.vertcat(*args, *unknowns[:k]), unknowns[k]
        kernels.append(
            NewtonKernel(
                residual=ca.Function(f"{name}_r{k}", [z, a], ca.cse([r, ca.densify(ca.jacobian(r, z))])),
                sensitivity=ca.Function(f"{name}_s{k}", [z, a], [ca.densify(ca.jacobian(r, a))]),
                z0=_sample(plan, z),
                a0=_sample(plan, a),
                scale=block.scale,
                label=", ".join(block.labels),
                even=quaternions,
                starts=plan.chain.starts(block, a) if plan.chain and plan.chain.is_solved_by([block]) else None,
            )
        )
    return Built(closed, kernels, guarded(closed, kernels, facts, sizes, name, names_in, with_status))


def _quaternions(plan: CausalPlan, inputs: Sequence[Pair]) -> tuple[tuple[int, ...], ...]:
    """Return the positions of vectors of four with their derivatives: possible quaternions, which q and -q share."""
    vectors = [set(indices) for shape, indices in plan.flat.groups.values() if shape == (4,)]
    positions = (tuple(n for n, (index, _) in enumerate(inputs) if index in vector) for vector in vectors)
    return tuple(filter(None, positions))


def _distinct(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """Append a number to names that are already taken: `a.b` and `a_b` are both a_b in C."""
    distinct: list[str] = []
    for name in names:
        k, new = 1, name
        while new in distinct or new in taken:
            k += 1
            new = f"{name}_{k}"
        distinct.append(new)
    return distinct


def _sample(plan: CausalPlan, column: ca.SX) -> np.ndarray:
    """Return the values of a column of symbols at the first sample point and its time, with the parameter values."""
    flat = plan.flat
    known = {pair: n for n, pair in enumerate(plan.pairs)}
    parameters = {q.symbol.element_hash(): q.value for q in flat.parameters}
    parameters[flat.scope.time.element_hash()] = plan.sampler.time
    values = []
    for s in ca.vertsplit(column):
        pair = flat.scope.owner(s)
        if pair is not None:
            values.append(plan.samples[0][known[pair]] if pair in known else 0.0)
        else:
            values.append(parameters.get(s.element_hash(), 0.0))
    return np.array(values)
