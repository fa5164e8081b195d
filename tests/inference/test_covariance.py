"""Coloured residuals: hand formulas, and intervals that hold on noise whose colour is known."""

import numpy as np
import pytest

from gtmodel.inference import (
    automatic_lag,
    block_bootstrap,
    correlation_time,
    decimated,
    fixed_b,
    newey_west,
    white,
)  # fmt: skip
from gtmodel.inference.covariance import carried
from gtmodel.results import ArgumentError


def ar1(rng: np.random.Generator, n: int, rho: float) -> np.ndarray:
    """Synthetic first-order autoregression of unit variance, stationary from the start."""
    e = rng.standard_normal(n) * np.sqrt(1 - rho**2)
    r = np.empty(n)
    r[0] = rng.standard_normal()
    for k in range(1, n):
        r[k] = rho * r[k - 1] + e[k]
    return r


def problem(n: int) -> np.ndarray:
    t = np.arange(n) / n
    return np.column_stack([np.ones(n), np.sin(2 * np.pi * 3 * t), 50 * t])


def test_white_is_the_inverse_information():
    J = problem(50)
    np.testing.assert_allclose(white(J, 0.3), 0.3 * np.linalg.inv(J.T @ J), rtol=1e-10)
    np.testing.assert_allclose(white(J, 0.3, scale=np.array([1, 1, 0.02])), white(J, 0.3), rtol=1e-9)


def test_newey_west_of_a_mean_by_hand():
    r = np.array([1.0, 2.0, -1.0, -2.0])
    # lag 0: 10, lag 1: 2 - 2 + 2 = 2 with weight 1 - 1/2, both signs; over T^2, times T / (T - 1)
    expected = (10 + 2 * 0.5 * 2) / 16 * 4 / 3 * fixed_b(0.5) ** 2
    assert newey_west(np.ones((4, 1)), r, lags=1)[0, 0] == pytest.approx(expected, rel=1e-12)
    # two recordings of two samples: the product across the break is not counted
    expected = (10 + 2 * 0.5 * (2 + 2)) / 16 * 4 / 3 * fixed_b(0.5) ** 2
    assert newey_west(np.ones((4, 1)), r, lags=1, starts=(0, 2))[0, 0] == pytest.approx(expected, rel=1e-12)


def test_without_lags_it_is_whites_sandwich():
    rng = np.random.default_rng(0)
    J, r = problem(60), rng.standard_normal(60)
    bread = np.linalg.inv(J.T @ J)
    expected = bread @ (J.T * r**2 @ J) @ bread * 60 / 57
    np.testing.assert_allclose(newey_west(J, r, lags=0), expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_intervals_hold_whatever_share_of_the_log_the_bandwidth_is(share: float):
    T, runs = 100, 2000
    rows = np.random.default_rng(12).standard_normal((runs, T))  # synthetic, seed 12
    ones, lags = np.ones((T, 1)), round(share * T) - 1
    std = np.sqrt([newey_west(ones, r - r.mean(), lags=lags)[0, 0] for r in rows])
    hits = np.abs(rows.mean(axis=1)) < 1.96 * std
    # 95 % within the binomial band of 2000; the normal quantile alone would give 90 and 81 %
    assert 0.935 < hits.mean() < 0.965
    assert np.mean(np.abs(rows.mean(axis=1)) < 1.96 * std / fixed_b(share)) < 0.92


def test_channels_sampled_together_are_summed_before_they_are_squared():
    rng = np.random.default_rng(1)
    J, r = rng.standard_normal((40, 2, 3)), rng.standard_normal((40, 2))
    scores = np.einsum("tcn,tc->tn", J, r)
    bread = np.linalg.inv(np.einsum("tcn,tcm->nm", J, J))
    expected = bread @ scores.T @ scores @ bread * 80 / 77
    np.testing.assert_allclose(newey_west(J, r, lags=0), expected, rtol=1e-9)


def test_times_and_lags_of_a_known_colour():
    r = ar1(np.random.default_rng(2), 20_000, 0.8)
    assert 7 <= correlation_time(r) <= 11  # (1 + rho) / (1 - rho) = 9
    assert 25 <= automatic_lag(r) <= 90
    assert correlation_time(np.random.default_rng(3).standard_normal(2000)) <= 2


def test_all_roads_agree_with_the_true_covariance_where_white_noise_is_three_times_too_narrow():
    rho, n, runs = 0.8, 2000, 60
    J = problem(n)
    k = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    P = np.linalg.solve(J.T @ J, J.T)
    true = np.diag(P @ rho**k @ P.T)
    pick = np.eye(n) - J @ P
    roads = {"white": [], "newey_west": [], "decimated": [], "bootstrap": []}
    for seed in np.random.SeedSequence(11).spawn(runs):
        r = pick @ ar1(np.random.default_rng(seed), n, rho)
        roads["white"].append(white(J, r @ r / (n - 3)))
        roads["newey_west"].append(newey_west(J, r))
        roads["decimated"].append(decimated(J, r))
        if len(roads["bootstrap"]) < 10:
            roads["bootstrap"].append(block_bootstrap(J, r, seed=1, draws=100))
    ratio = {name: np.sqrt(np.diag(np.mean(c, axis=0)) / true) for name, c in roads.items()}
    assert np.all((0.25 < ratio["white"]) & (ratio["white"] < 0.45))
    for name, (low, high) in {"newey_west": (0.85, 1.1), "decimated": (0.9, 1.3), "bootstrap": (0.8, 1.2)}.items():
        assert np.all((low < ratio[name]) & (ratio[name] < high)), (name, ratio[name])


def test_a_bootstrap_is_the_same_for_the_same_seed():
    r = ar1(np.random.default_rng(5), 300, 0.5)
    once, again, other = (block_bootstrap(problem(300), r, seed=s, draws=20) for s in (1, 1, 2))
    assert np.array_equal(once, again) and not np.array_equal(once, other)


def test_too_short_a_log_is_refused():
    with pytest.raises(ValueError, match="every 20-th of 40 samples leaves 2 rows for 3 parameters"):
        decimated(problem(40), np.ones(40), every=20)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda J, r: decimated(J, r, every=0), "every: .*0"),
        (lambda J, r: decimated(J, r, every=-2), "every: .*-2"),
        (lambda J, r: block_bootstrap(J, r, seed=1, block=0), "block: .*0"),
        (lambda J, r: block_bootstrap(J, r, seed=1, draws=1), "draws: .*1"),
        (lambda J, r: newey_west(J, r, lags=-1), "lags: .*-1"),
        (lambda J, r: newey_west(J[:3], r[:3]), "3 residuals for 3 parameters"),
        (lambda J, r: block_bootstrap(J[:3], r[:3], seed=1), "3 residuals for 3 parameters"),
    ],
)
def test_wrong_numbers_of_samples_are_refused(call, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        call(problem(60), np.random.default_rng(1).normal(size=60))


@pytest.mark.parametrize("column", [lambda t: np.ones_like(t), np.zeros_like, lambda t: 1 + 2 * t])
def test_columns_that_depend_on_others_have_no_covariance(column) -> None:
    t = np.arange(60) / 60
    J, r = np.column_stack([np.ones(60), t, column(t)]), np.random.default_rng(1).normal(size=60)
    for call in (
        lambda: white(J, 1.0), lambda: newey_west(J, r), lambda: decimated(J, r), lambda: block_bootstrap(J, r, seed=1)
    ):  # fmt: skip
        with pytest.raises(ArgumentError, match="rank is 2 for 3 parameters"):
            call()


class TestCarried:
    def test_no_variance_is_negative_where_the_product_leaves_one(self) -> None:
        """Directions on which the data say nothing: variances of zero, which products miss by rounding either way."""
        rng = np.random.default_rng(1)
        negative = 0
        for _ in range(20):
            F = rng.normal(size=(8, 3)) * 10 ** rng.uniform(-4, 4, size=(8, 1))  # units that lie far apart
            null = np.linalg.svd(F.T)[2][3:]
            C, T = F @ F.T, np.vstack([null, rng.normal(size=(2, 8))])
            product, own = T @ C @ T.T, carried(T, C)
            negative += np.sum(np.diag(product) < 0)
            assert np.all(np.diag(own) >= 0) and np.array_equal(own, own.T)
            assert np.linalg.eigvalsh(own)[0] > -1e-15 * np.linalg.norm(own)
            np.testing.assert_allclose(own, product, atol=1e-13 * np.linalg.norm(T, 2) ** 2 * np.linalg.norm(C))
        assert negative > 0  # the draws show the fault

    def test_unknowns_that_have_no_variance(self) -> None:
        C = np.diag([4.0, 0.0])
        np.testing.assert_allclose(carried(np.eye(2), C), C)
        np.testing.assert_allclose(carried(np.array([[1.0, 7.0]]), C), [[4.0]])
