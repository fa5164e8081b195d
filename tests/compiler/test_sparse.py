"""Constant sparse matrices do what SciPy's do."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from gtmodel.compiler.matrices import SparseMatrix, stacked_rows


def dense(m: SparseMatrix) -> np.ndarray:
    whole = np.zeros(m.shape)
    whole[m.rows, m.columns] = m.values
    return whole


@pytest.mark.parametrize(("shape", "entries"), [((4, 6), 15), ((1, 5), 3), ((7, 2), 0), ((0, 3), 0), ((3, 0), 0)])
def test_entries_products_and_what_casadi_gets(shape, entries):
    rng = np.random.default_rng(entries)
    rows, columns = (rng.integers(0, max(n, 1), entries) for n in shape)
    values = rng.normal(size=entries)
    m, expected = (
        SparseMatrix.of(rows, columns, values, shape),
        scipy.sparse.csr_matrix((values, (rows, columns)), shape),
    )
    assert np.allclose(dense(m), expected.toarray(), rtol=0, atol=1e-15)
    assert m.T.shape == shape[::-1] and np.array_equal(dense(m.T), dense(m).T)
    assert m.dm.shape == shape and m.dm.nnz() == len(m.values)
    assert np.array_equal(m.dm.full().reshape(shape), dense(m))
    both = stacked_rows([m, SparseMatrix.of([], [], [], (2, shape[1])), m])
    assert np.array_equal(dense(both), np.vstack([dense(m), np.zeros((2, shape[1])), dense(m)]))
    begin, end = shape[0] // 3, shape[0]
    assert np.array_equal(dense(m.among(begin, end)), dense(m)[begin:end])
    if shape[0]:
        asked = rng.integers(0, shape[0], 5)
        number, column, value = m.of_rows(asked)
        again = SparseMatrix.of(number, column, value, (5, shape[1]))
        assert np.array_equal(dense(again), dense(m)[asked])


def test_a_one_in_each_column():
    assert np.array_equal(dense(SparseMatrix.picked(np.array([2, 0, 2]), 3)), [[0, 1, 0], [0, 0, 0], [1, 0, 1]])
