"""Steps from inner products and from triangles of pieces, against lstsq on all rows."""

import numpy as np
import pytest

from gtmodel.inference import nonlinear_fit
from gtmodel.inference.nonlinear import CONDITION, descend, directions, sums, triangle
from gtmodel.inference.weighting import loss_named

LINEAR = loss_named("linear")


def jacobian(condition, rows, n, seed):
    rng = np.random.default_rng(seed)
    U, _ = np.linalg.qr(rng.standard_normal((rows, n)))
    V, _ = np.linalg.qr(rng.standard_normal((n, n)))
    return U * np.logspace(0, -np.log10(condition), n) @ V.T * np.sqrt(rows)


def pieces(A, length):
    return [A[k : k + length] for k in range(0, len(A), length)]


@pytest.mark.parametrize("length", [1, 3, 64, 199, 200, 201])
@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_sums_of_pieces_are_those_of_the_whole(length, loss):
    A, own = np.random.default_rng(1).standard_normal((200, 6)), loss_named(loss)
    W = A * own.weight(A[:, -1], 0.7)[:, None]
    gram, R = (sums(pieces(A, length), own, 0.7, triangular=t) for t in (False, True))
    np.testing.assert_allclose(gram.matrix, W.T @ W, atol=1e-12)
    np.testing.assert_allclose(R.matrix.T @ R.matrix, W.T @ W, atol=1e-12)
    assert gram.cost == pytest.approx(own.cost(A[:, -1], 0.7), rel=1e-13) == R.cost
    assert not np.tril(R.matrix, -1).any()


@pytest.mark.parametrize("condition", [1.0, 1e2, 0.99 * CONDITION, 1.01 * CONDITION, 1e7])
def test_a_fit_in_pieces_ends_where_lstsq_does(condition):
    """To 1e-10 of a standard deviation or what rounding times the condition leaves of any solution; inner products end
    at CONDITION."""
    rng = np.random.default_rng(7)
    J, truth = jacobian(condition, 3000, 5, 3), rng.standard_normal(5)
    b = J @ truth + 1e-3 * rng.standard_normal(3000)
    d = descend(lambda x: pieces(np.column_stack([J, J @ x - b]), 256), np.zeros(5), np.ones(5))
    x = np.linalg.lstsq(J, b, rcond=None)[0]
    inverse = np.linalg.pinv(J)
    std = 1e-3 * np.sqrt(np.sum(inverse**2, axis=1))
    rounding = np.finfo(float).eps * condition * np.linalg.norm(x)
    assert d.status.ok and np.all(np.abs(d.x - x) < np.maximum(1e-10 * std, rounding))
    inner = directions(sums([np.column_stack([J, -b])], LINEAR, 1.0, triangular=False), np.ones(6), np.zeros((0, 6)))
    assert (inner is None) == (condition > CONDITION)


def test_both_ways_have_the_same_directions_with_priors():
    A, prior = np.random.default_rng(2).standard_normal((50, 5)), np.eye(4, 5)[:2]
    scale = np.array([1.0, 0.1, 3.0, 2.0, 1.0])
    gram, R = (directions(sums(pieces(A, 9), LINEAR, 1.0, triangular=t), scale, prior) for t in (False, True))
    assert gram is not None and R is not None
    np.testing.assert_allclose(gram.singular, R.singular, rtol=1e-12)
    np.testing.assert_allclose(gram.V @ gram.projected, R.V @ R.projected, rtol=1e-11)
    assert gram.size == pytest.approx(R.size, rel=1e-13)


def test_fewer_rows_than_unknowns_and_none_at_all():
    A = np.array([[1.0, 0.0, 2.0, 3.0]])
    d = descend(lambda x: [np.column_stack([A[:, :-1], A[:, :-1] @ x - 3.0])], np.zeros(3), np.ones(3))
    np.testing.assert_allclose(d.x, np.array([1.0, 0.0, 2.0]) * 3 / 5, atol=1e-12)  # of least norm
    none = descend(lambda _: [np.zeros((0, 4))], np.ones(3), np.ones(3))
    assert none.status.ok and "no measurement depends" in none.message and np.all(none.x == 1)


def test_a_row_that_is_not_a_number_is_a_status():
    A = np.random.default_rng(0).standard_normal((20, 4))
    A[11, 1] = np.nan
    assert not sums(pieces(A, 6), LINEAR, 1.0, triangular=False).finite
    assert not sums(pieces(A, 6), LINEAR, 1.0, triangular=True).finite
    assert not descend(lambda _: pieces(A, 6), np.zeros(3), np.ones(3)).status.ok


def test_a_triangle_keeps_small_singular_values_that_inner_products_lose():
    J = jacobian(1e12, 500, 4, 5)
    R = np.zeros((0, 0))
    for piece in pieces(J, 100):
        R = triangle(R, piece)
    np.testing.assert_allclose(np.linalg.svd(R)[1], np.linalg.svd(J)[1], rtol=1e-3)


def test_a_function_is_not_evaluated_more_often_than_steps_are_tried():
    count = [0]
    time = np.linspace(0, 1, 50)

    def residuals(x):
        count[0] += 1
        e = np.exp(-x[1] * time)
        return x[0] * e - 2 * np.exp(-3 * time) - 1e-3 * np.sin(40 * time), np.column_stack([e, -x[0] * time * e])

    fit = nonlinear_fit(residuals, [1.0, 1.0], "ab")
    assert fit.status.ok and count[0] <= fit.evaluations + 1
