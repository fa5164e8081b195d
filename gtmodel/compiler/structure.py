"""Structural analysis with the Sigma-method: differentiation counts, index, degrees of freedom, and the differentiated
equations."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..lang.connect import place_of
from ..lang.model import Model
from ..lang.source import ModelError, SourceLocation
from .flat import FlatEquation, FlatModel
from .graph import alternating, highest_transversal, largest_matching, neighbours_of, reversed_matching
from .matrices import stacked
from .positions import is_position
from .rewriting import applied, of_expression, walked
from .trees import loop_of

MAX_SHOWN = 12  # equations named in one message
EPSILON = 2.0**-52


@dataclass(frozen=True)
class EquationStructure:
    """Offsets of the Sigma-method (Pryce 2001).

    Equation i is differentiated c[i] times; the system is solved for derivative d[j] of unknown j. `lift` of these
    differentiations are needed only for target derivatives.
    """

    equations: list[FlatEquation]
    unknowns: list[int]
    sigma: dict[tuple[int, int], int]
    c: np.ndarray
    d: np.ndarray
    lift: int = 0

    @property
    def degrees_of_freedom(self) -> int:
        """Number of initial values that may be chosen."""
        return int(self.d.sum() - self.c.sum())

    @property
    def index(self) -> int:
        """Structural index: 3 for a mechanism with position constraints."""
        if not self.unknowns:
            return 0
        return int(self.c.max() - self.lift) + int(np.any(self.d == self.lift))

    def raised(self, deficit: int) -> EquationStructure:
        """Return the same system differentiated `deficit` more times, for targets of higher order."""
        return EquationStructure(self.equations, self.unknowns, self.sigma, self.c + deficit, self.d + deficit, deficit)


def analyse(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: Collection[int] = ()
) -> EquationStructure:
    """Return the differentiation counts of a square system; targets: the unknowns that are targets.

    Raises ModelError if the numbers of equations and unknowns differ, or if some cannot be matched; the message names
    the surplus equations or variables.
    """
    column = {j: n for n, j in enumerate(unknowns)}
    sigma: dict[tuple[int, int], int] = {}
    for i, e in enumerate(equations):
        for index, order in flat.scope.symbols_in(e.residual):
            if index in column:
                key = (i, column[index])
                sigma[key] = max(sigma.get(key, 0), order)
    if len(equations) != len(unknowns):
        raise ModelError(_unbalanced(flat, equations, unknowns, targets, sigma))
    match = _transversal(flat, equations, unknowns, targets, sigma)
    return EquationStructure(equations, unknowns, sigma, *_offsets(len(equations), sigma, match))


def _transversal(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: Collection[int],
    sigma: dict[tuple[int, int], int],
) -> np.ndarray:  # fmt: skip
    """Return the column matched to each row in a highest-value transversal."""
    match = highest_transversal(len(equations), sigma)
    if match is None:
        raise ModelError(_unbalanced(flat, equations, unknowns, targets, sigma))
    return np.array(match, dtype=int)


def _offsets(n: int, sigma: dict[tuple[int, int], int], match: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    c = np.zeros(n, dtype=int)
    d = np.zeros(n, dtype=int)
    keys = np.array(sorted(sigma), dtype=int).reshape(-1, 2)
    values = np.array([sigma[tuple(k)] for k in keys.tolist()], dtype=int)
    matched = np.array([sigma[(i, int(match[i]))] for i in range(n)], dtype=int)
    while True:
        d[:] = 0
        np.maximum.at(d, keys[:, 1], values + c[keys[:, 0]])
        new = d[match] - matched
        if np.array_equal(new, c):
            return c, d
        c = new


def _unbalanced(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: Collection[int],
    sigma: dict[tuple[int, int], int],
) -> str:  # fmt: skip
    """Return the message for a system that is not square or cannot be matched; it names the surplus items."""
    if sentence := _locked(flat, equations, set(unknowns)):
        return sentence
    rows, cols = overdetermined_and_underdetermined(len(equations), len(unknowns), sigma)
    text = f"{flat.title}: {_count(len(equations), 'equation')} for {_count(len(unknowns), 'unknown')}"
    known = {i for e in equations for i, _ in flat.scope.symbols_in(e.residual)} - set(unknowns)
    if rows and (matrix := _rotation_in(flat, known)):
        text += (
            f"; {matrix} is a rotation matrix, whose nine numbers have three degrees of freedom: name three of its "
            f"entries, such as {_entries(matrix)}, instead of '{matrix}'"
        )
    if cols:
        modelica = getattr(type(flat.root), "_counts_from_one", False)
        shown = [flat.variables[unknowns[j]] for j in cols[:6]]
        names = ", ".join(f"{v.name} ({v.where})" if modelica else v.name for v in shown)
        names += ", ..." if len(cols) > 6 else ""
        few = "for these variables and their derivatives" if modelica else "or too few known variables"
        text += f"; not determined: {names} (too few equations {few})"
        met = {j for _, j in sigma}
        if absent := [flat.variables[unknowns[j]].name for j in cols if j not in met][:6]:
            verb = "appears" if len(absent) == 1 else "appear"
            missing = "an equation" if modelica else "an equation or its yield"
            text += f"; {', '.join(absent)} {verb} in no equation: is {missing} missing?"
        inputs = [flat.variables[i] for i in (unknowns[j] for j in cols) if i not in targets]
        lacking, given = len(unknowns) - len(equations), [flat.variables[i] for i in sorted(known)]
        whole = any(set(flat.groups[n][1]) <= known for n in flat.rotations)  # nine numbers, three degrees of freedom
        if not rows and lacking > 0 and not whole and any(v.role != "input" for v in given):
            of = ", ".join(dict.fromkeys(v.name.partition("[")[0] for v in given))
            text += f"; known ({of}) has {_count(len(given), 'number')}, and {len(given) + lacking} are needed"
            matrix = _rotation_in(flat, {unknowns[j] for j in cols}) if lacking == 3 else ""
            text += f": name {lacking} more" + (f", such as {_entries(matrix)}" if matrix else "")
        elif (names := [v.name for v in inputs if v.role == "input"][:6]) and not rows and not whole:
            text += f"; name the inputs that are known: known=[{', '.join(map(repr, names))}]"
    if not equations and (slips := difflib.get_close_matches("equations", vars(type(flat.root)), n=1)):
        text += f"; {type(flat.root).__name__}.{slips[0]}() is never called; rename it to equations()"
    if rows:
        text += f"; too many equations or knowns among: {_listed([equations[i] for i in rows])}"
        if both := _inputs_that_an_equation_joins(flat, [equations[i] for i in rows], set(unknowns)):
            text += f"; {both[0]} and {both[1]} are inputs: declare the one that an equation determines as a variable"
        if remedy := remedy_of(flat, [equations[i] for i in rows]):
            text += f"; {remedy}"
    if loose := _unconnected(flat):
        placed = [f"{name}{_declared_at(flat, name)}" for name in loose[:6]]
        text += f"; unconnected ports, whose flows are 0: {', '.join(placed)}"
    return text


def _locked(flat: FlatModel, equations: list[FlatEquation], unknowns: set[int]) -> str:
    """Return a sentence if more positions are known than a closed mechanism has degrees of freedom, else ""."""
    mobility, closings = flat.loops.mobility, flat.loops.closings
    if mobility is None or not closings:
        return ""
    shown = [f"{loop_of(c.component, c.cut)} ({place_of(c.component)})" for c in closings]
    where = f"loop{'s' if len(shown) > 1 else ''} {', '.join(shown[:4])}{', ...' if len(shown) > 4 else ''}"
    if mobility == 0:
        return f"{flat.title}: its mobility is 0: the mechanism is locked by the {where}; free a joint or a length"
    known = {i for e in equations for i, _ in flat.scope.symbols_in(e.residual)} - unknowns
    given = [flat.variables[i].name for i in sorted(known) if is_position(flat.variables[i])]
    names, surplus = ", ".join(given[:6]), len(equations) - len(unknowns)
    if len(given) <= mobility and 0 < surplus <= len(given):
        return (
            f"{flat.title}: {names} {'is' if len(given) == 1 else 'are'} known, and {_count(surplus, 'motor')} too few "
            f"to move the {where}: connect a motor, whose force follows"
        )
    if len(given) <= mobility:
        return ""
    return (
        f"{flat.title}: {len(given)} positions are known ({names}), and the mobility is {mobility} with the {where}; "
        f"name {mobility} of them"
    )


def _rotation_in(flat: FlatModel, variables: Collection[int]) -> str:
    """Return the name of a rotation matrix R of the model whose entries are all among the variables, else ""."""
    matrices = ((n, i) for n, (shape, i) in flat.groups.items() if n == "R" and shape == (3, 3))
    return next((name for name, indices in matrices if set(indices) <= set(variables)), "")


def _entries(matrix: str) -> str:
    """Return three entries that determine a rotation matrix near a pose."""
    return ", ".join(f"'{matrix}[{k}]'" for k in ("2,0", "2,1", "1,0"))


def remedy_of(flat: FlatModel, equations: Sequence[FlatEquation]) -> str:
    """Return the advice `if_redundant` of the first component of these equations that has one, else ""."""
    owners = {c._path: type(c) for c in flat.tree.components}
    advice = (getattr(owners.get(e.component), "if_redundant", "") for e in equations)
    return next(filter(None, advice), "")


def _inputs_that_an_equation_joins(
    flat: FlatModel, equations: list[FlatEquation], unknowns: set[int]
) -> tuple[str, str] | None:
    """Return the names of two known inputs of one equation: usually a component's input and the enclosing model's."""
    for equation in equations:
        known = {index for index, _ in flat.scope.symbols_in(equation.residual)} - unknowns
        names = [v.name for v in (flat.variables[i] for i in sorted(known)) if v.role == "input"]
        if len(names) > 1:
            return names[0], names[1]
    return None


def _unconnected(flat: FlatModel) -> list[str]:
    """Return the unconnected ports of components: their flow equation has only one port."""
    alone = (e.label for e in flat.equations if e.label.startswith("flow ") and " ~ " not in e.label)
    return list(dict.fromkeys(name for label in alone if "." in (name := label.partition(" of ")[2])))


def _declared_at(flat: FlatModel, port: str) -> str:
    """Return the line, in parentheses, where the user declares the component of a port; "" if it is not known."""
    component = flat.root
    for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", port.rpartition(".")[0]):
        component = getattr(component, name, None)
        if index and isinstance(component, (list, tuple)):
            component = component[int(index)]
    where = place_of(component) if isinstance(component, Model) else None
    return "" if where is None or where.ours else f" ({where})"


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _listed(equations: list[FlatEquation]) -> str:
    """Return labels with file and line; equations of one component from the same line are grouped."""
    groups: dict[tuple[str, SourceLocation], list[str]] = {}
    for e in equations:
        groups.setdefault((e.component, e.where), []).append(e.label)
    texts = [
        f"{labels[0]}{f' and {len(labels) - 1} more' if labels[1:] else ''} ({where})"
        for (_, where), labels in groups.items()
    ]
    return "; ".join(texts[:MAX_SHOWN]) + (f"; and {len(texts) - MAX_SHOWN} more" if texts[MAX_SHOWN:] else "")


def overdetermined_and_underdetermined(
    rows: int, cols: int, sigma: dict[tuple[int, int], int]
) -> tuple[list[int], list[int]]:
    """Return the rows of the overdetermined and the columns of the underdetermined part (Dulmage-Mendelsohn)."""
    by_row = neighbours_of(rows, sigma)
    by_col = neighbours_of(cols, [(j, i) for i, j in sigma])
    col_of_row = largest_matching(by_row, cols)
    row_of_col = reversed_matching(col_of_row, cols)
    return alternating(col_of_row, by_row, row_of_col), alternating(row_of_col, by_col, col_of_row)


Pair = tuple[int, int]


def differentiate(flat: FlatModel, structure: EquationStructure) -> list[list[ca.SX]]:
    """Return derivatives[i][m], the m-th time derivative of equation i, m = 0..c_i."""
    result = [[e.residual] for e in structure.equations]
    for m in range(int(structure.c.max(initial=0))):
        rows = [i for i in range(len(result)) if structure.c[i] > m]
        rates = flat.scope.derivative(ca.vertcat(*[result[i][m] for i in rows]))
        for n, i in enumerate(rows):
            half = _half(rates[n], {})
            result[i].append(rates[n] if half is None else half)
    return result


def _half(e: ca.SX, known: dict[int, ca.SX | None], depth: int = 50) -> ca.SX | None:
    """Return e/2 if every term has a factor two, as in the derivatives of squares; otherwise None.

    known: cache by element; depth: recursion limit, because sums may be longer than Python's stack.
    """
    key = e.element_hash()
    if key not in known:
        known[key] = _halved(e, known, depth)
    return known[key]


def _halved(e: ca.SX, known: dict[int, ca.SX | None], depth: int) -> ca.SX | None:
    if e.is_zero():
        return e
    if depth == 0 or e.is_constant() or e.is_symbolic():
        return None
    op = e.op()
    if op == ca.OP_TWICE:
        return e.dep(0)
    if op == ca.OP_NEG:
        a = _half(e.dep(0), known, depth - 1)
        return None if a is None else -a
    if op in (ca.OP_ADD, ca.OP_SUB):
        a = _half(e.dep(0), known, depth - 1)
        b = None if a is None else _half(e.dep(1), known, depth - 1)
        return None if a is None or b is None else a + b if op == ca.OP_ADD else a - b
    if op == ca.OP_MUL:
        for x, y in ((e.dep(0), e.dep(1)), (e.dep(1), e.dep(0))):
            a = _half(x, known, depth - 1)
            if a is not None:
                return a * y
    return None


def folded(flat: FlatModel, derivatives: list[list[ca.SX]], fold: ca.SX) -> list[list[ca.SX]]:
    """Return derivatives with numbers (or symbols) in place of the parameters."""
    if not flat.parameters:
        return derivatives
    everything = [e for chain in derivatives for e in chain]
    turns = _quarter_turns(flat, fold) if fold.is_constant() and not flat.scope.calls and everything else None
    if turns is not None:
        within = ca.which_depends(stacked(everything), turns, 1, True)
        chosen = [k for k, inside in enumerate(within) if inside]
        exact = _with_exact_turns(flat, stacked([everything[k] for k in chosen]), fold) if chosen else []
        for k, e in zip(chosen, exact, strict=True):
            everything[k] = e
    flatten = iter(ca.substitute(everything, [flat.p], [fold]))
    return [[next(flatten) for _ in chain] for chain in derivatives]


def _quarter_turns(flat: FlatModel, fold: ca.SX) -> ca.SX | None:
    """Return the parameters that are angles of one or more quarter turns; None without any."""
    values = zip(flat.parameters, np.array(ca.DM(fold)).ravel().tolist(), strict=True)
    turns = [q.symbol for q, x in values if q.unit == "rad" and any(_vanishes(op, x) for op in (ca.OP_COS, ca.OP_SIN))]
    return stacked(turns) if turns else None


def _vanishes(op: int, x: float) -> bool:
    """Return whether the cosine or sine of an angle that is not zero is round-off of zero."""
    return x != 0.0 and abs(math.cos(x) if op == ca.OP_COS else math.sin(x)) <= EPSILON * abs(x)


def _with_exact_turns(flat: FlatModel, column: ca.SX, fold: ca.SX) -> list[ca.SX]:
    """Return the entries of a column with numbers for the parameters; cosine and sine of quarter turns are exact, where
    those of the nearest double, such as 6e-17, are errors of the angle's last digit and would fill matrices."""
    number = {s.element_hash(): fold[k] for k, s in enumerate(ca.vertsplit(flat.p))}
    read, symbols = of_expression(column)
    return walked(read, [number.get(s.element_hash(), s) for s in symbols], _ExactTurns())


class _ExactTurns:
    """The forms of instructions; the operands are numbers where the parameters are."""

    def leaf(self, x: ca.SX) -> ca.SX:
        return x

    def operation(self, k: int, op: int, given: list[ca.SX]) -> ca.SX:
        if op in (ca.OP_COS, ca.OP_SIN) and given[0].is_constant() and _vanishes(op, float(given[0])):
            return ca.SX(0)
        return given[0] if op == ca.OP_ASSIGN else applied(op, given)

    def whole(self, form: ca.SX) -> ca.SX:
        return form


def condition_order(flat: FlatModel, conditions: Sequence[FlatEquation], pairs: Sequence[Pair]) -> int:
    """Return how often conditions on known values are differentiated; -1 if there are none."""
    highest = dict(sorted(pairs))
    return max((highest.get(i, 0) for e in conditions for i, _ in flat.scope.symbols_in(e.residual)), default=-1)


def _with_conditions(
    flat: FlatModel, stages: list[ca.SX], conditions: list[FlatEquation], pairs: list[Pair]
) -> list[ca.SX]:
    """Append the conditions on known values and their derivatives to the stage residuals."""
    if not conditions:
        return stages
    residual = ca.vertcat(*[e.residual for e in conditions])
    top = condition_order(flat, conditions, pairs)
    stages = [*stages, *[ca.SX(0, 1)] * max(0, top + 1 - len(stages))]
    for m in range(top + 1):
        stages[m] = ca.vertcat(stages[m], residual)
        residual = flat.scope.derivative(residual)
    return stages


def stage_residuals(
    flat: FlatModel,
    structure: EquationStructure,
    derivatives: list[list[ca.SX]],
    conditions: list[FlatEquation],
    pairs: list[Pair],
    without: Collection[str] = (),
) -> list[ca.SX]:
    """Return the residuals of each stage, positions first, including the conditions on known values; without the
    equations of these labels."""
    c = structure.c
    rows = [i for i, e in enumerate(structure.equations) if e.label not in without]
    conditions = [e for e in conditions if e.label not in without]
    stages = [
        ca.vertcat(*[derivatives[i][c[i] + k] for i in rows if c[i] + k >= 0])
        for k in range(-int(structure.d.max(initial=0)), 1)
    ]
    return [r for r in _with_conditions(flat, stages, conditions, pairs) if r.numel()]


def pairs_of(
    flat: FlatModel,
    derivatives: list[list[ca.SX]],
    structure: EquationStructure,
    conditions: list[FlatEquation],
    wanted: Sequence[Pair],
) -> list[Pair]:
    inside = flat.scope.symbols_in_each([e for chain in derivatives for e in chain])
    pairs = {p for each in inside for p in each}
    pairs |= {(j, m) for n, j in enumerate(structure.unknowns) for m in range(int(structure.d[n]) + 1)}
    pairs |= {p for e in conditions for p in flat.scope.symbols_in(e.residual)}
    return sorted(pairs | set(wanted))


def system_of(flat: FlatModel, structure: EquationStructure, derivatives: list[list[ca.SX]]) -> ca.SX:
    """Return d f_i^(c_i) / d x_j^(d_j)."""
    # ca.SX(...) because vertcat() of no equations is not an SX
    top = ca.SX(ca.vertcat(*[derivatives[i][structure.c[i]] for i in range(len(structure.c))]))
    columns = ca.SX(ca.vertcat(*[flat.scope.symbol(j, int(structure.d[n])) for n, j in enumerate(structure.unknowns)]))
    return ca.jacobian(top, columns)
