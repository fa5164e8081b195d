"""Integration of rates on rotations: against closed forms, against another integrator, its derivatives by
differences."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gtmodel.filtering.attitude.gyro_path import RateCorrection, gyro_path, picked, turns
from gtmodel.geometry.rotations import left_jacobian

PLAIN = RateCorrection(np.eye(3), np.zeros(3))


def coning(t: np.ndarray) -> np.ndarray:
    return np.column_stack([3 * np.cos(4 * t), 3 * np.sin(4 * t), 1.0 + 0 * t])


def test_a_constant_rate_is_turned_exactly() -> None:
    time = np.linspace(0, 2, 41)
    rate = np.array([1.0, -2.0, 0.5])
    at = np.array([0.013, 0.5, 1.987])
    path = gyro_path(time, np.tile(rate, (41, 1)), at, PLAIN)
    expected = Rotation.from_rotvec(np.outer(at - at[0], rate))
    assert (path.turn.inv() * expected).magnitude().max() < 1e-14


def test_fourth_order_against_an_integrator() -> None:
    """A rate whose axis turns: the error falls with the fourth power of the step, down to the interpolation's second
    power, which straight rates between samples have; so the truth is driven by the same straight rates."""
    errors = []
    for n in (20, 40):
        time = np.linspace(0, 1, n + 1)
        read = coning(time)

        def rates(t: float, q: np.ndarray, time: np.ndarray = time, read: np.ndarray = read) -> np.ndarray:
            x, y, z = (np.interp(t, time, read[:, k]) for k in range(3))
            cross = np.array([[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]])
            return 0.5 * cross @ q

        q = np.array([0.0, 0.0, 0.0, 1.0])
        for a, b in pairwise(time):  # from kink to kink of the rate
            q = solve_ivp(rates, (a, b), q, rtol=1e-12, atol=1e-13).y[:, -1]
        path = gyro_path(time, read, np.array([0.0, 1.0]), PLAIN)
        errors.append((path.turn[1].inv() * Rotation.from_quat(q)).magnitude())
    assert errors[0] < 2e-5 and 12 < errors[0] / errors[1] < 20


def test_products_in_rounds_are_products_one_by_one() -> None:
    steps = Rotation.random(37, rng=np.random.default_rng(0))
    one, every = Rotation.identity(), [Rotation.identity()]
    for k in range(37):
        one = one * steps[k]
        every.append(one)
    assert (turns(steps).inv() * Rotation.concatenate(every)).magnitude().max() < 1e-13


def test_instants_between_samples_and_in_parts() -> None:
    time = np.sort(np.random.default_rng(1).uniform(0, 2, 200))
    at = np.linspace(0.1, 1.9, 12)
    whole = gyro_path(time, coning(time), at, PLAIN)
    joined = gyro_path(time, coning(time), np.sort([*at, *(at[:-1] + 0.03)]), PLAIN)
    assert (picked(joined.turn, slice(None, None, 2)).inv() * whole.turn).magnitude().max() < 1e-6
    assert whole.rate == pytest.approx(coning(at), abs=2e-2)


def test_derivatives_by_differences() -> None:
    time = np.linspace(0, 2, 201)
    x = np.array([1.02, 0.03, -0.01, 0.02, 0.97, 0.04, 0.01, -0.05, 1.01, 0.02, -0.03, 0.01, 0.0031])
    at = np.array([0.1, 0.55, 1.2, 1.83])
    path = gyro_path(time, coning(time), at, RateCorrection.of(x), derivative=True)
    assert path.derivative is not None
    for k in range(13):
        h = np.zeros(13)
        h[k] = 1e-6
        up, down = (gyro_path(time, coning(time), at, RateCorrection.of(x + s * h)).turn for s in (1, -1))
        difference = ((up * path.turn.inv()).as_rotvec() - (down * path.turn.inv()).as_rotvec()) / 2e-6
        np.testing.assert_allclose(path.derivative[:, :, k], difference, atol=2e-6 if k == 12 else 1e-8)
    np.testing.assert_array_equal(RateCorrection.of(x).numbers, x)


@pytest.mark.parametrize("size", [1e-6, 9e-3, 1.1e-2, 2.0])
def test_left_jacobian(size: float) -> None:
    v = size * np.array([[0.6, -0.48, 0.64]])
    for k in range(3):
        h = 1e-6 * np.eye(3)[k]
        up, down = (Rotation.from_rotvec(v[0] + s * h) * Rotation.from_rotvec(-v[0]) for s in (1, -1))
        np.testing.assert_allclose(left_jacobian(v)[0][:, k], (up.as_rotvec() - down.as_rotvec()) / 2e-6, atol=1e-9)
