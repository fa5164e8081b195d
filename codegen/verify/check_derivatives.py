"""Part of check_certificate.py: derivatives along the operations of the C text, in ball arithmetic, and what they prove
about a closed form, namely a lower bound of the smallest singular value of its Jacobian."""

from __future__ import annotations

from typing import NamedTuple

from check_certificate import Undecided
from flint import Ordering, arb, arb_mat, fmpq, fmpq_mpoly_ctx


class Jet(NamedTuple):
    """A value with its first derivatives and second ones (i <= j) that are not zero."""

    x: arb
    g: dict[int, arb]
    h: dict[tuple[int, int], arb]


def _sum(a: Jet, b: Jet, s: int) -> Jet:
    """Return a + s b."""
    g, h = dict(a.g), dict(a.h)
    for to, terms in ((g, b.g), (h, b.h)):
        for k, y in terms.items():
            to[k] = to[k] + s * y if k in to else s * y
    return Jet(a.x + s * b.x, g, h)


def _scaled(a: Jet, x: arb, s: arb | int, bend: arb | int | None, order: int) -> Jet:
    """Return f(a) with the value x, the slope s and the second derivative `bend`."""
    g, h = {k: s * y for k, y in a.g.items()}, {k: s * y for k, y in a.h.items()}
    if order == 2 and bend is not None:
        for i, y in a.g.items():
            for j, other in a.g.items():
                if i <= j:
                    h[i, j] = h.get((i, j), 0) + bend * y * other
    return Jet(x, g, h)


def _times(a: Jet, b: Jet, order: int) -> Jet:
    r = _sum(_scaled(a, arb(0), b.x, None, order), _scaled(b, a.x * b.x, a.x, None, order), 1)
    if order == 2:
        for i, y in a.g.items():
            for j, other in b.g.items():
                k = (min(i, j), max(i, j))
                r.h[k] = r.h.get(k, 0) + (2 if i == j else 1) * y * other
    return r


def _unary(op: str, a: Jet, order: int) -> Jet:
    x = a.x
    if op in ("asin", "acos"):
        left, s = (1 - x * x).sqrt(), 1 if op == "asin" else -1
        return _scaled(a, x.asin() if s == 1 else x.acos(), s / left, s * x / left**3, order)
    if op == "fabs":
        if x.contains(0):
            raise Undecided
        return a if x > 0 else _scaled(a, -x, -1, None, order)
    if op == "floor":
        if not (x.floor().is_exact() and x > x.floor()):
            raise Undecided
        return Jet(x.floor(), {}, {})
    root, t = (x.sqrt(), x) if op == "sqrt" else (x, x.tanh() if op == "tanh" else x)
    value, slope, bend = {
        "neg": lambda: (-x, -1, None), "twice": lambda: (2 * x, 2, None),
        "sq": lambda: (x * x, 2 * x, 2), "inverse": lambda: (1 / x, -1 / (x * x), 2 / (x * x * x)),
        "sqrt": lambda: (root, 1 / (2 * root), -1 / (4 * root * x)),
        "sin": lambda: (x.sin(), x.cos(), -x.sin()), "cos": lambda: (x.cos(), -x.sin(), -x.cos()),
        "tanh": lambda: (t, 1 - t * t, -2 * t * (1 - t * t)),
        "atan": lambda: (x.atan(), 1 / (1 + x * x), -2 * x / (1 + x * x) ** 2),
    }[op]()  # fmt: skip
    return _scaled(a, value, slope, bend, order)


def _angle(y: Jet, x: Jet, order: int) -> Jet:
    if x.x < 0 and not (y.x > 0 or y.x < 0):  # across the cut, where the angle jumps by a turn but no derivative does
        slopes = _unary("atan", _times(y, _unary("inverse", x, order), order), order)
        return slopes._replace(x=arb.pi().union(-arb.pi()))
    if not (x.x > 0 or y.x > 0 or y.x < 0):
        raise Undecided
    if x.x > 0:
        return _unary("atan", _times(y, _unary("inverse", x, order), order), order)
    turned = _unary("atan", _times(x, _unary("inverse", y, order), order), order)
    quarter = arb.pi() / 2 if y.x > 0 else -arb.pi() / 2
    return Jet(quarter - turned.x, *_scaled(turned, turned.x, -1, None, order)[1:])


class Derivatives:
    """The operations of a body, evaluated with derivatives; second ones only for what the first output depends on, or
    everywhere."""

    def __init__(self, steps: list[tuple], everywhere: bool) -> None:
        latest: dict[str, int] = {}
        self.steps: list[tuple] = []
        for op, target, *rest in steps:
            reads = [target] if op == "out" else [] if op in ("in", "const") else rest
            self.steps.append((op, [latest[name] for name in reads], rest))
            latest[target] = len(self.steps) - 1 if op != "out" else latest[target]
        self.twice = [everywhere] * len(self.steps)
        for k in reversed(range(len(self.steps))):
            op, reads, rest = self.steps[k]
            if self.twice[k] or (op == "out" and rest[0] == 0):
                for r in reads:
                    self.twice[r] = True

    def run(self, inputs: list[list[Jet]], order: int) -> dict[tuple[int, int], Jet]:
        made: list[Jet] = []
        results = {}
        for (op, reads, rest), twice in zip(self.steps, self.twice, strict=True):
            made.append(self._step(op, [made[r] for r in reads], rest, inputs, order if twice else min(order, 1)))
            if not made[-1].x.is_finite():
                raise Undecided
            if op == "out":
                results[rest[0], rest[1]] = made[-1]
        return results

    def _step(self, op: str, given: list[Jet], rest: list, inputs: list[list[Jet]], order: int) -> Jet:
        if op == "in":
            return inputs[rest[0]][rest[1]]
        if op == "const":
            return Jet(arb(float(rest[0].rstrip("f"))), {}, {})
        a, b = given[0], given[-1]
        if op == "out":
            return a
        if op in "+-":
            return _sum(a, b, 1 if op == "+" else -1)
        if op == "*":
            return _unary("sq", a, order) if a is b else _times(a, b, order)
        if op == "/":
            return _times(a, _unary("inverse", b, order), order)
        if op == "atan2":
            return _angle(a, b, order)
        if op in ("fmin", "fmax"):
            if not (a.x < b.x or a.x > b.x):
                raise Undecided
            return a if (a.x < b.x) == (op == "fmin") else b
        return _unary(op, a, order)


def most(values: list[arb]) -> arb:
    """Return an upper bound of all values; max() alone would pass over NaN."""
    if not all(x.is_finite() for x in values):
        raise Undecided
    return max(x.upper() for x in values)


def norm(rows: list[list[arb]], s: list[arb]) -> arb:
    """Return the largest sum of |entries| of a row, in nominals."""
    return most([sum((abs(y) * t for y, t in zip(row, s, strict=True)), arb(0)) / s[i] for i, row in enumerate(rows)])


def inverse(matrix: list[list[arb]]) -> arb_mat:
    """Return about the inverse, or for a tall matrix the pseudoinverse, of the midpoints."""
    try:
        J = arb_mat(matrix).mid()
        wanted = J.inv() if J.nrows() == J.ncols() else (J.transpose() * J).inv() * J.transpose()
    except ZeroDivisionError as error:
        raise Undecided from error
    return wanted.mid()


def least_singular_value(matrix: list[list[arb]]) -> arb:
    """Return a lower bound of the smallest singular value of all matrices in these intervals."""
    if len(matrix) < len(matrix[0]):
        matrix = [list(column) for column in zip(*matrix, strict=True)]
    B, J = inverse(matrix), arb_mat(matrix)
    n = J.ncols()
    rest = arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)]) - B * J
    power = B * B.transpose()
    for _ in range(2):
        power = power * power
    size = sum((x.abs_upper() ** 2 for x in power.entries()), arb(0)) ** (arb(1) / 16)
    spread = sum((x.abs_upper() ** 2 for x in rest.entries()), arb(0)).sqrt()
    return ((1 - most([spread])) / most([size])).lower()


def split(jets: list[Jet], sizes: list[int]) -> list[list[Jet]]:
    rest = iter(jets)
    return [[next(rest) for _ in range(size)] for size in sizes]


def between(steps: list[tuple], m: int) -> dict[int, arb] | None:
    """Return the sums, by degree, of all |coefficients| of G - dr/dz: the second output of a kernel and the derivatives
    of the first one by its m unknowns, as polynomials with exact coefficients; None if they are no polynomials."""
    places = [tuple(x[2:]) for x in steps if x[0] == "in"]
    of, work, results = fmpq_mpoly_ctx.get([f"v{a}_{k}" for a, k in sorted(places)], Ordering.lex), {}, {}
    symbols = dict(zip(sorted(places), of.gens(), strict=True))
    for op, target, *rest in steps:
        given = [work[x] for x in rest] if op not in ("in", "const", "out") else []
        if op == "out":
            results[rest[0], rest[1]] = work[target]
        elif op in ("in", "const"):
            number = fmpq(*float(rest[0].rstrip("f")).as_integer_ratio()) if op == "const" else 0
            work[target] = symbols[tuple(rest)] if op == "in" else of.constant(number)
        elif op in ("+", "-", "*", "sq", "twice", "neg"):
            a, b = given[0], given[-1]
            made = {"+": a + b, "-": a - b, "neg": -a, "twice": 2 * a}
            work[target] = made[op] if op in made else a * b
        else:
            return None
    sums: dict[int, arb] = {}
    for i in range(m):
        for j in range(m):
            z = sorted(places).index((0, j)) if (0, j) in symbols else None
            slope = results[0, i].derivative(z) if z is not None else 0
            for powers, c in (results[1, i * m + j] - slope).terms():
                sums[sum(powers)] = sums.get(sum(powers), arb(0)) + abs(arb(c))
    return sums


class ClosedForm:
    """The rank of the Jacobian of a closed form; `least`: the stated bound of its smallest singular value."""

    def __init__(self, steps: list[tuple], sizes: list[int], wanted: list[tuple[int, int]], least: float) -> None:
        self.body, self.sizes, self.wanted, self.least = Derivatives(steps, True), sizes, wanted, arb(least)

    def full(self, a: list[float], b: list[float]) -> bool:
        """Return whether the bound holds in a box."""
        spans = [arb(p).union(arb(q)) for p, q in zip(a, b, strict=True)]
        middle = [x.mid() for x in spans]
        ways = [x - y for x, y in zip(spans, middle, strict=True)]
        zero, units = arb(0), [Jet(x, {k: arb(1)}, {}) for k, x in enumerate(middle)]
        try:
            at = self.body.run(split(units, self.sizes), 1)
            over = self.body.run(split([Jet(x, u.g, {}) for x, u in zip(spans, units, strict=True)], self.sizes), 2)
            matrix = [[at[o].g.get(c, zero) + sum((over[o].h.get((min(c, d), max(c, d)), zero) * way
                                                   for d, way in enumerate(ways)), zero)
                       for c in range(len(ways))] for o in self.wanted]  # fmt: skip
            return least_singular_value(matrix) >= self.least
        except Undecided:
            return False
