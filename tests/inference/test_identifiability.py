"""Rank, words and indices of derivatives that are made so that the answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.inference import dependencies, identifiability, observability

NAMES = ("A_2.x", "A_2.y", "A_2a.y", "A_2b.y", "L", "v_1")


def jacobian(rows: int = 30, seed: int = 7) -> np.ndarray:
    """A_2b.y = A_2.y + 2 A_2a.y, and v_1 moves nothing."""
    J = np.random.default_rng(seed).standard_normal((rows, 6))
    J[:, 3] = J[:, 1] + 2 * J[:, 2]
    J[:, 5] = 0.0
    return J


def test_the_gauge_and_the_unseen_are_named():
    found = identifiability(jacobian(), NAMES, keep=("A_2.y", "A_2a.y"))
    assert found.rank == 4 and found.redundant == 2
    assert set(found.ranks.values()) == {4}
    said = found.notes
    assert said[1] == "A_2b.y moves with A_2.y and A_2a.y: measure A_2b.y, or fix one of them"
    assert said[2] == "no measurement depends on v_1: fix it"
    assert dict(zip(NAMES, np.isinf(found.std), strict=True)) == {
        "A_2.x": False, "A_2.y": True, "A_2a.y": True, "A_2b.y": True, "L": False, "v_1": True,
    }  # fmt: skip
    c = found.dependencies.coefficients["A_2b.y"]
    assert c == pytest.approx({"A_2.y": 1.0, "A_2a.y": 2.0}, rel=1e-10)
    assert found.dependencies.base("A_2a.y") == pytest.approx({"A_2a.y": 1.0, "A_2b.y": 2.0}, rel=1e-10)


def test_null_directions_leave_all_rows_alone():
    J = jacobian()
    found = identifiability(J, NAMES)
    for direction in found.null:
        v = np.array([direction.weights.get(n, 0.0) for n in NAMES])
        assert np.linalg.norm(J @ v) < 1e-10


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(6)), st.integers(0, 3))
def test_the_order_of_columns_and_the_signs_of_rows_change_nothing(order, turned):
    """Property: names decide, neither places nor an orthogonal mixing of the rows, as another BLAS would make it."""
    J = jacobian()
    first = identifiability(J, NAMES, scale=np.ones(6))
    Q, _ = np.linalg.qr(np.random.default_rng(turned).standard_normal((30, 30)))
    names = tuple(NAMES[k] for k in order)
    other = identifiability((Q @ J)[:, order], names, scale=np.ones(6))
    assert other.dependencies.independent == first.dependencies.independent
    assert list(other.dependencies.coefficients) == list(first.dependencies.coefficients)
    assert other.notes[1:] == first.notes[1:]
    np.testing.assert_allclose(other.std, first.std[list(order)], rtol=1e-9)


def test_ties_go_to_the_first_name():
    J = np.eye(4)[:, [0, 1, 1, 0]]
    assert dependencies(J, "dcba").independent == ("a", "b")
    assert dependencies(J, "abcd").independent == ("a", "b")
    assert dependencies(J, "abcd", keep=["d"]).independent == ("d", "b")


def test_dependencies_in_other_units_are_the_same():
    J, f = jacobian(), np.array([1, 1e3, 1, 1e-3, 1, 1])
    once = dependencies(J, NAMES, keep=NAMES[:3])
    other = dependencies(J / f, NAMES, scale=f, keep=NAMES[:3])  # parameters p f, told in units of f
    expected = {n: c * f[NAMES.index(n)] / f[3] for n, c in once.coefficients["A_2b.y"].items()}
    assert other.coefficients["A_2b.y"] == pytest.approx(expected, rel=1e-9)


def test_a_direction_that_is_barely_seen_is_named_with_its_deviation():
    J = np.diag([100.0, 100.0, 1.0]) @ np.array([[1, 0, 0], [0, 1, 1], [0, 1, -1]]) / [1, np.sqrt(2), np.sqrt(2)]
    J[2] *= 0.04
    found = identifiability(J, "abc", scale=np.ones(3))
    assert found.rank == 3 and found.redundant == 0
    (near,) = found.near
    assert near.weights == pytest.approx({"b": 1.0, "c": -1.0}) and near.std == pytest.approx(25.0)
    assert "b and c are determined no better than they were known" in found.notes[-1]
    assert found.correlated[0][:2] == ("b", "c") and found.correlated[0][2] < -0.99


def test_standard_deviations_are_those_of_the_inverse_information():
    J = np.random.default_rng(3).standard_normal((20, 3)) * [1, 10, 100]
    found = identifiability(J, "abc")
    np.testing.assert_allclose(found.covariance, np.linalg.inv(J.T @ J), rtol=1e-10)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(np.linalg.inv(J.T @ J))), rtol=1e-10)
    np.testing.assert_allclose(found.determined_by, 1.0)


def test_observability_indices_by_hand():
    o = observability(np.array([8.0, 4.0, 2.0, 0.0]), 3, 16, "scaled")
    assert (o.o1, o.o2, o.o3, o.o4, o.o5) == pytest.approx((1.0, 0.25, 2.0, 0.5, 1 / (1 / 8 + 1 / 4 + 1 / 2)))
    assert "r = 3, 16 poses, scaled" in str(o)
    with pytest.raises(ValueError, match="rank and poses of at least one"):
        observability(np.zeros(2), 0, 3, "")


def test_wrong_slopes_get_a_sentence():
    with pytest.raises(ValueError, match=r"the derivatives have the shape \(30, 6\); expected \(rows, 2\)"):
        identifiability(jacobian(), "ab")
    with pytest.raises(ValueError, match="no measurement depends on"):
        identifiability(np.zeros((3, 2)), "ab")
    with pytest.raises(ValueError, match="the derivatives of 'b' are not finite"):
        identifiability([[1.0, np.nan]], "ab")
    with pytest.raises(ValueError, match="expected 2 finite numbers, one per parameter"):
        identifiability(np.ones((3, 2)), "ab", scale=[1.0, 2.0, 3.0])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.sampled_from([0.0, 1e-3, 0.1, 0.5, 2.0, 30.0, 1e4]), min_size=2, max_size=8), st.integers(0, 9999))
def test_every_combination_is_counted_once_by_the_number_that_decides(sizes, seed):
    """Slopes of chosen singular values: 0 is not told, below 1 no better than known, above 1 told."""
    if not any(sizes):
        sizes = [*sizes, 2.0]
    n, rng = len(sizes), np.random.default_rng(seed)
    U, V = (np.linalg.qr(rng.standard_normal((k, n)))[0] for k in (n + 4, n))
    found = identifiability(U @ np.diag(sizes) @ V.T, [f"p{k}" for k in range(n)], scale=np.ones(n))
    wanted = [sum(s > 1 for s in sizes), sum(0 < s < 1 for s in sizes), sum(s == 0 for s in sizes)]
    assert [found.determined, len(found.near), found.redundant] == wanted
    first, *others = found.notes
    assert first.startswith(f"{wanted[0]} of {n} parameters or combinations are determined")
    assert ("no better than they were known" in first) == (wanted[1] > 0) == any("no better" in s for s in others)
    numbers = [int(w) for w in first.partition("; the rank")[0].replace(",", "").split() if w.isdigit()]
    assert numbers == [wanted[0], n, *[w for w in wanted[1:] if w]]
