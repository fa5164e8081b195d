"""Milling forces: closed form for straight teeth, impulse, antisymmetry, classical averages, and order in discs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.milling import (
    Cut,
    Cutter,
    CuttingCoefficients,
    at_angles,
    force_spectrum,
    forces,
    immersion,
    integrated_forces,
    peak_force,
    smooth_force_function,
    to_world,
)
from tests.milling.thesis import CUT, CUTTER, C, K, X, Y

EXACT = 1e-10  # the bound, relative to the largest force
ROUNDING = 1e-12  # relative; sums of a hundred terms
# Simpson or midpoint sums over gates that open within one step: first order in the step
TURN = np.linspace(0, 2 * np.pi, 100_001)[:-1] + np.pi / 100_000
STRAIGHT = Cutter(CUTTER.diameter, 1, K)
EDGE = replace(K, K_tc=0.0, K_rc=0.0, K_ac=0.0)


def impulse(cutter: Cutter, cut: Cut) -> np.ndarray:
    """Integral over a turn of the spindle, per tooth [N.rad]."""
    return integrated_forces(cutter, cut, TURN).mean(axis=0) * 2 * np.pi / cutter.teeth


@pytest.mark.parametrize("mode", ["climb", "up", "slot"])
def test_one_straight_tooth_by_hand(mode) -> None:
    cut = replace(CUT, mode=mode)
    phi = np.linspace(0.0013, 2 * np.pi, 500, endpoint=False)
    start, end = immersion(mode, cut.radial_depth, CUTTER.diameter)
    h = np.where((phi >= start) & (phi <= end), cut.feed_per_tooth * np.sin(phi), np.nan)
    t, r, a = (cut.axial_depth * (e + c * h) for e, c in ((K.K_te, K.K_tc), (K.K_re, K.K_rc), (K.K_ae, K.K_ac)))
    expected = np.nan_to_num([-t * np.cos(phi) - r * np.sin(phi), t * np.sin(phi) - r * np.cos(phi), a]).T
    for found in (forces(STRAIGHT, cut, phi, discs=7), integrated_forces(STRAIGHT, cut, phi)):
        assert np.abs(found - expected).max() < EXACT * np.abs(expected).max()


@pytest.mark.parametrize("mode", ["climb", "up", "slot"])
def test_discs_converge_to_the_closed_form_in_the_mean_and_at_the_peak(mode) -> None:
    cut = replace(CUT, mode=mode)
    phi = np.linspace(0, 2 * np.pi, 997)
    exact = integrated_forces(CUTTER, cut, phi)
    errors = [np.abs(forces(CUTTER, cut, phi, n) - exact).max() / np.abs(exact).max() for n in (25, 50, 100, 200)]
    # where a tooth enters or leaves, the disc that it is in counts whole or not at all: first order
    assert np.all(np.array(errors) * [25, 50, 100, 200] < 0.75) and errors[-1] < 0.5 * errors[1]
    assert np.median(np.abs(forces(CUTTER, cut, phi, 100) - exact).max(axis=1)) < 0.002 * np.abs(exact).max()
    # within one engagement the midpoint rule is of second order
    inside = [np.pi - 0.5 if mode == "climb" else 0.5]
    deep = integrated_forces(CUTTER, cut, inside)
    second = [np.abs(forces(CUTTER, cut, inside, n) - deep).max() for n in (10, 20, 40)]
    assert np.allclose(np.array(second[:2]) / second[1:], 4, rtol=0.01)


@given(helix=st.floats(0, 1.4), depth=st.floats(1e-4, 0.03), teeth=st.integers(1, 5))
@settings(max_examples=15, deadline=None)
def test_impulse_per_tooth_does_not_depend_on_the_helix(helix, depth, teeth) -> None:
    cut = replace(CUT, axial_depth=depth)
    straight = force_spectrum(Cutter(CUTTER.diameter, 1, K), cut, 0)[0].real
    twisted = integrated_forces(Cutter(CUTTER.diameter, teeth, K, helix), cut, TURN[::10]).mean(axis=0) / teeth
    # a sum over 10^4 angles of a force whose gate opens within one of them
    np.testing.assert_allclose(twisted, straight, atol=3e-4 * np.abs(straight).max() * 2 * np.pi)


def test_helix_zero_is_the_limit_of_small_helices() -> None:
    phi = np.linspace(0.1, 6.2, 300)
    F = [integrated_forces(replace(CUTTER, helix=h), CUT, phi) for h in (0.0, 1e-9, 1e-6)]
    for h, twisted in zip((1e-9, 1e-6), F[1:], strict=True):
        # half the lag times the slope, which is at most about three peaks per radian
        lag = replace(CUTTER, helix=h).lag(CUT.axial_depth)
        assert 0 < np.abs(twisted - F[0]).max() < 1.5 * lag * np.abs(F[0]).max() + ROUNDING


@pytest.mark.parametrize("part", ["tangential", "radial"])
def test_up_against_climb_straight_teeth(part) -> None:
    k = replace(K, K_re=0.0, K_rc=0.0) if part == "tangential" else replace(K, K_te=0.0, K_tc=0.0)
    cutter = Cutter(CUTTER.diameter, 1, k)
    phi = np.linspace(0, np.pi, 777)
    up = integrated_forces(cutter, replace(CUT, mode="up"), phi)
    climb = integrated_forces(cutter, CUT, np.pi - phi)
    signs = [-1, 1, 1] if part == "tangential" else [1, -1, 1]
    inside = np.abs(phi - immersion("up", CUT.radial_depth, CUTTER.diameter)[1]) > 1e-9  # on the gate itself: rounding
    np.testing.assert_allclose(climb[inside], (up * signs)[inside], atol=ROUNDING * np.abs(up).max())
    assert np.abs(up[:, :2]).max(axis=0).min() > 0  # the signs are of numbers that are not zero


def test_slotting_averages_by_the_classical_integrals() -> None:
    cut = replace(CUT, mode="slot")
    N, a, f = CUTTER.teeth, cut.axial_depth, cut.feed_per_tooth
    # mean over a turn of sin, cos, sin^2, sin cos on 0..pi times N a
    expected = N * a * np.array([
        -K.K_re / np.pi - K.K_rc * f / 4, K.K_te / np.pi + K.K_tc * f / 4, K.K_ae / 2 + K.K_ac * f / np.pi
    ])  # fmt: skip
    np.testing.assert_allclose(force_spectrum(CUTTER, cut, 0)[0].real, expected, rtol=ROUNDING)
    np.testing.assert_allclose(integrated_forces(CUTTER, cut, TURN).mean(axis=0), expected, rtol=1e-6)


def test_spectrum_against_a_discrete_fourier_transform() -> None:
    odd = replace(CUTTER, tooth_angles=np.array([0.0, 2.9]), runout=np.array([4e-5, -2e-5]))
    n = 4096
    for cutter in (CUTTER, odd):
        F = integrated_forces(cutter, CUT, 2 * np.pi * np.arange(n) / n)
        by_fft = np.fft.rfft(F, axis=0)[:41] / n
        closed = force_spectrum(cutter, CUT, 40)
        # aliasing of a force with kinks: order n^-2
        assert np.abs(by_fft - closed).max() < 1e-4 * np.abs(closed).max()
    assert np.abs(force_spectrum(CUTTER, CUT, 9)[1::2]).max() < ROUNDING * np.abs(F).max()
    assert np.abs(closed[1]).max() > 1.0  # N: runout and pitch bring back the spindle's own frequency
    series = at_angles(force_spectrum(CUTTER, CUT, 2000), TURN[::997])
    assert np.abs(series - integrated_forces(CUTTER, CUT, TURN[::997])).max() < 2e-3 * np.abs(F).max()


def test_pitch_and_runout_share_the_feed() -> None:
    odd = replace(CUTTER, tooth_angles=np.array([0.0, 2.9]), runout=np.array([4e-5, -2e-5]), helix=0.3)
    phi = np.linspace(0, 2 * np.pi, 600)
    assert np.abs(forces(odd, CUT, phi, 400) - integrated_forces(odd, CUT, phi)).max() < 4e-3 * 2000
    slot = replace(CUT, mode="slot")
    no_edge = replace(odd, coefficients=replace(K, K_te=0.0, K_re=0.0, K_ae=0.0))
    even = replace(no_edge, tooth_angles=None, runout=None)
    mild = replace(no_edge, runout=np.array([1e-9, 0.0]))
    # what one tooth takes more the other takes less
    np.testing.assert_allclose(force_spectrum(mild, slot, 0)[0].real, force_spectrum(even, slot, 0)[0].real, rtol=1e-5)


def test_smooth_gate_comes_to_the_exact_one_and_has_derivatives() -> None:
    phi = np.linspace(0.05, 6.2, 150)
    exact = integrated_forces(CUTTER, CUT, phi)
    args = (CUT.radial_depth, CUT.axial_depth, CUT.feed_per_tooth)
    errors = []
    for width in (0.04, 0.02, 0.01):
        f = smooth_force_function(CUTTER, "climb", width=width)
        F = np.array(f.map(len(phi))(phi, *args)).T
        errors.append(np.abs(F - exact).mean() / np.abs(exact).max())
    assert errors[2] < 0.01 and errors[0] > 1.5 * errors[1] > 2 * errors[2]
    jacobian = f.factory("J", ["phi", "a_e", "a_p", "f_t"], ["jac:F:a_e", "jac:F:a_p", "jac:F:f_t"])
    for i, J in enumerate(jacobian(2.4, *args)):
        step = np.zeros(3)
        step[i] = 1e-6 * args[i]
        low, high = (np.array(f(2.4, *(args + s * step))).ravel() for s in (-1, 1))
        np.testing.assert_allclose(np.array(J).ravel(), (high - low) / (2 * step[i]), rtol=1e-6)


def test_peak_and_directions() -> None:
    F = peak_force(CUTTER, CUT)
    assert np.linalg.norm(F) == pytest.approx(
        np.linalg.norm(integrated_forces(CUTTER, CUT, TURN), axis=1).max(), rel=1e-4
    )
    np.testing.assert_allclose(to_world(F, X), F)
    np.testing.assert_allclose(to_world(F, Y), [-F[1], F[0], F[2]])
    assert np.linalg.norm(to_world(F, [1, 2, 0], [0, 0, 3])) == pytest.approx(np.linalg.norm(F))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: immersion("up", 0.03, 0.0254), "radial depth 0.03 m is more than the diameter 0.0254 m"),
        (lambda: replace(CUT, feed_per_tooth=-1e-4), "feed_per_tooth: must be more than 0; found -0.0001"),
        (lambda: replace(CUT, mode="down"), "mode: expected one of climb, up, slot; found 'down'"),
        (lambda: Cutter(0.0, 2, K), "diameter: must be more than 0"),
        (lambda: Cutter(0.02, 0, K), "teeth: must be at least 1"),
        (lambda: Cutter(0.02, 2, K, helix=2.0), "helix: must be at least 0 and less than 1.5708; found 2"),
        (lambda: Cutter(0.02, 2, K, tooth_angles=np.array([0.0, 7.0])), "tooth_angles: must rise"),
        (lambda: Cutter(0.02, 2, K, runout=np.zeros(3)), r"runout: has the shape \(3,\); expected 2"),
        (lambda: CuttingCoefficients(*[np.nan] * 6), "K_te: expected finite numbers"),
        (lambda: to_world([1.0, 0, 0], [0, 0, 1.0]), "tool axis"),
        (lambda: to_world([1.0, 0, 0], [0, 0, 0.0]), "must not be zero"),
        (lambda: forces(CUTTER, CUT, 0.0, discs=0), "0 discs"),
        (lambda: force_spectrum(CUTTER, CUT, -1), "-1 harmonics"),
        (lambda: smooth_force_function(CUTTER, "down"), "expected one of"),
        (lambda: smooth_force_function(replace(CUTTER, runout=np.array([1e-5, 0])), "up"), "runout"),
    ],
)  # fmt: skip
def test_wrong_inputs(make, sentence) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


def test_the_printed_lag() -> None:
    assert CUTTER.lag(C["axial_depth_m"]) == pytest.approx(0.4 * np.tan(np.pi / 6))


@pytest.mark.parametrize("name", ["K_tc", "K_te"])
def test_a_tooth_that_is_driven_by_its_chip_is_refused(name) -> None:
    with pytest.raises(ValueError, match=f"{name}: must be at least 0; found -1"):
        replace(CUTTER, coefficients=replace(K, **{name: -1.0}))
