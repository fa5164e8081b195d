"""Tearing of a block: the unknowns with the highest state preference determine the others one by one.

In a chain of joints these are the joint coordinates: positions and rotations of the links follow from them forwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from .matrices import triplets


@dataclass(frozen=True, eq=False)
class Torn:
    """A block torn at `unknowns`: `assignments` of the others, in order, and the equations that remain, after them."""

    unknowns: list[ca.SX]
    residuals: list[ca.SX]
    assignments: list[tuple[ca.SX, ca.SX]]


def torn(residuals: Sequence[ca.SX], unknowns: Sequence[ca.SX], preference: Sequence[int]) -> Torn | None:
    """Return the block torn at the unknowns of the fewest preference levels that determine the others; None if an
    unknown would have to be solved from an equation in which its coefficient is not a number."""
    use = _Use(residuals, unknowns)
    numbers = use.numbers
    for level in sorted(set(preference), reverse=True)[:-1]:
        kept = [j for j, p in enumerate(preference) if p >= level]
        order = use.forward(kept)
        if len(order) + len(kept) == len(unknowns):
            break
    else:
        return None
    assignments = []
    for i, j in order:
        rest = ca.substitute(residuals[i], unknowns[j], 0)
        assignments.append((unknowns[j], -rest / numbers[i, j]))
    used = {i for i, _ in order}
    remaining = [r for i, r in enumerate(residuals) if i not in used]
    _, remaining = ca.substitute_inplace([u for u, _ in assignments], [e for _, e in assignments], remaining)
    return Torn([unknowns[j] for j in kept], remaining, assignments)


def determines(residuals: Sequence[ca.SX], unknowns: Sequence[ca.SX], kept: Sequence[int]) -> bool:
    """Return whether the unknowns at these positions determine all others one by one, as joints of an open chain do."""
    return len(_Use(residuals, unknowns).forward(kept)) == len(unknowns) - len(kept) == len(residuals)


class _Use:
    """Which unknowns each equation uses, and the coefficients that are numbers other than zero."""

    def __init__(self, residuals: Sequence[ca.SX], unknowns: Sequence[ca.SX]) -> None:
        jacobian = ca.jacobian(ca.vertcat(*residuals), ca.vertcat(*unknowns))
        numbers = {(i, j): float(value) for i, j, value in triplets(jacobian) if value.is_constant()}
        self.numbers = {entry: value for entry, value in numbers.items() if value != 0.0}
        self._inside: list[set[int]] = [set() for _ in residuals]
        self._rows_of: list[list[int]] = [[] for _ in unknowns]
        for i, j in sorted(zip(*jacobian.sparsity().get_triplet(), strict=True)):
            self._inside[i].add(j)
            self._rows_of[j].append(i)

    def forward(self, kept: Sequence[int]) -> list[tuple[int, int]]:
        """Return (row, unknown) in the order in which each row has only this unknown left."""
        left = [set(row) for row in self._inside]
        order: list[tuple[int, int]] = []
        solved = set(kept)
        for j in kept:
            for i in self._rows_of[j]:
                left[i].discard(j)
        ready = [i for i, row in enumerate(left) if len(row) == 1]
        while ready:
            ready.sort(reverse=True)
            i = ready.pop()
            if len(left[i]) != 1:
                continue
            (j,) = left[i]
            if (i, j) not in self.numbers or j in solved:
                continue
            solved.add(j)
            order.append((i, j))
            for k in self._rows_of[j]:
                left[k].discard(j)
                if len(left[k]) == 1:
                    ready.append(k)
        return order
