"""The studies: what they answer, what their checks refuse, that they repeat."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

L = gt.control.lead_through
PHASES = [L.GuidePhase(1.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(3.0, force=(5.0, 0.0, -3.0))]
RANGE = L.StiffnessRange(500.0, 5000.0)


def of(**given: Any) -> Any:
    standing: dict[str, Any] = {"contact": L.SyntheticSurface(), "phases": PHASES, "hands": None, "stiffness": RANGE}
    return L.study(**(standing | given))


@pytest.fixture(scope="module")
def standing() -> Any:
    return of()


def test_the_gain_is_that_share_of_the_limit_at_the_stiffest_contact(standing: Any) -> None:
    s = standing
    assert s.status.ok and s.loop_gain == pytest.approx(0.4 * s.limit)
    assert s.simulated_limit == pytest.approx(s.limit, rel=0.05)
    assert s.simulated_frequency == pytest.approx(s.frequency, abs=2.0)
    assert s.gain_limits == pytest.approx(s.limit / np.array(s.stiffnesses))
    assert abs(s.mean_force - 2) < 0.02 and s.contact_losses == 0 and s.gain_share == 1.0
    assert s.checks["energy_deficit_share"].value <= 1e-2
    assert "synthetic" in s.title and "time_s" in s.files["samples.csv"]


def test_the_same_call_gives_the_same_bytes(standing: Any) -> None:
    assert of().files == standing.files


@pytest.mark.parametrize("which", ["tool", "handle"])
def test_a_sensor_of_the_wrong_sign_moves_nothing(which: str) -> None:
    s = of(**{which: L.SyntheticSensor(sign=-1.0)})
    assert s.status is gt.SolveStatus.CHECK_FAILED and not s.checks["sensors_usable"].passed
    assert s.run is None and s.mean_force is None and not s.figures


def test_without_a_mass_the_sign_is_not_known_and_nothing_moves() -> None:
    assert not of(tool=L.SyntheticSensor(mass=0.0)).checks["sensors_usable"].passed


def test_a_stiffer_contact_than_declared_is_said_and_the_gain_falls() -> None:
    s = of(contact=L.SyntheticSurface(stiffness=15e3), setup=L.GuideSetup(start=(0.0, 0.0, 0.001)))
    assert s.gain_share < 0.7 and any("outside the declared range" in n for n in s.notes)
    unwatched = of(contact=L.SyntheticSurface(stiffness=15e3), watch=L.OscillationWatch())
    assert not unwatched.checks["loop_gain_over_limit"].passed and unwatched.contact_losses > 0


def test_hands_beyond_the_limit_fail_with_the_limit_said() -> None:
    s = of(hands=L.HandRange(stiffness=(0.0, 20e3), draws=20))
    assert not s.checks["hand_damping"].passed and 1e3 < s.stiffest_hand < 20e3
    assert any(f"{s.stiffest_hand:.4g} N/m" in n for n in s.notes)


def test_never_in_contact_is_said() -> None:
    s = of(phases=[L.GuidePhase(1.0, force=(0.0, 0.0, 1.0))])
    assert not s.checks["settled_contact_s"].passed and s.mean_force is None and s.status is gt.SolveStatus.CHECK_FAILED


@pytest.mark.parametrize(
    ("friction", "start", "failed"),
    [
        (1.5, 2e-3, {"depth_mm", "misalignment_deg"}),
        (0.1, 0.2, {"contact_s", "depth_mm", "misalignment_deg"}),
    ],
    ids=["jams", "never touches"],
)
def test_a_peg_that_does_not_arrive_is_no_success(friction: float, start: float, failed: set[str]) -> None:
    gains = L.SurfaceGains(
        any_direction=True, force_gain=0.002, force_reference=0.0, enter_force=0.3, leave_force=0.05, least_force=0.05,
        contact_arm=0.01, normal_filter=0.0, dwell=0.02,
    )  # fmt: skip
    hole = L.SyntheticHole(np.radians(5.0), 0.25e-3, 0.08, stiffness=5e3, friction=friction)
    s = L.study(
        hole, [L.GuidePhase(5.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(2.0)], gains, L.TurningGains(torque_gain=1.0),
        setup=L.GuideSetup(start=(0.0, 0.0, start)), hands=None,
    )  # fmt: skip
    assert s.status is gt.SolveStatus.CHECK_FAILED
    assert failed == {name for name in ("contact_s", "depth_mm", "misalignment_deg") if not s.checks[name].passed}


@pytest.mark.parametrize(
    ("given", "argument"),
    [
        ({"phases": []}, "phases"),
        ({"contact": L.SyntheticHole(), "stiffness": None}, "gains.any_direction"),
        ({"gains": L.SurfaceGains(any_direction=True)}, "gains.any_direction"),
        ({"contact": L.SyntheticHole(), "gains": L.SurfaceGains(any_direction=True)}, "stiffness"),
        ({"setup": 3}, "setup"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(given: dict[str, Any], argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        of(**given)
    assert caught.value.argument == argument


SENSOR = L.SyntheticSensor(
    mass=0.9, centre=(0.01, -0.02, 0.12), force_bias=(3.0, -1.0, 2.0), point=(0.03, -0.1, 0.22),
    moment_bias=(0.1, 0.2, 0.0), force_noise=0.05, moment_noise=0.003,
)  # fmt: skip


def recorded(sensor: Any, poses: int = 24, **more: Any) -> gt.Trajectory:
    rng = np.random.default_rng(5)
    turns = scipy.spatial.transform.Rotation.random(poses, rng=rng)
    f, m = sensor.readings_at_rest(turns.as_matrix(), rng)
    values = {"turn": turns.as_rotvec(), "force": f, "moment": m} | more
    units = {"turn": "rad", "force": "N", "moment": "N.m"}
    return gt.Trajectory(
        np.arange(float(poses)), values, {n: units[n] for n in values}, synthetic="seed 5, noise of the sensor"
    )


def test_intervals_of_bias_mass_and_centre_hold_the_truth_as_often_as_they_say() -> None:
    s = L.wrench_study(L.SyntheticReadings(SENSOR))
    assert s.status.ok and s.checks["least_coverage"].passed and len(s.coverage) == 13
    assert s.arm == pytest.approx(SENSOR.point, abs=5e-3)


def test_measured_readings_and_pushes() -> None:
    s = L.wrench_study(recorded(SENSOR), force_noise=0.05, moment_noise=0.003)
    assert s.mass == pytest.approx(0.9, abs=0.01) and s.centre == pytest.approx(SENSOR.centre, abs=2e-3)
    assert s.arm is None and s.coverage is None and s.usable == "OK"


def test_no_mass_is_a_status_and_never_a_number_that_is_none() -> None:
    s = L.wrench_study(recorded(L.SyntheticSensor(mass=0.0)))
    assert s.usable == "NO_FORCE" and s.centre is None and s.status is gt.SolveStatus.CHECK_FAILED
    assert np.isfinite(s.force_bias).all()


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (
            lambda: L.wrench_study(gt.Trajectory(np.arange(3.0), {"force": np.zeros((3, 3))}, {"force": "N"})),
            "readings",
        ),
        (lambda: L.wrench_study(recorded(SENSOR, force=np.zeros((24, 2)))), "readings"),
        (lambda: L.wrench_study(recorded(SENSOR), recorded(SENSOR)), "force_noise"),
        (lambda: L.wrench_study(L.SyntheticReadings(SENSOR), recorded(SENSOR)), "pushes"),
        (lambda: L.wrench_study(recorded(SENSOR), force_noise=-1.0), "force_noise"),
    ],
)
def test_readings_that_do_not_fit_are_refused_by_their_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


def test_contact_that_noise_begins_is_said(standing: Any) -> None:
    assert not any("noise can start it" in n for n in standing.notes)
    assert any("noise can start it" in n for n in of(tool=L.SyntheticSensor(force_noise=0.5)).notes)


def test_a_limit_that_runs_do_not_show_is_no_limit_of_runs() -> None:
    s = of(servo=L.ServoChain(lag=5.0), stiffness=None)
    assert s.simulated_limit is None and "limits_apart" not in s.checks
    assert any("eigenvalues alone" in n for n in s.notes)


def test_rounding_that_is_left_of_a_run_does_not_count_as_growth() -> None:
    gains, servo = L.SurfaceGains(cycle=0.02), L.ServoChain()
    limit = gt.control.delayed.gain_limit(L.force_loop(servo, gains.cycle))
    assert L.simulated_limit(gains, servo, limit.gain)[0] == pytest.approx(limit.gain, rel=0.05)


def test_a_felt_mass_that_swings_by_itself_is_refused() -> None:
    for given, argument in (
        (lambda: L.SurfaceGains(mass=0.2), "mass"),  # 4 ms, 100 N s/m: unstable up to 0.2 kg
        (lambda: of(turning=L.TurningGains(by_handle=True, inertia=0.002)), "turning.inertia"),
    ):
        with pytest.raises(ArgumentError) as caught:
            given()
        assert caught.value.argument == argument
    assert L.SurfaceGains(mass=0.21).mass == 0.21


NOISES: Any = {"force_noise": 0.05, "moment_noise": 0.003}


@pytest.mark.parametrize("stated", [{}, NOISES], ids=["noise from residuals", "noise stated"])
def test_a_pose_that_touched_something_fails_the_calibration(stated: Any) -> None:
    good = recorded(SENSOR)
    assert L.wrench_study(good, **stated).status.ok
    for signal, by in (("force", 3.0), ("moment", 0.3)):
        rows = np.array(good[signal])
        rows[5, 0] += by
        s = L.wrench_study(recorded(SENSOR, **{signal: rows}), **stated)
        failed = [name for name, check in s.checks.items() if not check.passed]
        assert failed[0] == "wrench_usable" and f"{signal}_largest_residual" in failed
        assert all(name.startswith(signal) for name in failed[1:]) and s.status is gt.SolveStatus.CHECK_FAILED


def test_readings_that_stop_at_an_end_are_said() -> None:
    rows = np.clip(np.array(recorded(SENSOR)["force"]), -6.0, 6.0)
    assert any("saturated" in n for n in L.wrench_study(recorded(SENSOR, force=rows)).notes)
    assert not any("saturated" in n for n in L.wrench_study(recorded(SENSOR)).notes)


def test_a_run_that_a_sensor_stops_on_the_way_says_when() -> None:
    s = of(phases=[*PHASES, L.GuidePhase(0.2, force=(500.0, 0.0, 0.0))])
    assert not s.checks["sensors_usable"].passed and s.run is None
    assert any("stopped at 4 s" in n for n in s.notes)
    assert not any("stopped at" in n for n in of(tool=L.SyntheticSensor(sign=-1.0)).notes)


@pytest.mark.parametrize("asked", [1, 2])
def test_stopped_it_keeps_the_limits_and_the_run(asked: int, standing: Any) -> None:
    looks = iter(range(100))
    s, whole = of(hands=L.HandRange(), stop=lambda: next(looks) >= asked), standing
    assert s.status is gt.SolveStatus.INTERRUPTED and "so far" in s.message
    assert (s.limit, s.simulated_limit, s.gain_limits) == (whole.limit, whole.simulated_limit, whole.gain_limits)
    assert (s.mean_force, s.least_window) == ((None, None) if asked == 1 else (whole.mean_force, whole.least_window))
    assert s.hand_damping is None and set(s.checks) < {*whole.checks, "hand_damping"}
