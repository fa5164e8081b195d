"""Lifted maps against matrices written out by hand, and their adjoints."""

from __future__ import annotations

import control
import numpy as np
import pytest
import scipy

from gtmodel.control import learning
from gtmodel.control.learning.law import butterworth
from gtmodel.control.learning.lifted import SHORT
from gtmodel.results.refusal import ArgumentError
from tests.control.learning import by_hand

SAME = 1e-12  # of sums of some hundred products of order one
SIZES = [7, SHORT, 300]
B_Q, A_Q = scipy.signal.butter(2, 10.0, fs=250)
SOS = scipy.signal.butter(2, 10.0, fs=250, output="sos")


def maps(size: int) -> dict[str, tuple[learning.Lifted, np.ndarray]]:
    """Each map beside its matrix by hand."""
    b, a = learning.ACTUATORS[0]
    causal = by_hand.toeplitz(B_Q, A_Q, size)
    taps = np.array([0.5, 0.2, -0.1, 0.05])
    w = np.linspace(0.0, 1.0, size)
    return {
        "plant": (learning.lifted(learning.delayed_lag(b, a, 5), size), by_hand.actuator(b, a, size)),
        "shift": (learning.shifted(size, 0.9, 5), by_hand.shift(0.9, 5, size)),
        "causal": (learning.filtered(SOS, size), causal),
        "zero phase": (learning.zero_phase(SOS, size), causal.T @ causal),
        "taps": (
            learning.symmetric(taps, size),
            sum(
                t * (np.eye(size, k=j) + (np.eye(size, k=-j) if j else 0.0)) for j, t in enumerate(taps)
            ) + np.zeros((size, size)),
        ),
        "window": (learning.weighted(w), np.diag(w)),
        "sum": (2.0 * learning.identity(size) - learning.shifted(size, 0.9, 5),
                2.0 * np.eye(size) - by_hand.shift(0.9, 5, size)),
        "product": (learning.weighted(w) @ learning.zero_phase(SOS, size) @ learning.shifted(size, 0.9, 5),
                    np.diag(w) @ causal.T @ causal @ by_hand.shift(0.9, 5, size)),
    }  # fmt: skip


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", list(maps(7)))
def test_a_map_is_its_matrix_and_its_adjoint_the_transposed_one(name: str, size: int) -> None:
    made, matrix = maps(size)[name]
    assert np.abs(made.dense() - matrix).max() < SAME
    assert np.abs(made.adjoint.dense() - matrix.T).max() < SAME
    rng = np.random.default_rng(size)
    x, y = rng.normal(size=(2, size))
    assert abs(made(x) @ y - x @ made.adjoint(y)) < SAME * size
    assert np.abs(made(x) - matrix @ x).max() < SAME
    both = made.operator()
    assert np.abs(both.matvec(x) - matrix @ x).max() < SAME
    assert np.abs(both.rmatvec(y) - matrix.T @ y).max() < SAME


def test_forward_and_backward_is_not_filtfilt() -> None:
    # filtfilt pads the ends; in the middle both are the same filter
    x = np.random.default_rng(1).normal(size=800) + 1.0
    ours, padded = learning.zero_phase(SOS, 800)(x), scipy.signal.sosfiltfilt(SOS, x)
    assert np.abs(ours - padded)[300:500].max() < 1e-6
    assert np.abs(ours - padded)[[0, -1]].max() > 0.1


@pytest.mark.parametrize("states", [0, 1, 4])
def test_pulse_and_frequency_response_are_those_of_python_control(states: int) -> None:
    rng = np.random.default_rng(states)
    A = rng.normal(size=(states, states))
    A *= 0.95 / max(1e-9, np.abs(np.linalg.eigvals(A)).max(initial=0.0)) if states else 1.0
    B, C, D = rng.normal(size=(states, 1)), rng.normal(size=(1, states)), rng.normal(size=(1, 1))
    plant = control.StateSpace(A, B, C, D, 0.004)
    expected = [D[0, 0], *(float((C @ np.linalg.matrix_power(A, k) @ B)[0, 0]) for k in range(49))]
    assert np.abs(learning.pulse_response(plant, 50) - expected).max() < 1e-11
    f = np.linspace(0, 125, 40)
    assert np.abs(learning.frequency_response(plant, f) - plant(np.exp(2j * np.pi * f * 0.004))).max() < 1e-10
    one = learning.pulse_response(control.TransferFunction([0.1], [1.0, -0.9], 0.004), 4)
    assert np.abs(one - [0.0, 0.1, 0.09, 0.081]).max() < 1e-15


@pytest.mark.parametrize("delay", [0, 1, 5])
def test_a_delayed_lag_is_that_of_6_11(delay: int) -> None:
    b, a = learning.ACTUATORS[2]
    pulse = np.zeros(30)
    pulse[0] = 1.0
    expected = scipy.signal.lfilter([0.0] * delay + [b], [1.0, -a], pulse)
    assert np.abs(learning.pulse_response(learning.delayed_lag(b, a, delay), 30) - expected).max() < 1e-15


def test_refusals() -> None:
    lag = learning.delayed_lag(0.1, 0.9, 1)
    with pytest.raises(ArgumentError) as error:
        learning.stable(control.StateSpace([[1.001]], [[1.0]], [[1.0]], [[0.0]], 0.004))
    assert error.value.argument == "plant" and "1.001" in error.value.message
    assert learning.stable(lag) is lag
    with pytest.raises(ArgumentError, match="continuous time"):
        learning.lifted(control.StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), 10)
    with pytest.raises(ArgumentError, match="one input and one output"):
        learning.lifted(control.StateSpace(np.eye(2) / 2, np.eye(2), np.eye(2), np.zeros((2, 2)), 0.004), 10)
    with pytest.raises(ArgumentError, match="of 10 samples"):
        learning.identity(10)(np.zeros(9))
    with pytest.raises(ArgumentError, match="0 to 9"):
        learning.shifted(10, 1.0, 10)
    with pytest.raises(ArgumentError, match="delay: must not be negative"):
        learning.delayed_lag(0.1, 0.9, -1)
    with pytest.raises(ArgumentError, match="10 and 9 samples"):
        _ = learning.identity(10) @ learning.identity(9)
    with pytest.raises(ArgumentError, match="longer run"):
        learning.input_window(200)
    with pytest.raises(ArgumentError, match="below 125 Hz"):
        butterworth(130.0, 0.004)


def test_a_plant_that_grows_is_refused_where_transforms_would_hide_its_beginning() -> None:
    # 1.03^3000 = 1e38: the first samples of the answer were wrong by 1e22
    with pytest.raises(ArgumentError) as error:
        learning.lifted(learning.delayed_lag(0.1, 1.03, 5), 3000)
    assert error.value.argument == "plant" and "1.03" in error.value.message
    with pytest.raises(ArgumentError) as error:
        learning.rate(learning.simple_law(300, 0.9, 5, 10.0), learning.lifted(learning.delayed_lag(0.1, 1.01, 5), 300))
    assert error.value.argument == "plant"
    # an integrator stands on the circle
    x = np.sin(np.arange(500.0))
    assert np.abs(learning.lifted(learning.delayed_lag(1.0, 1.0, 1), 500)(x)[1:] - np.cumsum(x)[:-1]).max() < 1e-9
