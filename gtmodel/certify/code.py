"""Certificates of generated C: certificate.json, which check_certificate.py beside it checks again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._files import codegen_dir
from ..cgen.interface import box_of
from ..cgen.manifest import sha256
from ..cgen.real import real_of
from ..compiler.causal import CausalFunction
from ..results import ArgumentError, Work, at_least
from ..results.check import Check
from .certificate import PROVED
from .claims import entries
from .closed_form import ClosedFormProver
from .intervals import Array
from .subdivision import subdivide

FILE, CHECKER, IN_WORDS = "certificate.json", "check_certificate.py", "CERTIFICATE.md"
FORMAT = "gtmodel-certificate-1"
MAX_BOXES = 20_000
# the stated bounds are above the proved ones, and the ranges wider, since the checker encloses less tightly
ABOVE, WIDER = 1.5, 0.25


@dataclass(frozen=True)
class Statements:
    """Proved statements about the functions of a folder.

    functions: by Python name, the proved boxes with bounds of round-off and ranges. left_out: by name, why a function
    has none. checks: proved share of each other one. name, real: of the folder, and its number type.
    """

    functions: Mapping[str, Mapping[str, Any]]
    left_out: Mapping[str, str]
    checks: Mapping[str, Check]
    name: str
    real: str

    def beside(self, texts: Mapping[str, str]) -> dict[str, str]:
        """Return the files of the certificate for a folder with these texts; none without functions."""
        if not self.functions and not self.left_out:
            return {}
        name, body = self.name, f"gt_{self.name}_body.c"
        content = {
            "format": FORMAT,
            "real": self.real,
            "body": body,
            "body_sha256": sha256(texts[body]),
            "functions": {f"gt_{name}_{key}": dict(entry) for key, entry in self.functions.items()},
            "left_out": {f"gt_{name}_{key}": why for key, why in self.left_out.items()},
        }
        checker = (codegen_dir() / "verify" / CHECKER).read_text(encoding="utf-8")
        return {FILE: json.dumps(content, indent=1) + "\n", CHECKER: checker, IN_WORDS: self._in_words()}

    def _in_words(self) -> str:
        name = self.name
        lines = [
            "# Certificate",
            "",
            f"Proved for every point of the box in manifest.json, not for samples; {FILE} has the statements, and",
            f"`python3 {CHECKER}` checks them again from the C text (pip install python-flint).",
            "",
        ]
        for key, entry in self.functions.items():
            bounds = ", ".join(f"{n} {e:.3g}" for n, e in zip(entry["outputs"], entry["errors"], strict=True))
            lines.append(f"- `gt_{name}_{key}` returns GT_OK; round-off of the outputs at most {bounds} (SI units).")
        lines += [f"- `gt_{name}_{key}`: nothing is proved, since {why}." for key, why in self.left_out.items()]
        return "\n".join(lines) + "\n"


def statements(
    functions: Mapping[str, Any], box: Mapping[str, Sequence[Sequence[float]]], name: str, real: str, work: Work
) -> Statements:
    """Prove for the folder `name` the status of the functions that have a box, with bounds of their round-off. Other
    functions are left out with the reason; that a proof fails in a part of the box is a failed check."""
    made: dict[str, Any] = {}
    left_out: dict[str, str] = {}
    checks: dict[str, Check] = {}
    for n, (key, f) in enumerate(functions.items()):
        work.step(f"proving {key}", n / len(functions))
        intervals = box_of(f, box) if isinstance(f, CausalFunction) else None
        if intervals is None:
            left_out[key] = "it has no box for all inputs"
            continue
        if f.kernels:
            left_out[key] = "it has a Newton block; gtmodel certify proves such functions"
            continue
        lo, hi = np.array(intervals).T
        try:
            prover = ClosedFormProver(f, [], real=real_of(real), centred=False)  # as the checker evaluates
        except ArgumentError as error:
            left_out[key] = error.message
            continue
        leaves = subdivide(prover, lo, hi, MAX_BOXES, lambda share, boxes: not work.interrupted())
        proved = leaves.volume(PROVED)
        checks[f"certified_{key}"] = at_least(proved, 1.0, f"use a smaller box for {key}, or leave out the certificate")
        if proved == 1.0:
            made[key] = _entry(prover, leaves.lo, leaves.hi, real)
    return Statements(made, left_out, checks, name, real)


def _entry(prover: ClosedFormProver, lo: Array, hi: Array, real: str) -> dict[str, Any]:
    measured = prover.measures(lo, hi).reshape(4, prover.targets, -1).max(axis=2)
    errors = ABOVE * measured[0 if real == "double" else 1]
    most, least = measured[2], -measured[3]
    room = WIDER * (most - least) + 10.0 * errors
    return {
        "outputs": entries(prover.function.outputs),
        "errors": [float(f"{e:.3g}") for e in 1.01 * errors],
        "ranges": [[float(a), float(b)] for a, b in zip(least - room, most + room, strict=True)],
        "boxes": [[a.tolist(), b.tolist()] for a, b in zip(lo.T, hi.T, strict=True)],
    }
