"""Parameters of a model that stay parameters of its unit, and derivatives of a causal function in C along a seed,
through Newton's solutions too."""

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
from ..compiler.flat import FlatModel, FlatVariable
from ..compiler.plan import CausalPlan, make_plan
from ..lang.bind import ParameterRecord
from ..lang.declare import Declaration, Parameter
from ..lang.source import ModelError
from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class TangentFiles:
    """C files by name, the header to include, and text of the static function `along`: (a: inputs and unknowns of
    Newton, da: their changes, of the unknowns computed) -> dy."""

    files: dict[str, str]
    header: str
    text: str


def given_by(f: CausalFunction) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
    """Symbols of the inputs, of the unknowns of Newton, and all outputs as a column."""
    args = f.closed.sx_in()
    blocks = len(f.kernels)
    inputs = args[: len(args) - blocks]
    results = f.closed.call(args)[: len(f.outputs)]
    return inputs, args[len(args) - blocks :], ca.vertcat(*[ca.densify(ca.SX(r)) for r in results])


def depends(f: CausalFunction) -> list[set[int]]:
    """Of each output number which input numbers it depends on."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    n = x.numel()
    of_z: list[set[int]] = []
    for kernel, z in zip(f.kernels, zs, strict=True):
        a, own = ca.SX.sym("a", len(kernel.a0)), ca.SX.sym("z", z.numel())
        r = kernel.residual.call([own, a])[0]
        columns = set(ca.jacobian_sparsity(r, a).get_triplet()[1])
        inner = {c for c in columns if c < n}
        for c in columns - inner:
            inner |= of_z[c - n]
        of_z += [inner] * z.numel()
    full = ca.vertcat(x, *zs)
    rows, columns = ca.jacobian_sparsity(outputs, full).get_triplet()
    result: list[set[int]] = [set() for _ in range(outputs.numel())]
    for r, c in zip(rows, columns, strict=True):
        result[r] |= {c} if c < n else of_z[c - n]
    return result


def tangents(f: CausalFunction, face: Interface, name: str) -> TangentFiles:
    """Files and functions for the unit `name`."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    z = ca.vertcat(*zs) if zs else ca.SX(0, 1)
    n = x.numel()
    full = ca.vertcat(x, z)
    seed = ca.SX.sym("s", full.numel())
    own = f"gt_{name}_slope"
    kernels = [_function(f"{own}_out", [full, seed], [ca.jtimes(outputs, full, seed)])]
    first = n
    for k, kernel in enumerate(f.kernels):
        size = len(kernel.z0)
        a, u, s = (ca.SX.sym(c, w) for c, w in (("a", first), ("z", size), ("s", first)))
        r, jacobian = kernel.residual.call([u, a])
        kernels += [
            _function(f"{own}_matrix{k}", [a, u], [ca.vec(ca.densify(jacobian).T)]),
            _function(f"{own}_out{k}", [a, u, s], [ca.jtimes(r, a, s)]),
        ]
        first += size
    source, header = body(f"{name}_slope", [], kernels)
    file = f"gt_{name}_slope_body"
    return TangentFiles({f"{file}.c": source, f"{file}.h": header}, f"{file}.h", _along(face, own, n))


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
    own = "".join(f"    double matrix{k}[{s.size**2}];\n" for k, s in enumerate(face.newton))
    return f"{own}    double right[{most}];\n    double smallest;\n    int k;\n\n"


def _along(face: Interface, own: str, n: int) -> str:
    """da of the inputs is given, that of Newton's unknowns follows, then dy."""
    lines = [
        f"static gt_status along(const double *a, double *da, double *dy)\n{{\n{_declared(face)}",
    ]
    at = n
    for k, stage in enumerate(face.newton):
        lines += [
            _call(f"{own}_matrix{k}", ["a", f"&a[{at}]"], f"matrix{k}"),
            _call(f"{own}_out{k}", ["a", f"&a[{at}]", "da"], "right"),
            _solve(stage.size, k, 1e-300),
            f"    for (k = 0; k < {stage.size}; k++) {{\n        da[{at} + k] = -right[k];\n    }}\n",
        ]
        at += stage.size
    return "".join([*lines, _call(f"{own}_out", ["a", "da"], "dy"), "    return GT_OK;\n}\n\n"])


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
