"""Stable depths are never above what the delayed equations prove: drawn structures, three roads to the radius."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.milling import (
    Cut,
    Cutter,
    CuttingCoefficients,
    Oscillators,
    certain_depth,
    spectral_radius,
    stability_lobes,
)
from gtmodel.milling.forces import directional_matrix, plane
from gtmodel.milling.stability import multipliers, proven_depth

K = CuttingCoefficients(20e3, 600e6, 15e3, 200e6, 2e3, 100e6)
OVER = 1.01  # of a depth, the bound
SEMI = 120  # intervals of a tooth period: some 0.5 % of depth in the drawn range


def drawn(rng: np.random.Generator, number: int) -> tuple[Oscillators, Cutter, str, float, float, list[float]]:
    """A structure, cutter, mode, radial depth, speed [1/s] and feed; every third structure has two close modes."""
    f = rng.uniform(250, 900, (1, 3))
    if number % 3 == 0:
        f[0, 1] = f[0, 0] * rng.uniform(0.93, 1.07)
    m, zeta = rng.uniform(0.5, 3, (1, 3)), rng.uniform(0.005, 0.05, (1, 3))
    turn = rng.uniform(0, 2 * np.pi)
    cutter = Cutter(0.02, int(rng.choice([1, 2, 3, 6])), K, np.deg2rad(rng.choice([0.0, 0.0, 30.0, 45.0])))
    mode, radial = ("slot", "climb", "up")[rng.integers(3)], 0.02 * float(rng.choice([0.02, 0.1, 0.5, 0.9]))
    o = Oscillators.with_damping_ratio(m, m * (2 * np.pi * f) ** 2, zeta)
    return o, cutter, mode, radial, rng.uniform(2000, 12000) / 60, [np.cos(turn), np.sin(turn), 0.0]


@pytest.mark.parametrize(("seed", "draws"), [(15, 12), pytest.param(16, 60, marks=pytest.mark.proof)])
def test_the_limit_is_never_above_what_is_proven(seed: int, draws: int) -> None:
    rng = np.random.default_rng(seed)
    for number in range(draws):
        o, cutter, mode, radial, speed, feed = drawn(rng, number)
        lobes = stability_lobes(o, cutter, mode, radial, feed)
        depth, mean = (float(x[0]) for x in (lobes.depth_at([speed]), lobes.zeroth_order_at([speed])))
        case = f"draw {number}: {cutter.teeth} teeth, {mode}, {1e3 * radial:g} mm, depth {1e3 * depth:.3g} mm"
        assert certain_depth(o, cutter, mode, radial, feed) <= depth <= mean, case
        at = Cut(mode, radial, min(depth, 1.0), 1e-4)
        shallow = [replace(at, axial_depth=x * at.axial_depth) for x in np.linspace(0.1, 1, 10)]
        assert max(spectral_radius(o, cutter, cut, speed, feed) for cut in shallow) < 1, case
        below = replace(at, axial_depth=at.axial_depth / OVER)
        assert spectral_radius(o, cutter, below, speed, feed, intervals=SEMI) < 1, case
        if depth < 0.99 * mean:  # and no less than it must be
            above = replace(at, axial_depth=at.axial_depth * OVER)
            assert spectral_radius(o, cutter, above, speed, feed) > 1, case


def test_one_tooth_in_a_slot_between_two_close_modes() -> None:
    """The issue's case: 46.9 mm on a coarse grid of frequencies, 6.5 mm on a fine one, unstable from 6.41 mm on."""
    m, f = np.array([[1.96, 1.3, 1.33]]), np.array([[647.0, 674.0, 306.0]])
    o = Oscillators.with_damping_ratio(m, m * (2 * np.pi * f) ** 2, np.array([[0.032, 0.022, 0.03]]))
    feed, cutter, speed = [np.cos(np.deg2rad(348)), np.sin(np.deg2rad(348)), 0.0], Cutter(0.02, 1, K), 8666.6667 / 60
    lobes = stability_lobes(o, cutter, "slot", 0.02, feed)
    fine = stability_lobes(o, cutter, "slot", 0.02, feed, frequencies=np.linspace(50, 3500, 20000))
    at = np.linspace(6000, 12000, 60) / 60
    np.testing.assert_allclose(lobes.zeroth_order_at(at), fine.zeroth_order_at(at), rtol=0.01)
    depth = float(lobes.depth_at([speed])[0])
    assert 0.00635 < depth < 0.00642 < lobes.zeroth_order_at([speed])[0]
    assert simulated(o, cutter, depth / OVER, speed, feed) < 1 < simulated(o, cutter, depth * OVER, speed, feed)


def simulated(o: Oscillators, cutter: Cutter, depth: float, speed: float, feed: list[float]) -> float:
    """Growth of free vibration in a slot per tooth period, by central differences."""
    n, periods = 1500, 60
    step, P = 1 / (speed * cutter.teeth) / n, plane(feed)
    phi = 2 * np.pi / cutter.teeth * np.arange(n) / n
    D = sum(directional_matrix(cutter, phi + 1e-9 + a, 0.0, np.pi) for a in cutter.angles)
    W = depth * np.einsum("ri,nrs,sj->nij", P, D, P)
    x = np.zeros((n * periods, 3))
    x[: n + 1] = [1e-6, 2e-6, 0.0]
    m, c, k = o.m[0] / step**2, o.c[0] / (2 * step), o.k[0]
    W_rows, lead, before = list(W), 1 / (m + c), m - c
    for i in range(n, n * periods - 1):
        F = W_rows[i % n] @ (x[i] - x[i - n])
        x[i + 1] = lead * (F - k * x[i] + 2 * m * x[i] - before * x[i - 1])
    size = np.abs(x.reshape(periods, n, 3)).max(axis=(1, 2))
    return float((size[-1] / size[periods // 2]) ** (1 / (periods - 1 - periods // 2)))


def test_collocation_and_semi_discretisation_meet() -> None:
    """Errors of the slow method fall with its step; those of the collocation are gone before."""
    rng = np.random.default_rng(3)
    for number in range(3):
        o, cutter, mode, radial, speed, feed = drawn(rng, number)
        cut = Cut(mode, radial, 0.004, 1e-4)
        exact = spectral_radius(o, cutter, cut, speed, feed)
        errors = [abs(spectral_radius(o, cutter, cut, speed, feed, intervals=n) - exact) for n in (40, 80, 160)]
        assert errors[2] < 3e-3 and (errors[2] < 0.6 * errors[0] or errors[0] < 1e-6)


def test_uneven_pitch_is_that_of_even_pitch_in_the_limit_and_breaks_chatter() -> None:
    o, _, _, _, _, feed = drawn(np.random.default_rng(8), 1)
    even = Cutter(0.02, 4, K, np.deg2rad(30))
    nearly = replace(even, tooth_angles=even.angles + np.array([0, 1e-8, 0, 0]))
    cut = Cut("climb", 0.01, 0.012, 1e-4)
    # one period of four teeth with interpolated delays against a single tooth period
    one, turn = (spectral_radius(o, cutter, cut, 100.0, feed) for cutter in (even, nearly))
    assert turn == pytest.approx(one, rel=1e-6)
    uneven = replace(even, tooth_angles=np.deg2rad([0.0, 70.0, 180.0, 250.0]))
    radius = spectral_radius(o, uneven, cut, 100.0, feed)
    assert abs(radius - one) > 1e-3
    assert radius == pytest.approx(turned_radius(o, uneven, cut, 100.0, feed), rel=2e-3)
    with pytest.raises(ValueError, match="uneven"):
        spectral_radius(o, uneven, cut, 100.0, feed, intervals=60)


def turned_radius(o: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: list[float]) -> float:
    """Growth per tooth in a simulation with a delay for each tooth, straight teeth in slices of the helix."""
    n, turns, slices = 1440, 24, 30
    step, P, R = 1 / speed / n, plane(feed), cutter.radius
    start, end = np.pi - np.arccos(1 - cut.radial_depth / R), np.pi
    phi = 2 * np.pi * np.arange(n) / n
    lag = cutter.lag(cut.axial_depth) * (np.arange(slices) + 0.5) / slices
    W, delay = [], []
    for angle, pitch in zip(cutter.angles, cutter.pitch, strict=True):
        D = directional_matrix(cutter, phi[:, None] + angle - lag, start, end).reshape(n, slices, 2, 2).mean(axis=1)
        W.append(cut.axial_depth * np.einsum("ri,nrs,sj->nij", P, D, P))
        delay.append(round(pitch / (2 * np.pi) * n))
    x = np.zeros((n * turns, 3))
    x[: n + 1] = [1e-6, 2e-6, 0.0]
    m, c, k = o.m[0] / step**2, o.c[0] / (2 * step), o.k[0]
    for i in range(n, n * turns - 1):
        F = sum(w[i % n] @ (x[i] - x[i - d]) for w, d in zip(W, delay, strict=True))
        x[i + 1] = (F - k * x[i] + 2 * m * x[i] - (m - c) * x[i - 1]) / (m + c)
    size = np.abs(x.reshape(turns, n, 3)).max(axis=(1, 2))
    return float((size[-1] / size[turns // 3]) ** (1 / (turns - 1 - turns // 3) / cutter.teeth))


def test_multipliers_of_nothing_cut_are_those_of_the_free_modes() -> None:
    o, cutter, mode, radial, speed, feed = drawn(np.random.default_rng(5), 2)
    found = multipliers(o, cutter, mode, radial, 1e-12, speed, plane(feed))
    w, zeta = 2 * np.pi * o.frequency[0], o.damping_ratio[0]
    free = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * w / (speed * cutter.teeth))
    for value in free:
        assert np.abs(found - value).min() < 1e-6


@pytest.mark.parametrize("number", [0, 5, 7])
def test_the_tooth_that_is_counted_first_does_not_matter(number: int) -> None:
    """Uneven pitch, a narrow cut: while one tooth cuts, others may have been far from any cut a pitch before."""
    rng = np.random.default_rng(number)
    o, _, _, _, speed, feed = drawn(rng, number)
    pitch = np.deg2rad([75.0, 110.0, 82.0, 93.0]) if number % 2 else np.deg2rad([100.0, 140.0, 120.0])
    at = [np.append(0.0, np.cumsum(np.roll(pitch, -i)))[:-1] for i in range(len(pitch))]
    mode, radial = ("up", "climb")[number // 2 % 2], 0.02 * 10 ** rng.uniform(-3, -1.5)
    first, *others = (Cutter(0.02, len(pitch), K, np.deg2rad(15 * (number // 4)), tooth_angles=a) for a in at)
    cut = Cut(mode, radial, 5 * certain_depth(o, first, mode, radial, feed), 1e-4)
    radius = spectral_radius(o, first, cut, speed + 30, feed)
    assert 0 < radius < 1.5
    for other in others:
        assert spectral_radius(o, other, cut, speed + 30, feed) == pytest.approx(radius, rel=1e-6)


@pytest.mark.parametrize("damping", [1e-5, 0.05])
def test_an_island_between_multiples_of_the_axial_pitch_is_seen(damping: float) -> None:
    """Period doubling at 22.5 to 23.5 mm, below the Hopf limit at 28.3 mm: no peak at depths a fifth apart."""
    m, f = np.array([[50.0, 0.5, 50.0]]), np.array([[1500.0, 300.0, 400.0]])
    o = Oscillators.with_damping_ratio(m, m * (2 * np.pi * f) ** 2, np.array([[0.05, 0.004, damping]]))
    cutter = Cutter(0.012, 2, CuttingCoefficients(0, 600e6, 0, 180e6, 0, 0), np.pi / 4)
    at = cutter, "up", 0.0006, 108.0, [1.0, 0.0, 0.0]
    deepest = proven_depth(o, *at, deepest=0.04)
    assert 0.0220 < deepest < 0.0225
    inside = Cut("up", 0.0006, 0.023, 1e-4)
    assert spectral_radius(o, cutter, inside, 108.0, [1.0, 0.0, 0.0]) > 1.004
