"""Chatter: lobes against semi-discretisation, that against a simulation with regeneration; mode coupling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from gtmodel.milling import (
    Cut,
    Cutter,
    Oscillators,
    certain_depth,
    critical_depth,
    mean_directional_matrix,
    mode_coupling,
    spectral_radius,
    stability_lobes,
    stable_depth,
)  # fmt: skip
from gtmodel.milling.forces import directional_matrix
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS, TOOTH_HZ, K, X, Y

# the two-tooth example that the literature on lobes shares: 922 Hz, 1.1 % damping, 39.93 g, 600 and 200 N/mm2
SHARED = replace(K, K_tc=6e8, K_rc=2e8, K_te=0.0, K_re=0.0, K_ae=0.0, K_ac=0.0)
EXAMPLE = Cutter(0.02, 2, SHARED)
W = 2 * np.pi * 922.0
M = np.full((1, 3), 0.03993)
STIFF = Oscillators.with_damping_ratio(M, M * W**2 * [1.0, 1.0, 1e4], np.full((1, 3), 0.011))
MEAN_IS_GOOD = 0.05  # of the zeroth order, where four teeth keep the mean matrix nearly constant


def test_mean_directional_matrix_is_the_mean() -> None:
    phi = 2 * np.pi * (np.arange(20000) + 0.5) / 20000
    for mode, depth in (("climb", 0.00635), ("up", 0.004), ("slot", 1.0)):
        start, end = {"climb": (np.pi - np.arccos(0.5), np.pi), "up": (0, np.arccos(1 - 0.004 / 0.0127)),
                      "slot": (0, np.pi)}[mode]  # fmt: skip
        numeric = CUTTER.teeth * directional_matrix(CUTTER, phi, start, end).mean(axis=0)
        closed = mean_directional_matrix(CUTTER, mode, depth)
        np.testing.assert_allclose(numeric, closed, atol=2e-4 * np.abs(closed).max())


def test_lobes_against_semi_discretisation() -> None:
    four = replace(EXAMPLE, teeth=4)
    slot = Cut("slot", 0.02, 1e-3, 1e-4)
    lobes = stability_lobes(STIFF, four, "slot", 0.02, X)
    speeds = np.array([60.0, 85.0, 130.0])
    for speed, depth in zip(speeds, lobes.depth_at(speeds), strict=True):
        found = stable_depth(STIFF, four, slot, speed, X, low=depth / 3, high=3 * depth)
        assert found == pytest.approx(depth, rel=MEAN_IS_GOOD)
    # the least depth of all lobes, in closed form for two equal modes: no speed goes below
    floor = lobes.depth[lobes.lobe > 0].min()
    assert np.all(lobes.zeroth_order_at(np.linspace(30, 200, 50)) >= 0.999 * floor)


def test_lobes_of_one_mode_by_tlusty() -> None:
    # one flexible direction: a_lim = -1 / (2 D min Re H), the classical limit at any speed
    rigid = Oscillators.with_damping_ratio(M, M * W**2 * [1.0, 1e8, 1e8], np.full((1, 3), 0.011))
    D = mean_directional_matrix(EXAMPLE, "up", 0.01)[0, 0]
    lobes = stability_lobes(rigid, EXAMPLE, "up", 0.01, X)
    w = W * np.linspace(0.8, 1.2, 400_001)
    H = rigid.receptance(w)[0, :, 0].real
    limit = min(x for x in (1 / (2 * D * H.min()), 1 / (2 * D * H.max())) if x > 0)
    assert lobes.depth.min() == pytest.approx(limit, rel=1e-4)


def test_semi_discretisation_converges_and_shows_what_the_mean_cannot() -> None:
    cut = Cut("up", 0.002, 2e-3, 1e-4)  # a narrow cut: period doubling
    radii = [spectral_radius(STIFF, EXAMPLE, cut, 300.0, X, intervals=n) for n in (40, 80, 160)]
    assert abs(radii[2] - radii[1]) < 0.6 * abs(radii[1] - radii[0]) + 1e-4
    # a depth of nothing leaves free vibration: exp(-zeta w T) of the least damped mode
    free = spectral_radius(STIFF, EXAMPLE, replace(cut, axial_depth=1e-12), 300.0, X)
    assert free == pytest.approx(np.exp(-0.011 * W / 600.0), rel=1e-6)


@pytest.mark.parametrize("row", [0, 8])
def test_growth_in_a_simulation_with_regeneration(row) -> None:
    """Free motion of the delayed equations, stepwise by the matrix exponential, grows by the spectral radius."""
    o, speed = OSCILLATORS[row], TOOTH_HZ[row] / 2
    cutter = replace(CUTTER, helix=0.0)
    n, teeth = 240, 150
    step = 1 / (2 * speed) / n
    start = np.pi - np.arccos(1 - 2 * CUT.radial_depth / CUTTER.diameter)
    phi = np.pi * (np.arange(n) + 0.5) / n
    D = sum(directional_matrix(cutter, phi + k * np.pi, start, np.pi) for k in range(2)) * CUT.axial_depth
    A = np.zeros((9, 9))
    A[:3, 3:6] = np.eye(3)
    A[3:6, :3], A[3:6, 3:6], A[3:6, 6:] = -np.diag(o.k[0] / o.m[0]), -np.diag(o.c[0] / o.m[0]), np.diag(1 / o.m[0])
    E = expm(A * step)
    x = np.zeros((n * teeth + 1, 3))
    x[: n + 1, :2] = [1e-6, 1e-6]
    state = np.zeros(6)
    state[:3] = x[n]
    for i in range(n, n * teeth):
        F = np.zeros(3)
        F[:2] = D[i % n] @ (x[i] - x[i - n])[:2]
        state = E[:6, :6] @ state + E[:6, 6:] @ F
        x[i + 1] = state[:3]
    size = np.array([np.abs(x[i * n : (i + 1) * n, :2]).max() for i in range(teeth)])
    growth = (size[-1] / size[50]) ** (1 / (teeth - 51))
    # explicit in the force, 240 steps a tooth
    assert growth == pytest.approx(spectral_radius(o, cutter, CUT, speed, X, intervals=120), rel=0.01)


def test_the_printed_tests_along_x() -> None:
    """What the linear model says of the poses: only tests 9 and 10, the ones whose deflection nobody predicts, grow."""
    radius = [spectral_radius(OSCILLATORS[i], CUTTER, CUT, TOOTH_HZ[i] / 2, X) for i in range(10)]
    coupled = [critical_depth(OSCILLATORS[i], CUTTER, CUT, X) for i in range(10)]
    assert np.all(np.array(radius[:8]) < 1) and min(radius[8:]) > 1.2
    assert min(coupled[:8]) > 3 * CUT.axial_depth and max(coupled[8:]) < CUT.axial_depth


def test_critical_depth_of_two_equal_modes_by_hand() -> None:
    # equal m, c, k in the plane: eigenvalues of D decouple the modes; with complex ones s = j w grows from c w = a Im
    m, c, k = np.full((1, 3), 100.0), np.full((1, 3), 2000.0), np.full((1, 3), 2e6)
    o = Oscillators(m, c, k)
    D = mean_directional_matrix(CUTTER, CUT.mode, CUT.radial_depth)
    values = np.linalg.eigvals(D)
    limits = []
    for value in values:
        if abs(value.imag) > 0:  # m s^2 + c s + k - a value = 0 at s = j w: c w = a Im, k - m w^2 = a Re
            a = np.roots([value.imag**2 * 100.0, value.real * 2000.0**2, -2e6 * 2000.0**2])
            limits.append(min(x.real for x in a if abs(x.imag) < 1e-12 and x.real > 0))
        elif value.real > 0:
            limits.append(2e6 / value.real)  # divergence
    assert critical_depth(o, CUTTER, CUT, X) == pytest.approx(min(limits), rel=1e-6)
    found = mode_coupling(o, CUTTER, replace(CUT, axial_depth=1e-3), X)
    assert found.warn and found.apart == 0 and found.pair == (0, 1) and "mode coupling is possible" in found.message


def test_words_of_mode_coupling() -> None:
    far, near = mode_coupling(OSCILLATORS[0], CUTTER, CUT, X), mode_coupling(OSCILLATORS[8], CUTTER, CUT, X)
    assert (
        not far.warn and far.message.startswith("no sign of mode coupling") and "at no depth below 1 m" in far.message
    )
    assert near.warn and "mode-coupling chatter is expected" in near.message
    assert mode_coupling(OSCILLATORS[0], CUTTER, CUT, Y).angle != pytest.approx(far.angle)
    with pytest.raises(ValueError, match="expected a stable depth and an unstable one"):
        stable_depth(OSCILLATORS[0], CUTTER, CUT, 30.0, X, low=1e-6, high=2e-6)
    with pytest.raises(ValueError, match="the spindle speed is -60 rpm"):
        spectral_radius(OSCILLATORS[0], CUTTER, CUT, -1.0, X)


def test_slow_speeds_need_more_lobes_than_there_are() -> None:
    # few lobes answer as many do, or below: never "no limit"
    speeds = np.array([8.0, 20.0])
    few, many = (stability_lobes(STIFF, EXAMPLE, "slot", 0.02, X, lobes=n, frequencies=np.linspace(700, 2500, 1500))
                 for n in (5, 160))  # fmt: skip
    true, found = many.zeroth_order_at(speeds), few.zeroth_order_at(speeds)
    assert np.all(np.isfinite(true)) and np.all(found <= 1.001 * true)
    assert found[0] == pytest.approx(few.depth.min(), rel=1e-3)
    # so slow that the spectral radius proves nothing: what holds at every speed
    assert few.depth_at([2.0])[0] == certain_depth(STIFF, EXAMPLE, "slot", 0.02, X) < found[0]


def test_slow_spindles_get_the_nodes_that_their_modes_need() -> None:
    # test 1 at 120 rpm: the mode at 58 Hz swings 15 times from tooth to tooth; 60 intervals call it stable at 10 mm
    slow, o = replace(CUT, axial_depth=0.01), OSCILLATORS[:1]
    few, own, fine = (spectral_radius(o, CUTTER, slow, 1.0, X, intervals=n) for n in (60, None, 800))
    assert few < 1.0 < own == pytest.approx(fine, rel=0.1)
    with pytest.raises(ValueError, match="least depth"):
        spectral_radius(o, CUTTER, CUT, 0.1, X)
