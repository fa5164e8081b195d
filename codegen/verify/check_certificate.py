#!/usr/bin/env python3
"""Checks certificate.json of this folder again: python3 check_certificate.py

Needs only Python and python-flint (pip install python-flint). It knows nothing of gtmodel: it reads the operations from
the text of the C bodies and evaluates them in ball arithmetic (Arb) over boxes, with an error bound of every operation.
Exit code 0 if every statement holds at every point of its box, else 1 with the reason. Assumed: IEEE 754 arithmetic
rounded to nearest with denormal numbers, -ffp-contract=off, libm within 4 units in the last place.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import sys
from pathlib import Path
from typing import NamedTuple

from flint import arb, ctx

ctx.prec = 100
MOST = 400_000  # boxes for one function
LIBM_ULP = 4
ARITHMETIC = {  # round-off, smallest and largest number
    "double": (arb(2) ** -53, arb(2) ** -1074, (2 - arb(2) ** -52) * arb(2) ** 1023),
    "float": (arb(2) ** -24, arb(2) ** -149, (2 - arb(2) ** -23) * arb(2) ** 127),
}
_BODY = re.compile(r"^/\* \w+:[^\n]*\*/\nstatic int (casadi_f\d+)\([^\n]*\{\n(.*?)\n\}$", re.M | re.S)
_EXPORTED = re.compile(r"^CASADI_SYMBOL_EXPORT int (\w+)\([^\n]*\)\{\n  return (casadi_f\d+)\(", re.M)
_NUMBER = r"-?(?:\d+\.\d*|\d+)(?:[eE][-+]?\d+)?f?"
_PASSED = re.compile(r"  (casadi_real [\w, ]+;|\(void\)\w+;|return 0;)")
_GIVEN = re.compile(r"  (\w+)=arg\[(\d+)\]\[(\d+)\];")
_RESULT = re.compile(r"  res\[(\d+)\]\[(\d+)\]=(\w+);")
_CONSTANT = re.compile(rf"  (\w+)=({_NUMBER});")
_BINARY = re.compile(r"  (\w+)=\((\w+)([-+*/])(\w+)\);")
_UNARY = {
    "twice": re.compile(r"  (\w+)=\(2\.0?f?\*(\w+)\);"),
    "inverse": re.compile(r"  (\w+)=\(1\.0?f?/(\w+)\);"),
    "neg": re.compile(r"  (\w+)=\(- ?(\w+)\);"),
}
_CALL = re.compile(r"  (\w+)=(\w+)\((\w+)(?:,(\w+))?\);")
_CALLS = re.compile(r"(?:casadi_)?(sq|fmin|fmax|sqrt|fabs|sin|cos|tanh|atan2|atan|asin|acos)f?")
_HELPER = re.compile(r"casadi_real casadi_(\w+)\([^)]*\) *\{ *([^}]*?) *\}")
_HELPERS = {"sq": "return x*x;", "fabs": "return fabs(x);", "fmin": "return (x <= y || y != y) ? x : y;",
            "fmax": "return (x >= y || y != y) ? x : y;"}  # fmt: skip
_DEFINED = re.compile(r"# *define (\w+)(.*)")


class Refused(Exception):
    """A statement that does not hold, or cannot be checked."""


class Undecided(Exception):
    """An operation that may be undefined over this box: the box is cut."""


def operations(text: str, real: str) -> dict[str, list[tuple]]:
    """Return the operations of every body by its C symbol: (operator, target, operands)."""
    for name, helper in _HELPER.findall(text):
        if _HELPERS.get(name, helper) != helper.replace("fabsf", "fabs"):
            raise Refused(f"casadi_{name} is not the function of this name")
    for name, value in _DEFINED.findall(text):
        if not name.lower().strip("_").startswith("casadi") or (name == "casadi_real" and value.strip() != real):
            raise Refused(f"the macro {name} is not expected in code in {real}")
    bodies = dict(_BODY.findall(text))
    return {symbol: _read(symbol, bodies[name]) for symbol, name in _EXPORTED.findall(text) if name in bodies}


def _read(symbol: str, body: str) -> list[tuple]:
    steps: list[tuple] = []
    for line in body.split("\n"):
        if _PASSED.fullmatch(line):
            continue
        if m := _GIVEN.fullmatch(line):
            steps.append(("in", m[1], int(m[2]), int(m[3])))
        elif m := _RESULT.fullmatch(line):
            steps.append(("out", m[3], int(m[1]), int(m[2])))
        elif m := _CONSTANT.fullmatch(line):
            steps.append(("const", m[1], m[2]))
        elif found := [(op, *m.groups()) for op, pattern in _UNARY.items() if (m := pattern.fullmatch(line))]:
            steps.append(found[0])
        elif m := _BINARY.fullmatch(line):
            steps.append((m[3], m[1], m[2], m[4]))
        elif (m := _CALL.fullmatch(line)) and (name := _CALLS.fullmatch(m[2])):
            steps.append((name[1], m[1], *[x for x in (m[3], m[4]) if x]))
        else:
            raise Refused(f"{symbol}: cannot read the operation '{line.strip()}'")
    return steps


class Value(NamedTuple):
    """x: encloses the exact value; e: bound of |computed - exact|; depends: positions of inputs."""

    x: arb
    e: arb
    depends: frozenset[int]


def _product(x: arb, y: arb) -> arb:
    ends = [a * b for a in (x.lower(), x.upper()) for b in (y.lower(), y.upper())]
    return ends[0].union(ends[1]).union(ends[2]).union(ends[3])


def _away(y: arb, e: arb) -> arb:
    """Return a lower bound of |computed y|, which must be positive."""
    least = (y.abs_lower() - e).lower()
    if not least > 0:
        raise Undecided
    return least


class Machine:
    """Evaluates the operations of one body over a box in one arithmetic."""

    def __init__(self, steps: list[tuple], sizes: list[int], real: str) -> None:
        self.steps, self.real = steps, real
        self.firsts = [sum(sizes[:k]) for k in range(len(sizes))]
        self.unit, self.tiny, self.largest = ARITHMETIC[real]

    def run(self, lo: list[float], hi: list[float]) -> dict[tuple[int, int], Value]:
        """Return the results by (output, entry)."""
        work: dict[str, Value] = {}
        results: dict[tuple[int, int], Value] = {}
        for op, target, *rest in self.steps:
            if op == "out":
                results[rest[0], rest[1]] = work[target]
            elif op == "in":
                k = self.firsts[rest[0]] + rest[1]
                work[target] = Value(arb(lo[k]).union(arb(hi[k])), arb(0), frozenset([k]))
            elif op == "const":
                # the compiler rounds the text; a text of the shortest digits is the number itself up to that
                number = arb(float(rest[0].rstrip("f")))
                e = arb(0) if self.real == "double" else abs(number) * self.unit + self.tiny
                work[target] = Value(number, e, frozenset())
            else:
                given = [work[name] for name in rest]
                x, carried, unit = self._applied(op, given, len(rest) == 2 and rest[0] == rest[1])
                size = x.abs_upper() + carried
                e = (carried + unit * size + (2 * LIBM_ULP * self.tiny if unit != 0 else 0)).upper()
                if not (size + e < self.largest and x.is_finite()):
                    raise Undecided
                work[target] = Value(x, e, frozenset().union(*[g.depends for g in given]))
        return results

    def _applied(self, op: str, given: list[Value], same: bool) -> tuple[arb, arb, arb | int]:
        """Return the exact result, the error carried by the operands, and the round-off of the operation."""
        a, b = given[0], given[-1]
        u, libm = self.unit, 2 * LIBM_ULP * self.unit
        if op == "+":
            return (a.x + b.x, a.e + b.e, u)
        if op == "-":
            return (a.x - b.x, a.e + b.e, u)
        if op == "sq" or (op == "*" and same):
            return ((a.x.abs_lower() ** 2).union(a.x.abs_upper() ** 2), a.e * (2 * a.x.abs_upper() + a.e), u)
        if op == "*":
            return (_product(a.x, b.x), a.x.abs_upper() * b.e + b.x.abs_upper() * a.e + a.e * b.e, u)
        if op == "/":
            least = _away(b.x, b.e)
            x = _product(a.x, (1 / b.x.lower()).union(1 / b.x.upper()))
            return (x, (a.e + x.abs_upper() * b.e) / least, u)
        if op == "inverse":
            least = _away(a.x, a.e)
            x = (1 / a.x.lower()).union(1 / a.x.upper())
            return (x, x.abs_upper() * a.e / least, u)
        if op == "sqrt":
            if not (a.x.lower() - a.e).lower() >= 0:
                raise Undecided
            x = a.x.lower().sqrt().union(a.x.upper().sqrt())
            if a.e == 0:
                return (x, arb(0), u)
            below = ((a.x.lower() - a.e).lower().sqrt() + x.lower()).lower()
            if not below > 0:
                raise Undecided
            return (x, a.e / below, u)
        if op in ("sin", "cos"):
            return ((arb.sin if op == "sin" else arb.cos)(a.x), a.e, libm)
        if op in ("tanh", "atan"):
            f = arb.tanh if op == "tanh" else arb.atan
            return (f(a.x.lower()).union(f(a.x.upper())), a.e, libm)
        if op in ("asin", "acos"):
            most = (a.x.abs_upper() + a.e).upper()
            if not most < 1:
                raise Undecided
            f = arb.asin if op == "asin" else arb.acos
            return (f(a.x.lower()).union(f(a.x.upper())), a.e / (1 - most**2).sqrt(), libm)
        if op == "atan2":
            y, x = ((g.x.lower() - g.e).union(g.x.upper() + g.e) for g in (a, b))
            if not (x.lower() > 0 or y.lower() > 0 or y.upper() < 0):
                raise Undecided
            ends = [arb.atan2(p, q) for p in (a.x.lower(), a.x.upper()) for q in (b.x.lower(), b.x.upper())]
            near = (x.abs_lower() ** 2 + y.abs_lower() ** 2).sqrt().lower()
            angle = ends[0].union(ends[1]).union(ends[2]).union(ends[3])
            return (angle, (a.e + b.e) / near, libm)
        if op in ("twice", "neg"):
            return (2 * a.x, 2 * a.e, 0) if op == "twice" else (-a.x, a.e, 0)
        if op == "fabs":
            return (a.x.abs_lower().union(a.x.abs_upper()), a.e, 0)
        pick = min if op == "fmin" else max
        ends = [pick(a.x.lower(), b.x.lower()), pick(a.x.upper(), b.x.upper())]
        return (ends[0].union(ends[1]), max(a.e, b.e), 0)


def tiles(lo: list[float], hi: list[float], boxes: list[tuple[list[float], list[float]]]) -> bool:
    """Return whether boxes that were cut in halves fill the box lo, hi."""
    waiting = [(list(lo), list(hi), boxes)]
    while waiting:
        a, b, inside = waiting.pop()
        if len(inside) == 1 and inside[0] == (a, b):
            continue
        for k in range(len(a)):
            middle = a[k] + 0.5 * (b[k] - a[k])
            parts = [[x for x in inside if x[1][k] <= middle], [x for x in inside if x[0][k] >= middle]]
            if a[k] < middle < b[k] and sum(map(len, parts)) == len(inside) and all(parts):
                waiting.append((a, [*b[:k], middle, *b[k + 1 :]], parts[0]))
                waiting.append(([*a[:k], middle, *a[k + 1 :]], b, parts[1]))
                break
        else:
            return False
    return True


def checked(symbol: str, entry: dict, stated: dict, machine: Machine, tolerance: float) -> int:
    """Check one function and return the number of boxes. Raises Refused."""
    names = [m["signal"] for m in entry["inputs"]]
    lo, hi = ([float(pair[k]) for name in names for pair in entry["box"][name]] for k in (0, 1))
    boxes = [([float(x) for x in a], [float(x) for x in b]) for a, b in stated["boxes"]]
    if not tiles(lo, hi, boxes):
        raise Refused(f"{symbol}: the boxes do not fill the box of the manifest")
    sizes = sum((max(abs(a), abs(b)) / entry["limits"][name]) ** 2 for name in names for a, b in entry["box"][name])
    if not sizes * (1 + 1e-6) <= 1:
        raise Refused(f"{symbol}: inputs of the box exceed their limits")
    wanted = [(k, j) for k, m in enumerate(entry["outputs"]) for j in range(math.prod(m["shape"]))]
    results = [step[2:] for step in machine.steps if step[0] == "out"]
    margins = [(len(entry["outputs"]), n) for n in range(len(entry["margins"]))]
    if not len(wanted) == len(stated["errors"]) == len(stated["ranges"]) or sorted(results) != [*wanted, *margins]:
        raise Refused(f"{symbol}: statements and manifest do not fit the outputs")
    count, waiting, whole = 0, list(boxes), [b - a for a, b in zip(lo, hi, strict=True)]
    while waiting:
        a, b = waiting.pop()
        count += 1
        if count > MOST:
            raise Refused(f"{symbol}: not decided with {MOST} boxes, last {a} to {b}")
        depends = _open(machine, entry, stated, wanted, tolerance, a, b)
        if depends is None:
            continue
        sides = [k for k in range(len(a)) if b[k] > a[k] and (k in depends or not depends)]
        if not sides:
            raise Refused(f"{symbol}: a statement does not hold at {a}")
        k = max(sides, key=lambda k: (b[k] - a[k]) / whole[k])
        middle = a[k] + 0.5 * (b[k] - a[k])
        if not a[k] < middle < b[k] or (b[k] - a[k]) < 1e-9 * whole[k]:
            raise Refused(f"{symbol}: a statement does not hold near {a}")
        waiting += [(a, [*b[:k], middle, *b[k + 1 :]]), ([*a[:k], middle, *a[k + 1 :]], b)]
    return count


def _open(machine, entry, stated, wanted, tolerance, a, b) -> frozenset[int] | None:
    """Return the inputs that an open statement depends on, empty if unknown; None if all statements hold."""
    try:
        results = machine.run(a, b)
    except Undecided:
        return frozenset()
    for n, m in enumerate(entry["margins"]):
        v = results[len(entry["outputs"]), n]
        least = arb(tolerance) * arb(float(m["scale"])) * (1 + arb(2) ** -20)
        low, high = (v.x.lower() - v.e).lower(), (v.x.upper() + v.e).upper()
        good = low > least or (m["kind"] == "pivot" and high < -least) if m["kind"] in ("pivot", "branch") else low >= 0
        if not good:
            return v.depends
    for place, error, (low, high) in zip(wanted, stated["errors"], stated["ranges"], strict=True):
        v = results[place]
        if not (v.e <= arb(error) and v.x.lower() >= arb(low) and v.x.upper() <= arb(high)):
            return v.depends
    return None


def main(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    certificate = json.loads((folder / "certificate.json").read_text())
    for file, expected in manifest["files"].items():
        if hashlib.sha256((folder / file).read_bytes()).hexdigest() != expected:
            raise Refused(f"{file} was changed since it was written")
    body = (folder / certificate["body"]).read_text()
    if hashlib.sha256(body.encode()).hexdigest() != certificate["body_sha256"] or not certificate["functions"]:
        raise Refused(f"the certificate is not one of this {certificate['body']}")
    bodies, entries = operations(body, manifest["real"]), {e["symbol"]: e for e in manifest["functions"]}
    for symbol, stated in certificate["functions"].items():
        entry = entries[symbol]
        machine = Machine(bodies[f"{symbol}_body"], [math.prod(m["shape"]) for m in entry["inputs"]], manifest["real"])
        count = checked(symbol, entry, stated, machine, manifest["pivot_tolerance"])
        print(f"{symbol}: proved in {count} boxes")


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
    except (Refused, ArithmeticError, LookupError, TypeError, ValueError, OSError) as error:
        print(f"refused: {error}")
        sys.exit(1)
