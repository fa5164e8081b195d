"""Matchings are SciPy's: the largest ones row by row, highest transversals by their sum."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from gtmodel.compiler.graph import (
    highest_transversal,
    largest_matching,
    neighbours_of,
    reversed_matching,
)


def pattern(rng: np.random.Generator, rows: int, columns: int, share: float) -> dict[tuple[int, int], int]:
    places = zip(*np.nonzero(rng.random((rows, columns)) < share), strict=True)
    return {(int(i), int(j)): int(rng.integers(0, 4)) for i, j in places}


@pytest.mark.parametrize("seed", range(8))
def test_the_largest_matching_is_scipys(seed):
    """The same of all that are as large: which equation gives which unknown decides the order of what is computed."""
    rng = np.random.default_rng(seed)
    for _ in range(150):
        rows, columns = (int(n) for n in rng.integers(0, 30, 2))
        entries = pattern(rng, rows, columns, rng.uniform(0.0, 0.35))
        at = [list(part) for part in zip(*entries, strict=True)] or [[], []]
        matrix = scipy.sparse.csr_matrix((np.ones(len(entries)), at), (rows, columns))
        expected = scipy.sparse.csgraph.maximum_bipartite_matching(matrix, perm_type="column").tolist()
        match = largest_matching(neighbours_of(rows, entries), columns)
        assert match == expected
        row_of = reversed_matching(match, columns)
        assert all(row_of[column] == row for row, column in enumerate(match) if column >= 0)
        assert sum(row >= 0 for row in row_of) == sum(column >= 0 for column in match)


@pytest.mark.parametrize("seed", range(8))
def test_the_transversal_has_the_highest_sum(seed):
    rng, without = np.random.default_rng(seed), 0
    for _ in range(100):
        n = int(rng.integers(1, 25))
        values = pattern(rng, n, n, rng.uniform(0.1, 0.4))
        at = [list(part) for part in zip(*values, strict=True)] or [[], []]
        weights = scipy.sparse.csr_matrix(([4.0 - v for v in values.values()], at), (n, n))
        match = highest_transversal(n, values)
        try:
            i, j = scipy.sparse.csgraph.min_weight_full_bipartite_matching(weights)
        except ValueError:
            assert match is None
            without += 1
            continue
        assert match is not None and sorted(match) == list(range(n))
        assert sum(values[pair] for pair in enumerate(match)) == sum(
            values[int(a), int(b)] for a, b in zip(i, j, strict=True)
        )
    assert 10 < without < 90
    assert highest_transversal(0, {}) == []
    assert highest_transversal(1, {}) is None
