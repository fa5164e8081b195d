"""Claims: what must hold for the outputs of a function at every point of a box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..cgen.real import DOUBLE, Real
from ..compiler.blocks import VERDICTS, Margin
from ..compiler.causal import CausalFunction, CausalSignal
from ..results.refusal import ArgumentError
from .intervals import Array

STATUS, BOUND, REGULAR, SOLVED = "status", "bound", "regular", "solved"
_WORDS = {
    "discriminant": "a real solution for {}",
    "condition": "known values satisfy {}",
    "solution": "the solution satisfies {}",
    "limit": "limits of {}",
    "turn": "no half turn: {}",
    "pivot": "nonzero pivot of {}",
    "branch": "on the branch {}",
}


@dataclass(frozen=True)
class Claim:
    """low <= output <= high; with `outside`, the output is below `low` or above `high` instead.

    kind: STATUS, BOUND, REGULAR or SOLVED. output: position among all outputs of the closed function, -1 for none.
    """

    kind: str
    name: str
    output: int = -1
    low: float = -np.inf
    high: float = np.inf
    outside: bool = False

    def states(self, lo: Array, hi: Array) -> Array:
        """Return for intervals 1 where the claim holds for all numbers, -1 where for none, else 0; 0 for NaN."""
        inside, beyond = (lo >= self.low) & (hi <= self.high), (hi < self.low) | (lo > self.high)
        good, bad = (beyond, inside) if self.outside else (inside, beyond)
        return good.astype(int) - bad.astype(int)


def status_claims(function: CausalFunction, real: Real = DOUBLE) -> list[Claim]:
    """Return the claims that together make the status OK, apart from finite outputs and the size of the inputs."""
    first = sum(s.size for s in function.outputs)
    return [of_margin(m, first + k, real) for k, m in enumerate(function.margins)]


def of_margin(margin: Margin, output: int, real: Real) -> Claim:
    """Return the claim that a margin, which is this output, leaves the status OK."""
    assert margin.kind in VERDICTS
    name = _WORDS[margin.kind].format(margin.label)
    if margin.kind not in ("pivot", "branch"):
        return Claim(STATUS, name, output, low=0.0)
    least = float(real.dtype(real.pivot) * real.dtype(margin.scale))
    if margin.kind == "branch":
        return Claim(STATUS, name, output, low=float(np.nextafter(real.dtype(least), real.dtype(np.inf))))
    return Claim(STATUS, name, output, low=-least, high=least, outside=True)


def bound_claims(function: CausalFunction, bounds: Mapping[str, Sequence[Sequence[float]]]) -> list[Claim]:
    """Return one claim for each bounded number of an output. Raises ArgumentError for a wrong name or interval."""
    firsts = np.cumsum([0, *[s.size for s in function.outputs]])
    places = {s.name: (int(first), s) for first, s in zip(firsts, function.outputs, strict=False)}
    claims = []
    for name, rows in bounds.items():
        if name not in places:
            raise ArgumentError(f"there is no output '{name}'; the outputs are {', '.join(places)}", "bounds")
        first, signal = places[name]
        for k, (low, high) in enumerate(_intervals(signal, rows)):
            claims.append(
                Claim(
                    BOUND, f"{entry(signal, k)} from {low:g} to {high:g} {signal.unit}".rstrip(), first + k, low, high
                )
            )
    return claims


def _intervals(signal: CausalSignal, rows: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    try:
        pairs = [(float(a), float(b)) for a, b in rows]
    except (TypeError, ValueError):
        pairs = []
    if len(pairs) not in (1, signal.size) or not all(a < b for a, b in pairs):
        raise ArgumentError(
            f"'{signal.name}' has {signal.size} numbers; give [least, greatest], the first below the second, for each, "
            "or one for all",
            "bounds",
        )
    return pairs * (signal.size if len(pairs) == 1 else 1)


def entry(signal: CausalSignal, k: int) -> str:
    """Return the name of one number of a signal, such as "q[0]"."""
    return f"{signal.name}[{k}]" if signal.shape else signal.name


def entries(signals: Sequence[CausalSignal]) -> list[str]:
    """Return the names of all numbers of signals."""
    return [entry(s, k) for s in signals for k in range(s.size)]
