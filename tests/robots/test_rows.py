"""Many rows at once: the same numbers as one by one, in blocks, from a pickle."""

import pickle

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.rows import BLOCK, RowFunction
from gtmodel.robots.six_link import six_link_gantry_tau

ROBOT = gt.robots.gantry_tau("l1_tape")
IK = ROBOT.causal("T", ["q", "arm[0].rod.a.r", "der(q)"])


def rows(n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    T = np.array(ROBOT.home) + rng.uniform(-1.5, 1.5, (n, 3))  # many of them out of reach
    T[1] = np.nan
    return [T, rng.normal(size=(n, 3))]


def test_blocks_and_single_calls_give_the_same_bits() -> None:
    n = 2 * BLOCK + 5
    arguments = rows(n)
    *many, status = IK(*arguments)
    assert 0 < np.count_nonzero(status == 0) < n
    for k in (0, 1, BLOCK - 1, BLOCK, 2 * BLOCK, n - 1):
        *one, code = IK(*(a[k] for a in arguments))
        assert code == status[k]
        for x, y in zip(one, many, strict=True):
            np.testing.assert_array_equal(x, y[k])


def test_jacobians_in_blocks() -> None:
    ik = ROBOT.causal("T", "q")
    T = rows(BLOCK + 3)[0]
    J, status = ik.jacobian(T)
    for k in (0, 1, BLOCK, BLOCK + 2):
        one, code = ik.jacobian(T[k])
        assert code == status[k]
        np.testing.assert_array_equal(one, J[k])


def test_cut_loose_and_pickled_it_stays_the_same() -> None:
    arguments = rows(50)
    expected = IK(*arguments)
    for f in (RowFunction(IK), pickle.loads(pickle.dumps(RowFunction(IK)))):
        for x, y in zip(f(*arguments), expected, strict=True):
            np.testing.assert_array_equal(x, y)


def test_newton_stays_with_its_model() -> None:
    with pytest.raises(gt.ModelError, match=r"Newton.*call the CausalFunction"):
        RowFunction(six_link_gantry_tau().causal("q", "T"))
