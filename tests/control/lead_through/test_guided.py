"""The loop in time against a synthetic surface: closed forms of the note, limits by eigenvalues, the cone, release."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError

L = gt.control.lead_through
S = L.WrenchStatus

K, STIFFNESS, SPEED = 0.01, 5000.0, 0.1
PRESSED = (0.0, 0.0, -2.0 / STIFFNESS)  # starts at the reference
THREE_PERCENT, FIVE_PERCENT = 0.03, 0.05
NOISE = 0.1  # [N], synthetic
AT_REST_M = 1e-15  # rounding of positions of 0.4 mm by the servo's matrices


def law_of(**gains: Any) -> Any:
    return L.SurfaceLaw(L.SurfaceGains(force_gain=gains.pop("force_gain", K), **gains))


def steady(force: Any, cycles: int = 2000) -> np.ndarray:
    return np.tile(np.asarray(force, float), (cycles, 1))


ALONG = steady([SPEED * L.SurfaceGains().damping, 0.0, 0.0])


@pytest.mark.parametrize("force", [[10.0, 0.0, 0.0], [3.0, -4.0, 12.0]])
def test_in_free_space_the_speed_is_force_over_damping(force: list[float]) -> None:
    run = L.guide(law_of(), steady(force), start=(0, 0, 1.0))
    assert run.command[-1] == pytest.approx(np.array(force) / 100.0, rel=THREE_PERCENT)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("degrees", [2.0, 4.0])
def test_a_normal_off_by_psi_changes_the_force_by_v_sin_psi_over_K(degrees: float, way: int) -> None:
    psi = np.radians(degrees)
    run = L.guide(law_of(cone=0.0), way * ALONG, L.SyntheticSurface(tilt=psi), start=PRESSED)
    # along +x the surface falls
    assert run.force[-1, 2] - 2 == pytest.approx(-way * SPEED * np.sin(psi) / K, rel=THREE_PERCENT)


@pytest.mark.parametrize("rise", [0.005, -0.005])
def test_on_a_surface_that_rises_the_force_is_off_by_w_over_K(rise: float) -> None:
    run = L.guide(law_of(), 0 * ALONG, L.SyntheticSurface(rise=rise), start=PRESSED)
    assert run.force[-1, 2] - 2 == pytest.approx(rise / K, rel=THREE_PERCENT)


@pytest.mark.parametrize("mu", [0.02, 0.05])
def test_friction_tilts_the_normal_by_its_angle(mu: float) -> None:
    run = L.guide(law_of(), ALONG, L.SyntheticSurface(friction=mu), start=PRESSED)
    angle = np.arctan2(-run.normal[-1, 0], run.normal[-1, 2])
    assert angle == pytest.approx(np.arctan(mu), rel=THREE_PERCENT)
    assert np.linalg.norm(run.force[-1]) - 2 == pytest.approx(-SPEED * np.sin(np.arctan(mu)) / K, rel=THREE_PERCENT)


def test_a_wrong_sign_is_detected_before_anything_moves() -> None:
    run = L.guide(law_of(), ALONG, start=PRESSED, sensor_sign=-1)
    assert run.status is S.WRONG_SIGN
    assert not run.command.any() and np.ptp(run.position, axis=0).max() < AT_REST_M


def test_the_servo_is_that_of_python_control() -> None:
    servo = L.ServoChain(lag=0.01, delay=0.0065, mode_frequency=67.0, mode_damping=0.03)
    run = L.guide(law_of(), 20 * np.random.default_rng(1).normal(size=(300, 3)), servo=servo, start=(0, 0, 1.0))
    s, w, fine = control.tf("s"), 2 * np.pi * 67.0, 0.0005
    chain = control.c2d(control.ss(1 / (s * (0.01 * s + 1)) * w**2 / (s**2 + 0.06 * w * s + w**2)), fine, "zoh")
    held = np.concatenate([np.zeros(13), np.repeat(run.command[:, 0], 8)])  # 6.5 ms late
    fine_x = control.forced_response(chain, inputs=held).outputs
    assert np.abs(fine_x[: 300 * 8 : 8] - run.position[:, 0]).max() < 1e-9 * np.abs(run.position[:, 0]).max() + 1e-12


SERVOS = [
    L.ServoChain(),
    L.ServoChain(lag=0.004, delay=0.004, mode_frequency=67.0),
    L.ServoChain(lag=0.02, delay=0.0055),
    L.ServoChain(mode_frequency=67.0, mode_damping=0.005),
]


@pytest.mark.parametrize("servo", SERVOS)
def test_the_limit_by_eigenvalues_is_that_of_the_run(servo: Any) -> None:
    limit = gt.control.delayed.gain_limit(L.force_loop(servo))
    for share, grows in ((1 - FIVE_PERCENT, False), (1 + FIVE_PERCENT, True)):
        law = law_of(force_gain=share * limit.gain / STIFFNESS, cone=0.0)
        run = L.guide(law, steady([0, 0, 0], 1000), servo=servo, start=(0, 0, -(2 + 1e-8) / STIFFNESS))  # stays linear
        parts = np.array_split(run.force[:, 2] - 2, 5)
        assert bool(np.std(parts[-1]) > np.std(parts[2])) is grows  # the first hold the transient
        if grows:  # what grows, after the transient
            tail = run.force[250:500, 2]
            spectrum = np.abs(np.fft.rfft(np.hanning(250) * (tail - tail.mean()), 8192))
            assert np.fft.rfftfreq(8192, 0.004)[np.argmax(spectrum)] == pytest.approx(limit.frequency, abs=2.0)


@pytest.mark.parametrize(("stiffness", "speed"), [(500.0, 0.1), (5e3, 0.1), (5e4, 0.01)])
@pytest.mark.parametrize("share", [0.1, pytest.param(0.2, marks=pytest.mark.proof), 0.4])
def test_two_newtons_are_held_without_loss_of_contact(stiffness: float, speed: float, share: float) -> None:
    # v sigma / (K |f|) limits the speed on stiffer contacts: K falls as the stiffness rises
    servo = SERVOS[0]
    gain = share * gt.control.delayed.gain_limit(L.force_loop(servo)).gain / stiffness
    hand = steady([100.0 * speed, 0.0, -3.0], 3000)
    run = L.guide(
        law_of(force_gain=gain, cone=0.0), hand, L.SyntheticSurface(stiffness=stiffness), servo,
        start=(0, 0, -2 / stiffness), noise=NOISE, seed=4,
    )  # fmt: skip
    assert abs(run.force[:, 2].mean() - 2) < 0.02
    assert run.contact.all() and run.force[:, 2].min() > 0


def off(cone: float, tilt: float, constant: float = 0.0) -> float:
    """Root mean square of the force less 2 N, mean of three seeds."""
    law = law_of(cone=np.radians(cone), normal_filter=constant)
    surface, runs = L.SyntheticSurface(tilt=np.radians(tilt)), []
    for seed in range(3):
        run = L.guide(law, ALONG, surface, start=PRESSED, noise=NOISE, seed=seed)
        runs.append(np.mean((np.linalg.norm(run.force[500:], axis=1) - 2) ** 2))
    return float(np.sqrt(np.mean(runs)))


def test_the_deviation_grows_with_the_cone_on_a_flat_surface_and_falls_on_a_tilted_one() -> None:
    flat, tilted = [off(c, 0.0) for c in (0, 5, 10)], [off(c, 4.0) for c in (0, 5, 10)]
    assert flat[0] < flat[1] < flat[2] and tilted[0] > tilted[1] > tilted[2]
    for tilt, raw in ((0.0, flat[2]), (4.0, tilted[2])):
        assert off(10, tilt, 0.2) < raw / 2


PRESS, RELEASE = 30.0, 15.0


def test_after_a_long_push_release_is_prompt_and_no_change_jumps() -> None:
    law = law_of()
    p = law.gains
    hand = np.vstack([steady([0, 0, -2.0], 250), steady([0, 0, -PRESS], 1000), steady([0, 0, RELEASE], 250)])
    run = L.guide(law, hand, start=(0, 0, 0.005))
    assert run.status is S.OK and not run.contact[0] and run.contact[250:1250].all()
    # the integral of the push without back-calculation would be 24 m/s
    speeds = np.linalg.norm(run.guided, axis=1)
    assert speeds.max() <= p.speed_limit + p.cycle / p.mass * (PRESS + p.damping * p.speed_limit)
    released = np.flatnonzero(run.force[1250:, 2] == 0)[0] * p.cycle
    assert released < 0.3 and run.command[1300:, 2].min() > 0
    changes = np.linalg.norm(np.diff(run.command, axis=0, prepend=0.0), axis=1)
    assert changes.max() <= p.acceleration_limit * p.cycle * (1 + 1e-12)
    assert np.count_nonzero(np.diff(run.contact.astype(int))) == 2


def test_the_same_call_gives_the_same_bytes() -> None:
    a, b = (L.guide(law_of(), ALONG[:300], noise=NOISE, seed=5).force.tobytes() for _ in range(2))
    assert a == b


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"handle": np.zeros((3, 2))}, "handle"),
        ({"handle": np.full((3, 3), np.nan)}, "handle"),
        ({"start": (0, 0)}, "start"),
        ({"noise": -1.0}, "noise"),
        ({"tool_mass": 0.0}, "tool_mass"),
        ({"sensor_sign": 0}, "sensor_sign"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(options: dict[str, Any], argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        L.guide(**({"law": law_of(), "handle": np.zeros((3, 3))} | options))
    assert caught.value.argument == argument
