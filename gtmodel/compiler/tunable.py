"""Functions of which some model parameters are inputs: one plan and one compilation for all their values."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from .._lazy import hint
from ..lang.bind import ParameterRecord
from ..lang.declarations import Declaration, Parameter
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from .derivative import depends
from .evaluate import CausalSignal
from .flat import FlatModel, FlatVariable
from .plan import CausalPlan, make_plan

if TYPE_CHECKING:
    from .causal import CausalFunction
else:
    CausalFunction = hint("gtmodel.compiler.causal", "CausalFunction")

SMALLEST = sys.float_info.min  # least value of a positive parameter: FMI's limits are inclusive


def with_parameters(
    f: CausalFunction, names: Sequence[str], argument: str
) -> tuple[CausalFunction, list[CausalSignal]]:
    """Append these model parameters to the function's inputs; return the function and the new inputs.

    names: independent parameters, whole or one element, such as "m" or "m[0]"; argument: their name in a refusal.
    Their limits become `min` and `max` of variables in the function's model. Signs of roots and largest sizes of
    arguments stay those at the model's values.

    Raises ArgumentError for an unknown name, a parameter whose numbers are bound together, one that decides how the
    equations are solved, and one that the function does not depend on.
    """
    flat = f.flat
    chosen: dict[str, tuple[tuple[int, ...], list[int], ParameterRecord]] = {}
    if twice := [name for name in names if list(names).count(name) > 1]:
        raise ArgumentError(f"'{twice[0]}' is named twice; name it once", argument)
    for name in names:
        shape, places, record = _record(flat, name, argument)
        _refuse_bound(flat, record, name, argument)
        chosen[name] = shape, places, record
    order = [n for _, places, _ in chosen.values() for n in places]
    if len(set(order)) != len(order):
        raise ArgumentError(f"{', '.join(names)} contain one number twice; name it once", argument)
    plan = _planned(f, order, names, argument)
    first, values = len(flat.variables), []
    signals = []
    for name, (shape, places, record) in chosen.items():
        pairs = tuple((first + len(values) + k, 0) for k in range(len(places)))
        signals.append(CausalSignal(name, shape, record.item.unit or "?", pairs))
        values += [_variable(flat, n, pair[0], record) for n, pair in zip(places, pairs, strict=True)]
    scope = copy(flat.scope)  # the chain of a parameter is its symbol alone, without derivatives
    scope.chains = [*scope.chains, *[[flat.parameters[n].symbol] for n in order]]
    scope.names = [*scope.names, *[flat.parameters[n].name for n in order]]
    groups = {s.name: (s.shape, [i for i, _ in s.pairs]) for s in signals}
    model = replace(flat, scope=scope, variables=[*flat.variables, *values], groups={**flat.groups, **groups}, cache={})
    function = f.again(replace(plan, flat=model, numbers=f.plan), [*f.inputs, *signals])
    used = set().union(*depends(function))
    offset = sum(s.size for s in f.inputs)
    for s in signals:
        if not used & set(range(offset, offset + s.size)):
            raise ArgumentError(f"{f.name} does not depend on '{s.name}'; leave it out", argument)
        offset += s.size
    return function, signals


def _record(flat: FlatModel, name: str, argument: str) -> tuple[tuple[int, ...], list[int], ParameterRecord]:
    """Return shape, indices in `flat.p` and declaration of a parameter, or of one element of it."""
    parameters = [r for r in flat.tree.parameters if isinstance(r.item, Parameter)]
    for r in parameters:
        if r.name == name and not r.indices:
            sources = ", ".join(dict.fromkeys(s.name().split("[")[0] for s in ca.symvar(r.expression)))
            sources = sources or "numbers in the model"
            raise ArgumentError(f"'{name}' is computed from {sources}; name those instead", argument)
        if r.name == name:
            return r.shape, list(r.indices), r
        for n in r.indices:
            if flat.parameters[n].name == name:
                return (), [n], r
    available = ", ".join(f"'{r.name}'" for r in parameters if r.indices) or "none"
    raise ArgumentError(f"{flat.title} has no parameter '{name}'; it has {available}", argument)


def _refuse_bound(flat: FlatModel, record: ParameterRecord, name: str, argument: str) -> None:
    """Raise ArgumentError unless each number of the parameter can be checked on its own."""
    item = record.item
    assert isinstance(item, Parameter)
    if item.kind is not None or item.increasing:
        what = "increasing" if item.increasing else f"a {item.kind}"
        raise ArgumentError(
            f"'{name}' is declared {what}: its numbers cannot be set one by one; leave it out", argument
        )
    bounds = [r for r in flat.tree.parameters for b in (r.item.low, r.item.high) if isinstance(b, Declaration)
              and (r is record or (b.name, r.component) == (item.name, record.component))]  # fmt: skip
    if bounds:
        raise ArgumentError(f"the limits of '{bounds[0].name}' are other parameters; leave '{name}' out", argument)
    symbols = ca.vertcat(*[flat.parameters[n].symbol for n in record.indices])
    for r in flat.tree.parameters:
        limited = isinstance(r.item, Parameter) and _is_limited(r.item)
        if limited and not r.indices and not _plain(r.expression) and ca.depends_on(r.expression, symbols):
            raise ArgumentError(f"'{r.name}' depends on '{name}' and has limits; leave '{name}' out", argument)


def _is_limited(item: Parameter) -> bool:
    return item.nonzero or item.increasing or item.kind is not None or item.low is not None or item.high is not None


def _plain(expression: ca.SX) -> bool:
    """Return whether an expression consists of parameters and numbers only, without operations."""
    return all(e.is_symbolic() or e.is_constant() for e in ca.vertsplit(ca.vec(ca.densify(expression))))


def _variable(flat: FlatModel, n: int, index: int, record: ParameterRecord) -> FlatVariable:
    """Return a parameter as a variable that starts at its value, with the limits of all declarations bound to it."""
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


def _planned(f: CausalFunction, symbolic: Sequence[int], names: Sequence[str], argument: str) -> CausalPlan:
    """Return the plan with symbols for these parameters; it must solve the equations as the numeric plan does."""
    flat = f.flat
    numbers = [q.symbol if n in symbolic else ca.SX(q.value) for n, q in enumerate(flat.parameters)]
    known = [i for _, _, indices in f.groups for i in indices]
    targets = [p for s in f.outputs for p in s.pairs]
    decides = f"the value of {' or '.join(map(repr, names))} decides how the equations of {f.name} are solved"
    try:
        plan = make_plan(flat, known, targets, f.preferred, f.branches, fold=ca.vertcat(*numbers))
    except ModelError as error:
        raise ArgumentError(f"{decides}: {error}", argument) from error
    if _structure(plan) != _structure(f.plan):
        raise ArgumentError(f"{decides}; leave it out", argument)
    return plan


def _structure(plan: CausalPlan) -> tuple[object, ...]:
    """Return the parts that must not depend on numbers: inputs, Newton's unknowns, and the choice at each root."""
    newton = [[u.element_hash() for u in b.unknowns] for b in plan.newton]
    roots = sorted((r.settled_by, r.value) for b in plan.blocks for r in b.roots)
    return plan.inputs, plan.uses_time, newton, roots
