"""The complementary filter of Dressler 2012, (7.17): the two parts add up, drift is taken out, motion is left."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering.family.complementary import complementary, twice_integrated
from gtmodel.results.refusal import ArgumentError

DT, COUNT = 0.004, 1500
T = DT * np.arange(COUNT)
CUTOFF = [4.50, 2.63]  # Hz, (7.18)


def signals(z_c: np.ndarray, a: np.ndarray) -> tuple[gt.Trajectory, gt.Trajectory]:
    return gt.Trajectory(T, {"z": z_c}, {"z": "m"}), gt.Trajectory(T, {"a": a}, {"a": "m/s2"})


def motion(frequency: float) -> tuple[np.ndarray, np.ndarray]:
    """1 cm along two axes and its acceleration, (K, 2)."""
    w, phase = 2 * np.pi * frequency, np.array([0.0, 1.0])
    z = 0.01 * np.sin(w * T[:, None] + phase)
    return z, -(w**2) * z


def test_what_both_signals_show_comes_out_as_it_is():
    z, _ = motion(3.0)
    # the acceleration whose exact double integral is known at the instants: of a motion with straight acceleration
    a = np.random.default_rng(0).normal(size=(COUNT, 2))
    moved = twice_integrated(a, DT) + 0.3 + T[:, None] * [0.2, -0.1]
    made = complementary(*signals(moved, a), CUTOFF)["z"]
    assert np.max(np.abs(made - moved)) < 1e-9 * np.abs(moved).max()
    assert z.shape == made.shape


@pytest.mark.parametrize("zero_phase", [True, False])
def test_the_frequency_response_is_that_of_butterworth(zero_phase):
    # the slow signal alone passes through G, away from the ends of the log
    z, _ = motion(5.0)
    z[:, 1] = z[:, 0]
    made = complementary(*signals(z, np.zeros_like(z)), CUTOFF, zero_phase=zero_phase)["z"]
    middle = slice(600, 600 + round(100 / 5.0 / DT / 100) * 10)  # ten periods
    wave = np.exp(-2j * np.pi * 5.0 * T[middle])
    for n, f in enumerate(CUTOFF):
        amplitude = abs(wave @ made[middle, n]) / abs(wave @ z[middle, n])
        ratio = np.tan(np.pi * 5.0 * DT) / np.tan(np.pi * f * DT)  # of the bilinear transform
        gain = 1 / np.sqrt(1 + ratio**4)
        assert amplitude == pytest.approx(gain**2 if zero_phase else gain, rel=2e-3)


def test_fast_motion_of_the_accelerometer_is_left_and_its_bias_is_not():
    # the motors see the slow motion only; the accelerometer both, with bias and noise (synthetic)
    slow, a_slow = motion(0.5)
    fast, a_fast = motion(14.0)
    rng = np.random.default_rng(1)
    a = a_slow + a_fast + 0.05 + rng.normal(size=fast.shape) * 0.07
    made = complementary(*signals(slow, a), CUTOFF)["z"]
    inside = slice(250, -250)
    off = np.sqrt(np.mean((made - slow - fast)[inside] ** 2))
    assert off < 0.05 * np.sqrt(np.mean(fast[inside] ** 2))


def test_refusals():
    z, a = motion(2.0)
    slow, felt = signals(z, a)
    with pytest.raises(ArgumentError, match="the times and the size of the slow signal"):
        complementary(slow, gt.Trajectory(T, {"a": a[:, 0]}, {"a": "m/s2"}), 2.0)
    with pytest.raises(ArgumentError, match="below 125 Hz"):
        complementary(slow, felt, 130.0)
    with pytest.raises(ArgumentError, match="one per component"):
        complementary(slow, felt, [1.0, 2.0, 3.0])
    uneven = T.copy()
    uneven[3] += 1e-3
    with pytest.raises(ArgumentError, match="even times"):
        complementary(gt.Trajectory(uneven, {"z": z}, {"z": "m"}), gt.Trajectory(uneven, {"a": a}, {"a": "m/s2"}), 2.0)
