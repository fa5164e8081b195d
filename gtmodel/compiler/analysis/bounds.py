"""Interval bounds of functions of time and their rates, and the longest integration steps that miss nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..rewriting import Instruction, instructions

Bounds = tuple[Any, Any]
# (value, rate), each with a lower and an upper bound over every cell
Dual = tuple[Bounds, Bounds]

ZERO: Bounds = (0.0, 0.0)
ANYTHING: Bounds = (-np.inf, np.inf)


def _add(a: Bounds, b: Bounds) -> Bounds:
    return a[0] + b[0], a[1] + b[1]


def _negative(a: Bounds) -> Bounds:
    return -a[1], -a[0]


def _product(a: Any, b: Any) -> Any:
    """Return a b with zero times infinity equal to zero, for the bounds of a product of intervals."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where((a == 0) | (b == 0), 0.0, a * b)


def _scaled(factor: float, a: Bounds) -> Bounds:
    if factor == 0.0:
        return ZERO
    return (factor * a[0], factor * a[1]) if factor > 0 else (factor * a[1], factor * a[0])


def _times(a: Bounds, b: Bounds) -> Bounds:
    if a is ZERO or b is ZERO:
        return ZERO
    if isinstance(a[0], float) and a[0] == a[1]:
        return _scaled(a[0], b)
    if isinstance(b[0], float) and b[0] == b[1]:
        return _scaled(b[0], a)
    corners = [_product(x, y) for x in a for y in b]
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


def _square(a: Bounds) -> Bounds:
    low, high = _product(a[0], a[0]), _product(a[1], a[1])
    inside = (a[0] < 0) & (a[1] > 0)
    return np.where(inside, 0.0, np.minimum(low, high)), np.maximum(low, high)


def _inverse(a: Bounds) -> Bounds:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        through = (a[0] <= 0) & (a[1] >= 0)
        return np.where(through, -np.inf, 1.0 / a[1]), np.where(through, np.inf, 1.0 / a[0])


def _rising(f: Callable[[Any], Any], a: Bounds) -> Bounds:
    with np.errstate(all="ignore"):
        low, high = f(a[0]), f(a[1])
    return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def _cosine(a: Bounds) -> Bounds:
    """Return the bounds of cos: its end values, or 1 or -1 if an even or odd multiple of pi lies between."""
    with np.errstate(invalid="ignore"):
        ends = np.cos(a[0]), np.cos(a[1])
        low, high = np.minimum(*ends), np.maximum(*ends)
        top = np.floor(a[1] / (2 * np.pi)) >= np.ceil(a[0] / (2 * np.pi))
        bottom = np.floor((a[1] - np.pi) / (2 * np.pi)) >= np.ceil((a[0] - np.pi) / (2 * np.pi))
    known = np.isfinite(a[0]) & np.isfinite(a[1])
    return np.where(bottom | ~known, -1.0, low), np.where(top | ~known, 1.0, high)


def _sine(a: Bounds) -> Bounds:
    return _cosine((a[0] - np.pi / 2, a[1] - np.pi / 2))


def _root(a: Bounds) -> Bounds:
    return _rising(lambda x: np.sqrt(np.maximum(x, 0.0)), a)


def _one_minus(a: Bounds) -> Bounds:
    return 1.0 - a[1], 1.0 - a[0]


def _erf(a: Bounds) -> Bounds:
    from scipy.special import erf

    return _rising(erf, a)


def _size(a: Bounds) -> Bounds:
    low, high = np.abs(a[0]), np.abs(a[1])
    return np.where((a[0] < 0) & (a[1] > 0), 0.0, np.minimum(low, high)), np.maximum(low, high)


def _tanh_slope(a: Bounds) -> Bounds:
    """Return 1/cosh^2; 1 - tanh^2 would suffer from cancellation."""
    size = _size(a)
    with np.errstate(over="ignore"):
        return np.cosh(size[1]) ** -2.0, np.cosh(size[0]) ** -2.0


def _piecewise_constant(step: Callable[[Any], Any]) -> tuple[Callable[[Bounds], Bounds], Callable[[Bounds], Bounds]]:
    """Return the bounds of a piecewise constant function, whose rate is unbounded at its jumps."""

    def rate(a: Bounds) -> Bounds:
        still = step(a[0]) == step(a[1])
        return np.where(still, 0.0, -np.inf), np.where(still, 0.0, np.inf)

    return lambda a: _rising(step, a), rate


_SQRT_PI = float(np.sqrt(np.pi))
# operation -> (bounds of the value, bounds of the derivative) over bounds of its argument
UNARY: dict[int, tuple[Callable[[Bounds], Bounds], Callable[[Bounds], Bounds]]] = {
    ca.OP_ASSIGN: (lambda a: a, lambda a: (1.0, 1.0)),
    ca.OP_NEG: (_negative, lambda a: (-1.0, -1.0)),
    ca.OP_TWICE: (lambda a: (2 * a[0], 2 * a[1]), lambda a: (2.0, 2.0)),
    ca.OP_SQ: (_square, lambda a: (2 * a[0], 2 * a[1])),
    ca.OP_INV: (_inverse, lambda a: _negative(_square(_inverse(a)))),
    ca.OP_EXP: (lambda a: _rising(np.exp, a), lambda a: _rising(np.exp, a)),
    ca.OP_EXPM1: (lambda a: _rising(np.expm1, a), lambda a: _rising(np.exp, a)),
    ca.OP_LOG: (lambda a: _rising(np.log, a), _inverse),
    ca.OP_LOG1P: (lambda a: _rising(np.log1p, a), lambda a: _inverse((1 + a[0], 1 + a[1]))),
    ca.OP_SQRT: (_root, lambda a: _times((0.5, 0.5), _inverse(_root(a)))),
    ca.OP_SIN: (_sine, _cosine),
    ca.OP_COS: (_cosine, lambda a: _negative(_sine(a))),
    ca.OP_TAN: (
        lambda a: _times(_sine(a), _inverse(_cosine(a))),
        lambda a: _inverse(_square(_cosine(a))),
    ),
    ca.OP_ATAN: (lambda a: _rising(np.arctan, a), lambda a: _inverse(_add((1.0, 1.0), _square(a)))),
    ca.OP_ASIN: (lambda a: _rising(np.arcsin, a), lambda a: _inverse(_root(_one_minus(_square(a))))),
    ca.OP_SINH: (lambda a: _rising(np.sinh, a), lambda a: _rising(np.cosh, _size(a))),
    ca.OP_COSH: (lambda a: _rising(np.cosh, _size(a)), lambda a: _rising(np.sinh, a)),
    ca.OP_TANH: (lambda a: _rising(np.tanh, a), _tanh_slope),
    ca.OP_ASINH: (lambda a: _rising(np.arcsinh, a), lambda a: _inverse(_root(_add((1.0, 1.0), _square(a))))),
    ca.OP_ERF: (
        _erf,
        lambda a: _times((2 / _SQRT_PI, 2 / _SQRT_PI), _rising(np.exp, _negative(_square(a)))),
    ),
    ca.OP_FABS: (_size, lambda a: _rising(np.sign, a)),
    ca.OP_SIGN: _piecewise_constant(np.sign),
    ca.OP_FLOOR: _piecewise_constant(np.floor),
    ca.OP_CEIL: _piecewise_constant(np.ceil),
    ca.OP_NOT: (lambda a: (0.0, 1.0), lambda a: ANYTHING),
}


def _divide(a: Dual, b: Dual) -> Dual:
    value = _times(a[0], _inverse(b[0]))
    return value, _times(_add(a[1], _negative(_times(value, b[1]))), _inverse(b[0]))


def _multiply(a: Dual, b: Dual) -> Dual:
    return _times(a[0], b[0]), _add(_times(a[1], b[0]), _times(a[0], b[1]))


def _least(a: Dual, b: Dual) -> Dual:
    value = np.minimum(a[0][0], b[0][0]), np.minimum(a[0][1], b[0][1])
    first, second = a[0][1] < b[0][0], b[0][1] < a[0][0]
    low = np.where(first, a[1][0], np.where(second, b[1][0], np.minimum(a[1][0], b[1][0])))
    high = np.where(first, a[1][1], np.where(second, b[1][1], np.maximum(a[1][1], b[1][1])))
    return value, (low, high)


def _negated(a: Dual) -> Dual:
    return _negative(a[0]), _negative(a[1])


def _comparison(a: Dual, b: Dual) -> Dual:
    """Return a < b as 0 or 1; its rate is unbounded where it changes."""
    true, false = a[0][1] < b[0][0], a[0][0] > b[0][1]
    known = true | false
    return (np.where(true, 1.0, 0.0), np.where(false, 0.0, 1.0)), (
        np.where(known, 0.0, -np.inf),
        np.where(known, 0.0, np.inf),
    )


def _power(a: Dual, b: Dual) -> Dual:
    exponent = b[0][0]
    if np.ndim(exponent) or b[0][1] != exponent:  # exp(b log a)
        return _chain(ca.OP_EXP, _multiply(b, _chain(ca.OP_LOG, a)))

    def power(n: float) -> Bounds:
        if n == 0:
            return (1.0, 1.0)
        if n == int(n) and n % 2 == 0:
            size = _size(a[0])
            return _rising(lambda x: x**n, size) if n > 0 else _inverse(_rising(lambda x: x**-n, size))
        if n == int(n):
            return _rising(lambda x: x**n, a[0]) if n > 0 else _inverse(_rising(lambda x: x**-n, a[0]))
        positive = np.maximum(a[0][0], 0.0), a[0][1]
        return _rising(lambda x: x**n, positive) if n > 0 else _inverse(_rising(lambda x: x**-n, positive))

    n = float(exponent)
    return power(n), _times(_times((n, n), power(n - 1)), a[1])


BINARY: dict[int, Callable[[Dual, Dual], Dual]] = {
    ca.OP_ADD: lambda a, b: (_add(a[0], b[0]), _add(a[1], b[1])),
    ca.OP_SUB: lambda a, b: (_add(a[0], _negative(b[0])), _add(a[1], _negative(b[1]))),
    ca.OP_MUL: _multiply,
    ca.OP_IF_ELSE_ZERO: _multiply,
    ca.OP_AND: _multiply,
    ca.OP_DIV: _divide,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_FMIN: _least,
    ca.OP_FMAX: lambda a, b: _negated(_least(_negated(a), _negated(b))),
    ca.OP_LT: _comparison,
    ca.OP_LE: _comparison,
}


def _chain(operation: int, a: Dual) -> Dual:
    value, slope = UNARY[operation]
    return value(a[0]), _times(slope(a[0]), a[1])


def bounds(steps: Sequence[Instruction], low: np.ndarray, high: np.ndarray) -> Dual:
    """Return the bounds (n,) of the last of `steps`, and of its rate, over time cells from `low` to `high` (n,)."""
    duals: list[Dual] = []
    with np.errstate(all="ignore"):
        for op, reads, _, constant in steps:
            arguments = [duals[k] for k in reads]
            if op == ca.OP_INPUT:
                value: Dual = (low, high), (1.0, 1.0)
            elif op == ca.OP_CONST:
                value = (constant, constant), ZERO
            elif op in UNARY:
                value = _chain(op, arguments[0])
            elif op in BINARY:
                value = BINARY[op](arguments[0], arguments[1])
            else:
                value = ANYTHING, ANYTHING
            duals.append(value)
    (a, b), (da, db) = duals[-1]
    a, b, da, db = (np.broadcast_to(np.asarray(x, dtype=float), low.shape) for x in (a, b, da, db))
    unknown = np.isnan(a) | np.isnan(b)
    a, b = np.where(unknown, -np.inf, a), np.where(unknown, np.inf, b)
    unknown = np.isnan(da) | np.isnan(db)
    return (a, b), (np.where(unknown, -np.inf, da), np.where(unknown, np.inf, db))


def functions_of_time(column: ca.SX, t: ca.SX) -> list[list[Instruction]]:
    """Return the largest parts of expressions that depend only on t, as instruction lists; each part once."""
    rest = [s for s in ca.symvar(column) if not ca.is_equal(s, t)]
    steps = instructions(ca.Function("parts", [ca.vertcat(t, *rest)], [column]))
    alone: list[bool] = []  # whether a step depends on nothing but t
    moves: list[bool] = []  # whether it depends on t
    parts: dict[int, None] = {}
    for op, reads, place, _ in steps:
        inside = place == 0 if op == ca.OP_INPUT else all(alone[n] for n in reads)
        if op == ca.OP_OUTPUT or not inside:
            parts |= dict.fromkeys(n for n in reads if alone[n] and moves[n])
        alone.append(inside)
        moves.append(inside if op == ca.OP_INPUT else any(moves[n] for n in reads))
    return [_with_ancestors(steps, n) for n in parts]


def _with_ancestors(steps: list[Instruction], last: int) -> list[Instruction]:
    """Return the steps that the step `last` needs, ending with it."""
    needed, todo = {last}, [last]
    while todo:
        fresh = [n for n in steps[todo.pop()].reads if n not in needed]
        needed.update(fresh)
        todo += fresh
    order = sorted(needed)
    place = {n: k for k, n in enumerate(order)}
    return [steps[n]._replace(reads=[place[a] for a in steps[n].reads]) for n in order]


# tolerance of a straight line, relative to a function's range
SEEN = 1e-4
# a range below this fraction of a function's size is not refined, it may be round-off
FLOOR = 1e-3
# initial number of cells of a run, and shortest cell as a fraction of the run
CELLS, SHORTEST = 64, 2.0**-40
# limits of the cells of one function, and of the operations on them; beyond, cells are not refined any further
MOST_CELLS, MOST_WORK = 300_000, 20_000_000
# if the lengths of straight stretches differ by more than this factor, the integrator restarts between them
RATIO = 16.0
# longest step in straight stretches of its neighbourhood: a pulse has more of them
STRETCHES = 32.0


@dataclass(frozen=True, eq=False)
class Pace:
    """`knots`: times [s] at which an integrator must restart; `longest`: longest steps [s] before, between and after
    them."""

    knots: np.ndarray
    longest: np.ndarray

    def at(self, time: float) -> float:
        """Return the longest step [s] from a time on."""
        return float(self.longest[int(np.searchsorted(self.knots, time, side="right"))])


def pace_of(column: ca.SX, t: ca.SX, start: float, end: float) -> Pace:
    """Return the common pace of all parts of expressions that are functions of t alone."""
    paces = [_pace(steps, start, end) for steps in functions_of_time(column, t)]
    knots = np.unique(np.concatenate([np.zeros(0), *(p.knots for p in paces)]))
    middles = np.concatenate([[start], knots])
    return Pace(knots, np.array([min([np.inf, *(p.at(time) for p in paces)]) for time in middles.tolist()]))


def edges_of(column: ca.SX, t: ca.SX, start: float, end: float) -> np.ndarray:
    """Return times [s] between which all functions of t alone in expressions are straight lines within SEEN."""
    ends = [_stretches(steps, start, end)[1][:-1] for steps in functions_of_time(column, t)]
    return np.unique(np.concatenate([np.zeros(0), *map(np.array, ends)]))


def _pace(steps: Sequence[Instruction], start: float, end: float) -> Pace:
    """Return the pieces of time in which the straight stretches of a function have equal lengths up to RATIO."""
    lengths, ends = _stretches(steps, start, end)
    knots: list[float] = []
    longest: list[float] = []
    least = most = lengths[0]
    for n in range(1, len(lengths)):
        length = lengths[n]
        # the run ends before the last stretch does
        low, high = (min(least, length), max(most, length)) if n < len(lengths) - 1 else (least, max(most, length))
        if high > RATIO * low:
            knots.append(ends[n - 1])
            longest.append(STRETCHES * least)
            low = high = length
        least, most = low, high
    return Pace(np.array(knots), np.array([*longest, STRETCHES * least if len(lengths) > 1 else np.inf]))


def _stretches(steps: Sequence[Instruction], start: float, end: float) -> tuple[list[float], list[float]]:
    """Return lengths and ends of successive stretches on which a function is a straight line within SEEN."""
    low, high, (a, b), (da, db), tolerance = _cells(steps, start, end)
    lengths: list[float] = []
    ends: list[float] = []
    begin = start
    hull: tuple[float, float, float, float] | None = None
    rows = zip(low.tolist(), high.tolist(), a.tolist(), b.tolist(), da.tolist(), db.tolist(), strict=True)
    for first, last, *cell in rows:
        if hull is None:
            hull = cell[0], cell[1], cell[2], cell[3]
            continue
        joined = min(hull[0], cell[0]), max(hull[1], cell[1]), min(hull[2], cell[2]), max(hull[3], cell[3])
        if min(joined[1] - joined[0], (joined[3] - joined[2]) * (last - begin)) <= tolerance:
            hull = joined
            continue
        lengths.append(first - begin)
        ends.append(first)
        begin, hull = first, (cell[0], cell[1], cell[2], cell[3])
    return [*lengths, end - begin], [*ends, end]


def _cells(
    steps: Sequence[Instruction], start: float, end: float
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], float]:
    """Return cells from `start` to `end` over which a function is a straight line, the bounds of its value and rate,
    and the absolute tolerance."""
    edges = np.linspace(start, end, CELLS + 1)
    table = _evaluated(steps, edges[:-1], edges[1:])
    work, shortest, tolerance = 2 * CELLS * len(steps), SHORTEST * (end - start), 0.0
    while True:
        low, high, a, b, da, db, middles = table
        with np.errstate(invalid="ignore", over="ignore"):
            off = np.fmin(b - a, (db - da) * (high - low))
        # from its values: the bounds of a difference may be much wider than its range
        if (values := middles[np.isfinite(middles)]).size:
            tolerance = SEEN * max(float(np.ptp(values)), FLOOR * float(np.max(np.abs(values))))
        split = ~(off <= tolerance) & (high - low > shortest)
        if not split.any() or work > MOST_WORK or low.size > MOST_CELLS:
            order = np.argsort(low)
            low, high, a, b, da, db, _ = table[:, order]
            return low, high, (a, b), (da, db), tolerance
        middle = 0.5 * (low[split] + high[split])
        fresh = _evaluated(steps, np.append(low[split], middle), np.append(middle, high[split]))
        work += 2 * fresh.shape[1] * len(steps)
        table = np.concatenate([table[:, ~split], fresh], axis=1)


def _evaluated(steps: Sequence[Instruction], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the rows low, high, bounds of the value, bounds of the rate, value in the middle of each cell."""
    (a, b), (da, db) = bounds(steps, low, high)
    middle = 0.5 * (low + high)
    return np.array([low, high, a, b, da, db, bounds(steps, middle, middle)[0][0]])
