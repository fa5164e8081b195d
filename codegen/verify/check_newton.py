"""Part of check_certificate.py: functions with Newton's method (gt_newton.h).

For a box of the inputs a, with the solution z0 at the midpoint a0, C = J^-1 and M = dz/da there, we write
z = z0 + M (a - a0) + w and u = (w, a - a0). The Krawczyk operator -C r + (I - C J) w maps |w| <= W into itself only if
there is exactly one solution in it for every a (Rump, Acta Numerica 2010). From a start within e of it a step of
Newton's method, with the matrix G that the code computes in place of J, leaves
(|C r''| e / 2 + |C (G - J)|) e / (1 - |I - C G|) and round-off. Distances are in nominals: the largest |w_i| / s_i.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from check_certificate import ARITHMETIC, Machine, Undecided, Value, framed, halves, outside, passes
from check_derivatives import Derivatives, Jet, between, inverse, least_singular_value, most, norm, split
from check_text import Refused, function, tests
from flint import arb, arb_mat

ANSWER = arb("1e-9")  # largest distance of an answer from the solution
STEPS, REACH, CONTRACTION, ROUND_OFF, SLACK = 4, arb("0.5"), arb("0.25"), arb("1e-10"), arb("1e-6")  # of gt_newton.h
MOST = 50_000  # boxes for one function
UNIT = ARITHMETIC["double"][0]


def _numbers(text: str, name: str) -> list[float]:
    found = re.search(rf"static const double {name}\[\d+\] = \{{([^}}]*)\}};", text)
    return [float(x) for x in found[1].split(",")] if found else []


class Newton:
    """A function with one Newton block: the operations `bodies` by symbol, and its C text."""

    def __init__(self, symbol: str, entry: dict, stated: dict, bodies: dict, wrapper: str) -> None:
        name, self.stated, self.entry = entry["name"], stated, entry
        solve = function(wrapper, f"static gt_status solve_{name}0(")
        whole = function(wrapper, f"gt_status {symbol}(")
        self.before, self.after = tests(solve), tests(whole)
        nominal, largest = (_numbers(solve, what) for what in ("nominal", "largest"))
        call = rf"return solve\({symbol}_kernel0, arg, res, iw, w, (\d+), nominal, largest, ([-+.\de]+), z, marks\);"
        given = re.search(call, solve)
        if given is None or not int(given[1]) == len(nominal) == len(largest) or f"solve_{name}1(" in wrapper:
            raise Refused(f"{symbol}: the call of Newton's method cannot be read")
        self.m, self.s, self.least = int(given[1]), [1 / arb(x) for x in nominal], arb(float(given[2]))
        self.limit, self.loosest = 1 / arb(max(largest)), 1 / arb(min(largest))
        steps = [bodies[f"{symbol}_{part}"] for part in ("prepare0", "kernel0", "body")]
        self.prepare, self.kernel, self.body = (Derivatives(x, False) for x in steps)
        self.between = between(steps[1], self.m)
        self.sizes = [math.prod(x["shape"]) for x in entry["inputs"]]
        self.k, self.constants = sum(self.sizes), sum(x[0] == "out" and x[2] == 0 for x in steps[0])
        inputs = (self.sizes, [self.m, self.constants], [*self.sizes, self.m])
        self.machines = [Machine(x, sizes, "double") for x, sizes in zip(steps, inputs, strict=True)]
        self.wanted = [(k, j) for k, x in enumerate(entry["outputs"]) for j in range(math.prod(x["shape"]))]
        found = [[x[2:] for x in part if x[0] == "out"] for part in steps[1:]]
        square = [(0, i) for i in range(self.m)] + [(1, i) for i in range(self.m**2)]
        stop = [x[:2] for x in steps[1]].index(("const", "stop")) if ("const", "stop", "0.0") in steps[1] else None
        if stop is not None and any(x[0] == "out" and x[2] == 0 for x in steps[1][stop:]):
            raise Refused(f"{symbol}: the kernel returns before its residual")
        if sorted(found[0]) != square or sorted(x for x in found[1] if x[0] < len(entry["outputs"])) != self.wanted:
            raise Refused(f"{symbol}: the outputs of the bodies are not those of the manifest")
        speeds = [stated["speed"][x["signal"]] if "speed" in stated else 0.0 for x in entry["inputs"]]
        moved = [arb(v) * arb(stated.get("period", 0.0)) for v in speeds]
        self.away = [x for x, size in zip(moved, self.sizes, strict=True) for _ in range(size)]

    def open(self, a: list[float], b: list[float], start: list[float], tolerance: float) -> tuple:
        """Return the line of solutions. Raises Undecided unless all statements hold in the box; `start`: about the
        solution at its midpoint."""
        spans = [(arb(p) - w).union(arb(q) + w) for p, q, w in zip(a, b, self.away, strict=True)]
        D, w, widest = self._krawczyk(spans, [p + 0.5 * (q - p) for p, q in zip(a, b, strict=True)], start)
        slope = self._slope(D)
        moved = [sum((abs(x) * y for x, y in zip(row, self.away, strict=True)), arb(0)) / self.s[i]
                 for i, row in enumerate((arb_mat(self.M) + slope).tolist())]  # fmt: skip
        # the last inputs may lie beside the box, these do not
        spans = [arb(p).union(arb(q)) for p, q in zip(a, b, strict=True)]
        self.way = [x - y for x, y in zip(spans, self.a0, strict=True)]
        e = self._reached(ANSWER + most(moved), w, spans)
        self._results(e, w, spans, slope, tolerance)
        return self.a0, self.z0, self.M, widest

    def _krawczyk(self, spans: list[arb], a0: list[float], start: list[float]) -> tuple[arb_mat, list[arb], list[arb]]:
        """Return C dr/du, and half widths in which the solutions lie, and in which there is no other one."""
        self.a0, m, s, tiny = a0, self.m, self.s, arb("1e-13")
        self.way = [x - y for x, y in zip(spans, a0, strict=True)]
        self._centre(start)
        w = [tiny * x for x in s]
        for _ in range(5):
            second, D, _ = self._around(w)
            line = arb_mat(m + self.k, 1, [arb(0)] * m + self.way)
            g = self.r0 + self.first * line
            for c, way in enumerate(self.way, m):
                g += second[c] * line * (way / 2)
            image = [most([abs(g[i, 0]) + sum((abs(x) * y for x, y in zip(row, w, strict=True)), arb(0))])
                     for i, row in enumerate(self._rest(D))]  # fmt: skip
            if all(x < y for x, y in zip(image, w, strict=True)):
                return D, image, w
            w = [2 * x + tiny * y for x, y in zip(image, s, strict=True)]
        raise Undecided

    def same(self, p: list[float], lines: list[tuple]) -> bool:
        """Return whether two lines of solutions have the same one at a point."""
        starts = [[arb(z) + sum((t * (arb(x) - y) for t, x, y in zip(row, p, a0, strict=True)), arb(0))
                   for z, row in zip(z0, M, strict=True)] for a0, z0, M, _ in lines]  # fmt: skip
        try:
            _, w, _ = self._krawczyk([arb(x) for x in p], p, [float(z.mid()) for z in starts[0]])
        except Undecided:
            return False
        return all(abs(x - z) + d < y for begin, (*_, widest) in zip(starts, lines, strict=True)
                   for x, z, d, y in zip(begin, self.z0, w, widest, strict=True))  # fmt: skip

    def _centre(self, z: list[float]) -> None:
        """Set solution, inverse, tangents and first derivatives at the midpoint."""
        m, k = self.m, self.k
        self.z0, self.M = z, [[arb(0)] * k for _ in range(m)]
        none, still = [arb(0)] * m, [arb(0)] * k
        for _ in range(20):
            r = self._kernel(none, still, 1)
            J = arb_mat([[r[0, i].g.get(c, arb(0)) for c in range(m + k)] for i in range(m)])
            self.C = inverse([row[:m] for row in J.tolist()])
            step = (self.C * arb_mat(m, 1, [r[0, i].x for i in range(m)])).entries()
            if all(abs(x).upper() < 1e-14 * y for x, y in zip(step, self.s, strict=True)):
                break
            self.z0 = [x - float(d.mid()) for x, d in zip(self.z0, step, strict=True)]
        self.M = (-self.C * arb_mat([row[m:] for row in J.tolist()])).mid().tolist()
        r = self._kernel(none, still, 1)
        self.r0 = self.C * arb_mat(m, 1, [r[0, i].x for i in range(m)])
        first = [[r[0, i].g.get(c, arb(0)) for c in range(m + k)] for i in range(m)]
        self.first = self.C * arb_mat(first)
        self.apart = self.C * arb_mat([[r[1, i * m + j].x - first[i][j] for j in range(m)] for i in range(m)])

    def _kernel(self, w: list[arb], way: list[arb], order: int) -> dict[tuple[int, int], Jet]:
        m, one = self.m, arb(1)
        a = [Jet(x + y, {m + j: one}, {}) for j, (x, y) in enumerate(zip(self.a0, way, strict=True))]
        found, z = self.prepare.run(split(a, self.sizes), order), self._z(w, way)
        constants = [found[0, j] for j in range(self.constants)]
        self.largest = most([one, *[abs(x.x) for x in [*z, *constants]]])
        return self.kernel.run([z, constants], order)

    def _z(self, w: list[arb], way: list[arb]) -> list[Jet]:
        return [
            Jet(sum((t * y for t, y in zip(row, way, strict=True)), arb(z)) + d.union(-d),
                {i: arb(1), **{self.m + j: t for j, t in enumerate(row)}}, {})
            for i, (z, row, d) in enumerate(zip(self.z0, self.M, w, strict=True))
        ]  # fmt: skip

    def _around(self, w: list[arb]) -> tuple[list[arb_mat], arb_mat, arb_mat]:
        """Return for |w_i| <= `w` the second derivatives C r'' by u, C dr/du, and C (G - J)."""
        m, both, none = self.m, self.m + self.k, arb(0)
        r = self._kernel(w, self.way, 2)
        u = arb_mat(both, 1, [*[x.union(-x) for x in w], *self.way])
        bent = [arb_mat([[r[0, i].h.get((min(c, d), max(c, d)), none) for d in range(both)] for i in range(m)])
                for c in range(both)]  # fmt: skip
        second = [self.C * x for x in bent]
        change = [x * u for x in second]
        D = arb_mat([[self.first[i, c] + change[c][i, 0] for c in range(both)] for i in range(m)])
        self.rows = most([sum((abs(r[0, i].g.get(j, none)) * self.s[j] for j in range(m)), none) for i in range(m)])
        if self.between is not None:
            most_ = sum((c * self.largest**degree for degree, c in self.between.items()), none)
            part = [sum((abs(x) for x in row), none) * most_ for row in self.C.tolist()]
            return second, D, arb_mat([[x.union(-x)] * m for x in part])
        apart = []
        for j in range(m):
            turn = arb_mat([[r[1, i * m + j].g.get(d, none) for d in range(both)] for i in range(m)]) - bent[j]
            apart.append((self.C * turn * u).entries())
        return second, D, self.apart + arb_mat(apart).transpose()

    def _rest(self, D: arb_mat) -> list[list[arb]]:
        """Return I - C J."""
        return [[int(i == j) - x for j, x in enumerate(row[: self.m])] for i, row in enumerate(D.tolist())]

    def _slope(self, D: arb_mat) -> arb_mat:
        """Return dz/da - M = -(C J)^-1 slant, slant being the part of D by the inputs."""
        rho, slant = norm(self._rest(D), self.s), [row[self.m :] for row in D.tolist()]
        if not rho < 1:
            raise Undecided
        share = (rho / (1 - rho)).upper()
        largest = [most([abs(row[a]) / s for row, s in zip(slant, self.s, strict=True)]) for a in range(self.k)]
        error = [[abs(x) + share * s * y for x, y in zip(row, largest, strict=True)]
                 for row, s in zip(slant, self.s, strict=True)]  # fmt: skip
        return arb_mat([[x.union(-x) for x in row] for row in error])

    def _reached(self, start: arb, w: list[arb], spans: list[arb]) -> arb:
        """Return a bound of the distance of the answer of the code from the solution, if it starts within `start`."""
        m, s = self.m, self.s
        wide = [x + start * y for x, y in zip(w, s, strict=True)]
        second, D, apart = self._around(wide)
        rest = self._rest(D)
        drift, left = norm(apart.tolist(), s), 1 - norm(rest, s) - norm(apart.tolist(), s)
        if not left > 0:
            raise Undecided
        units = range(m)
        bend = most([sum(abs(second[c][i, d]) * s[c] * s[d] for c in units for d in units) / s[i] for i in units])
        half, drift = bend / 2 / left, drift / left
        size = [most([sum((abs(x) for x in row), arb(0))]) for row in self.C.tolist()]
        beta = most([x / y for x, y in zip(size, s, strict=True)]) / left
        self.prepared = self.machines[0].run([Value(x, arb(0), frozenset()) for x in spans])
        z = [x.x for x in self._z(wide, self.way)]
        kernel = self.machines[1].run([*[Value(x, arb(0), frozenset()) for x in z],
                                       *[self.prepared[0, j] for j in range(self.constants)]])  # fmt: skip
        noise, matrix = most([kernel[0, i].e for i in units]), [kernel[1, i] for i in range(m * m)]
        if "speed" not in self.stated:
            e = beta * (self.loosest + noise)
            if not e <= ANSWER:
                raise Undecided
            return e
        # backward error of LU with partial pivoting, 3 n u |L| |U|, doubled for the inverse of the pivot
        lu = 6 * m**3 * UNIT * 2 ** (m - 1) * most([abs(x.x) for x in matrix])
        perturbed = m * most([x.e for x in matrix]) + lu
        spoilt = beta * perturbed * most(s)
        quiet = 2 * beta * noise + 4 * UNIT * most([abs(x) / y for x, y in zip(z, s, strict=True)])
        # a pivot is the greatest entry of a column of a Schur complement, whose inverse is a part of G^-1
        plain = 1 - norm((arb_mat(rest) - apart).tolist(), [arb(1)] * m)
        e, shrinking = start, half * start + drift + 2 * spoilt
        for _ in range(STEPS):
            e = most([(half * e + drift + 2 * spoilt) * e + quiet])
        good = shrinks(shrinking, quiet) and start * (1 + shrinking) + quiet <= REACH * (1 - SLACK) and e <= ANSWER
        good = good and plain > 0 and plain / most(size) > self.least * (1 + arb(2) ** -20) + perturbed
        if not (good and self.rows * e + noise <= self.limit):
            raise Undecided
        return e

    def _results(self, e: arb, w: list[arb], spans: list[arb], slope: arb_mat, tolerance: float) -> None:
        """Raise Undecided unless margins, errors, ranges and the rank are as stated."""
        z = self._z(w, self.way)
        known = [Value(x, arb(0), frozenset([k])) for k, x in enumerate(spans)]
        known += [Value(x.x, e * y, frozenset()) for x, y in zip(z, self.s, strict=True)]
        found = self.machines[2].run(known)
        tested = [(self.prepared[1, n], kind, x) for n, kind, x in self.before]
        tested += [(found[len(self.entry["outputs"]), n], kind, x) for n, kind, x in self.after]
        good = all(passes(value, kind, scale, tolerance) for value, kind, scale in tested)
        if not good or outside(found, self.wanted, self.stated) is not None:
            raise Undecided
        if "least_singular_value" in self.stated:
            a = [Jet(x, {self.m + k: arb(1)}, {}) for k, x in enumerate(spans)]
            g = [x.g for x in map(self.body.run([*split(a, self.sizes), z], 1).get, self.wanted)]
            by = [[y.get(self.m + k, arb(0)) + sum((y.get(i, arb(0)) * slope[i, k] for i in range(self.m)), arb(0))
                   for k in range(self.k)] for y in g]  # fmt: skip
            if not least_singular_value(by) >= arb(self.stated["least_singular_value"]):
                raise Undecided


def shrinks(left: arb, quiet: arb) -> bool:
    """Return whether steps that leave at most `left` of the distance e, and `quiet` of round-off, pass the code's test.

    A step has at least (1 - left) e - 2 quiet, the next one at most (1 + left) (left e + quiet) + 2 quiet; it is tested
    only above the limit of the round-off, which bounds e from below.
    """
    following = (ROUND_OFF - 2 * quiet) / (1 + left) - quiet
    if not following > 0:
        return False
    t = quiet * left / following
    return (1 + left) * (left + t) + 2 * t <= CONTRACTION * (1 - left - 2 * t) * (1 - SLACK)


def checked(symbol: str, entry: dict, stated: dict, bodies: dict, wrapper: str, tolerance: float) -> int:
    """Check one function over boxes, each with about the solution at its midpoint; return their number."""
    function, (boxes, whole), count = Newton(symbol, entry, stated, bodies, wrapper), framed(symbol, entry, stated), 0
    waiting = [(a, b, z) for (a, b), z in zip(boxes, stated["starts"], strict=True)]
    solved: list[tuple] = []
    while waiting:
        a, b, start = waiting.pop()
        count += 1
        try:
            solved.append((a, b, function.open(a, b, start, tolerance)))
        except Undecided:
            if count >= MOST:
                raise Refused(f"{symbol}: not decided with {MOST} boxes, last {a} to {b}") from None
            waiting += [(*half, start) for half in halves(symbol, a, b, whole, None)]
    for p, lines in common_faces(solved, whole):
        if not function.same(p, lines):
            raise Refused(f"{symbol}: the boxes at {p} may hold different solutions")
    return count


def common_faces(solved: list[tuple], whole: list[float]) -> Iterator[tuple[list[float], list[tuple]]]:
    """Yield a point of each common face of two boxes, and the lines of both."""
    sides = [k for k, width in enumerate(whole) if width > 0]
    for k in sides:
        above: dict[float, list[tuple]] = {}
        for box in solved:
            above.setdefault(box[0][k], []).append(box)
        for a, b, line in solved:
            for c, d, other in above.get(b[k], []):
                low, high = [max(x) for x in zip(a, c, strict=True)], [min(x) for x in zip(b, d, strict=True)]
                if all(low[i] < high[i] for i in sides if i != k):
                    yield [x + 0.5 * (y - x) for x, y in zip(low, high, strict=True)], [line, other]
