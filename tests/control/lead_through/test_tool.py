"""Guiding with the estimated normal from the approach on, oscillation, a peg in its hole, energy at the handle."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

L = gt.control.lead_through
S = L.WrenchStatus
OK = L.SignTest(None, S.OK)
SERVO = L.ServoChain()
LIMIT = gt.control.delayed.gain_limit(L.force_loop(SERVO)).gain
WITHIN = 0.02  # [N] of the mean
NOISE = 0.05  # [N], synthetic, of both sensors
SENSOR = L.SyntheticSensor(mass=0.0, force_noise=NOISE, moment_noise=0.002)
QUIET = L.SyntheticSensor(mass=0.0, force_noise=0.0, moment_noise=0.0)


def surface_law(gain: float, watch: Any = None, **more: Any) -> Any:
    gains = L.SurfaceGains(force_gain=gain, **more)
    return L.LeadThroughLaw(L.SurfaceLaw(gains, watch=watch or L.OscillationWatch()))


def guided(law: Any, phases: Any, contact: Any, servo: Any = SERVO, **more: Any) -> Any:
    given = {"handle": SENSOR, "tool": SENSOR, "tests": (OK, OK), "seed": 4, "start": (0.0, 0.0, 0.002)} | more
    return L.guide_tool(law, phases, contact, servo, **given)


def losses(run: Any) -> int:
    return int(np.count_nonzero(run.contact[:-1] & ~run.contact[1:]))


# each value of each factor, with every value of another one; all of them in `make proof`
FEW = {(500.0, 0.1, 0.1), (500.0, 0.4, 0.0), (5e3, 0.1, 0.0), (5e3, 0.4, 0.1), (5e4, 0.4, 0.1)}
APPROACHES = [
    pytest.param(k, pace, s, f, marks=[pytest.mark.proof] * ((k, s, f) not in FEW))
    for k, pace in ((500.0, 1.0), (5e3, 1.0), (5e4, 0.1)) for s in (0.1, 0.2, 0.4) for f in (0.0, 0.1)
]  # fmt: skip


@pytest.mark.parametrize(("stiffness", "pace", "share", "friction"), APPROACHES)
def test_two_newtons_from_the_approach_on_with_the_estimated_normal(
    stiffness: float, pace: float, share: float, friction: float
) -> None:
    # on a stiffer contact K is smaller, and noise of the normal times speed over K larger: the hand goes slower
    law = surface_law(share * LIMIT / stiffness, friction=friction, friction_speed=0.01 * pace)
    surface = L.SyntheticSurface(stiffness=stiffness, tilt=np.radians(3.0), friction=friction)
    down = L.GuidePhase(1.0 / pace, force=(0.0, 0.0, -1.0 * pace))
    run = guided(law, [down, L.GuidePhase(10.0 if pace == 1 else 16.0, force=(5.0 * pace, 0.0, -3.0))], surface)
    began = np.flatnonzero(run.contact)[0]
    assert 0 < began < 250 / pace  # it came down onto it
    pressed = run.force @ surface.normal
    assert abs(pressed[began + 500 :].mean() - 2) < WITHIN
    assert losses(run) == 0 and pressed[began:].min() > 0


def test_friction_in_the_estimate_is_what_makes_the_force_right() -> None:
    surface = L.SyntheticSurface(friction=0.1)
    phases, means = [L.GuidePhase(1.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(8.0, force=(10.0, 0.0, -3.0))], {}
    speeds = {}
    for known in (0.0, 0.1):
        run = guided(surface_law(0.01, friction=known), phases, surface, handle=QUIET, tool=QUIET)
        means[known] = run.force[1500:].mean(axis=0)
        speeds[known] = np.linalg.norm(run.velocity[1500:], axis=1).mean()
    assert means[0.1][2] == pytest.approx(2.0, abs=WITHIN)
    # v sin(atan mu) / K along the estimate
    assert np.linalg.norm(means[0.0]) - 2 == pytest.approx(-speeds[0.0] * np.sin(np.arctan(0.1)) / 0.01, rel=0.03)


def test_a_curved_surface_is_followed() -> None:
    surface = L.SyntheticSurface(curvature=0.3)
    phases = [L.GuidePhase(1.5, force=(0.0, 0.0, -1.0)), L.GuidePhase(8.0, force=(4.0, 0.0, -3.0))]
    run = guided(surface_law(0.4 * LIMIT / 5e3), phases, surface, start=(-0.15, 0.0, 0.001))
    began = np.flatnonzero(run.contact)[0] + 250
    normals = np.array([surface.normal_at(x) for x in run.position])
    pressed = np.einsum("ni,ni->n", run.force, normals)[began:]
    assert abs(pressed.mean() - 2) < WITHIN and pressed.min() > 1.5
    assert np.ptp(np.degrees(np.arctan2(normals[began:, 0], normals[began:, 2]))) > 4


def test_the_force_of_a_curved_surface_is_that_of_its_distance() -> None:
    surface = L.SyntheticSurface(curvature=2.0, tilt=0.2)
    fall, up = np.array([np.cos(0.2), 0, -np.sin(0.2)]), surface.normal
    for x in (-0.05, 0.02, 0.08):
        foot = x * fall - x**2 * up  # on the parabola
        n = surface.normal_at(foot)
        force = surface.force(foot - 1e-4 * n, np.zeros(3), 0.0)
        assert force == pytest.approx(0.5 * n, rel=2e-3)
        assert surface.energy(foot - 1e-4 * n, np.eye(3), 0.0) == pytest.approx(0.5 * 5e3 * 1e-8, rel=4e-3)


@pytest.mark.parametrize("times", [3.0, 10.0])
def test_oscillation_on_a_stiffer_contact_reduces_the_gain_until_two_newtons_are_held(times: float) -> None:
    servo, surface = L.ServoChain(mode_frequency=67.0), L.SyntheticSurface(stiffness=times * 5e3)
    gain = 0.4 * LIMIT / 5e3
    # the noise of the normal times speed over K, smaller on a stiffer contact: the hand goes slower there
    phases = [L.GuidePhase(2.0, force=(0.0, 0.0, -0.3)), L.GuidePhase(5.0, force=(3.0 / times, 0.0, -3.0))]
    without = guided(surface_law(gain), phases, surface, servo)
    reduced = guided(surface_law(gain, L.OscillationWatch(level=0.5)), phases, surface, servo)
    assert losses(without) > 10 and without.force[1250:, 2].std() > 1
    late = reduced.force[1250:, 2]
    assert late.mean() == pytest.approx(2.0, abs=WITHIN) and late.std() < 0.2 and late.min() > 0
    assert reduced.share[-1] * times * 0.4 < 0.7 and (np.diff(reduced.share) <= 0).any()
    calm = guided(surface_law(gain, L.OscillationWatch(level=0.5)), phases, L.SyntheticSurface(), servo)
    assert calm.share[-1] == 1.0


def peg_law(about: str = "free", **more: Any) -> Any:
    gains = L.SurfaceGains(
        force_gain=0.002, any_direction=True, force_reference=0.0, enter_force=0.3, leave_force=0.05, least_force=0.05,
        normal_filter=0.0, dwell=0.02, contact_arm=0.01,
    )  # fmt: skip
    return L.LeadThroughLaw(
        L.SurfaceLaw(gains),
        L.TurningLaw(L.TurningGains(torque_gain=1.0, about_axis=about)),  # type: ignore[arg-type]
    )


HOLE = L.SyntheticHole(tilt=np.radians(5.0), clearance=0.25e-3, depth=0.08, stiffness=5e3, friction=0.1)
FINE = L.SyntheticSensor(mass=0.0, force_noise=0.005, moment_noise=0.0005)
DOWN = [L.GuidePhase(10.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(5.0)]


@functools.cache
def peg_run(about: str, moment_noise: float = 0.0005, tilt: float = 5.0, seed: int = 3) -> Any:
    sensor = L.SyntheticSensor(mass=0.0, force_noise=0.005, moment_noise=moment_noise)
    hole = L.SyntheticHole(tilt=np.radians(tilt), clearance=0.25e-3, depth=0.08, stiffness=5e3, friction=0.1)
    return guided(peg_law(about), DOWN, hole, handle=FINE, tool=sensor, seed=seed)


@pytest.mark.parametrize("about", ["free", "lock", "hold"])
def test_a_misaligned_peg_goes_in_and_its_torque_to_zero(about: str) -> None:
    run = peg_run(about)
    torque = np.linalg.norm(run.moment, axis=1)
    off = np.degrees(np.arccos(run.turn[:, :, 2] @ HOLE.axis))
    assert torque.max() > 0.02 and torque[-250:].mean() < 0.05 * torque.max()
    assert off[0] == pytest.approx(5.0, abs=1e-6) and off[-1] < 0.5
    assert -HOLE.axis @ run.position[-1] > 0.05
    if about == "lock":
        assert abs(run.about[-1]) < 1e-12
    if about == "hold":  # as far from the angle at which contact began as noise of one correction
        assert np.abs(run.about).max() < 1e-4


def test_the_rotation_about_the_peg_is_a_random_walk_unless_it_is_locked() -> None:
    # K sigma T sqrt(n), from twelve runs; chi-square at 99.9 %
    ends, expected = [], None
    for seed in range(12):
        law = peg_law()
        state, rng = law.start(OK, OK), np.random.default_rng(seed)
        still = (0.0, 0.0, 0.0)
        for noise in 0.002 * rng.standard_normal((1000, 3)):
            moment = (0.02 + noise[0], noise[1], noise[2])  # a couple keeps it in contact
            state = law.step(state, (still, still), (still, tuple(float(x) for x in moment)))
        ends.append(state.rotation.about)
    expected = 1.0 * 0.002 * 0.004 * np.sqrt(1000)
    low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], 12)
    assert low < np.sum(np.square(ends)) / expected**2 < high


def test_hold_turns_back_what_somebody_turned() -> None:
    law = peg_law("hold")
    state, tool = law.start(OK, OK), ((0.0, 0.0, 0.0), (0.03, 0.0, 0.0))
    R = np.eye(3)
    for k in range(1500):
        if k == 100:
            R = scipy.spatial.transform.Rotation.from_rotvec([0, 0, 0.1]).as_matrix() @ R
        turn = tuple(tuple(float(x) for x in row) for row in R)
        state = law.step(state, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), tool, turn)  # type: ignore[arg-type]
        about = state.rate[2] * law.cycle * R[:, 2]
        R = scipy.spatial.transform.Rotation.from_rotvec(about).as_matrix() @ R
    assert abs(np.arctan2(R[1, 0], R[0, 0])) < 0.1 * np.exp(-5.0 * 1400 * 0.004) + 1e-6


def test_the_hole_has_a_conservative_force_and_no_torque_about_the_peg() -> None:
    from gtmodel.control.lead_through.judgement import peg_stiffness

    k = peg_stiffness(HOLE)
    assert np.abs(k - k.T).max() < 1e-3 * np.abs(k).max()
    assert np.abs(k[5]).max() < 1e-6 and np.linalg.eigvalsh((k + k.T) / 2).min() > -1e-3
    assert k[0, 0] == pytest.approx(2 * 5e3, rel=1e-3) and k[4, 4] == pytest.approx(5e3 * 0.08**2, rel=1e-3)


ALONG = [
    L.GuidePhase(1.0, force=(0.0, 0.0, -1.0)),
    L.GuidePhase(3.0, force=(5.0, 0.0, -3.0)),
    L.GuidePhase(3.0, force=(-5.0, 1.0, -3.0)),
    L.GuidePhase(0.8, force=(0.0, 0.0, 15.0)),
    L.GuidePhase(0.5),
]


@pytest.mark.parametrize("hand", [None, L.Hand(0.5, 10.0, 200.0), L.Hand(2.0, 5.0, 800.0)])
@pytest.mark.parametrize("tilt", [0.0, 4.0])
def test_over_no_window_the_hand_gets_more_than_was_stored(hand: Any, tilt: float) -> None:
    from gtmodel.control.lead_through.judgement import TOO_MUCH, at_the_handle

    phases = ALONG
    if hand is not None:
        phases = [L.GuidePhase(1.0, velocity=(0, 0, -0.01)), L.GuidePhase(3.0, velocity=(0.05, 0, 0)),
                  L.GuidePhase(3.0, velocity=(-0.05, 0.02, 0)), L.GuidePhase(1.0, velocity=(0, 0, 0.1))]  # fmt: skip
    law = surface_law(0.2 * LIMIT / 5e3)
    run = guided(law, phases, L.SyntheticSurface(tilt=np.radians(tilt)), hand=hand)
    book = at_the_handle(run, law.translation.gains, law.rotation.gains, SERVO)
    assert run.contact.any() and book.worst < 0 < book.energy[-1]
    assert book.share <= TOO_MUCH
    # by every window, in place of the running minimum
    few = slice(None, None, 7)
    E, s = book.energy[few], book.stored[few]
    assert (E[None] - E[:, None] + s[:, None])[np.triu_indices(len(E))].min() >= -book.deficit - 1e-12


def test_long_guiding_does_not_hide_energy_that_was_given() -> None:
    time, after = np.linspace(0, 1, 101), 1.01 + np.linspace(0, 100, 10_001)
    given = np.outer(-0.1 * time, [1.0, 0, 0])  # 0.5 J, of which 0.2 J were stored
    short = L.passivity_book(time, np.tile([5.0, 0, 0], (101, 1)), given, np.full(101, 0.2))
    there = np.outer(np.sin(after - after[0]), [1.0, 0, 0])  # then it is guided to and fro against its damping
    long = L.passivity_book(
        np.concatenate([time, after]),
        np.concatenate([np.tile([5.0, 0, 0], (101, 1)), np.outer(np.cos(after - after[0]), [5.0, 0, 0])]),
        np.concatenate([given, given[-1] + there]),
        np.full(10_102, 0.2),
    )
    assert long.passed > 100 * short.passed
    assert short.share == pytest.approx(1.5) and long.share == pytest.approx(1.5)


def test_a_robot_that_gives_energy_is_seen() -> None:
    time = np.linspace(0, 1, 101)
    moved = np.outer(-0.1 * time, [1.0, 0, 0])  # it pushes a hand that holds against it
    book = L.passivity_book(time, np.tile([5.0, 0, 0], (101, 1)), moved, np.zeros(101))
    assert book.worst == pytest.approx(-0.5) and book.deficit == pytest.approx(0.5) and book.window == (0.0, 1.0)
    turned = L.passivity_book(time, 0 * moved, moved, np.zeros(101), moment=np.tile([0, 0, 2.0], (101, 1)),
                              turned=np.outer(-time, [0, 0, 1.0]))  # fmt: skip
    assert turned.deficit == pytest.approx(2.0)


def test_release_after_a_long_push_with_both_sensors_noisy() -> None:
    law = surface_law(0.01)
    p = law.translation.gains
    phases = [L.GuidePhase(1.0, force=(0, 0, -1.0)), L.GuidePhase(4.0, force=(0, 0, -30.0)),
              L.GuidePhase(1.0, force=(0, 0, 15.0))]  # fmt: skip
    run = guided(law, phases, L.SyntheticSurface())
    released = np.flatnonzero(run.force[1250:, 2] == 0)[0] * p.cycle
    changes = np.linalg.norm(np.diff(run.command[:, :3], axis=0, prepend=0.0), axis=1)
    assert released < 0.3 and losses(run) == 1
    assert changes.max() <= p.acceleration_limit * p.cycle * (1 + 1e-12)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: guided(surface_law(0.01), [], L.SyntheticSurface()), "phases"),
        (lambda: guided(surface_law(0.01), [L.GuidePhase(1e6)], L.SyntheticSurface()), "phases"),
        (lambda: guided(surface_law(0.01), DOWN, L.SyntheticSurface(), start=(0, 0)), "start"),
        (lambda: guided(surface_law(0.01), DOWN, L.SyntheticSurface(), turn=np.zeros((3, 3))), "turn"),
        (lambda: L.passivity_book([0, 1], np.zeros((2, 3)), np.zeros((3, 3)), [0, 0]), "moved"),
        (lambda: L.passivity_book([0, 1], np.zeros((2, 3)), np.zeros((2, 3)), [0, -1]), "stored"),
        (lambda: L.passivity_book([0, 1], *np.zeros((2, 2, 3)), [0, 1], moment=np.zeros((2, 3))), "turned"),
        (lambda: L.HandRange(mass=(2.0, 1.0)), "mass"),
        (lambda: L.StiffnessRange(5000.0, 500.0), "softest"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


@pytest.mark.parametrize(("share", "unstable"), [(0.95, False), (1.05, True)])
@pytest.mark.parametrize("per", [50.0, 2000.0])
def test_the_loop_gain_of_a_peg_over_its_limit_decides_about_runs(share: float, unstable: bool, per: float) -> None:
    from gtmodel.control.lead_through.judgement import peg_stiffness

    hole = L.SyntheticHole(clearance=0.0, depth=0.08, stiffness=5e3)
    largest = np.abs(np.linalg.eigvals(np.diag([1.0] * 3 + [per] * 3) @ peg_stiffness(hole))).max()
    gain = share * LIMIT / largest
    gains = L.SurfaceGains(
        force_gain=gain, any_direction=True, force_reference=0.0, enter_force=1e-12, leave_force=-1.0,
        least_force=1e-15, normal_filter=0.0,
    )  # fmt: skip
    law = L.LeadThroughLaw(L.SurfaceLaw(gains), L.TurningLaw(L.TurningGains(torque_gain=per * gain)))
    run = guided(
        law, [L.GuidePhase(4.0)], hole, handle=QUIET, tool=QUIET, start=(1e-8, 0.0, -0.0799),
        turn=scipy.spatial.transform.Rotation.from_rotvec([0.0, 1e-7, 0.0]).as_matrix(),
    )  # fmt: skip
    parts = np.array_split(np.linalg.norm(run.force, axis=1) + np.linalg.norm(run.moment, axis=1) / 0.08, 5)
    assert bool(parts[-1].max() > parts[2].max()) is unstable
