"""Filters: amplitude, phase and orders of accuracy against sines, whose derivatives are known."""

import numpy as np
import pytest
from scipy.signal import butter, freqz

from gtmodel.measurements import (
    Session,
    ZeroPhase,
    cutoff_for,
    decimate,
    derivative,
    excitation_band,
    motion,
    moving,
    second_derivative,
)
from gtmodel.results import Trajectory, TrajectoryError

DT = 0.004
TIME = DT * np.arange(2000)
# what the ends of a record leave of a sine behind `end_rows`: three periods of the cut-off, some 1e-3
ENDS = 2e-3


_UNITS = {"q": "m", "force": "N"}


def session(q: np.ndarray, **signals: np.ndarray) -> Session:
    values = {"q": q, **signals}
    return Session(
        "made here", Trajectory(TIME, values, {name: _UNITS[name] for name in values}, synthetic="no noise"), DT
    )


@pytest.mark.parametrize("frequency", [2.0, 10.0, 20.0, 40.0])
def test_a_sine_keeps_its_phase_and_loses_the_known_amplitude(frequency: float) -> None:
    low_pass = ZeroPhase(20.0, order=4)
    sine = np.sin(2 * np.pi * frequency * TIME)
    cut = low_pass.end_rows(DT)
    # an independent road: the transfer function's polynomials, not its second-order sections
    _, response = freqz(*butter(4, 20.0, fs=1 / DT), worN=[2 * np.pi * frequency * DT])
    expected = abs(response[0]) ** 2 * sine
    assert np.abs(low_pass(sine, DT) - expected)[cut:-cut].max() < ENDS
    assert low_pass.amplitude(frequency, DT)[0] == pytest.approx(abs(response[0]) ** 2, rel=1e-9)


def test_half_the_amplitude_is_left_at_the_cutoff() -> None:
    assert ZeroPhase(20.0).amplitude(20.0, DT)[0] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("every", [1, 7, 24])
@pytest.mark.parametrize("cutoff", [6.0, 20.0, 60.0])
def test_every_nth_row_by_the_kernel_is_the_filter_away_from_the_ends(cutoff: float, every: int) -> None:
    low_pass = ZeroPhase(cutoff)
    rows = np.random.default_rng(1).normal(size=(1001, 2))  # seed 1
    cut, kernel = low_pass.end_rows(DT), low_pass.kernel(DT)
    assert np.array_equal(kernel, kernel[::-1]) and kernel.sum() == pytest.approx(1.0)
    found = low_pass.every(rows, DT, every)
    assert len(found) == len(range(cut, 1001 - cut, every))
    # the same weights by a matrix of shifted windows
    windows = np.lib.stride_tricks.sliding_window_view(rows, len(kernel), axis=0)
    assert np.allclose(found, (windows @ kernel)[::every], atol=1e-12)
    # the recursive filter's amplitude, but for its response beyond three periods of the cut-off
    frequency, shift = np.linspace(0.0, 124.0, 63), DT * np.arange(-cut, cut + 1)
    amplitude = np.cos(2 * np.pi * np.outer(frequency, shift)) @ kernel
    assert amplitude == pytest.approx(low_pass.amplitude(frequency, DT), abs=2 * ENDS)
    assert len(low_pass.every(rows[: 2 * cut], DT, every)) == 0


@pytest.mark.parametrize(("differences", "order"), [(derivative, 1), (second_derivative, 2)])
def test_differences_are_of_second_order(differences, order: int) -> None:
    errors = []
    for step in (0.02, 0.01, 0.005):
        t = np.arange(0, 2, step)
        exact = [np.cos(3 * t) * 3, -9 * np.sin(3 * t)][order - 1]
        inside = slice(1, -1)
        errors.append(np.abs(differences(np.sin(3 * t), step) - exact)[inside].max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.allclose(ratios, 4.0, rtol=0.02)  # (step / 2)^2; the next term is step^2 smaller


def test_a_parabola_is_differentiated_exactly_up_to_the_ends() -> None:
    t = 0.1 * np.arange(9)
    assert np.allclose(derivative(t**2, 0.1), 2 * t, atol=1e-13)
    assert np.allclose(second_derivative(np.column_stack([t**2, 3 * t]), 0.1), [2.0, 0.0], atol=1e-11)


def test_motion_filters_all_signals_alike_and_cuts_the_ends() -> None:
    low_pass = ZeroPhase(15.0)
    q = np.sin(2 * np.pi * 5 * TIME)
    done = motion(session(q, force=2 * q), "q", low_pass)
    assert done.names == ("q", "force", "der(q)", "der(q,2)")
    assert len(done) == len(TIME) - 2 * low_pass.end_rows(DT)
    assert done.unit("der(q)") == "m/s" and done.unit("der(q,2)") == "m/s2"
    assert np.allclose(done["force"], 2 * done["q"], atol=1e-12)
    assert done.synthetic == "no noise"
    turn = 2 * np.pi * 5
    # sin(turn dt) / (turn dt) is what central differences leave of the derivative: 1 - 0.0026
    assert np.abs(done["der(q)"] - turn * np.cos(turn * done.time) * low_pass.amplitude(5.0, DT)).max() < 0.005 * turn


def test_unfiltered_motion_loses_only_the_ends() -> None:
    done = motion(session(TIME**2), "q", None)
    assert len(done) == len(TIME) - 2 and np.allclose(done["der(q,2)"], 2.0, atol=1e-8)


def test_the_band_of_a_motion_sets_the_cutoff() -> None:
    q = np.sin(2 * np.pi * 1.0 * TIME) + 0.2 * np.sin(2 * np.pi * 4.0 * TIME)
    assert excitation_band(q, DT) == pytest.approx(4.0, abs=0.5)
    assert cutoff_for(q, DT) == pytest.approx(2.5 * excitation_band(q, DT))
    assert cutoff_for(np.sin(2 * np.pi * 60.0 * TIME), DT) == pytest.approx(100.0)  # 0.4 of the sampling rate


def test_the_band_does_not_depend_on_the_ends_or_on_the_noise() -> None:
    """Sums of sines up to 1.7 Hz, cut anywhere, with white noise from none to 1 % of the motion."""
    for seed in range(20):  # fixed beforehand
        rng = np.random.default_rng(seed)
        frequency, phase = np.append(rng.uniform(0.1, 1.7, 5), 1.7), rng.uniform(0, 2 * np.pi, 6)
        time = DT * np.arange(rng.integers(4000, 6000))
        q = np.sin(2 * np.pi * frequency * time[:, None] + phase).sum(axis=1)
        for noise in (0.0, 1e-4, 1e-2):
            band = excitation_band(q + noise * np.std(q) * rng.standard_normal(len(q)), DT)
            assert 1.5 < band < 3.3, (seed, noise, band)
    with pytest.raises(TrajectoryError, match="does not exceed the position noise"):
        excitation_band(rng.standard_normal(len(TIME)), DT)


def test_slow_rows_are_dropped_and_counted() -> None:
    velocity = np.sin(2 * np.pi * TIME / 8.0)
    found = moving(velocity, DT, step=0.5 * DT / 3)
    assert found.threshold == pytest.approx(0.5)
    # |sin| < 1/2 in a third of a period
    assert found.dropped == pytest.approx(1 / 3, abs=2e-3) and found.rows.sum() == round((1 - found.dropped) * 2000)
    both = moving(np.column_stack([velocity, np.ones_like(velocity)]), DT, step=0.5 * DT / 3)
    assert np.array_equal(both.rows, found.rows)


def test_decimation_keeps_every_nth_row() -> None:
    less = decimate(session(TIME).trajectory, 10)
    assert np.allclose(less["q"], TIME[::10], atol=0) and len(less) == 200


def test_refusals() -> None:
    for call, said in (
        (lambda: ZeroPhase(200.0)(TIME, DT), r"the cut-off is 200 Hz; expected between 0 and half .* 125 Hz"),
        (lambda: ZeroPhase(20.0)(TIME[:10], DT), r"there are 10 rows to filter; expected more than 15"),
        (lambda: derivative(TIME[:2], DT), r"there are 2 rows to differentiate"),
        (lambda: second_derivative(TIME[:2], DT), r"there are 2 rows to differentiate"),
        (lambda: excitation_band(np.ones(50), DT), r"nothing moves"),
        (lambda: motion(session(TIME), "q", ZeroPhase(0.5)), r"'made here' lasts 7.996 s; expected more than twice"),
        (lambda: decimate(session(TIME).trajectory, 0), r"every = 0 of 2000 rows"),
    ):
        with pytest.raises(TrajectoryError, match=said):
            call()
