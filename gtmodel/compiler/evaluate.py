"""A plan as functions: one closed SX function, a kernel for each Newton block, and a ca.Function of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .analysis.sizes import sizes_of
from .analysis.whole import judged, whole as followed
from .emit import express
from .newton import NewtonKernel
from .plan import CausalPlan

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Built:
    """closed: (inputs..., z of each Newton block...) -> (targets..., margins); `whole` has no z, and its outputs are
    (targets..., status, margins)."""

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
    """Functions for a plan; inputs and outputs are (C name, chain symbols).

    parametric: the parameter vector is the last input; else the plan must have numbers folded in.
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
    # other parameters are other lengths
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
    # kernels take all that is given as one column: inputs, then the unknowns of earlier blocks
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
            )
        )
    return Built(closed, kernels, followed(closed, kernels, facts, sizes, name, names_in, with_status))


def _quaternions(plan: CausalPlan, given: Sequence[Pair]) -> tuple[tuple[int, ...], ...]:
    """Places of vectors of four, each with its derivatives: they may be quaternions, which turn as their opposites."""
    vectors = [set(indices) for shape, indices in plan.flat.groups.values() if shape == (4,)]
    places = (tuple(n for n, (index, _) in enumerate(given) if index in vector) for vector in vectors)
    return tuple(filter(None, places))


def _distinct(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """The names with a number behind those that are taken: `a.b` and `a_b` are both a_b in C."""
    distinct: list[str] = []
    for name in names:
        k, new = 1, name
        while new in distinct or new in taken:
            k += 1
            new = f"{name}_{k}"
        distinct.append(new)
    return distinct


def _sample(plan: CausalPlan, column: ca.SX) -> np.ndarray:
    """Values of a column of symbols at the first sample point and its time; parameters at their values."""
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
