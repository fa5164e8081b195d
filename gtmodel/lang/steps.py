"""The piece of a curve in which its argument lies, as an expression."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca


def steps_of(x: ca.SX, breaks: Sequence[ca.SX | float]) -> list[ca.SX]:
    """1 from each break on, 0 before it: their derivatives are zero."""
    return [x >= b for b in breaks]


def chosen(steps: Sequence[ca.SX], pieces: Sequence[ca.SX]) -> ca.SX:
    """The column of the piece that the argument lies in: piece k + 1 begins where steps[k] does.

    A sum of all pieces, all but one of them times 0, so that it is exact: adding up changes from piece to piece would
    lose the digits of a small one after a large one.
    """
    weights: dict[tuple[int, int], ca.SX] = {}

    def weight(begin: int, end: int) -> ca.SX:
        if (begin, end) not in weights:
            before = ca.SX(1) if begin == 0 else steps[begin - 1]
            weights[begin, end] = before - steps[end - 1] if end < len(pieces) else before
        return weights[begin, end]

    def entry(values: list[ca.SX]) -> ca.SX:
        changes = [k for k in range(1, len(values)) if not ca.is_equal(values[k - 1], values[k])]
        if not changes:
            return values[0]
        runs = zip([0, *changes], [*changes, len(values)], strict=True)
        return sum((weight(a, b) * values[a] for a, b in runs if not values[a].is_zero()), ca.SX(0))

    rows = [ca.vertsplit(ca.densify(p)) for p in pieces]
    return ca.vertcat(*[entry([row[j] for row in rows]) for j in range(len(rows[0]))])
