"""Columns of a log that may be exchanged: in which orders they are tried."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, permutations


def orders(n: int, groups: Sequence[Sequence[int]]) -> list[list[int]]:
    """All orders of groups of three and less, single exchanges within larger ones."""
    tried = []
    for group in groups:
        if len(group) <= 3:
            trials = [list(p) for p in permutations(group)][1:]
        else:
            trials = []
            for a, b in combinations(range(len(group)), 2):
                trial = list(group)
                trial[a], trial[b] = trial[b], trial[a]
                trials.append(trial)
        for trial in trials:
            order = list(range(n))
            for k, m in zip(group, trial, strict=True):
                order[k] = m
            tried.append(order)
    return tried
