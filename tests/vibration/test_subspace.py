"""Subspace identification: exact without noise, consistent with it, equal to nfoursid, and what is refused."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats
from scipy.signal import dlsim

from gtmodel.linear.response import free_responses, simulate
from gtmodel.results import ArgumentError
from gtmodel.vibration import Record, identify_subspace, physical_form, structure_record
from tests.vibration.structures import TS, D, K, M, matched, random_system, relative, response

METHODS = ["moesp", "n4sid", "cva"]
EXACT = 1e-8  # of poles from noise-free data: the bound
IDENTICAL = 1e-6  # relative difference of frequency responses from noise-free data, resonance peaks among them
WITHIN = 1e-3  # of noisy frequency responses: the bound
F = np.linspace(2.0, 25.0, 60)  # Hz, where the modes are


@pytest.fixture(scope="module")
def noisy() -> Record:
    return structure_record(M, D, K, force=50.0, samples=4000, sample_time=TS, noise=1e-5, seed=5, hold=8)


def test_simulation_equals_scipy() -> None:
    A, B, C, D_ = random_system(1, 5, 2, 3)
    random = np.random.default_rng(0)
    u, x0 = random.standard_normal((60, 2)), random.standard_normal(5)
    expected = dlsim((A, B, C, D_, 1.0), u, x0=x0)[1]
    np.testing.assert_allclose(simulate(A, B, C, D_, u, x0), expected, atol=1e-12)
    rest = dlsim((A, B, C, D_, 1.0), 0 * u, x0=x0)[1]
    np.testing.assert_allclose(free_responses(A, C, 60) @ x0, rest, atol=1e-12)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 6),
    m=st.integers(1, 2),
    p=st.integers(1, 3),
    method=st.sampled_from(METHODS),
)
def test_random_systems_come_back_exactly(seed, n, m, p, method) -> None:
    A, B, C, D_ = random_system(seed, n, m, p)
    random = np.random.default_rng(seed + 1)
    u, x0 = random.standard_normal((400, m)), random.standard_normal(n)
    record = Record(u, simulate(A, B, C, D_, u, x0), TS)
    found = identify_subspace(record, order=n, method=method, block_rows=8, feedthrough=True)
    assert matched(found.poles, np.linalg.eigvals(A)) < EXACT
    f = np.linspace(1.0, 120.0, 40)
    truth = response(control.StateSpace(A, B, C, D_, TS), f)
    assert relative(response(found.system, f), truth) < IDENTICAL
    # the initial state of the data, in the model's own coordinates, gives the whole record
    assert np.abs(found.fitted - record.y).max() < EXACT * np.abs(record.y).max()


def test_coordinates_and_units_do_not_matter(noisy) -> None:
    """Outputs in other units: poles stay, the transfer function scales."""
    one = identify_subspace(noisy, order=4, block_rows=10)
    other = identify_subspace(Record(noisy.u / 50, 1e3 * noisy.y, TS), order=4, block_rows=10)
    assert matched(other.poles, one.poles) < EXACT
    assert relative(response(other.system, F), 5e4 * response(one.system, F)) < IDENTICAL


@pytest.mark.parametrize("method", METHODS)
def test_the_order_is_found_and_held_out_samples_are_predicted_to_the_noise(noisy, method) -> None:
    found = identify_subspace(noisy, method=method, largest=6)
    assert found.order == found.gap_order == 4 and "fall most after the same order" in found.why
    held = found.prediction[found.first_held_out :] - noisy.y[found.first_held_out :]
    # the fitted part's initial state, 11 s later: what is left is the noise of 10 um, model errors within 10 %
    assert np.sqrt(np.mean(held**2)) == pytest.approx(1e-5, rel=0.1)
    assert np.all(found.held_out_fit > 99) and found.synthetic == "seed 5, noise 1e-05 m"
    worse = {t.order: t.held_out_rms for t in found.trials}
    assert worse[2] > 10 * worse[4]


@pytest.mark.parametrize(("noise", "bound"), [(0.0, IDENTICAL), (1e-5, WITHIN)])
def test_nfoursid_agrees(noise, bound) -> None:
    """An independent implementation of PO-MOESP with states, on the two-mass robot."""
    pandas, oracle = pytest.importorskip("pandas"), pytest.importorskip("nfoursid.nfoursid")
    # it takes the cube of the samples
    record = structure_record(M, D, K, force=50.0, samples=2000, sample_time=TS, noise=noise, seed=63, hold=8)
    frame = pandas.DataFrame({"u": record.u[:, 0], "a": record.y[:, 0], "b": record.y[:, 1]})
    peer = oracle.NFourSID(frame, output_columns=["a", "b"], input_columns=["u"], num_block_rows=10)
    peer.subspace_identification()
    ss, _ = peer.system_identification(rank=4)
    theirs = control.StateSpace(ss.a, ss.b, ss.c, ss.d, TS)
    for method in METHODS:
        ours = identify_subspace(record, order=4, method=method, block_rows=10)
        assert relative(physical_form(ours.system).M_inv_K, physical_form(theirs).M_inv_K) < bound
        assert matched(ours.poles, theirs.poles()) < bound
        if not noise:
            assert relative(response(ours.system, F), response(theirs, F)) < bound


def pole_errors(samples: int, seeds: range) -> np.ndarray:
    A, B, C, D_ = random_system(7, 2, 1, 1)
    true = np.linalg.eigvals(A)[0]
    errors = []
    for seed in seeds:
        random = np.random.default_rng(seed)
        u = random.standard_normal((samples, 1))
        y = simulate(A, B, C, D_, u) + 0.3 * random.standard_normal((samples, 1))
        poles = identify_subspace(Record(u, y, TS), order=2, block_rows=6).poles
        errors.append(poles[np.argmin(np.abs(poles - true))] - true)
    return np.array(errors)


@pytest.mark.parametrize("seeds", [range(40), pytest.param(range(1000, 1600), marks=pytest.mark.proof)], ids=len)
def test_errors_fall_with_the_root_of_the_samples(seeds: range) -> None:
    """Sixteen times the samples: a quarter of the error, within the 99.9 % band of the F distribution."""
    few, many = pole_errors(500, seeds), pole_errors(8000, seeds)
    ratio = np.mean(np.abs(few) ** 2) / np.mean(np.abs(many) ** 2)
    low, high = stats.f.ppf([5e-4, 1 - 5e-4], len(seeds), len(seeds))  # one freedom a seed: parts may be correlated
    assert 16 * low < ratio < 16 * high


def test_what_is_refused(noisy) -> None:
    def refused(sentence, record=noisy, **options):
        with pytest.raises(ArgumentError, match=sentence):
            identify_subspace(record, **options)

    refused("unknown method 'n4'; expected n4sid, moesp, cva", method="n4")
    refused("the held-out share is 1; expected a number between 0 and 1", held_out=1.0)
    refused("order 19 .* 10 block rows of 2 outputs determine 1 to 18", order=19, block_rows=10)
    refused("1 block rows cannot", block_rows=1)
    refused(
        "67 samples are too few for 20 block rows of 1 inputs and 2 outputs; expected at least 159", noisy.rows(0, 100)
    )
    still = Record(np.full(500, 50.0), noisy.y[:500], TS)
    refused("the inputs excite 0 of the 20 directions that 10 block rows need", still, block_rows=10)
    A, B, C, D_ = random_system(3, 2, 1, 1)
    u = np.random.default_rng(0).standard_normal((300, 1))
    clean = Record(u, simulate(A, B, C, D_, u), TS)
    refused("order 4 .* only 2 singular values", clean, order=4, block_rows=6)
    growing = Record(u, simulate(np.array([[1.02]]), B[:1], C[:, :1], D_, u), TS)
    refused(r"the model of order 1 is unstable: a pole has the modulus 1\.02", growing, order=1, block_rows=6)


def test_records_are_checked() -> None:
    with pytest.raises(ArgumentError, match="3 samples of the inputs and 4 of the outputs"):
        Record(np.zeros(3), np.zeros(4), TS)
    with pytest.raises(ArgumentError, match="sample 1 of column 0 of the outputs is nan; expected finite numbers"):
        Record(np.zeros(2), np.array([0.0, np.nan]), TS)
    with pytest.raises(ArgumentError, match="sample_time"):
        Record(np.zeros(2), np.zeros(2), 0.0)


def test_where_the_robot_stands_does_not_matter(noisy) -> None:
    # positions about 1.5 m and a force with a bias: the same model, the offset told apart
    one = identify_subspace(noisy, order=4, block_rows=10)
    moved = Record(noisy.u + 20.0, np.add(noisy.y, [1.5, -0.2]), TS)
    for method in ("moesp", "n4sid", "cva"):
        other = identify_subspace(moved, method=method, block_rows=10, largest=6)
        assert other.order == 4 and other.held_out_fit.min() > 90
        steady = np.real(response(other.system, np.array([0.0]))[0]) @ [20.0]
        np.testing.assert_allclose(other.offset + steady.ravel(), [1.5, -0.2], atol=2e-4)
    again = identify_subspace(moved, order=4, block_rows=10)
    assert matched(again.poles, one.poles) < 1e-6
    np.testing.assert_allclose(again.residual, one.residual, rtol=1e-6)
