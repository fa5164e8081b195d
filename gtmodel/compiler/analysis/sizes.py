"""Limits of the size of inputs: round-off must stay small relative to the lengths in the closure equations.

In |T - A - q v|^2 = L^2 with q a million times L, one of thirteen digits of L remains. For inputs that occur in no
closure equation, such as rates and forces, the limit is far beyond any practical value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..blocks import SolvedBlock
from ..plan import CausalPlan
from ..rewriting import Instruction, of_expression

Pair = tuple[int, int]

# candidate limits: 2^k and 1.5 2^k, which float and double represent exactly
TRIED = np.sort(np.concatenate([2.0 ** np.arange(-40, 54), 1.5 * 2.0 ** np.arange(-40, 53)]))
ROOM = 8.0  # smallest limit relative to the size at the home pose
# units of unknowns whose size does not grow with the lengths: components of unit vectors and quaternions, angles
NUMBERS, ANGLES = {"1"}, {"rad", "deg"}
_PERIODIC = frozenset([ca.OP_SIN, ca.OP_COS, ca.OP_TAN])
_BOUNDED = _PERIODIC | {ca.OP_TANH, ca.OP_SIGN, ca.OP_ATAN, ca.OP_ATAN2, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ERF}
DIGITS = ".6g"  # of values at the home pose: limits must not depend on the linear algebra library


@dataclass(frozen=True)
class Precision:
    """A floating-point precision. `share`: largest round-off relative to the lengths in a closure equation; `largest`:
    largest size of any input, beyond which differences of large rates are only round-off."""

    round_off: float
    share: float
    largest: float


# 1e-8 of the lengths; near a singular pose further digits are lost
DOUBLE = Precision(2.0**-53, 1e-8, 2.0**53)


@dataclass(frozen=True)
class Sizes:
    """`limits`: the largest size of each argument. The norm of all arguments, each divided by its limit, must not
    exceed one: a single comparison."""

    limits: tuple[float, ...]

    @cached_property
    def most(self) -> float:
        """The largest allowed weighted sum of squares."""
        return max(self.limits, default=1.0) ** 2

    @cached_property
    def groups(self) -> list[tuple[float, list[int]]]:
        """(weight of the squares, positions of the arguments with this weight) in the order of the sum."""
        groups: dict[float, list[int]] = {}
        for n, limit in enumerate(self.limits):
            groups.setdefault(self.most / limit**2, []).append(n)
        return list(groups.items())

    def norm(self, columns: Sequence[ca.SX]) -> ca.SX:
        """Return the weighted sum of squares as an expression, for comparison with `most`."""
        return sum([weight * ca.sumsqr(columns[n]) for weight, places in self.groups for n in places], ca.SX(0))

    def within(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Return which columns of the arguments (size, n) are within the limits; false for NaN."""
        total = np.zeros(columns[0].shape[1] if columns else 1, columns[0].dtype if columns else float)
        number = total.dtype.type
        with np.errstate(over="ignore", invalid="ignore"):
            for n, (weight, places) in enumerate(self.groups):  # in the order in which C adds
                rows = [row for place in places for row in columns[place]]
                squares = rows[0] * rows[0]
                for row in rows[1:]:
                    squares = squares + row * row
                squares = squares if weight == 1.0 else number(weight) * squares
                total = squares if n == 0 else total + squares
            return total <= number(self.most)


def sizes_of(plan: CausalPlan, arguments: Sequence[Sequence[Pair]], precision: Precision = DOUBLE) -> Sizes:
    """Return the limits for arguments that consist of these chain symbols; an argument without symbols is the time."""
    plan, scope = plan.numbers or plan, plan.flat.scope  # `numbers` has numeric lengths
    reach = _Reach(plan)
    closures = [_Closures(plan, reach, b, precision) for b in plan.blocks if b.closures]
    limits = []
    for pairs in arguments:
        symbols = [scope.symbol(*p) for p in pairs] or [scope.time]
        keys = frozenset(s.element_hash() for s in symbols)
        limits.append(min([precision.largest, *[c.limit(keys) for c in closures]]))
    return Sizes(tuple(limits))


class _Reach:
    """The inputs that each symbol of a plan depends on: all, and those not only through a periodic function."""

    def __init__(self, plan: CausalPlan) -> None:
        self._plan = plan
        self._made = {u.element_hash(): e for b in plan.blocks for u, e in b.assignments}
        self._block: dict[int, SolvedBlock] = {}
        for b in plan.blocks:
            if b.closures:
                own = [*(b.newton.unknowns if b.newton else []), *[u for u, _ in b.assignments]]
                self._block |= {u.element_hash(): b for u in own}
        self._known: dict[int, tuple[frozenset[int], frozenset[int]]] = {}

    def of(self, symbol: ca.SX) -> tuple[frozenset[int], frozenset[int]]:
        """Return (all inputs, those not only through a periodic function) as hashes of their symbols."""
        key = symbol.element_hash()
        if key not in self._known:
            self._known[key] = frozenset([key]), frozenset([key])  # an input depends on itself
            block = self._block.get(key)
            if block is not None:
                own = self.unknowns(block)
                reached = self._through(ca.vertcat(*block.closures), own)
                self._known |= dict.fromkeys(own, reached)
            elif key in self._made:
                self._known[key] = self._through(self._made[key], frozenset())
        return self._known[key]

    def unknowns(self, block: SolvedBlock) -> frozenset[int]:
        return frozenset(key for key, b in self._block.items() if b is block)

    def _through(self, expression: ca.SX, own: frozenset[int]) -> tuple[frozenset[int], frozenset[int]]:
        symbols = [s for s in ca.symvar(expression) if s.element_hash() not in own]
        straight = _outside(expression, symbols)
        every = [self.of(s) for s in symbols]
        plain = [x[1] for s, x in zip(symbols, every, strict=True) if s.element_hash() in straight]
        return frozenset().union(*[x[0] for x in every]), frozenset().union(*plain)


def _outside(expression: ca.SX, symbols: Sequence[ca.SX]) -> frozenset[int]:
    """Return which symbols occur in an expression outside periodic functions."""
    if not symbols:
        return frozenset()
    read, free = of_expression(expression)
    work: list[frozenset[int]] = []
    outside = nothing = frozenset[int]()
    for op, reads, place, _ in read:
        if op == ca.OP_INPUT:
            work.append(frozenset([free[place].element_hash()]))
        else:
            work.append(nothing if op in _PERIODIC else nothing.union(*[work[i] for i in reads]))
        if op == ca.OP_OUTPUT:
            outside |= work[-1]
    return outside & {s.element_hash() for s in symbols}


class _Closures:
    """The closures of a block, and the sizes of inputs at which their round-off is small."""

    def __init__(self, plan: CausalPlan, reach: _Reach, block: SolvedBlock, precision: Precision) -> None:
        closures, own = ca.vertcat(*block.closures), reach.unknowns(block)
        symbols = ca.symvar(closures)
        self._symbols = [s.element_hash() for s in symbols]
        self._values = [_home(plan, s) for s in symbols]
        self._reach = {s.element_hash(): reach.of(s) for s in symbols if s.element_hash() not in own}
        self._every = frozenset().union(*[inputs for inputs, _ in self._reach.values()])
        self._straight = _outside(closures, symbols)
        self._lengths = {
            s.element_hash() for s in symbols if s.element_hash() in own and _unit(plan, s) not in NUMBERS | ANGLES
        }
        self._read, _ = of_expression(closures)
        self._precision = precision
        self._known: dict[tuple[frozenset[int], frozenset[int]], float] = {}

    def limit(self, keys: frozenset[int]) -> float:
        """Return the largest size of the inputs with these hashes."""
        if self._every.isdisjoint(keys):
            return np.inf
        concerned = {key for key, (inputs, _) in self._reach.items() if inputs & keys}
        moved = frozenset(key for key in concerned & self._straight if self._reach[key][1] & keys)
        if moved:  # the unknowns move with the inputs
            moved |= self._lengths
        case = moved, frozenset() if moved else frozenset(concerned)
        if case not in self._known:
            self._known[case] = self._limit(*case)
        return self._known[case]

    def _limit(self, moved: frozenset[int], turned: frozenset[int]) -> float:
        size, eps = TRIED, self._precision.round_off
        given = []
        for key, value in zip(self._symbols, self._values, strict=True):
            magnitude = size if key in moved else np.full_like(size, value)
            given.append((magnitude, eps * (size if key in turned else magnitude)))
        noise = _errors(self._read, given, eps)[1]
        lengths = _errors(self._read, [(np.zeros(1), np.zeros(1))] * len(self._symbols), 0.0)[0]
        bad = np.any((lengths > 0.0) & ~(noise <= self._precision.share * lengths), axis=0)
        held = size[np.argmax(bad) - 1] if bad.any() else np.inf
        values = zip(self._symbols, self._values, strict=True)
        typical = max([v for key, v in values if key in moved], default=0.0)
        return float(max(held, ROOM * 2.0 ** np.ceil(np.log2(max(typical, size[0])))))


def _errors(
    read: Sequence[Instruction], given: Sequence[tuple[np.ndarray, np.ndarray]], eps: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return magnitudes and round-off of a column, (rows, sizes), from those of its symbols.

    Magnitudes are added, ignoring cancellation. An unknown operation gets the larger magnitude of its arguments.
    """
    work: list[tuple[np.ndarray, np.ndarray]] = []
    none = np.zeros_like(given[0][0])
    outputs: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    with np.errstate(all="ignore"):
        for op, reads, place, constant in read:
            if op == ca.OP_OUTPUT:
                work.append(work[reads[0]])
                outputs[place] = work[-1]
            elif op == ca.OP_INPUT:
                work.append(given[place])
            elif op == ca.OP_CONST:
                c = abs(constant)
                work.append((none + c, none + eps * c))
            else:
                (a, x), (b, y) = work[reads[0]], work[reads[-1]]
                if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_TWICE):
                    size, error = a + b, x + y
                elif op in (ca.OP_MUL, ca.OP_SQ):
                    size, error = a * b, a * y + b * x
                elif op == ca.OP_DIV:
                    b = np.where(b > 0.0, b, 1.0)
                    size, error = a / b, (x + a / b * y) / b
                elif op == ca.OP_SQRT:
                    size = np.sqrt(a)
                    error = x / np.where(size > 0.0, size, 1.0)
                elif op in _BOUNDED:
                    size, error = none + 1.0, np.minimum(x + y, 2.0)
                else:
                    size, error = np.maximum(a, b), np.maximum(x, y)
                work.append((size, error + eps * size))
    each = [outputs[place] for place in sorted(outputs)]
    return np.array([size for size, _ in each]), np.array([error for _, error in each])


def _unit(plan: CausalPlan, symbol: ca.SX) -> str:
    pair = plan.flat.scope.owner(symbol)
    return "s" if pair is None else plan.flat.unit_of(*pair)


def _home(plan: CausalPlan, symbol: ca.SX) -> float:
    """Return the size of a symbol at the home pose, rounded to be independent of the linear algebra library."""
    pair = plan.flat.scope.owner(symbol)
    if pair is None or pair not in plan.pairs:
        return 0.0 if pair is not None else abs(plan.sampler.time)
    return float(f"{abs(plan.samples[0][plan.pairs.index(pair)]):{DIGITS}}")
