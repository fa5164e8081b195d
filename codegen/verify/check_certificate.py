#!/usr/bin/env python3
"""Checks certificate.json of this folder again: python3 check_certificate.py

Needs only Python and python-flint. It knows nothing of gtmodel: it reads the operations from the text of the C bodies
and evaluates them in ball arithmetic (Arb) over boxes, with an error bound of every operation. Exit code 0 if every
statement holds at every point of its box, else 1 with the reason. Assumed: IEEE 754 arithmetic rounded to nearest with
denormal numbers, -ffp-contract=off, libm within 4 units in the last place.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from check_text import Refused, guarded, headers, operations
from flint import arb, ctx

ctx.prec, MOST, LIBM_ULP = 100, 400_000, 4  # bits; boxes for one function; error of libm in units in the last place
ARITHMETIC = {  # round-off, smallest and largest number
    "double": (arb(2) ** -53, arb(2) ** -1074, (2 - arb(2) ** -52) * arb(2) ** 1023),
    "float": (arb(2) ** -24, arb(2) ** -149, (2 - arb(2) ** -23) * arb(2) ** 127),
}


class Undecided(Exception):
    """A statement is open over this box, perhaps since an operation may be undefined: the box is cut."""


class Value(NamedTuple):
    """x: encloses the exact value; e: bound of |computed - exact|; depends: positions of inputs."""

    x: arb
    e: arb
    depends: frozenset[int]


def _corners(f: Callable[[arb, arb], arb], x: arb, y: arb) -> arb:
    """Return the hull of f at the corners, which holds all values of a product or of an angle."""
    ends = [f(a, b) for a in (x.lower(), x.upper()) for b in (y.lower(), y.upper())]
    return ends[0].union(ends[1]).union(ends[2]).union(ends[3])


class Machine:
    """Evaluates the operations of one body over a box in one arithmetic."""

    def __init__(self, steps: list[tuple], sizes: list[int], real: str) -> None:
        self.steps, self.real, (self.unit, self.tiny, self.largest) = steps, real, ARITHMETIC[real]
        self.firsts = [sum(sizes[:k]) for k in range(len(sizes))]

    def run(self, inputs: list[Value]) -> dict[tuple[int, int], Value]:
        """Return the results by (output, entry)."""
        work, results = dict[str, Value](), dict[tuple[int, int], Value]()
        for op, target, *rest in self.steps:
            if op == "out":
                results[rest[0], rest[1]] = work[target]
            elif op == "in":
                work[target] = inputs[self.firsts[rest[0]] + rest[1]]
            elif op == "const":
                number, single = arb(float(rest[0].rstrip("f"))), int(self.real == "float")  # the compiler rounds it
                work[target] = Value(number, single * (abs(number) * self.unit + self.tiny), frozenset())
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
        a, b, u, libm = given[0], given[-1], self.unit, 2 * LIBM_ULP * self.unit
        if op in ("+", "-"):
            return (a.x + b.x if op == "+" else a.x - b.x, a.e + b.e, u)
        if op == "sq" or (op == "*" and same):
            return ((a.x.abs_lower() ** 2).union(a.x.abs_upper() ** 2), a.e * (2 * a.x.abs_upper() + a.e), u)
        if op == "*":
            return (_corners(arb.__mul__, a.x, b.x), a.x.abs_upper() * b.e + b.x.abs_upper() * a.e + a.e * b.e, u)
        if op in ("/", "inverse"):
            least = (b.x.abs_lower() - b.e).lower()
            if not least > 0:
                raise Undecided
            over = (1 / b.x.lower()).union(1 / b.x.upper())
            x, e = (_corners(arb.__mul__, a.x, over), a.e) if op == "/" else (over, arb(0))
            return (x, (e + x.abs_upper() * b.e) / least, u)
        if op == "sqrt":
            x, least = a.x.lower().sqrt().union(a.x.upper().sqrt()), (a.x.lower() - a.e).lower()
            if not least >= 0 or not (a.e == 0 or (least.sqrt() + x.lower()).lower() > 0):
                raise Undecided
            return (x, arb(0) if a.e == 0 else a.e / (least.sqrt() + x.lower()).lower(), u)
        if op in ("sin", "cos"):
            return (getattr(arb, op)(a.x), a.e, libm)
        if op in ("tanh", "atan", "asin", "acos"):
            f, most = getattr(arb, op), (a.x.abs_upper() + a.e).upper()
            if op[1:] in ("sin", "cos") and not most < 1:
                raise Undecided
            e = a.e / (1 - most**2).sqrt() if op[1:] in ("sin", "cos") else a.e
            return (f(a.x.lower()).union(f(a.x.upper())), e, libm)
        if op == "floor":
            x = (a.x.lower() - a.e).floor().lower().union((a.x.upper() + a.e).floor().upper())
            return (x, x.upper() - x.lower(), 0)
        if op == "atan2":
            y, x = ((g.x.lower() - g.e).union(g.x.upper() + g.e) for g in (a, b))
            if not (x.lower() > 0 or y.lower() > 0 or y.upper() < 0):  # the cut, where a signed zero decides
                return (arb.pi().union(-arb.pi()), 2 * arb.pi(), libm)
            near = (x.abs_lower() ** 2 + y.abs_lower() ** 2).sqrt().lower()
            return (_corners(arb.atan2, a.x, b.x), (a.e + b.e) / near, libm)
        if op in ("twice", "neg", "fabs"):
            x = a.x.abs_lower().union(a.x.abs_upper()) if op == "fabs" else -a.x
            return (2 * a.x, 2 * a.e, 0) if op == "twice" else (x, a.e, 0)
        pick = min if op == "fmin" else max
        return (pick(a.x.lower(), b.x.lower()).union(pick(a.x.upper(), b.x.upper())), max(a.e, b.e), 0)


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


def framed(symbol: str, entry: dict, stated: dict) -> tuple[list, list[float]]:
    """Return the boxes of a statement, which fill the box of the manifest, and its widths. Raises Refused."""
    pairs = [(m["signal"], *pair) for m in entry["inputs"] for pair in entry["box"][m["signal"]]]
    lo, hi = ([float(pair[k]) for pair in pairs] for k in (1, 2))
    boxes = [([float(x) for x in a], [float(x) for x in b]) for a, b in stated["boxes"]]
    sizes = sum((max(abs(a), abs(b)) / entry["limits"][name]) ** 2 for name, a, b in pairs)
    if not tiles(lo, hi, boxes) or not sizes * (1 + 1e-6) <= 1:
        raise Refused(f"{symbol}: the boxes do not fill the box of the manifest, or exceed the limits of the inputs")
    if not sum(math.prod(m["shape"]) for m in entry["outputs"]) == len(stated["errors"]) == len(stated["ranges"]):
        raise Refused(f"{symbol}: statements and manifest do not fit the outputs")
    return boxes, [b - a for a, b in zip(lo, hi, strict=True)]


def checked(symbol: str, entry: dict, stated: dict, steps: list[tuple], real: str, tolerance: float) -> int:
    """Check a closed form and return the number of boxes. Raises Refused."""
    waiting, whole = framed(symbol, entry, stated)
    sizes = [math.prod(m["shape"]) for m in entry["inputs"]]
    wanted = [(k, j) for k, m in enumerate(entry["outputs"]) for j in range(math.prod(m["shape"]))]
    outputs = wanted + [(len(entry["outputs"]), n) for n in range(len(entry["margins"]))]
    if sorted(step[2:] for step in steps if step[0] == "out") != outputs:
        raise Refused(f"{symbol}: the outputs of the body are not those of the manifest")
    machine, count, full = Machine(steps, sizes, real), 0, None
    if "least_singular_value" in stated:
        full = import_module("check_derivatives").ClosedForm(steps, sizes, wanted, stated["least_singular_value"]).full
    while waiting:
        a, b = waiting.pop()
        count += 1
        depends = _open(machine, entry, stated, wanted, tolerance, a, b)
        if depends is None and (full is None or full(a, b)):
            continue
        if count == MOST:
            raise Refused(f"{symbol}: not decided with {MOST} boxes, last {a} to {b}")
        waiting += halves(symbol, a, b, whole, depends)
    return count


def halves(symbol: str, a: list[float], b: list[float], whole: list[float], sides: frozenset[int] | None) -> list:
    """Return the halves of a box along the widest one of the sides, or of all."""
    k = max(sides or range(len(a)), key=lambda k: (b[k] - a[k]) / (whole[k] or 1.0))
    middle = a[k] + 0.5 * (b[k] - a[k])
    if not a[k] < middle < b[k] or (b[k] - a[k]) < 1e-9 * whole[k]:
        raise Refused(f"{symbol}: a statement does not hold near {a}")
    return [(a, [*b[:k], middle, *b[k + 1 :]]), ([*a[:k], middle, *a[k + 1 :]], b)]


def _open(machine, entry, stated, wanted, tolerance, a, b) -> frozenset[int] | None:
    """Return the inputs that an open statement depends on, empty if unknown; None if all statements hold."""
    given = [Value(arb(p).union(arb(q)), arb(0), frozenset([k])) for k, (p, q) in enumerate(zip(a, b, strict=True))]
    try:
        results = machine.run(given)
    except Undecided:
        return frozenset()
    for n, m in enumerate(entry["margins"]):
        if not passes(v := results[len(entry["outputs"]), n], m["kind"], float(m["scale"]), tolerance):
            return v.depends
    return outside(results, wanted, stated)


def passes(v: Value, kind: str, scale: float, tolerance: float) -> bool:
    """Return whether the test of a margin in the code is passed."""
    least = arb(tolerance) * arb(scale) * (1 + arb(2) ** -20)
    low, high = (v.x.lower() - v.e).lower(), (v.x.upper() + v.e).upper()
    return low > least or (kind == "pivot" and high < -least) if kind in ("pivot", "branch") else low >= 0


def outside(results: dict, wanted: list[tuple[int, int]], stated: dict) -> frozenset[int] | None:
    """Return the inputs of an output that may leave its range or exceed its error, or None."""
    for place, error, (low, high) in zip(wanted, stated["errors"], stated["ranges"], strict=True):
        v = results[place]
        if not (v.e <= arb(error) and v.x.lower() >= arb(low) and v.x.upper() <= arb(high)):
            return v.depends
    return None


def main(folder: Path) -> None:
    manifest, certificate = (json.loads((folder / f"{x}.json").read_text()) for x in ("manifest", "certificate"))
    for file, expected in manifest["files"].items():
        if hashlib.sha256((folder / file).read_bytes()).hexdigest() != expected:
            raise Refused(f"{file} was changed since it was written")
    body = (folder / certificate["body"]).read_text()
    if hashlib.sha256(body.encode()).hexdigest() != certificate["body_sha256"] or not manifest["certificate"]["proved"]:
        raise Refused(f"the certificate is not one of this {certificate['body']}")
    headers(folder, manifest["name"])
    proved, entries = manifest["certificate"]["proved"], {e["symbol"]: e for e in manifest["functions"]}
    bodies = operations(body, manifest["real"], proved)
    wrapper, tolerance = (folder / f"gt_{manifest['name']}.c").read_text(), manifest["pivot_tolerance"]
    for symbol, stated in proved.items():
        places = certificate["functions"][symbol]  # what is claimed stands in the manifest alone
        known = symbol, entries[symbol], stated | {key: places[key] for key in ("boxes", "starts") if key in places}
        guarded(entries[symbol], wrapper, tolerance)
        if "state" in entries[symbol]:
            count = import_module("check_newton").checked(*known, bodies, wrapper, tolerance)
        else:
            count = checked(*known, bodies[f"{symbol}_body"], manifest["real"], tolerance)
        print(f"{symbol}: proved in {count} boxes")


if __name__ == "__main__":
    sys.modules["check_certificate"] = sys.modules["__main__"]  # for the other parts
    try:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
    except (Refused, ArithmeticError, LookupError, TypeError, ValueError, OSError) as error:
        sys.exit(f"refused: {error}")
