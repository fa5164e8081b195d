"""Parameters of a model that stay parameters of its unit: inputs of the body in place of numbers in the code."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction, CausalSignal
from ..compiler.flat import FlatModel, FlatVariable
from ..compiler.plan import CausalPlan, make_plan
from ..lang.bind import ParameterRecord
from ..lang.declare import Declaration, Parameter
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from .tangents import depends

Pair = tuple[int, int]
ARGUMENT = "parameters"
SMALLEST = sys.float_info.min  # of a parameter that is declared positive: limits of FMI belong to the interval


def with_parameters(f: CausalFunction, names: Sequence[str]) -> tuple[CausalFunction, list[CausalSignal]]:
    """The function with these parameters of its model as further inputs, the last ones, and these inputs.

    names: of parameters with values of their own, whole or one element, as "m" or "m[0]". Limits are `min` and `max` of
    their variables in the function's model. Roots keep the signs, and arguments the largest sizes, that they have at
    the model's own values.

    Raises ArgumentError for a name that is none, a parameter whose numbers are bound together, and one that decides how
    the equations are solved or that the function does not depend on.
    """
    flat = f.flat
    chosen: dict[str, tuple[tuple[int, ...], list[int], ParameterRecord]] = {}
    if twice := [name for name in names if list(names).count(name) > 1]:
        raise ArgumentError(f"'{twice[0]}' is named twice; name it once", ARGUMENT)
    for name in names:
        shape, places, record = _record(flat, name)
        _refuse_bound(flat, record, name)
        chosen[name] = shape, places, record
    order = [n for _, places, _ in chosen.values() for n in places]
    if len(set(order)) != len(order):
        raise ArgumentError(f"{', '.join(names)} name one number twice; name it once", ARGUMENT)
    plan = _planned(f, order, names)
    first, values = len(flat.variables), []
    signals = []
    for name, (shape, places, record) in chosen.items():
        pairs = tuple((first + len(values) + k, 0) for k in range(len(places)))
        signals.append(CausalSignal(name, shape, record.item.unit or "?", pairs))
        values += [_variable(flat, n, pair[0], record) for n, pair in zip(places, pairs, strict=True)]
    scope = copy(flat.scope)  # a chain that is never differentiated: the symbol of the parameter
    scope.chains = [*scope.chains, *[[flat.parameters[n].symbol] for n in order]]
    scope.names = [*scope.names, *[flat.parameters[n].name for n in order]]
    groups = {s.name: (s.shape, [i for i, _ in s.pairs]) for s in signals}
    own = replace(flat, scope=scope, variables=[*flat.variables, *values], groups={**flat.groups, **groups}, cache={})
    made = CausalFunction(
        replace(plan, flat=own, numbers=f.plan), [*f.inputs, *signals], f.outputs, f.name, f.groups, f.preferred,
        f.branches,
    )  # fmt: skip
    used = set().union(*depends(made))
    at = sum(s.size for s in f.inputs)
    for s in signals:
        if not used & set(range(at, at + s.size)):
            raise ArgumentError(f"'{s.name}' does not enter what {f.name} computes; leave it out", ARGUMENT)
        at += s.size
    return made, signals


def _record(flat: FlatModel, name: str) -> tuple[tuple[int, ...], list[int], ParameterRecord]:
    """Shape, places in `flat.p` and declaration of a parameter, or of one element of it."""
    own = [r for r in flat.tree.parameters if isinstance(r.item, Parameter)]
    for r in own:
        if r.name == name and not r.indices:
            sources = ", ".join(dict.fromkeys(s.name().split("[")[0] for s in ca.symvar(r.expression)))
            raise ArgumentError(f"'{name}' follows from {sources or 'numbers in the model'}; name that", ARGUMENT)
        if r.name == name:
            return r.shape, list(r.indices), r
        for n in r.indices:
            if flat.parameters[n].name == name:
                return (), [n], r
    there = ", ".join(f"'{r.name}'" for r in own if r.indices) or "none"
    raise ArgumentError(f"{flat.title} has no parameter '{name}'; it has {there}", ARGUMENT)


def _refuse_bound(flat: FlatModel, record: ParameterRecord, name: str) -> None:
    """A number alone must say whether it is allowed."""
    item = record.item
    assert isinstance(item, Parameter)
    if item.kind is not None or item.increasing:
        what = "increasing" if item.increasing else f"a {item.kind}"
        raise ArgumentError(
            f"'{name}' is declared {what}: its numbers cannot be set one by one; leave it out", ARGUMENT
        )
    bounds = [r for r in flat.tree.parameters for b in (r.item.low, r.item.high) if isinstance(b, Declaration)
              and (r is record or (b.name, r.component) == (item.name, record.component))]  # fmt: skip
    if bounds:
        raise ArgumentError(f"the limits of '{bounds[0].name}' are other parameters; leave '{name}' out", ARGUMENT)
    symbols = ca.vertcat(*[flat.parameters[n].symbol for n in record.indices])
    for r in flat.tree.parameters:
        limited = isinstance(r.item, Parameter) and _is_limited(r.item)
        if limited and not r.indices and not _plain(r.expression) and ca.depends_on(r.expression, symbols):
            raise ArgumentError(f"'{r.name}' follows from '{name}' and has limits of its own; leave it out", ARGUMENT)


def _is_limited(item: Parameter) -> bool:
    return item.nonzero or item.increasing or item.kind is not None or item.low is not None or item.high is not None


def _plain(expression: ca.SX) -> bool:
    """Whether an expression of parameters is only these, under another name, or numbers."""
    return all(e.is_symbolic() or e.is_constant() for e in ca.vertsplit(ca.vec(ca.densify(expression))))


def _variable(flat: FlatModel, n: int, index: int, record: ParameterRecord) -> FlatVariable:
    """A parameter as a variable that begins at its value, with the limits of all declarations that are bound to it."""
    q = flat.parameters[n]
    low, high = [q.min], [q.max]
    for r in flat.tree.parameters:
        item = r.item
        if not isinstance(item, Parameter):
            continue
        entries = ca.vertsplit(ca.vec(ca.densify(r.expression).T))  # by rows
        for k, e in enumerate(entries):
            if e.is_symbolic() and e.element_hash() == q.symbol.element_hash():
                low.append(_limit(item.low, r.shape, k, -np.inf))
                high.append(_limit(item.high, r.shape, k, np.inf))
    if q.name in flat.positive:
        low.append(SMALLEST)
    return FlatVariable(
        q.name, index, "parameter", q.unit, record.component, q.where, record.item.description,
        abs(q.value) or 1.0, max(low), min(high), q.value,
    )  # fmt: skip


def _limit(value: object, shape: tuple[int, ...], k: int, default: float) -> float:
    return default if value is None else float(np.broadcast_to(np.asarray(value, float), shape).reshape(-1)[k])


def _planned(f: CausalFunction, kept: Sequence[int], names: Sequence[str]) -> CausalPlan:
    """The plan with symbols for these places, which solves the equations in the way of numbers."""
    flat = f.flat
    numbers = [q.symbol if n in kept else ca.SX(q.value) for n, q in enumerate(flat.parameters)]
    known = [i for _, _, indices in f.groups for i in indices]
    wanted = [p for s in f.outputs for p in s.pairs]
    decides = f"{' or '.join(map(repr, names))} decides how the equations of {f.name} are solved"
    try:
        plan = make_plan(flat, known, wanted, f.preferred, f.branches, fold=ca.vertcat(*numbers))
    except ModelError as error:
        raise ArgumentError(f"{decides}, and its number is needed for that: {error}", ARGUMENT) from error
    if _way(plan) != _way(f.plan):
        raise ArgumentError(f"{decides}, and its number is needed for that; leave it out", ARGUMENT)
    return plan


def _way(plan: CausalPlan) -> tuple[object, ...]:
    """What must not depend on numbers: inputs, unknowns of Newton's method, and the choice at each root."""
    newton = [[u.element_hash() for u in b.unknowns] for b in plan.newton]
    roots = sorted((r.settled_by, r.value) for b in plan.blocks for r in b.roots)
    return plan.inputs, plan.uses_time, newton, roots
