"""Checks of a problem and its solution, with the source line concerned: overdetermined equations, values that are not
finite, wrong branches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.flat import FlatBranch
from ...compiler.rewriting import of_expression
from ...compiler.structure import overdetermined_and_underdetermined
from ...lang.slips import line_of
from ...lang.source import ModelError, SourceLocation
from ..collocation import Element
from ..formulation.dynamic import DynamicProblem
from ..formulation.system import on_rows
from ..nlp import Nlp, instants, placed
from ..solution import constants, horizon, mesh_fractions, states_and_controls

BY_STATE = ("continuity of ", "rate of ")


@dataclass(frozen=True)
class Remark:
    """A sentence, or a part of one, and the source line it refers to, if any."""

    text: str
    where: SourceLocation | None = None

    def __bool__(self) -> bool:
        return bool(self.text)

    def __str__(self) -> str:
        """Return the sentence, followed by its place unless it names that already."""
        silent = self.where is None or f"{self.where})" in self.text
        return self.text if silent else f"{self.text} ({self.where})"


def joined(remarks: Iterable[Remark]) -> Remark:
    """Join remarks into one sentence at the place of the first that has one."""
    present = [r for r in remarks if r]
    return Remark("; ".join(map(str, present)), next((r.where for r in present if r.where is not None), None))


def class_place(problem: DynamicProblem) -> SourceLocation | None:
    """Return the line of the problem's class."""
    return getattr(type(problem.flat.root), "_written", None)


def objective_place(problem: DynamicProblem) -> SourceLocation | None:
    """Return the line of the objective."""
    return line_of(getattr(type(problem.flat.root), "objective", None)) or class_place(problem)


def final_time_place(problem: DynamicProblem) -> SourceLocation | None:
    """Return the line that declares a free end of the horizon."""
    ends = [q.where for name in ("final_time", "start_time") for q in problem.flat.parameters if q.name == name]
    return ends[0] if ends else class_place(problem)


def variable_place(problem: DynamicProblem, name: str) -> SourceLocation | None:
    """Return the line that declares a state, control, unknown or free constant of this name."""
    flat = problem.flat
    pairs = dict(zip(problem.state_names, problem.state_pairs, strict=False))
    pairs |= dict(zip([*problem.control_names, *problem.point_names], problem.input_pairs, strict=True))
    if name in pairs:
        return flat.variables[pairs[name][0]].where
    known = [v.where for v in (*flat.variables, *flat.parameters) if v.name == name]
    return known[0] if known else objective_place(problem)  # integral states belong to the objective


def row_place(problem: DynamicProblem, label: str) -> SourceLocation | None:
    """Return the line of the constraint, equation or variable behind a row of the NLP."""
    label = label.removeprefix("at the edge: ")
    if label.startswith("delay of "):
        return variable_place(problem, label.removeprefix("delay of ").partition(" in element ")[0])
    for row in (*problem.points, *problem.path):
        if row.label == label and row.where is not None:
            return row.where
    for begin in BY_STATE:
        if label.startswith(begin):
            return variable_place(problem, label.removeprefix(begin))
    for e in (*problem.flat.equations, *problem.flat.initial):
        if f"{e.label} ({e.where})" in label:
            return e.where
    for v in problem.flat.variables:
        if label in (f"{v.name} by the motion", f"bounds of {v.name}") or f"'{v.name}'" in label:
            return v.where
    return final_time_place(problem) if "horizon" in label else class_place(problem)


MOST_NAMED = 6


def check_equalities(problem: DynamicProblem, element: Element) -> None:
    """Match the equations of one element to its unknowns. Raises ModelError naming redundant equations.

    The left end belongs to the previous element, the right end to this one.
    """
    layout = element.layout
    equal = np.flatnonzero(element.low == element.high)
    columns_own = np.arange(layout.nl, layout.size)
    column = {int(j): n for n, j in enumerate(columns_own)}
    row = {int(i): n for n, i in enumerate(equal)}
    entries = {
        (row[i], column[j]): 0
        for i, j in zip(*ca.jacobian_sparsity(element.rows, element.y).get_triplet(), strict=True)
        if i in row and j in column
    }
    # a continuity row is matched by the right end
    for n, i in enumerate(equal):
        if i < layout.nl:
            entries[(n, len(columns_own) + int(i))] = 0
    columns = len(columns_own) + layout.nl
    constants = {s.element_hash() for s in ca.symvar(element.rows)} & {
        s.element_hash() for s in ca.vertsplit(element.P)
    }
    if constants and layout.mesh.elements == 1:
        return  # free constants may be determined by the surplus rows
    over, _ = overdetermined_and_underdetermined(len(equal), columns, entries)
    if not over:
        return
    names = list(dict.fromkeys(element.row_names[int(equal[n])][0] for n in over))
    names_text = "; ".join(names[:MOST_NAMED]) + ("; ..." if len(names) > MOST_NAMED else "")
    raise ModelError(
        f"{problem.flat.title} has more equations along the path than unknowns; these are contradictory or redundant: "
        f"{names_text}; remove one, or add a control"
    )


SIGNS = {ca.OP_DIV: "/", ca.OP_MUL: "*", ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_POW: "**", ca.OP_CONSTPOW: "**"}


Step = tuple[str, ca.SX]  # a quantity computed at a point: its label, and its expression in known symbols


def not_finite(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return a remark on the first operation whose value, or else derivative, is not finite at a collocation point."""
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
        values_at = dict(zip((v.element_hash() for v in symbols), numbers[:, k], strict=True))
        for column, row in zip(arguments, (xs[k], rates[k], us[k], P, times[k : k + 1]), strict=True):
            symbols_at = ca.vertsplit(ca.vec(column)) if column.numel() else []
            values_at |= dict(zip((v.element_hash() for v in symbols_at), row, strict=True))
        for label, expression in steps:
            term = _first(expression, values_at, infinite_slope)
            if term:
                slope = "the derivative of " if infinite_slope else ""
                element = min(mesh.elements, int(np.searchsorted(mesh.edges, s[k] - 1e-12, side="right")))
                text = f"{slope}{term} in {label} at {times[k]:.4g} s (element {element}) is not finite"
                return Remark(text, _label_place(nlp, label))
    return _at_instants(nlp, x)


def _label_place(nlp: Nlp, label: str) -> SourceLocation | None:
    """Return the line of a step by its label."""
    if label.endswith("objective"):
        return objective_place(nlp.problem)
    if label.startswith("the rate of "):
        return variable_place(nlp.problem, label.removeprefix("the rate of "))
    return row_place(nlp.problem, label.strip("'"))


def _at_instants(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return the remark on the Mayer term and point constraints."""
    problem = nlp.problem
    rows = [("the objective", problem.mayer)] + [(f"'{r.label}'", r.expression) for r in problem.points]
    values_at = instants(problem, placed(nlp, x), nlp.element.layout, nlp.p_scale, [])
    expressions = [e for _, e in rows]
    if values_at.old.numel():
        expressions = ca.substitute(expressions, [values_at.old], [values_at.new])
    numbers = {s.element_hash(): v for s, v in zip(ca.vertsplit(values_at.z), x[values_at.index].tolist(), strict=True)}
    for infinite_slope in (False, True):
        for (label, _), e in zip(rows, expressions, strict=True):
            term = _first(e, numbers, infinite_slope)
            if term:
                text = f"{'the derivative of ' if infinite_slope else ''}{term} in {label} is not finite"
                return Remark(text, _label_place(nlp, label))
    return Remark("")


def _computed(nlp: Nlp) -> tuple[list[Step], list[ca.SX], ca.SX]:
    """Return the steps computed at a point in order, symbols of their results, and the results as expressions of the
    problem's symbols."""
    problem = nlp.problem
    builder, plan, flat = problem.builder, problem.plan, problem.flat
    steps: list[Step] = []
    symbols: list[ca.SX] = []
    if builder.kind != "dae":
        known = {p: e for p, e in builder.rates.items()}
        known |= {p: sign * builder.u[n] for p, (n, sign) in builder.control_symbols.items()}
        computed = {flat.scope.symbol(*p).element_hash() for p in known}
        pairs = [(flat.p, plan.parameters)] if flat.parameters else []
        pairs += [(r.sign, ca.SX(r.value)) for b in plan.blocks for r in b.roots]
        pairs += [(flat.scope.symbol(*p), v) for p, v in known.items()]
        old, new = (ca.vertcat(*side) for side in zip(*pairs, strict=True)) if pairs else (ca.SX(0, 1), ca.SX(0, 1))
        for block in plan.blocks:
            equations = "; ".join(dict.fromkeys(block.equations))
            for symbol, expression in block.assignments:
                if symbol.element_hash() not in computed or builder.kind == "inverse":
                    steps.append((f"'{equations}'", ca.substitute([expression], [old], [new])[0]))
                    symbols.append(symbol)
    expressions = builder.express(symbols, with_controls=builder.kind != "inverse") if symbols else []
    named = zip(problem.state_names, problem.rates, strict=True)
    rows: list[tuple[str, ca.SX]] = [(f"the rate of {n}", r) for n, r in named if r is not None]
    rows += [(f"'{label}'", problem.algebraic[n]) for n, label in enumerate(problem.algebraic_labels)]
    rows += [(f"'{r.label}'", r.expression) for r in problem.path]
    rows += [("an integral of the objective", e) for _, e, _ in problem.integrals]
    steps += rows
    values = ca.vertcat(*expressions, *[e for _, e in rows]) if expressions or rows else ca.SX(0, 1)
    symbols += [ca.SX.sym("row") for _ in rows]
    return steps, symbols, values


def _first(expression: ca.SX, numbers: dict[int, float], infinite_slope: bool) -> str:
    """Return the first operation of an expression with finite arguments whose value (or derivative) is not finite."""
    operations, free = of_expression(expression)
    memory: list[float] = []
    for op, reads, place, constant in operations:
        arguments = [memory[i] for i in reads]
        if op == ca.OP_INPUT:
            value = numbers.get(free[place].element_hash(), np.nan)
        elif op == ca.OP_CONST:
            value = constant
        elif op == ca.OP_OUTPUT:
            value = arguments[0]
        elif op == ca.OP_CALL:
            value = np.nan  # of a function whose operations are unknown: it and what follows are not judged
        else:
            value = float(ca.DM.unary(op, arguments[0]) if len(reads) == 1 else ca.DM.binary(op, *arguments))
            if all(np.isfinite(arguments)) and (_steep(op, arguments) if infinite_slope else not np.isfinite(value)):
                return _operation_text(op, arguments)
        memory.append(float(value))
    return ""


def _steep(op: int, a: list[float]) -> bool:
    """Return whether the derivative is infinite although the value is finite."""
    if op == ca.OP_SQRT:
        return a[0] == 0.0
    if op in (ca.OP_ACOS, ca.OP_ASIN):
        return abs(a[0]) == 1.0
    if op in (ca.OP_POW, ca.OP_CONSTPOW):
        return a[0] == 0.0 and a[1] < 1.0
    return op == ca.OP_ATAN2 and a[0] == a[1] == 0.0


def _operation_text(op: int, a: list[float]) -> str:
    if op in SIGNS:
        return f"({a[0]:.4g}) {SIGNS[op]} ({a[1]:.4g})"
    if op == ca.OP_INV:
        return f"1 / ({a[0]:.4g})"
    x = [ca.SX.sym("x") for _ in a]
    name = str(ca.SX.unary(op, *x) if len(a) == 1 else ca.SX.binary(op, *x)).partition("(")[0]
    return f"{name or 'an operation'}({', '.join(f'{v:.4g}' for v in a)})"


# a branch expression this small relative to its largest value counts as zero: the border of the branch
TOUCHES = 1e-6
AT_LIMIT = 1e-3  # relative distance from its shortest length at which a horizon is at the bound


def astray(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return a remark on a wrong branch or a collapsed horizon; empty if there is neither."""
    return wrong_branch(nlp, x) or shrunk(nlp, x)


def shrunk(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return a remark on an unbounded free horizon that has collapsed to its automatic lower bound."""
    shortest, (t0, tf) = nlp.problem.shortest, horizon(nlp, x)
    if not shortest or tf - t0 > shortest * (1 + AT_LIMIT):
        return Remark("")
    return Remark(
        f"the horizon has shrunk to {tf - t0:.4g} s, a thousandth of its guess, and would shrink further; bound the "
        "free time, as in gt.free(guess=..., min=0.1), or add the constraint that requires time",
        final_time_place(nlp.problem),
    )


def wrong_branch(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return a remark on the first declared branch with the wrong sign at some point; empty if there is none."""
    problem = nlp.problem
    if "branches" not in problem.cache:
        problem.cache["branches"] = _branches(problem)
    branches, f = problem.cache["branches"]
    if not branches:
        return Remark("")
    xs, rates, us, times = states_and_controls(nlp, x, mesh_fractions(placed(nlp, x))[1:])
    (values,) = on_rows(f, (xs, rates, us), constants(nlp, x), times)
    for b, row in zip(branches, values, strict=True):
        sign = problem.branches.get(b.name, 1)
        wrong = np.flatnonzero(~(sign * row > -TOUCHES * np.max(np.abs(row), initial=0.0)))
        if wrong.size:
            k = int(wrong[0])
            return Remark(
                f"the solution is on the wrong branch: '{b.name}' ({b.where}) is {row[k]:.4g} at {times[k]:.6g} s, but "
                f"its sign must be {sign:+d}; give a guess on that branch, or branches={{'{b.name}': {-sign:+d}}}",
                b.where,
            )
    return Remark("")


def _branches(problem: DynamicProblem) -> tuple[list[FlatBranch], ca.Function]:
    """Return the declared branches that the problem can express, and a function of their expressions."""
    flat, alias, builder = problem.flat, problem.plan.alias, problem.builder
    branches = [
        b
        for b in flat.branches
        if all(builder.expressible(p) for p in flat.scope.symbols_in(alias.rewrite(flat, b.expression)))
    ]
    expressions = builder.express([b.expression for b in branches]) if branches else []
    return branches, ca.Function("branches", problem.arguments, [ca.vertcat(ca.SX(0, 1), *expressions)])
