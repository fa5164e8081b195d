"""Completion of a guess of some variables: the others follow from the known values and the equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..plan import CausalPlan

Pair = tuple[int, int]


class Completion:
    """Completes guesses to all symbols of a plan, row by row, starting at its home pose.

    `read`: the symbols in the rows of known values, in order.
    """

    def __init__(self, plan: CausalPlan, read: Sequence[Pair]) -> None:
        self._plan = plan
        self._sampler = replace(plan.sampler)  # its time changes with the rows
        self._place = {pair: n for n, pair in enumerate(plan.pairs)}
        self._read = [(k, self._place[pair]) for k, pair in enumerate(read) if pair in self._place]
        self._fixed = {n for _, n in self._read}

    def knows(self, pair: Pair) -> bool:
        """Return whether a guess of this symbol is useful: it occurs in the equations, and its value is not known."""
        return pair in self._place and self._place[pair] not in self._fixed

    def __call__(self, known: np.ndarray, guess: Mapping[Pair, np.ndarray], wanted: Sequence[Pair]) -> np.ndarray:
        """Return values (wanted, n) near the guess, (n,) per symbol; known: (read, n), and the time if it is used."""
        rows, columns = (np.array(x, dtype=int) for x in zip(*self._read, strict=True)) if self._read else ([], [])
        guessed = [self._place[p] for p in guess]
        targets = [self._place[p] for p in wanted]
        free = np.ones(len(self._place))
        free[columns] = free[guessed] = 0.0
        values = np.full((len(wanted), known.shape[1]), np.nan)
        for n in range(known.shape[1]):
            w = self._plan.samples[0].copy()
            w[columns], w[guessed] = known[rows, n], [g[n] for g in guess.values()]
            if not np.all(np.isfinite(w)):
                continue
            if self._plan.uses_time:
                self._sampler.time = float(known[-1, n])
            self._sampler.follow(w, free, targets)
            values[:, n] = w[targets]
        return values
