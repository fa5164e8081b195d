"""Which sub-expression is not a finite number: the operation, its arguments, the equation with its line, and when."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.rewriting import of_expression
from ..lang.source import SourceLocation
from .formulation.system import on_rows
from .judgement.places import Remark, objective_place, row_place, variable_place
from .nlp import Nlp, instants, placed
from .solution import constants, mesh_fractions, states_and_controls

SIGNS = {ca.OP_DIV: "/", ca.OP_MUL: "*", ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_POW: "**", ca.OP_CONSTPOW: "**"}


Step = tuple[str, ca.SX]  # something that is computed at a point: its name, and it in symbols of known values


def not_finite(nlp: Nlp, x: np.ndarray) -> Remark:
    """A remark on the first operation without a finite value, or else without a finite derivative, at any collocation
    point; nothing where all is finite."""
    if not np.all(np.isfinite(x)):
        return Remark("")
    mesh = placed(nlp, x)
    s = mesh_fractions(mesh)[1:]
    xs, rates, us, times = states_and_controls(nlp, x, s)
    P = constants(nlp, x)
    problem = nlp.problem
    arguments = problem.arguments
    steps, symbols, values = _computed(nlp)
    everything = ca.Function("computed", arguments, [values, ca.jacobian(values, ca.vertcat(*arguments[:3])).nz[:]])
    numbers, jacobian = on_rows(everything, (xs, rates, us), P, times)
    for infinite_slope in (False, True):
        table = jacobian if infinite_slope else numbers
        bad = np.flatnonzero(~np.all(np.isfinite(table), axis=0))
        if not bad.size:
            continue
        k = int(bad[0])
        given = dict(zip((v.element_hash() for v in symbols), numbers[:, k], strict=True))
        for column, row in zip(arguments, (xs[k], rates[k], us[k], P, times[k : k + 1]), strict=True):
            own = ca.vertsplit(ca.vec(column)) if column.numel() else []
            given |= dict(zip((v.element_hash() for v in own), row, strict=True))
        for label, expression in steps:
            term = _first(expression, given, infinite_slope)
            if term:
                slope = "the slope of " if infinite_slope else ""
                element = min(mesh.elements, int(np.searchsorted(mesh.edges, s[k] - 1e-12, side="right")))
                said = f"{slope}{term} in {label} at {times[k]:.4g} s (element {element}) is not finite"
                return Remark(said, _label_place(nlp, label))
    return _at_instants(nlp, x)


def _label_place(nlp: Nlp, label: str) -> SourceLocation | None:
    """Where what is called so is written."""
    if label.endswith("objective"):
        return objective_place(nlp.problem)
    if label.startswith("the rate of "):
        return variable_place(nlp.problem, label.removeprefix("the rate of "))
    return row_place(nlp.problem, label.strip("'"))


def _at_instants(nlp: Nlp, x: np.ndarray) -> Remark:
    """The same of what holds values at instants: the objective beside its integrals, and point constraints."""
    problem = nlp.problem
    rows = [("the objective", problem.mayer)] + [(f"'{r.label}'", r.expression) for r in problem.points]
    held = instants(problem, placed(nlp, x), nlp.element.layout, nlp.p_scale, [])
    expressions = [e for _, e in rows]
    if held.old.numel():
        expressions = ca.substitute(expressions, [held.old], [held.new])
    given = {s.element_hash(): v for s, v in zip(ca.vertsplit(held.z), x[held.index].tolist(), strict=True)}
    for infinite_slope in (False, True):
        for (label, _), e in zip(rows, expressions, strict=True):
            term = _first(e, given, infinite_slope)
            if term:
                said = f"{'the slope of ' if infinite_slope else ''}{term} in {label} is not finite"
                return Remark(said, _label_place(nlp, label))
    return Remark("")


def _computed(nlp: Nlp) -> tuple[list[Step], list[ca.SX], ca.SX]:
    """What is computed at a point in order; symbols of intermediate results, and these with the rows as expressions of
    the problem's own symbols."""
    problem = nlp.problem
    builder, plan, flat = problem.builder, problem.plan, problem.flat
    steps: list[Step] = []
    symbols: list[ca.SX] = []
    if builder.kind != "dae":
        taken = {p: e for p, e in builder.rates.items()}
        taken |= {p: sign * builder.u[n] for p, (n, sign) in builder.control_symbols.items()}
        computed = {flat.scope.symbol(*p).element_hash() for p in taken}
        pairs = [(flat.p, plan.parameters)] if flat.parameters else []
        pairs += [(r.sign, ca.SX(r.value)) for b in plan.blocks for r in b.roots]
        pairs += [(flat.scope.symbol(*p), v) for p, v in taken.items()]
        old, new = (ca.vertcat(*side) for side in zip(*pairs, strict=True)) if pairs else (ca.SX(0, 1), ca.SX(0, 1))
        for block in plan.blocks:
            equations = "; ".join(dict.fromkeys(block.equations))
            for symbol, expression in block.assignments:
                if symbol.element_hash() not in computed or builder.kind == "inverse":
                    steps.append((f"'{equations}'", ca.substitute([expression], [old], [new])[0]))
                    symbols.append(symbol)
    own = builder.express(symbols, with_controls=builder.kind != "inverse") if symbols else []
    named = zip(problem.state_names, problem.rates, strict=True)
    rows: list[tuple[str, ca.SX]] = [(f"the rate of {n}", r) for n, r in named if r is not None]
    rows += [(f"'{label}'", problem.algebraic[n]) for n, label in enumerate(problem.algebraic_labels)]
    rows += [(f"'{r.label}'", r.expression) for r in problem.path]
    rows += [("an integral of the objective", e) for _, e, _ in problem.integrals]
    steps += rows
    values = ca.vertcat(*own, *[e for _, e in rows]) if own or rows else ca.SX(0, 1)
    symbols += [ca.SX.sym("row") for _ in rows]
    return steps, symbols, values


def _first(expression: ca.SX, given: dict[int, float], infinite_slope: bool) -> str:
    """The first operation of an expression whose arguments are finite, but not its value (or its derivative)."""
    read, free = of_expression(expression)
    memory: list[float] = []
    for op, reads, place, constant in read:
        arguments = [memory[i] for i in reads]
        if op == ca.OP_INPUT:
            value = given.get(free[place].element_hash(), np.nan)
        elif op == ca.OP_CONST:
            value = constant
        elif op == ca.OP_OUTPUT:
            value = arguments[0]
        else:
            value = float(ca.DM.unary(op, arguments[0]) if len(reads) == 1 else ca.DM.binary(op, *arguments))
            if all(np.isfinite(arguments)) and (_steep(op, arguments) if infinite_slope else not np.isfinite(value)):
                return _written(op, arguments)
        memory.append(float(value))
    return ""


def _steep(op: int, a: list[float]) -> bool:
    """Is the derivative infinite, though the value is not?"""
    if op == ca.OP_SQRT:
        return a[0] == 0.0
    if op in (ca.OP_ACOS, ca.OP_ASIN):
        return abs(a[0]) == 1.0
    if op in (ca.OP_POW, ca.OP_CONSTPOW):
        return a[0] == 0.0 and a[1] < 1.0
    return op == ca.OP_ATAN2 and a[0] == a[1] == 0.0


def _written(op: int, a: list[float]) -> str:
    if op in SIGNS:
        return f"({a[0]:.4g}) {SIGNS[op]} ({a[1]:.4g})"
    if op == ca.OP_INV:
        return f"1 / ({a[0]:.4g})"
    x = [ca.SX.sym("x") for _ in a]
    name = str(ca.SX.unary(op, *x) if len(a) == 1 else ca.SX.binary(op, *x)).partition("(")[0]
    return f"{name or 'an operation'}({', '.join(f'{v:.4g}' for v in a)})"
