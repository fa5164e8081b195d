"""Sampled forces carry the whole impulse; chips under runout are those of the surface that teeth leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.milling import (
    Cut,
    Cutter,
    Oscillators,
    cutting_force,
    deflections,
    force_spectrum,
    forces,
    integrated_forces,
    peak_force,
    to_world,
)  # fmt: skip
from gtmodel.milling.cutter import teeth_in_cut
from gtmodel.milling.forces import mean_forces
from tests.milling.thesis import CUT, CUTTER, K, X

THIN = replace(CUT, radial_depth=2e-6)  # m: a tooth cuts for 0.03 rad, less than a sample at 20 kHz and 6000 rpm
MEAN = 1e-6  # relative, of a mean force over a whole turn
SOFT = Oscillators.with_damping_ratio(np.full((1, 3), 100.0), np.full((1, 3), 2e4), np.full((1, 3), 0.5))


@pytest.mark.parametrize("helix", [0.0, 1e-7, 1e-4, 0.02, 0.5, 1.3])
@pytest.mark.parametrize("cut", [CUT, THIN, replace(CUT, mode="slot"), replace(CUT, mode="up", radial_depth=1e-3)])
def test_mean_over_a_sample_is_the_integral_by_quadrature(cut, helix) -> None:
    odd = replace(CUTTER, helix=helix, tooth_angles=np.array([0.0, 2.9]), runout=np.array([4e-5, -2e-5]))
    width = 2 * np.pi / 30
    phi = np.linspace(0, 2 * np.pi, 30, endpoint=False) + 0.003
    fine = (np.arange(4000) + 0.5) / 4000 - 0.5
    sums = integrated_forces(odd, cut, (phi[:, None] + fine * width).ravel()).reshape(30, 4000, 3).mean(axis=1)
    # a gate opens within one of 4000 parts
    peak = np.abs(peak_force(odd, cut)).max()
    assert np.abs(mean_forces(odd, cut, phi, width) - sums).max() < 1e-3 * peak
    # and together they are the mean of a turn
    mean = force_spectrum(odd, cut, 0)[0].real
    found = mean_forces(odd, cut, phi, width).mean(axis=0)
    np.testing.assert_allclose(found, mean, atol=MEAN * np.abs(mean).max())


@pytest.mark.parametrize("speed", [17.0, 31.7, 90.3, 100.0, 143.0])
def test_mean_deflection_of_straight_teeth_in_a_thin_cut_is_mean_force_over_stiffness(speed) -> None:
    straight = replace(CUTTER, helix=0.0)
    F, _ = cutting_force(straight, THIN, speed, X, seconds=4 / speed)
    mean = to_world(force_spectrum(straight, THIN, 0)[0].real, X)
    np.testing.assert_allclose(F[:-1].mean(axis=0), mean, atol=MEAN * np.abs(mean).max())
    # well above the modes the tool stands still under the mean force
    found = deflections(SOFT, straight, THIN, speed, X)
    assert found.mean[0] == pytest.approx(np.linalg.norm(mean / SOFT.k[0]), rel=0.02)


def test_averages_keep_the_second_order() -> None:
    """Against the exact periodic state the error falls with the square of the step."""
    straight, speed = replace(CUTTER, helix=0.0), 31.7
    peaks = [deflections(SOFT, straight, THIN, speed, X, rate=r).steady_peak[0] for r in (20e3, 40e3, 640e3)]
    assert abs(peaks[1] - peaks[2]) < 0.3 * abs(peaks[0] - peaks[2]) + 1e-4 * peaks[2]


def surface_chips(cutter: Cutter, cut: Cut, phi: np.ndarray) -> np.ndarray:
    """(teeth, n) chip of each tooth at its angle phi [m], by the surface that all passes of three turns leave."""
    out = np.zeros(cutter.teeth) if cutter.runout is None else cutter.runout
    found = np.empty((cutter.teeth, len(phi)))
    for tooth in range(cutter.teeth):
        surface = np.full(len(phi), -np.inf)
        for turn in range(3):
            for other in range(cutter.teeth):
                # spindle angle since the other tooth stood where this one stands
                ago = 2 * np.pi * turn + cutter.angles[other] - cutter.angles[tooth]
                if ago > 1e-12:
                    moved = cut.feed_per_tooth * cutter.teeth * ago / (2 * np.pi)
                    surface = np.maximum(surface, out[other] - moved * np.sin(phi))
        found[tooth] = np.maximum(out[tooth] - surface, 0)
    return found


def test_a_tooth_that_does_not_cut_leaves_its_chip() -> None:
    cut = Cut("slot", 0.02, 1e-3, 50e-6)
    two = Cutter(0.02, 2, K, runout=np.array([200e-6, 0.0]))
    rows = teeth_in_cut(two, cut)
    assert len(rows.start) == 1 and rows.feed[0] + rows.offset[0] == pytest.approx(100e-6)
    # it is a cutter of one tooth at twice the feed
    one = Cutter(0.02, 1, K)
    phi = np.linspace(0, 2 * np.pi, 501)
    double = replace(cut, feed_per_tooth=100e-6)
    np.testing.assert_allclose(integrated_forces(two, cut, phi), integrated_forces(one, double, phi), atol=1e-9)
    np.testing.assert_allclose(force_spectrum(two, cut), force_spectrum(one, double), atol=1e-9)


def test_chips_are_those_of_the_surface_that_is_left() -> None:
    rng = np.random.default_rng(22)
    for _ in range(25):
        teeth = int(rng.integers(1, 7))
        angles = np.sort(rng.uniform(0, 2 * np.pi, teeth)) if rng.integers(2) else None
        cutter = Cutter(0.02, teeth, replace(K, K_te=0.0, K_re=0.0, K_ae=0.0), tooth_angles=angles,
                        runout=rng.choice([1e-6, 2e-5, 3e-4]) * rng.normal(size=teeth))  # fmt: skip
        cut = Cut(("slot", "climb", "up")[rng.integers(3)], 0.004, 1e-3, 5e-5)
        rows = teeth_in_cut(cutter, cut)
        phi = np.linspace(0, np.pi, 313)[1:-1]
        found = np.zeros((teeth, len(phi)))
        for angle, start, end, feed, offset in zip(*rows, strict=True):
            tooth = int(np.argmin(np.abs(cutter.angles - angle)))
            found[tooth] += np.where((phi >= start) & (phi <= end), feed * np.sin(phi) + offset, 0)
        ends = {"slot": (0, np.pi), "climb": (np.pi - np.arccos(0.6), np.pi), "up": (0, np.arccos(0.6))}[cut.mode]
        expected = np.where((phi >= ends[0]) & (phi <= ends[1]), surface_chips(cutter, cut, phi), 0)
        np.testing.assert_allclose(found, expected, atol=1e-12)
        # what the teeth take together is the feed of a turn
        np.testing.assert_allclose(
            expected.sum(axis=0), np.where(expected.any(axis=0), teeth * 5e-5 * np.sin(phi), 0), atol=1e-12
        )
        turned = np.linspace(0, 2 * np.pi, 97) + 1e-3
        np.testing.assert_allclose(forces(cutter, cut, turned), integrated_forces(cutter, cut, turned), atol=1e-9)


def test_the_peak_of_straight_teeth_is_where_they_leave() -> None:
    for mode, at in (("up", np.arccos(0.5)), ("climb", np.pi - np.arccos(0.5))):
        straight = replace(CUTTER, helix=0.0)
        F = integrated_forces(straight, replace(CUT, mode=mode), [at - 1e-8, at + 1e-8])
        best = np.linalg.norm(F, axis=1).max()
        assert np.linalg.norm(peak_force(straight, replace(CUT, mode=mode))) == pytest.approx(best, rel=1e-6)
