"""Model parameters that stay settable in an FMU, and directional derivatives of a causal function in C, also through
Newton's solutions."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..cgen.body import body
from ..cgen.interface import Interface
from ..cgen.wrapper import scratch
from ..compiler.causal import CausalFunction, CausalSignal
from ..compiler.derivative import depends, given_by
from ..compiler.flat import FlatModel, FlatVariable
from ..compiler.plan import CausalPlan, make_plan
from ..lang.bind import ParameterRecord
from ..lang.declare import Declaration, Parameter
from ..lang.source import ModelError
from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class TangentFiles:
    """C files by name, header to include, and text of the static function `along`: (a: inputs and Newton's unknowns,
    da: their changes, computed for the unknowns) -> dy."""

    files: dict[str, str]
    header: str
    text: str


def tangents(f: CausalFunction, face: Interface, name: str) -> TangentFiles:
    """Return files and functions for the FMU `name`."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    z = ca.vertcat(*zs) if zs else ca.SX(0, 1)
    n = x.numel()
    full = ca.vertcat(x, z)
    seed = ca.SX.sym("s", full.numel())
    prefix = f"gt_{name}_slope"
    kernels = [_function(f"{prefix}_out", [full, seed], [ca.jtimes(outputs, full, seed)])]
    first = n
    for k, kernel in enumerate(f.kernels):
        size = len(kernel.z0)
        a, u, s = (ca.SX.sym(c, w) for c, w in (("a", first), ("z", size), ("s", first)))
        r, jacobian = kernel.residual.call([u, a])
        kernels += [
            _function(f"{prefix}_matrix{k}", [a, u], [ca.vec(ca.densify(jacobian).T)]),
            _function(f"{prefix}_out{k}", [a, u, s], [ca.jtimes(r, a, s)]),
        ]
        first += size
    source, header = body(f"{name}_slope", [], kernels)
    file = f"gt_{name}_slope_body"
    return TangentFiles({f"{file}.c": source, f"{file}.h": header}, f"{file}.h", _along(face, prefix, n))


def _function(name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ca.Function:
    return ca.Function(name, list(inputs), ca.cse([ca.densify(ca.SX(e)) for e in outputs]))


def _call(symbol: str, arguments: Sequence[str], result: str) -> str:
    lines = [*scratch(symbol), "\n"]
    lines += [f"    arg[{k}] = {a};\n" for k, a in enumerate(arguments)]
    lines += [f"    res[0] = {result};\n", f"    (void){symbol}(arg, res, iw, w, 0);\n"]
    return "    {\n" + "".join(f"    {line}" if line != "\n" else line for line in lines) + "    }\n"


def _solve(size: int, k: int, least: float) -> str:
    return (
        f"    smallest = DBL_MAX;\n    if (gt_newton_lu(matrix{k}, right, {size}, {least!r}, &smallest) == 0) {{\n"
        "        return GT_SINGULAR;\n    }\n"
    )


def _declared(face: Interface) -> str:
    if not face.newton:
        return ""
    most = max(s.size for s in face.newton)
    matrices = "".join(f"    double matrix{k}[{s.size**2}];\n" for k, s in enumerate(face.newton))
    return f"{matrices}    double right[{most}];\n    double smallest;\n    int k;\n\n"


def _along(face: Interface, prefix: str, n: int) -> str:
    """Return C that computes da of Newton's unknowns from da of the inputs, then dy."""
    lines = [
        f"static gt_status along(const double *a, double *da, double *dy)\n{{\n{_declared(face)}",
    ]
    offset = n
    for k, stage in enumerate(face.newton):
        lines += [
            _call(f"{prefix}_matrix{k}", ["a", f"&a[{offset}]"], f"matrix{k}"),
            _call(f"{prefix}_out{k}", ["a", f"&a[{offset}]", "da"], "right"),
            _solve(stage.size, k, 1e-300),
            f"    for (k = 0; k < {stage.size}; k++) {{\n        da[{offset} + k] = -right[k];\n    }}\n",
        ]
        offset += stage.size
    return "".join([*lines, _call(f"{prefix}_out", ["a", "da"], "dy"), "    return GT_OK;\n}\n\n"])


Pair = tuple[int, int]
ARGUMENT = "parameters"
SMALLEST = sys.float_info.min  # least value of a positive parameter: FMI's limits are inclusive


def with_parameters(f: CausalFunction, names: Sequence[str]) -> tuple[CausalFunction, list[CausalSignal]]:
    """Append these model parameters to the function's inputs; return the function and the new inputs.

    names: independent parameters, whole or one element, such as "m" or "m[0]". Their limits become `min` and `max` of
    variables in the function's model. Signs of roots and largest sizes of arguments stay those at the model's values.

    Raises ArgumentError for an unknown name, a parameter whose numbers are bound together, one that decides how the
    equations are solved, and one that the function does not depend on.
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
        raise ArgumentError(f"{', '.join(names)} contain one number twice; name it once", ARGUMENT)
    plan = _planned(f, order, names)
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
    function = CausalFunction(
        replace(plan, flat=model, numbers=f.plan), [*f.inputs, *signals], f.outputs, f.name, f.groups, f.preferred,
        f.branches,
    )  # fmt: skip
    used = set().union(*depends(function))
    offset = sum(s.size for s in f.inputs)
    for s in signals:
        if not used & set(range(offset, offset + s.size)):
            raise ArgumentError(f"{f.name} does not depend on '{s.name}'; leave it out", ARGUMENT)
        offset += s.size
    return function, signals


def _record(flat: FlatModel, name: str) -> tuple[tuple[int, ...], list[int], ParameterRecord]:
    """Return shape, indices in `flat.p` and declaration of a parameter, or of one element of it."""
    parameters = [r for r in flat.tree.parameters if isinstance(r.item, Parameter)]
    for r in parameters:
        if r.name == name and not r.indices:
            sources = ", ".join(dict.fromkeys(s.name().split("[")[0] for s in ca.symvar(r.expression)))
            sources = sources or "numbers in the model"
            raise ArgumentError(f"'{name}' is computed from {sources}; name those instead", ARGUMENT)
        if r.name == name:
            return r.shape, list(r.indices), r
        for n in r.indices:
            if flat.parameters[n].name == name:
                return (), [n], r
    available = ", ".join(f"'{r.name}'" for r in parameters if r.indices) or "none"
    raise ArgumentError(f"{flat.title} has no parameter '{name}'; it has {available}", ARGUMENT)


def _refuse_bound(flat: FlatModel, record: ParameterRecord, name: str) -> None:
    """Raise ArgumentError unless each number of the parameter can be checked on its own."""
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
            raise ArgumentError(f"'{r.name}' depends on '{name}' and has limits; leave '{name}' out", ARGUMENT)


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


def _planned(f: CausalFunction, symbolic: Sequence[int], names: Sequence[str]) -> CausalPlan:
    """Return the plan with symbols for these parameters; it must solve the equations as the numeric plan does."""
    flat = f.flat
    numbers = [q.symbol if n in symbolic else ca.SX(q.value) for n, q in enumerate(flat.parameters)]
    known = [i for _, _, indices in f.groups for i in indices]
    targets = [p for s in f.outputs for p in s.pairs]
    decides = f"the value of {' or '.join(map(repr, names))} decides how the equations of {f.name} are solved"
    try:
        plan = make_plan(flat, known, targets, f.preferred, f.branches, fold=ca.vertcat(*numbers))
    except ModelError as error:
        raise ArgumentError(f"{decides}: {error}", ARGUMENT) from error
    if _structure(plan) != _structure(f.plan):
        raise ArgumentError(f"{decides}; leave it out", ARGUMENT)
    return plan


def _structure(plan: CausalPlan) -> tuple[object, ...]:
    """Return the parts that must not depend on numbers: inputs, Newton's unknowns, and the choice at each root."""
    newton = [[u.element_hash() for u in b.unknowns] for b in plan.newton]
    roots = sorted((r.settled_by, r.value) for b in plan.blocks for r in b.roots)
    return plan.inputs, plan.uses_time, newton, roots
