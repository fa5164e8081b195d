"""Margins of a late loop against python-control, against their own meaning, and where control.margin misleads."""

from __future__ import annotations

import control
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from tests.control.delayed.test_limit import CYCLE, LATE, ON_CIRCLE, arm

D = gt.control.delayed

THEIRS = 1e-4  # python-control interpolates on a grid of frequencies


def theirs(loop: D.DelayedLoop, gain: float) -> control.StateSpace:
    plant = control.c2d(control.ss(loop.plant.A, loop.plant.B[:, None], loop.plant.C[None], 0), CYCLE)
    late = control.ss(np.eye(13, k=-1), np.eye(13)[:, :1], np.eye(13)[-1:], 0, CYCLE)
    return control.series(late, plant) * gain


@pytest.mark.parametrize(
    ("plant", "share"), [(arm(), 0.5), (arm(), 0.9), (arm(14.0, 0.08, 1.0), 0.7), (D.rigid_plant(CYCLE), 0.4)]
)
def test_they_are_those_of_python_control_where_it_has_them(plant: D.CorrectedPlant, share: float) -> None:
    loop = D.DelayedLoop(plant, CYCLE, LATE)
    gain = share * D.gain_limit(loop).gain
    m, L = D.loop_margins(loop, gain), theirs(loop, gain)
    gains, phases, _, _, crossings, _ = control.stability_margins(L, returnall=True)
    assert m.gain == pytest.approx(min(g for g in np.atleast_1d(gains) if g > 1), rel=THEIRS)
    assert m.gain == pytest.approx(1 / share, rel=1e-9)
    phases, crossings = np.atleast_1d(phases), np.atleast_1d(crossings)
    if len(phases):
        assert m.phase == pytest.approx(np.deg2rad(np.abs(phases).min()), rel=THEIRS)
        assert m.phase_delay == pytest.approx(np.min(np.deg2rad(phases % 360) / crossings), rel=THEIRS)
    else:
        assert m.phase == np.pi and m.phase_delay == np.inf
    w = np.linspace(1.0, np.pi / CYCLE, 1000)
    near = w[np.argmin(np.abs(1 + L(np.exp(1j * w * CYCLE))) / np.abs(1 - L(np.exp(1j * w * CYCLE))))]
    w = np.linspace(max(near - 2 * (w[1] - w[0]), 1.0), min(near + 2 * (w[1] - w[0]), np.pi / CYCLE), 200)
    assert m.disk == pytest.approx(control.disk_margins(L, w)[0], rel=THEIRS)


@pytest.mark.parametrize("delay", [0.0, LATE, 0.0505])
@pytest.mark.parametrize("share", [pytest.param(0.2, marks=pytest.mark.proof), 0.6, 0.95])
def test_the_delay_margin_put_in_as_a_delay_takes_a_pole_to_the_unit_circle(delay: float, share: float) -> None:
    for plant in (arm(), D.rigid_plant(CYCLE), arm(accumulate=True)):
        loop = D.DelayedLoop(plant, CYCLE, delay)
        gain = share * D.gain_limit(loop).gain
        margin = D.delay_margin(loop, gain)
        if np.isinf(margin):  # the response stays below one: no delay ends it
            assert all(loop.late_by(delay + x).stable(gain) for x in np.linspace(0, 0.2, 40))
            continue
        assert abs(loop.late_by(delay + margin).radius(gain) - 1) < ON_CIRCLE
        assert all(loop.late_by(delay + x * margin).stable(gain) for x in np.linspace(0, 0.999, 20))


def test_a_disk_margin_holds_for_gain_and_phase_at_once() -> None:
    """Within the disk, any factor leaves the loop stable: tried with complex factors by the Nyquist count; on its edge
    some factor does not."""
    loop = D.DelayedLoop(arm(), CYCLE, LATE)
    gain = 0.15
    disk = D.disk_margin(loop, gain)
    w = np.linspace(0.5, np.pi / CYCLE, 60000)
    L = gain * loop.response(w)
    assert np.min(2 * np.abs(1 + L) / np.abs(1 - L)) == pytest.approx(disk, rel=1e-4)
    for factor in ((2 - disk) / (2 + disk), (2 + disk) / (2 - disk)):
        assert loop.stable(gain * factor)
    # the factor of the edge that takes L to -1
    at = int(np.argmin(np.abs(1 + L) / np.abs(1 - L)))
    f = -1 / L[at]
    assert abs(2 * abs((1 - f) / (1 + f)) - disk) < 1e-3


def test_control_margin_gives_another_gain_margin_of_an_unstable_loop() -> None:
    """Cvitanic 2021: the margin nearest one of a loop beyond its limit is a crossing far above it."""
    loop = D.DelayedLoop(arm(), CYCLE, LATE)
    limit = D.gain_limit(loop).gain
    misled, *_ = control.margin(theirs(loop, 1.0))
    assert limit < 0.25 < 0.5 < misled
    with pytest.raises(ArgumentError) as fault:
        D.loop_margins(loop, 1.0)
    assert fault.value.argument == "gain"


@pytest.mark.parametrize("gain", [0.0, -1.0, np.nan, np.inf])
def test_gains_without_margins(gain: float) -> None:
    with pytest.raises(ArgumentError) as fault:
        D.loop_margins(D.DelayedLoop(arm(), CYCLE, LATE), gain)
    assert fault.value.argument == "gain"
    with pytest.raises(ArgumentError) as fault:
        D.delay_margin(D.DelayedLoop(arm(), CYCLE, LATE), 3.0)
    assert fault.value.argument == "gain"
