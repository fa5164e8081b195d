"""A person's hand as a range of impedances: eigenvalues beside runs in time, python-control, and random hands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest

import gtmodel as gt

L = gt.control.lead_through
OK = L.SignTest(None, L.WrenchStatus.OK)
QUIET = L.SyntheticSensor(mass=0.0, force_noise=0.0, moment_noise=0.0)
GAINS = L.SurfaceGains()
SERVOS = [
    L.ServoChain(delay=0.0055), L.ServoChain(mode_frequency=67.0),
    *(pytest.param(servo, marks=pytest.mark.proof) for servo in (L.ServoChain(), L.ServoChain(delay=0.0))),
]  # fmt: skip
FIVE_PERCENT = 0.05


def run_of(hand: Any, servo: Any, turning: Any = None, grip: Any = (0.0, 0.0, 0.0)) -> Any:
    law = L.LeadThroughLaw(L.SurfaceLaw(GAINS), L.TurningLaw(turning or L.TurningGains()))
    blow = L.GuidePhase(0.004, force=(0.01, 0.0, 0.0))
    return L.guide_tool(
        law, [blow, L.GuidePhase(8.0)], L.SyntheticSurface(), servo, handle=QUIET, tool=QUIET, tests=(OK, OK),
        hand=hand, grip=grip, start=(0.0, 0.0, 1.0),
    )  # fmt: skip


def grows(run: Any) -> bool:
    return bool(np.ptp(run.velocity[1500:, 0]) > np.ptp(run.velocity[700:1200, 0]))


@pytest.mark.parametrize("servo", SERVOS)
def test_the_stiffest_stable_hand_is_that_of_runs_in_time(servo: Any) -> None:
    limit = L.hand_stability(GAINS, servo, L.HandRange(mass=(0.5, 0.5), damping=(10.0, 10.0))).stiffness_limit
    assert not grows(run_of(L.Hand(0.5, 10.0, (1 - FIVE_PERCENT) * limit), servo))
    assert grows(run_of(L.Hand(0.5, 10.0, (1 + FIVE_PERCENT) * limit), servo))


def test_with_a_lever_arm_and_a_tool_that_turns_too() -> None:
    turning, servo = L.TurningGains(by_handle=True), L.ServoChain()
    hands = L.HandRange(mass=(0.5, 0.5), damping=(10.0, 10.0))
    limit = L.hand_stability(GAINS, servo, hands, turning, 0.15).stiffness_limit
    assert limit < 0.7 * L.hand_stability(GAINS, servo, hands).stiffness_limit
    for share, unstable in ((1 - FIVE_PERCENT, False), (1 + FIVE_PERCENT, True)):
        assert grows(run_of(L.Hand(0.5, 10.0, share * limit), servo, turning, (0.0, 0.0, 0.15))) is unstable


def test_the_poles_are_those_of_python_control() -> None:
    hand, servo, T = L.Hand(0.0, 12.0, 700.0), L.ServoChain(), 0.004
    z = control.tf([1, 0], [1], T)
    law = control.ss(control.tf([T / 5.0], [1, -(1 - T / 5.0 * 100.0)], T))
    from_speed = control.ss(
        control.c2d(control.tf([12.0, 700.0], [0.012, 1.0, 0.0]), T, "zoh")
    )  # of position and speed
    late = control.ss(1 / z**2)
    loop = control.feedback(control.series(law, late, from_speed), 1, -1)
    ours = np.sort_complex(np.linalg.eigvals(L.hand_matrix(hand, GAINS, servo)))
    theirs = np.sort_complex(control.poles(loop))
    ours = ours[np.abs(ours) > 1e-4]  # a command more on its way than the loop needs: a pole at 0
    theirs = theirs[np.abs(theirs) > 1e-4]
    assert np.abs(ours - theirs).max() < 1e-7


def test_the_worst_hand_is_not_better_than_any_draw() -> None:
    hands = L.HandRange(stiffness=(0.0, 3000.0), draws=50)
    seen = L.hand_stability(GAINS, L.ServoChain(), hands)
    rng = np.random.default_rng(9)
    for m, b, k in rng.uniform([0, 2, 0], [2, 40, 3000], (200, 3)).tolist():
        poles = np.linalg.eigvals(L.hand_matrix(L.Hand(m, b, k), GAINS, L.ServoChain()))
        least = min(-np.log(abs(p)) / abs(np.log(p + 0j)) for p in poles if abs(p) > 1e-12)
        assert least >= seen.least - 1e-3
        assert not seen.stable or np.abs(poles).max() < 1


def test_a_mode_that_a_hand_leaves_nearly_undamped_fails_and_is_named() -> None:
    """The mode of the servo at 67 Hz keeps 0.006 of its 0.02 with a heavy hand."""
    servo = L.ServoChain(mode_frequency=67.0)
    hand = L.HandRange(mass=(2.0, 2.0), damping=(40.0, 40.0), stiffness=(0.0, 0.0), draws=1)
    phases = [L.GuidePhase(0.5, force=(0.0, 0.0, -3.0))]
    s = L.study(L.SyntheticSurface(), phases, servo=servo, hands=hand)
    assert not s.checks["hand_damping"].passed and s.hand_damping == pytest.approx(0.006354, rel=1e-3)
    assert "67 Hz" in s.checks["hand_damping"].advice and s.hand_mode == pytest.approx(69.5, abs=0.1)
    milder = L.study(L.SyntheticSurface(), phases, servo=servo, hands=replace(hand, least_damping=0.005))
    assert milder.checks["hand_damping"].passed


def test_a_range_beyond_the_limit_is_said_with_the_range_that_holds() -> None:
    seen = L.hand_stability(GAINS, L.ServoChain(), L.HandRange(stiffness=(0.0, 20_000.0), draws=50))
    assert not seen.stable and seen.least < 0 and 1000 < seen.stiffness_limit < 20_000
    inside = L.hand_stability(
        GAINS, L.ServoChain(), L.HandRange(stiffness=(0.0, 0.99 * seen.stiffness_limit), draws=50)
    )
    assert inside.stable


@pytest.mark.parametrize("servo", SERVOS)
def test_the_force_limit_by_eigenvalues_is_that_of_runs(servo: Any) -> None:
    limit = gt.control.delayed.gain_limit(L.force_loop(servo))
    gain, frequency = L.simulated_limit(GAINS, servo, limit.gain)
    assert gain == pytest.approx(limit.gain, rel=FIVE_PERCENT) and frequency == pytest.approx(limit.frequency, abs=2.0)


def test_a_light_mode_near_67_hertz_sets_the_limit_at_68_hertz() -> None:
    servo = L.ServoChain(delay=0.006, mode_frequency=67.0, mode_damping=0.001)
    limit = gt.control.delayed.gain_limit(L.force_loop(servo))
    gain, frequency = L.simulated_limit(GAINS, servo, limit.gain)
    assert limit.frequency == pytest.approx(68.0, abs=2.0) and frequency == pytest.approx(limit.frequency, abs=2.0)
    assert gain == pytest.approx(limit.gain, rel=FIVE_PERCENT)


def test_cones_filter_and_tilt() -> None:
    seen = L.cone_deviations(GAINS, L.ServoChain(), L.ConeComparison(duration=4.0))
    flat, tilted = seen["flat, unfiltered"], seen["tilted, unfiltered"]
    assert flat[0] < flat[1] < flat[2] and tilted[0] > tilted[1] > tilted[2]
    for surface, worst in (("flat", flat[2]), ("tilted", tilted[2])):
        assert seen[f"{surface}, filtered"][2] <= worst / 2
    assert tilted[0] == pytest.approx(0.1 * np.sin(np.radians(4.0)) / 0.01, rel=0.03)  # v sin psi / K
