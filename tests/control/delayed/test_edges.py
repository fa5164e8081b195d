"""Loops at the edge: hardly damped, undamped, without effect, unstable by themselves, late by hundreds of cycles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.control.delayed.limit import stability_ranges
from gtmodel.results import ArgumentError
from tests.control.delayed.test_limit import CYCLE, LATE, arm
from tests.control.delayed.test_scan import radius

D = gt.control.delayed


@pytest.mark.parametrize("zeta", [3.6e-5, 1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("delay", [0.0, 0.0013, LATE])
def test_a_narrow_resonance_beside_a_rigid_arm_is_not_stepped_over(zeta: float, delay: float) -> None:
    """Gains at which the resonance leaves the circle and comes back lie close together in frequency."""
    w = 0.15293 / CYCLE
    swings = D.CorrectedPlant([[0, 1], [-w * w, -2 * zeta * w]], [0, w * w], [0.1025, 0])
    plant = D.side_by_side([D.rigid_plant(CYCLE), swings], [0.3, 1.0], [1.0, 1.0])
    limit = D.gain_limit(D.DelayedLoop(plant, CYCLE, delay)).gain
    shares = [*np.geomspace(1e-4, 0.999, 150)]
    assert max(radius(plant, CYCLE, delay, s * limit) for s in shares) < 1
    assert radius(plant, CYCLE, delay, 1.001 * limit) > 1 + 1e-12


def test_an_undamped_arm_has_the_limit_of_one_that_is_hardly_damped() -> None:
    limits = [D.gain_limit(D.DelayedLoop(arm(zeta=z), CYCLE, LATE)).gain for z in (0.0, 1e-9)]
    assert limits[0] == pytest.approx(limits[1], rel=1e-6)


def test_where_corrections_do_nothing_no_gain_limits() -> None:
    plant = D.CorrectedPlant([[-1.0]], [0.0], [1.0])
    assert D.gain_limit(D.DelayedLoop(plant, CYCLE, LATE)) == D.GainLimit(np.inf, 0.0)


@pytest.mark.parametrize(
    "plant",
    [
        D.side_by_side([arm(), D.rigid_plant(CYCLE)], [1.0, 1.0], [1.0, 0.0]),  # never measured
        D.side_by_side([arm(), D.rigid_plant(CYCLE)], [1.0, 0.0], [1.0, 1.0]),  # never corrected
        D.side_by_side([D.rigid_plant(CYCLE)] * 2, [1.0, 2.0], [1.0, 1.0]),  # the difference of two is neither
    ],
)
def test_a_motion_that_stays_at_every_gain_is_refused(plant: Any) -> None:
    with pytest.raises(ArgumentError, match=r"rest"):
        D.gain_limit(D.DelayedLoop(plant, CYCLE, 0.004))


def test_a_plant_that_only_corrections_hold_is_refused_and_its_range_said() -> None:
    plant = D.CorrectedPlant([[1.0]], [1.0], [1.0])  # x' = x + u: stable for gains above one
    loop = D.DelayedLoop(plant, CYCLE, 0.0)
    (low, high), *more = stability_ranges(loop)[1]
    assert not more and low == pytest.approx(1.0)
    assert [radius(plant, CYCLE, 0.0, g) < 1 for g in (0.99, 1.01, 0.99 * high, 1.01 * high)] == [0, 1, 1, 0]
    with pytest.raises(ArgumentError, match=f"{low:.4g} to {high:.4g}"):
        D.gain_limit(loop)


@pytest.mark.parametrize("cycles", [250, pytest.param(1900, marks=pytest.mark.proof)])
def test_late_by_hundreds_of_cycles(cycles: int) -> None:
    limit = D.gain_limit(D.DelayedLoop(D.rigid_plant(CYCLE), CYCLE, cycles * CYCLE))
    assert limit.gain == pytest.approx(2 * np.sin(np.pi / (2 * (2 * cycles + 1))), rel=1e-9)
    assert limit.returns == ()


@pytest.mark.parametrize("gain", [np.nan, np.inf, -np.inf])
def test_a_gain_that_is_no_number_is_refused_everywhere(gain: float) -> None:
    loop = D.DelayedLoop(arm(), CYCLE, LATE)
    for asked in (
        loop.matrix, loop.radius, loop.stable, loop.noise_entry, lambda g: D.delay_margin(loop, g),
        lambda g: D.disk_margin(loop, g), lambda g: D.run_along(loop, g),
    ):  # fmt: skip
        with pytest.raises(ArgumentError) as fault:
            asked(gain)
        assert fault.value.argument == "gain"


def test_an_unstable_loop_has_no_disk_margin() -> None:
    with pytest.raises(ArgumentError) as fault:
        D.disk_margin(D.DelayedLoop(arm(), CYCLE, LATE), 1.0)
    assert fault.value.argument == "gain"


def test_a_delay_margin_may_end_at_the_nyquist_frequency() -> None:
    """There the response is real, and its size changes with the part of a cycle: no size of one need come before."""
    cycle, w = 0.004, 771.3  # rad/s, beside the Nyquist frequency
    swings = D.CorrectedPlant([[0, 1], [-w * w, -38.4]], [0, w * w], [-0.105, 0])
    plant = D.side_by_side([swings, D.CorrectedPlant([[0.0]], [75.0], [1.0])], [1.0, 1.0], [1.0, 1.0])
    loop = D.DelayedLoop(plant, cycle, 0.0)
    gain = 0.95 * D.gain_limit(loop).gain
    margin = D.delay_margin(loop, gain)
    assert max(radius(plant, cycle, s * margin, gain) for s in np.linspace(0, 0.9999, 300)) < 1
    assert radius(plant, cycle, margin, gain) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(("frequency", "zeta"), [(20.0, 0.002), (20.0, 0.02), (50.0, 0.002)])
@pytest.mark.parametrize("peak", [1.0003, 1.01])
def test_a_delay_margin_that_a_little_more_delay_gives_back_is_not_stepped_over(
    frequency: float, zeta: float, peak: float
) -> None:
    """A response that is hardly above one has a narrow range of delays without stability."""
    plant = arm(frequency, zeta, 1.0)
    loop = D.DelayedLoop(plant, CYCLE, 0.0)
    w = 2 * np.pi * frequency * np.linspace(0.9, 1.1, 20001)
    gain = peak / np.abs(loop.response(w)).max()
    margin = D.delay_margin(loop, gain)
    assert radius(plant, CYCLE, margin, gain) == pytest.approx(1, abs=1e-9)
    assert max(radius(plant, CYCLE, s * margin, gain) for s in np.linspace(0, 0.9999, 300)) < 1
    beyond = [radius(plant, CYCLE, margin + x * CYCLE, gain) for x in np.linspace(0, 0.5, 500)]
    assert max(beyond) > 1
