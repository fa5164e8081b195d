"""Calibration of force sensors: exact data, coverage of the intervals, a load without mass, signs, lever arms."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

L = gt.control.lead_through
S = L.WrenchStatus

G = np.array([0.0, 0.0, -9.81])
BIAS_F, BIAS_M = np.array([3.0, -1.0, 2.0]), np.array([0.1, 0.2, -0.3])
MASS, CENTRE = 0.9, np.array([0.01, -0.02, 0.12])
NOISE_F, NOISE_M = 0.05, 0.003  # synthetic
TRUTH = dict(zip(["bias_force_x", "bias_force_y", "bias_force_z", "mass"], [*BIAS_F, MASS], strict=True))
TRUTH_M = dict(
    zip([f"{w}_{a}" for w in ("bias_moment", "first_moment") for a in "xyz"], [*BIAS_M, *(MASS * CENTRE)], strict=True)
)
TRUTH_C = dict(zip(["centre_x", "centre_y", "centre_z"], CENTRE, strict=True))
TURNS = scipy.spatial.transform.Rotation.random(24, rng=np.random.default_rng(4)).as_matrix()
ROUNDING = 1e-11
RUNS = pytest.mark.parametrize("count", [60, pytest.param(400, marks=pytest.mark.proof)])


def readings(turns: np.ndarray, rng: Any = None, mass: float = MASS) -> tuple[np.ndarray, np.ndarray]:
    """By the wrench of every particle: three that have the mass and the centre together, and a row of noise."""
    at = CENTRE + np.array([[0.05, 0.02, -0.01], [-0.03, 0.01, 0.04], [-0.02, -0.03, -0.03]])
    f, m = np.zeros((len(turns), 3)), np.zeros((len(turns), 3))
    for k, R in enumerate(turns):
        pulls = [R.T @ (mass / 3 * G) for _ in at]
        f[k] = BIAS_F + np.sum(pulls, axis=0)
        m[k] = BIAS_M + np.sum([np.cross(p, pull) for p, pull in zip(at, pulls, strict=True)], axis=0)
    if rng is not None:
        f, m = f + NOISE_F * rng.normal(size=f.shape), m + NOISE_M * rng.normal(size=m.shape)
    return f, m


def one(rng: Any, _: int, known: bool) -> Any:
    sigma = {"sigma_force": NOISE_F, "sigma_moment": NOISE_M} if known else {}
    return L.calibrate_wrench(TURNS, *readings(TURNS, rng), **sigma)


def test_exact_readings_give_the_truth_and_leave_no_contact() -> None:
    c = L.calibrate_wrench(TURNS, *readings(TURNS))
    assert c.status is S.OK
    for estimate, truth in ((c.force, TRUTH), (c.moment, TRUTH_M), (c.centre, TRUTH_C)):
        assert [estimate.value(n) for n in truth] == pytest.approx(list(truth.values()), abs=ROUNDING)
    assert np.abs(c.contact(TURNS, *readings(TURNS))).max() < ROUNDING


@RUNS
@pytest.mark.parametrize("known", [True, False], ids=["noise known", "noise from residuals"])
def test_intervals_hold_the_truth_as_often_as_they_say(known: bool, count: int) -> None:
    runs = gt.inference.monte_carlo(partial(one, known=known), count, seed=25, processes=0).results
    for part, truth in (("force", TRUTH), ("moment", TRUTH_M), ("centre", TRUTH_C)):
        seen = gt.inference.coverage([getattr(r, part) for r in runs], truth)
        assert not seen.outside and not seen.biased, str(seen)


def test_without_a_mass_the_status_says_so_and_the_bias_remains() -> None:
    f, m = readings(TURNS, np.random.default_rng(2), mass=0.0)
    c = L.calibrate_wrench(TURNS, f, m)
    assert c.status is S.NO_FORCE and c.centre is None
    assert c.force.values[:3] == pytest.approx(BIAS_F, abs=5 * NOISE_F / np.sqrt(len(TURNS)))
    assert np.isfinite(c.contact(TURNS, f, m)).all()
    assert L.sign_test(c, np.eye(3), f[:1], sigma=NOISE_F).status is S.NO_FORCE


def test_a_sensor_that_reports_the_force_by_the_tool_is_known_by_its_negative_mass() -> None:
    f, m = readings(TURNS, np.random.default_rng(3))
    c = L.calibrate_wrench(TURNS, -f, -m)
    assert c.status is S.WRONG_SIGN
    assert c.centre.values == pytest.approx(CENTRE, abs=0.01)
    with pytest.raises(ArgumentError):
        c.contact(TURNS, -f, -m)


def test_a_turned_world_changes_nothing() -> None:
    f, m = readings(TURNS, np.random.default_rng(5))
    Q = scipy.spatial.transform.Rotation.from_rotvec([0.3, -1.2, 0.8]).as_matrix()
    a, b = L.calibrate_wrench(TURNS, f, m), L.calibrate_wrench(Q @ TURNS, f, m, gravity=Q @ G)
    for part in ("force", "moment", "centre"):
        assert getattr(a, part).values == pytest.approx(getattr(b, part).values, abs=1e-12)


def test_sign_is_told_against_noise_and_drift() -> None:
    c = L.calibrate_wrench(TURNS, *readings(TURNS))
    f = readings(TURNS[:1])[0]
    for reading, drift, status in ((f, 2.0, S.OK), (2 * BIAS_F - f, 2.0, S.WRONG_SIGN), (f, 9.0, S.NO_FORCE)):
        assert L.sign_test(c, TURNS[0], reading, sigma=NOISE_F, drift=drift).status is status


ARM = np.array([0.03, -0.1, 0.22])


def pushes(rng: Any, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    f = 15.0 * rng.normal(size=(count, 3))
    m = np.cross(ARM, f)
    return f + NOISE_F * rng.normal(size=f.shape), m + NOISE_M * rng.normal(size=m.shape)


def arm_of(rng: Any, _: int) -> Any:
    return L.lever_arm(*pushes(rng), sigma_force=NOISE_F, sigma_moment=NOISE_M).estimate


@RUNS
def test_intervals_of_a_lever_arm_hold_the_truth_as_often_as_they_say(count: int) -> None:
    runs = gt.inference.monte_carlo(arm_of, count, seed=26, processes=0).results
    seen = gt.inference.coverage(runs, dict(zip(["arm_x", "arm_y", "arm_z"], ARM, strict=True)))
    assert not seen.outside and not seen.biased, str(seen)


TRUE = L.calibrate_wrench(TURNS, *readings(TURNS))


def arm_after_few_poses(rng: Any, _: int) -> Any:
    c = L.calibrate_wrench(TURNS[:4], *readings(TURNS[:4], rng), sigma_force=NOISE_F, sigma_moment=NOISE_M)
    f = 15.0 * rng.normal(size=(200, 3))
    turns = np.tile(np.eye(3), (200, 1, 1))
    (weight, moment), m = TRUE.weight(turns), np.cross(ARM, f)
    f = f + BIAS_F + weight + NOISE_F * rng.normal(size=f.shape)
    m = m + TRUE.moment.values[:3] + moment + NOISE_M * rng.normal(size=m.shape)
    own = c.contact(turns, f, m)
    return L.lever_arm(*own, sigma_force=NOISE_F, sigma_moment=NOISE_M, calibration=c, turns=turns).estimate


@RUNS
def test_intervals_of_a_lever_arm_hold_what_the_calibration_leaves_open(count: int) -> None:
    runs = gt.inference.monte_carlo(arm_after_few_poses, count, seed=27, processes=0).results
    seen = gt.inference.coverage(runs, dict(zip(["arm_x", "arm_y", "arm_z"], ARM, strict=True)))
    assert not seen.outside and not seen.biased, str(seen)


def test_about_its_lever_arm_a_push_has_no_moment() -> None:
    f = np.random.default_rng(6).normal(size=(7, 3))
    assert np.abs(L.moment_about(f, np.cross(ARM, f), ARM)).max() < 1e-14


def test_pushes_in_one_direction_or_none_are_a_status() -> None:
    rng = np.random.default_rng(7)
    for f, status in (
        (np.tile([0.0, 0.0, 30.0], (20, 1)), S.ONE_DIRECTION),
        (np.zeros((20, 3)), S.NO_FORCE),
    ):
        noisy = f + NOISE_F * rng.normal(size=f.shape)
        arm = L.lever_arm(noisy, np.cross(ARM, f), sigma_force=NOISE_F, sigma_moment=NOISE_M)
        assert arm.status is status and arm.estimate is None


def calibrated(**other: Any) -> Any:
    f, m = readings(TURNS)
    return L.calibrate_wrench(**({"turns": TURNS, "forces": f, "moments": m} | other))


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: calibrated(turns=TURNS[:, :2]), "turns"),
        (lambda: calibrated(turns=-TURNS), "turns"),
        (lambda: calibrated(turns=2 * TURNS), "turns"),
        (lambda: calibrated(turns=np.full((24, 3, 3), np.nan)), "turns"),
        (lambda: calibrated(turns=np.tile(np.eye(3), (24, 1, 1))), "turns"),
        (lambda: calibrated(forces=np.zeros((23, 3))), "forces"),
        (lambda: calibrated(moments=np.full((24, 3), np.inf)), "moments"),
        (lambda: calibrated(gravity=[0, 0, 0]), "gravity"),
        (lambda: calibrated(gravity=[0, 9.81]), "gravity"),
        (lambda: calibrated(sigma_force=0.0), "sigma_force"),
        (lambda: calibrated(sigma_moment=-1.0), "sigma_moment"),
        (lambda: L.sign_test(calibrated(), TURNS, [[0.0, 0, 0]], sigma=0.1), "turn"),
        (lambda: L.sign_test(calibrated(), TURNS[0], [[0.0, 0, 0]], sigma=0.1, drift=-1), "drift"),
        (lambda: L.lever_arm(np.ones((2, 3)), np.ones((3, 3)), sigma_force=0.1, sigma_moment=0.1), "moments"),
        (lambda: L.moment_about([1, 2, 3], [1, 2], [0, 0, 0]), "moment"),
        (lambda: L.moment_about([1, 2, 3], [1, 2, 3], [[0, 0, 0]]), "point"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


def test_poses_that_hardly_differ_are_refused_where_the_weight_is_not_seen() -> None:
    rng = np.random.default_rng(8)
    alike = scipy.spatial.transform.Rotation.from_rotvec(1e-4 * rng.normal(size=(24, 3))).as_matrix()
    for known in ({}, {"sigma_force": NOISE_F, "sigma_moment": NOISE_M}):
        with pytest.raises(ArgumentError) as caught:  # its bias was off by tens of newtons and said to be usable
            L.calibrate_wrench(alike, *readings(alike, rng), **known)
        assert caught.value.argument == "turns"


@pytest.mark.parametrize("case", ["swapped", "half", "turned"])
def test_another_load_sensor_or_frame_is_no_passed_sign_test(case: str) -> None:
    c = L.calibrate_wrench(TURNS, *readings(TURNS))
    R = TURNS[0]
    weight = R.T @ (MASS * G)
    by = scipy.spatial.transform.Rotation.from_rotvec(np.deg2rad(45.0) * np.cross(weight, [1.0, 0, 0]) / np.linalg.norm(
        np.cross(weight, [1.0, 0, 0]))).as_matrix()  # fmt: skip
    read = {"swapped": 0.3 / MASS * weight, "half": 0.5 * weight, "turned": by @ weight}[case]
    test = L.sign_test(c, R, [BIAS_F + read], sigma=NOISE_F)
    assert test.status is S.WRONG_LOAD and not test.status.ok
    assert L.sign_test(c, R, [BIAS_F + read], sigma=NOISE_F, drift=5.0 if case == "turned" else 3.0).status in (
        S.OK, S.NO_FORCE,
    )  # fmt: skip
    assert L.sign_test(c, R, [BIAS_F + 0.9 * weight], sigma=NOISE_F).status is S.OK
