"""Optimal motion along a given path, with the squared path speed at each node as unknown."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Literal

import casadi as ca
import numpy as np

from ..compiler.rewriting import of_expression
from ..compiler.tape.elimination import gradient, hessian, jacobian
from ..compiler.tape.function import TapeFunction, written
from ..compiler.tape.operations import Tape, parted, read_in
from ..results.status import SolveStatus
from .ipopt import run_ipopt
from .judgement.diagnosis import failure
from .nlp import functions_of, scatter
from .solve import SolverOptions
from .watch import Program, Progress

Terms = dict[tuple[int, ...], int]  # product of variables (sorted indices) -> its coefficient
MOST_FACTORS, MOST_TERMS = 4, 12  # limits for expanding a product


class _Collected:
    """Operations expanded into sums of terms. The tape `coefficients` holds the coefficients; the tape `rows`, whose
    inputs are the variables and symbols for these coefficients, holds everything that is not such a sum."""

    def __init__(self, variables: int) -> None:
        self.rows, self.coefficients = Tape(), Tape()
        self._inputs = variables
        self.variables = [self.rows.input(n) for n in range(variables)]
        self.places: dict[int, int] = {}  # coefficient -> its symbol among the inputs of `rows`

    def operation(self, op: int, operands: Sequence[Terms]) -> Terms:
        tape, first, last = self.coefficients, operands[0], operands[-1]
        if all(_fixed(form) for form in operands):
            return {(): tape.applied(op, *[self._constant(form) for form in operands])}
        if op in (ca.OP_ADD, ca.OP_SUB):
            return self._sum(first, last if op == ca.OP_ADD else self._scaled(last, -1.0))
        if op in (ca.OP_NEG, ca.OP_TWICE):
            return self._scaled(first, -1.0 if op == ca.OP_NEG else 2.0)
        if op == ca.OP_DIV and _fixed(last):
            divisor = self._constant(last)
            return {factors: tape.applied(op, value, divisor) for factors, value in first.items()}
        if op in (ca.OP_MUL, ca.OP_SQ) and (product := self._product(first, last)) is not None:
            return product
        self.variables.append(self.rows.applied(op, *[self.whole(form) for form in operands]))
        return {(len(self.variables) - 1,): tape.constant(1.0)}

    def whole(self, form: Terms) -> int:
        """Write the sum to the tape `rows`."""
        total = self.rows.constant(0.0)
        for factors, value in form.items():
            term = self._symbol(value)
            for n in factors:
                term = self.rows.product(term, self.variables[n])
            total = self.rows.total(total, term)
        return total

    def _symbol(self, value: int) -> int:
        if value in self.coefficients.constants:
            return self.rows.constant(self.coefficients.constants[value])
        return self.rows.input(self.places.setdefault(value, self._inputs + len(self.places)))

    def _constant(self, form: Terms) -> int:
        return form.get((), self.coefficients.constant(0.0))

    def _scaled(self, form: Terms, factor: float) -> Terms:
        tape = self.coefficients
        return {factors: tape.product(tape.constant(factor), value) for factors, value in form.items()}

    def _sum(self, first: Terms, last: Terms) -> Terms:
        total, tape = dict(first), self.coefficients
        for factors, value in last.items():
            total[factors] = tape.total(total[factors], value) if factors in total else value
        return {factors: value for factors, value in total.items() if tape.constants.get(value) != 0.0}

    def _product(self, first: Terms, last: Terms) -> Terms | None:
        """Return the expanded product; None if it is too long."""
        if len(first) * len(last) > MOST_TERMS:
            return None
        product: Terms = {}
        for a, x in first.items():
            for b, y in last.items():
                factors = tuple(sorted(a + b))
                if len(factors) > MOST_FACTORS:
                    return None
                product = self._sum(product, {factors: self.coefficients.product(x, y)})
        return product


def collected(expression: ca.SX, variables: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Collect expressions as sums of terms in the variables.

    Returns the expressions in the variables and in coefficient symbols, these symbols, and their values as functions
    of everything else in the expressions.
    """
    read, symbols = of_expression(expression)
    numbers = {v.element_hash(): n for n, v in enumerate(ca.vertsplit(variables))}
    forms = _Collected(len(numbers))
    terms: list[Terms] = []
    results: dict[int, int] = {}
    for op, reads, place, constant in read:
        if op == ca.OP_INPUT:
            number = numbers.get(symbols[place].element_hash())
            terms.append(
                {(): forms.coefficients.input(place)}
                if number is None
                else {(number,): forms.coefficients.constant(1.0)}
            )
        elif op == ca.OP_CONST:
            terms.append({(): forms.coefficients.constant(constant)})
        elif op == ca.OP_OUTPUT:
            results[place] = forms.whole(terms[reads[0]])
            terms.append(terms[reads[0]])
        else:
            terms.append(forms.operation(op, [terms[i] for i in reads]))
    coefficients = ca.SX.sym("c", len(forms.places))
    rows = written(forms.rows, [results[place] for place in sorted(results)], ca.vertcat(variables, coefficients))
    return rows, coefficients, written(forms.coefficients, list(forms.places), ca.vertcat(ca.SX(0, 1), *symbols))


def _fixed(form: Terms) -> bool:
    return not any(form)


ROOT = 1e-12  # added under the square root to keep its derivative at rest finite
LEAST_GUESS = 1e-3  # lower bound of the guess of b [1/s2]
Curve = Callable[[np.ndarray], tuple[np.ndarray, ...]]


@dataclass(frozen=True, eq=False)
class PathTask:
    """A path-following task: the path, the bounded quantities and the cost.

    Args:
        curve: fractions s (n,) in [0, 1] -> path x(s) and its first and second derivative, (n, d) each, followed by
            further arguments of `quantities` (n, k) that depend on s alone.
        quantities: (x, dx/dt, d2x/dt2, further arguments) -> bounded rows (m,).
        low, high: (m,) bounds of the rows.
        squares: (m,) weights; the energy is the integral of sum squares * rows^2.
        time, energy: weights of the cost.
        rest: whether the motion begins at rest, and whether it ends at rest.
    """

    curve: Curve
    quantities: ca.Function
    low: np.ndarray
    high: np.ndarray
    squares: np.ndarray
    time: float = 1.0
    energy: float = 0.0
    rest: tuple[bool, bool] = (True, True)


@dataclass(frozen=True, eq=False)
class PathMotion:
    """Nodes s (n + 1,), squared speeds b (n + 1,) [1/s2] and node times t (n + 1,) [s] of the motion."""

    status: SolveStatus
    message: str
    objective: float
    energy: float
    iterations: int
    s: np.ndarray
    b: np.ndarray
    seconds: float
    t: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        v = np.sqrt(self.b)
        steps = 2 * np.diff(self.s) / np.maximum(v[1:] + v[:-1], np.sqrt(ROOT))
        object.__setattr__(self, "t", np.concatenate([[0.0], np.cumsum(steps)]))

    @property
    def final_time(self) -> float:
        """Duration [s]."""
        return float(self.t[-1])

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return s, s', s'' at instants [s], exact between the nodes; s'' at a node is that of the right interval."""
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.s) - 2)
        a = (np.diff(self.b) / (2 * np.diff(self.s)))[k]
        tau, v = np.clip(times, 0.0, self.final_time) - self.t[k], np.sqrt(self.b[k])
        return np.clip(self.s[k] + v * tau + a * tau**2 / 2, 0.0, 1.0), np.maximum(v + a * tau, 0.0), a


def cosine_nodes(intervals: int) -> np.ndarray:
    """Return fractions (intervals + 1,) from 0 to 1, densest at both ends."""
    return (1 - np.cos(np.pi * np.arange(intervals + 1) / intervals)) / 2


def solve_path(
    task: PathTask,
    intervals: int = 200,
    *,
    bounded: Literal["middle", "ends"] = "middle",
    tolerance: float = 1e-8,
    max_iterations: int = 300,
    max_seconds: float | None = None,
    progress: Progress | None = None,
) -> PathMotion:
    """Compute the optimal motion along the path.

    bounded: where the bounds of the rows are imposed: in the "middle" of each interval (second order), or at both
    "ends" of each interval, so that between nodes only the curvature of the rows can exceed them.
    progress: called with (iteration, cost, violation); True stops. An infeasible task does not raise: see the status.
    Raises ValueError for inconsistent shapes.
    """
    rows = task.quantities.numel_out(0)
    if any(np.shape(a) != (rows,) for a in (task.low, task.high, task.squares)):
        raise ValueError(f"low, high and squares must have shape ({rows},), the number of rows of the quantities")
    begin = time.perf_counter()
    s = cosine_nodes(intervals)
    interval, data, per = _interval(task, s, bounded)
    count = per * rows
    nlp, derivatives, _functions = _assemble(interval, data, intervals, count)
    low_b, high_b = np.zeros(intervals + 1), np.full(intervals + 1, np.inf)
    for end, rests in zip((0, -1), task.rest, strict=True):
        if rests:
            high_b[end] = 0.0
    low, high = (np.tile(bound / _scale(task), per * intervals) for bound in (task.low, task.high))
    program = Program(derivatives, nlp, low_b, high_b, low, high)
    options = SolverOptions(tolerance=tolerance, max_iterations=max_iterations, max_seconds=max_seconds)
    run = run_ipopt(program, _guess(s), options, progress).at_best()
    b = np.maximum(run.x, 0.0)
    energy = float(np.sum(interval.map(intervals)(b[:-1], b[1:], data)[2].full()))
    message = "solved" if run.status.ok else str(failure(run, []))
    return PathMotion(run.status, message, run.objective, energy, run.iterations, s, b, time.perf_counter() - begin)


def _scale(task: PathTask) -> np.ndarray:
    """Return the size of each row: its larger finite bound."""
    size = np.maximum(*(np.where(np.isfinite(a), np.abs(a), 0.0) for a in (task.low, task.high)))
    return np.where(size > 0, size, 1.0)


def _guess(s: np.ndarray) -> np.ndarray:
    """Return the squared speed of a trapezoidal profile (1/4, 1/2, 1/4) of 1 s along the path."""
    top = 4.0 / 3.0
    return np.clip(np.minimum(8 * top * np.minimum(s, 1 - s), top**2), LEAST_GUESS, None)


def _interval(task: PathTask, s: np.ndarray, bounded: str) -> tuple[ca.Function, ca.DM, int]:
    """Return (b left, b right, data) -> (scaled rows, cost, energy) on one interval, the data of all intervals (one
    column each), and the number of points per interval at which the rows are bounded."""
    fractions = [(s[:-1] + s[1:]) / 2] if bounded == "middle" else [s[:-1], s[1:]]
    rows, symbols, coefficients = _collected_rows(task)
    # coefficients of the rows at each point, and the length of the interval
    data = ca.vertcat(
        *[coefficients.map(len(x))(ca.DM(np.hstack(task.curve(x)).T)) for x in fractions], ca.DM(np.diff(s)).T
    )
    bl, br, p = ca.SX.sym("bl"), ca.SX.sym("br"), ca.SX.sym("p", data.shape[0])
    ds = p[-1]
    a = (br - bl) / (2 * ds)
    duration = 2 * ds / (ca.sqrt(bl + ROOT) + ca.sqrt(br + ROOT))
    scaled, energies = [], []
    for n, b in enumerate([(bl + br) / 2] if bounded == "middle" else [bl, br]):
        row = rows(ca.sqrt(b + ROOT), b, a, p[n * symbols : (n + 1) * symbols])
        scaled.append(row / ca.DM(_scale(task)))
        energies.append(duration * ca.dot(ca.DM(task.squares), row**2))
    energy = sum(energies) / len(energies)
    cost = task.time * duration + task.energy * energy
    f = ca.Function("interval", [bl, br, p], [ca.vertcat(*scaled), cost, energy], {"cse": True})
    return f, data, len(scaled)


def _collected_rows(task: PathTask) -> tuple[ca.Function, int, ca.Function]:
    """Return (s', s'^2, s'', coefficients) -> rows, the number of coefficients, and curve values -> coefficients."""
    sizes = [column.shape[1] for column in task.curve(np.zeros(1))]
    v, b, a, place = ca.SX.sym("v"), ca.SX.sym("b"), ca.SX.sym("a"), ca.SX.sym("place", sum(sizes))
    x, slope, curvature, *further = ca.vertsplit(place, np.cumsum([0, *sizes]).tolist())
    expressions = task.quantities(x, slope * v, curvature * b + slope * a, *further)
    rows, symbols, coefficients = collected(expressions, ca.vertcat(v, b, a))
    coefficients_of = ca.Function("known", [place], [coefficients], {"cse": True})
    return ca.Function("rows", [v, b, a, symbols], [rows], {"cse": True}), symbols.numel(), coefficients_of


class _Hoisted:
    """Results of a tape for all columns of the data, the last argument. Subexpressions that depend on the data alone
    (pose, its Jacobians, masses) are evaluated once. The object must live as long as the results of its calls."""

    def __init__(self, tape: Tape, args: Sequence[ca.SX], outputs: Sequence[Sequence[int]], data: ca.DM) -> None:
        *free, p = args
        self._free, self._data, N = free, data, data.shape[1]
        first = sum(a.numel() for a in free)
        numbers = [k for inputs in outputs for k in inputs]
        outside, rest, results = parted(tape, numbers, [tape.input(first + k) for k in range(p.numel())])
        known = TapeFunction("known", tape, args, [outside]).map(N)
        self._known = known(*[ca.DM.zeros(a.numel(), N) for a in free], data)
        inputs, remaining = [*args, ca.SX.sym("known", len(outside))], iter(results)
        # one function per result, since IPOPT evaluates them one at a time
        self._mapped = [TapeFunction("path", rest, inputs, [list(islice(remaining, len(k)))]).map(N) for k in outputs]

    def __call__(self, column: int, *arguments: ca.MX) -> ca.MX:
        """Evaluate a result, which depends on the first arguments and the data only."""
        N = self._data.shape[1]
        padding = [ca.DM.zeros(a.numel(), N) for a in self._free[len(arguments) :]]
        return self._mapped[column](*arguments, *padding, self._data, self._known)


def _assemble(
    interval: ca.Function, data: ca.DM, N: int, m: int
) -> tuple[dict[str, ca.MX], dict[str, ca.Function], _Hoisted]:
    """Return the problem, its derivatives, and the object that must live as long as these.

    One interval with its two unknowns is differentiated once and mapped over all intervals.
    """
    y, p = ca.SX.sym("y", 2), ca.SX.sym("p", data.shape[0])
    rows, cost, _ = interval(y[0], y[1], p)
    args, tape = [y, ca.SX.sym("sigma"), ca.SX.sym("lam", m), p], Tape()
    *rows, cost = read_in(tape, ca.vertcat(rows, cost), ca.vertcat(*args))
    v, weights = [tape.input(0), tape.input(1)], [*(tape.input(3 + k) for k in range(m)), tape.input(2)]
    none, one = tape.constant(0.0), tape.constant(1.0)
    J, H = jacobian(tape, rows, v), hessian(tape, [*rows, cost], weights, v)
    outputs = [
        rows,
        [cost],
        [J.get((row, column), none) for column in range(2) for row in range(m)],
        gradient(tape, [cost], [one], v),
        [H.get(place, none) for place in ((0, 0), (0, 1), (1, 1))],
    ]
    hoisted = _Hoisted(tape, args, outputs, data)
    value, share, slope, gradients, curvature = (partial(hoisted, column) for column in range(len(outputs)))
    x, empty = ca.MX.sym("x", N + 1), ca.MX.sym("none", 0)
    Y = ca.horzcat(x[:-1], x[1:]).T
    g, f = ca.vec(value(Y)), ca.sum2(share(Y))
    df = gradients(Y)
    grad = ca.vertcat(df[0, :].T, 0) + ca.vertcat(0, df[1, :].T)
    k = np.arange(N)
    columns = (k[:, None, None] + np.arange(2)[None, :, None] + np.zeros((1, 1, m), int)).reshape(-1)
    lines = (k[:, None, None] * m + np.zeros((1, 2, 1), int) + np.arange(m)[None, None, :]).reshape(-1)
    jac = scatter(lines, columns, ca.vec(slope(Y)), (N * m, N + 1))
    sg, lg = ca.MX.sym("sg"), ca.MX.sym("lg", N * m)
    h = curvature(Y, ca.repmat(sg, 1, N), ca.reshape(lg, m, N))
    diagonal = ca.vertcat(h[0, :].T, 0) + ca.vertcat(0, h[2, :].T)
    n = np.arange(N + 1)
    entries = ca.vertcat(diagonal, h[1, :].T)
    hess = scatter(np.concatenate([n, k]), np.concatenate([n, k + 1]), entries, (N + 1, N + 1))
    functions = functions_of(x, empty, sg, lg, f, g, grad, jac, hess)
    return {"x": x, "p": empty, "f": f, "g": g}, functions, hoisted
