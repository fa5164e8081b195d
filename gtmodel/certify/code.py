"""Certificates of generated C: the statements in its manifest and README, their boxes in certificate.json, and
check_certificate.py beside them, which proves them again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .._files import codegen_dir
from ..cgen.generation import Beside
from ..cgen.interface import box_of
from ..cgen.manifest import sha256
from ..cgen.real import real_of
from ..compiler.causal import CausalFunction
from ..results import ArgumentError, Work, at_least
from ..results.check import Check
from .certificate import PROVED, InputSpeed
from .claims import entries
from .closed_form import ClosedFormProver
from .newton_form import ANSWER, NewtonProver
from .subdivision import Leaves, least_singular, subdivide

FILE, CHECKER = "certificate.json", "check_certificate.py"
PARTS = ("check_text.py", "check_derivatives.py", "check_newton.py")
FORMAT = "gtmodel-certificate-2"
MAX_BOXES, SHARPENING = 20_000, 200
# the stated bounds are above the proved ones, and the ranges wider, since the checker encloses less tightly
ABOVE, WIDER = 1.5, 0.25
# operations that the checker reads
_READ = frozenset([
    ca.OP_CONST, ca.OP_INPUT, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV, ca.OP_NEG,
    ca.OP_SQRT, ca.OP_SIN, ca.OP_COS, ca.OP_TANH, ca.OP_ATAN, ca.OP_ATAN2, ca.OP_ASIN, ca.OP_ACOS, ca.OP_FABS,
    ca.OP_FMIN, ca.OP_FMAX, ca.OP_FLOOR,
])  # fmt: skip
_README = """
## Proved

For every point of the box in manifest.json, not for samples:

{statements}

Assumed: IEEE 754 arithmetic rounded to nearest with denormal numbers, `-ffp-contract=off`, sin, cos and the like of
libm within 4 units in the last place; inputs and constants are exact. `python3 {checker}` proves it again from the C
text (`pip install python-flint`); {file} has the boxes.
"""


@dataclass(frozen=True)
class Statements:
    """Proved statements about the functions of a folder.

    functions: by Python name, bounds of round-off, ranges, and what else is proved. boxes: by Python name, the proved
    boxes. left_out: by name, why a function has none. checks: proved share of each other one. name, real: of the
    folder, and its number type.
    """

    functions: Mapping[str, Mapping[str, Any]]
    boxes: Mapping[str, Mapping[str, Any]]
    left_out: Mapping[str, str]
    checks: Mapping[str, Check]
    name: str
    real: str

    def beside(self, texts: Mapping[str, str]) -> Beside:
        """Return what the certificate adds to a folder with these texts; nothing without functions."""
        if not self.functions and not self.left_out:
            return Beside()
        body = f"gt_{self.name}_body.c"
        content = {
            "format": FORMAT,
            "body": body,
            "body_sha256": sha256(texts[body]),
            "functions": self._by_symbol(self.boxes),
        }
        facts = {"proved": self._by_symbol(self.functions), "not_proved": self._by_symbol(self.left_out)}
        parts = (CHECKER, *PARTS)
        checkers = {f: (codegen_dir() / "verify" / f).read_text(encoding="utf-8") for f in parts}
        words = _README.format(statements=self._in_words(), checker=CHECKER, file=FILE)
        return Beside({FILE: json.dumps(content, indent=1) + "\n", **checkers}, words, {"certificate": facts})

    def _by_symbol(self, of: Mapping[str, Any]) -> dict[str, Any]:
        return {f"gt_{self.name}_{key}": value for key, value in of.items()}

    def _in_words(self) -> str:
        lines = []
        for symbol, entry in self._by_symbol(self.functions).items():
            bounds = ", ".join(f"{n} {e:.3g}" for n, e in zip(entry["outputs"], entry["errors"], strict=True))
            one = "has one solution in this assembly mode"
            near = f"{one}; where it returns GT_OK within {ANSWER:g} of it, in nominal sizes of the unknowns"
            solved = near if entry["newton"] else "returns GT_OK"
            if "speed" in entry:
                speeds = ", ".join(f"{n} by {v:g}" for n, v in entry["speed"].items())
                solved = f"{one}, and returns GT_OK from its last answer with a call every {entry['period']:g} s, "
                solved += f"while inputs change in a second by at most {speeds}"
            comma = "," if solved is near else ";"
            line = f"- `{symbol}` {solved}{comma} the outputs differ from the exact ones by at most {bounds} (SI units)"
            if "least_singular_value" in entry:
                least = entry["least_singular_value"]
                line += f"; no pose is singular, the smallest singular value of the Jacobian is at least {least:.3g}"
            lines.append(f"{line}.")
        lines += [f"- `{symbol}`: nothing, since {why}." for symbol, why in self._by_symbol(self.left_out).items()]
        return "\n".join(lines)


def statements(
    functions: Mapping[str, Any], box: Mapping[str, Sequence[Sequence[float]]], name: str, real: str, work: Work,
    moving: InputSpeed | None = None, regular: Sequence[str] = (),
) -> Statements:  # fmt: skip
    """Prove for the folder `name` the status of the functions that have a box, with bounds of their round-off.

    moving: speeds of inputs; functions with Newton's method whose inputs all have one return GT_OK while these move.
    regular: names of functions whose Jacobian must have full rank. Other functions are left out with the reason; that a
    proof fails in a part of the box is a failed check.
    """
    made: dict[str, Any] = {}
    boxes: dict[str, Any] = {}
    left_out: dict[str, str] = {}
    checks: dict[str, Check] = {}
    for n, (key, f) in enumerate(functions.items()):
        work.step(f"proving {key}", n / len(functions))
        intervals = box_of(f, box) if isinstance(f, CausalFunction) else None
        if intervals is None:
            left_out[key] = "it has no box for all inputs"
            continue
        lo, hi = np.array(intervals).T
        try:
            prover = _prover(f, real, moving, key in regular)
            if unread := sorted(prover.operations - _READ):
                names = {getattr(ca, n): n for n in dir(ca) if n.startswith("OP_")}
                raise ArgumentError(f"{CHECKER} cannot read its operation {names[unread[0]]}", "function")
        except ArgumentError as error:
            left_out[key] = error.message
            continue

        def going(share: float, boxes: int, key: str = key, n: int = n) -> bool:
            work.progress(f"proving {key}", (n + share) / len(functions), {"boxes": boxes})
            return not work.interrupted()

        leaves = subdivide(prover, lo, hi, MAX_BOXES, going)
        proved = leaves.volume(PROVED)
        checks[f"certified_{key}"] = at_least(proved, 1.0, f"use a smaller box for {key}, or leave out the certificate")
        if proved == 1.0:
            made[key], boxes[key] = _entry(prover, leaves, real, moving)
    return Statements(made, boxes, left_out, checks, name, real)


def _prover(f: CausalFunction, real: str, moving: InputSpeed | None, regular: bool) -> ClosedFormProver | NewtonProver:
    if not f.kernels:  # decided by natural evaluation, as the checker does it
        return ClosedFormProver(f, [], regular, real=real_of(real), centred=False)
    if real != "double":
        raise ArgumentError(f"{f.name} uses Newton's method in float; it is certified in double only", "real")
    names = [s.name for s in f.inputs]
    away = None
    if moving is not None and all(n in moving.speed for n in names):
        away = np.array([moving.speed[s.name] * moving.period for s in f.inputs for _ in range(s.size)])
    return NewtonProver(f, [], away, regular)


def _entry(
    prover: ClosedFormProver | NewtonProver, leaves: Leaves, real: str, moving: InputSpeed | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the statements about a function, and its boxes."""
    every = np.ones(leaves.lo.shape[1], dtype=bool)
    extra: dict[str, Any] = {}
    boxes: dict[str, Any] = {"boxes": [[a.tolist(), b.tolist()] for a, b in zip(leaves.lo.T, leaves.hi.T, strict=True)]}
    if isinstance(prover, NewtonProver):
        double, single, most, low = prover.bounds(leaves, every, every)
        boxes["starts"] = prover.solutions(leaves.lo + 0.5 * (leaves.hi - leaves.lo)).T.tolist()
        if prover.away is not None and moving is not None:
            names = [s.name for s in prover.function.inputs]
            extra |= {"speed": {n: moving.speed[n] for n in names}, "period": moving.period}
    else:
        double, single, most, low = prover.measures(leaves.lo, leaves.hi).reshape(4, prover.targets, -1).max(axis=2)
    if prover.regular:
        extra["least_singular_value"] = float(f"{least_singular(prover, leaves, every, SHARPENING) / ABOVE:.3g}")
    errors = ABOVE * (double if real == "double" else single)
    room = WIDER * (most + low) + 10.0 * errors
    return {
        "outputs": entries(prover.function.outputs),
        "errors": [float(f"{e:.3g}") for e in 1.01 * errors],
        "ranges": [[float(a), float(b)] for a, b in zip(-low - room, most + room, strict=True)],
        "newton": isinstance(prover, NewtonProver),
        **extra,
    }, boxes
