"""Rotations and wrapped angles are taken as what they are: by resampling, motions, clocks, delays and identification.

Sets of the statistics, stated before they were run: clean recordings of seeds 4000 to 4399, damaged ones of seeds 5000
to 5199, four kinds of damage in turn; the first 20 of each in the ordinary suite.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

import gtmodel as gt
from gtmodel.measurements import AlignBy, EvenGrid, resample, resampling_study, smooth
from gtmodel.results import ArgumentError, TrajectoryError
from gtmodel.results.interpolation import natures

ROWS, STEP = 400, 0.01
CLEAN, DAMAGED = range(4000, 4400), range(5000, 5200)
MOST_ALARMS, LEAST_SEEN = 15, 190  # of 400 clean recordings and of 200 damaged ones
FEW = 12
NOISE = 1e-3  # rad, of each recording
# cubic curves through rows 10 ms apart, of turns with components up to 0.7 Hz: h^4 times the fourth derivative / 384,
# 1e-8 * (2 pi 0.7)^4 * 2 / 384 = 2e-8; jitter triples the longest step, which is to the fourth power 81 times that
CUBIC = 2e-6


def turning(rng: np.random.Generator, t: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """An attitude and an angle of several turns at times t, both smooth (synthetic)."""
    w, phase = rng.uniform(0.5, 4.4, (3, 2)), rng.uniform(0, 2 * np.pi, (3, 2))
    vector = np.sum(rng.uniform(0.2, 0.6, (3, 2)) * np.sin(w * t[:, None, None] + phase), axis=2)
    angle = rng.uniform(2.0, 6.0) * t + 0.4 * np.sin(w[0, 0] * t)
    return Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]) * Rotation.from_rotvec(vector), angle


def uneven(rng: np.random.Generator) -> np.ndarray:
    t = STEP * (np.arange(ROWS) + rng.uniform(-0.25, 0.25, ROWS))
    return t[rng.random(ROWS) > 0.02]


def recorded(rng: np.random.Generator, t: np.ndarray, noise: float, seed: object) -> gt.Trajectory:
    """Quaternions with signs by chance, one vector and four columns, an angle within half a turn, a distance."""
    R, angle = turning(rng, t)
    if noise:
        R = R * Rotation.from_rotvec(noise * rng.normal(size=(len(t), 3)))
    q = R.as_quat() * rng.choice([-1.0, 1.0], (len(t), 1))
    angle = angle + noise * rng.normal(size=len(t))
    x = np.sin(3 * t) + 0.5 * np.sin(5.3 * t + 1) + noise * rng.normal(size=len(t))
    single = {f"q{c}": column for c, column in zip("xyzw", q.T, strict=True)}
    values = {"q": q, **single, "a": (angle + np.pi) % (2 * np.pi) - np.pi, "x": x, "m": R.as_matrix().reshape(-1, 9)}
    units = {n: "1" for n in values} | {"a": "rad", "x": "m"}
    return gt.Trajectory(t, values, units, synthetic=f"seed {seed}, noise {noise:g} rad")


@pytest.mark.parametrize("method", ["cubic", "monotone", "linear"])
def test_what_is_between_the_rows_is_a_rotation(method: str) -> None:
    rng, again = np.random.default_rng(11), np.random.default_rng(11)
    t = uneven(rng)
    uneven(again)
    even = resample(recorded(rng, t, 0.0, 11), STEP, method=method)  # type: ignore[arg-type]
    time, made = even.trajectory.time, even.trajectory
    np.testing.assert_allclose(np.linalg.norm(made["q"], axis=1), 1.0, atol=1e-14)  # round-off of a division
    R, angle = turning(again, time)
    by_columns = np.column_stack([made[f"q{c}"] for c in "xyzw"])
    size = {"cubic": CUBIC, "monotone": 100 * CUBIC, "linear": 2e-3}[method]  # h^2 (2 pi 0.7)^2 / 8 = 2e-4 at h
    for rows in (Rotation.from_quat(made["q"]), Rotation.from_quat(by_columns),
                 Rotation.from_matrix(made["m"].reshape(-1, 3, 3))):  # fmt: skip
        assert (R.inv() * rows).magnitude().max() < size
    whole = np.round((made["a"] - angle)[0] / (2 * np.pi)) * 2 * np.pi
    assert np.abs(made["a"] - angle - whole).max() < size
    assert np.all(np.sum(made["q"][1:] * made["q"][:-1], axis=1) > 0.9)


def test_it_is_the_curve_of_a_spline_of_rotations() -> None:
    rng = np.random.default_rng(12)
    t = uneven(rng)
    log = recorded(rng, t, 0.0, 12)
    even = resample(log, STEP / 3).trajectory
    other = RotationSpline(t, Rotation.from_quat(log["q"]))(even.time)
    inner = slice(20, -20)  # the two differ in what they take for the ends
    assert (other.inv() * Rotation.from_quat(even["q"])).magnitude()[inner].max() < CUBIC


def test_the_speed_of_a_wrapped_angle_has_no_spike() -> None:
    t, turn = 0.004 * np.arange(2000), 2 * np.pi
    log = gt.Trajectory(t, {"q": (turn / 3 * t + 0.7 * turn) % turn}, {"q": "rad"})  # a third of a turn per second
    session = gt.measurements.session_of(log)
    # round-off over the step; of the filter's ends 1e-3 is left where they are cut (SETTLING_PERIODS)
    for low_pass, rtol in ((None, 1e-9), (gt.measurements.ZeroPhase(20.0), 1e-3)):
        moved = gt.measurements.motion(session, "q", low_pass)
        np.testing.assert_allclose(moved["der(q)"], turn / 3, rtol=rtol)


def test_a_filtered_quaternion_is_one() -> None:
    rng = np.random.default_rng(13)
    t = STEP * np.arange(ROWS)
    log = recorded(rng, t, NOISE, 13)
    moved = gt.measurements.motion(gt.measurements.session_of(log), "q", gt.measurements.ZeroPhase(15.0))
    np.testing.assert_allclose(np.linalg.norm(moved["q"], axis=1), 1.0, atol=1e-14)
    # |w| = 2 |dq/dt|: against the turns of the true motion, up to what central differences and noise leave
    R = [turning(np.random.default_rng(13), moved.time + s)[0] for s in (-1e-5, 1e-5)]
    speed = (R[0].inv() * R[1]).magnitude() / 2e-5
    inner = slice(30, -30)
    assert np.abs(2 * np.linalg.norm(moved["der(q)"], axis=1) - speed)[inner].max() < 0.35  # rad/s, of up to 10


def test_a_delay_of_a_wrapped_angle_moves_it_in_time_only() -> None:
    t = 0.01 * np.arange(800)
    late = 3.0 * (t - 0.02) + 0.2 * np.sin(2 * (t - 0.02))
    log = gt.Trajectory(t, {"q": (late + np.pi) % (2 * np.pi)}, {"q": "rad"})
    signals = {"q": gt.measurements.Signal("q", "rad", delay=0.02)}
    (session,) = gt.measurements.Corrections(signals, [gt.measurements.session_of(log)]).apply()
    at = session.trajectory.time
    expected = 3.0 * at + 0.2 * np.sin(2 * at) + np.pi
    np.testing.assert_allclose(session.trajectory["q"], expected, atol=CUBIC)


def test_plain_numbers_stay_as_they_are() -> None:
    t = 0.01 * np.arange(100)
    rng = np.random.default_rng(14)
    values = {"force": rng.normal(size=(100, 4)), "turns": 9.0 * t**2, "g": np.column_stack([0 * t, 0 * t, 0 * t + 1])}
    log = gt.Trajectory(t, values, {"force": "1", "turns": "rad", "g": "1"})
    assert not natures(log) and smooth(log) is log


def test_a_turn_whose_sense_is_not_clear_is_refused_with_its_time() -> None:
    t = 0.1 * np.arange(40)
    fast = gt.Trajectory(t, {"a": np.radians((110.0 * np.arange(40) + 180) % 360 - 180)}, {"a": "rad"})
    with pytest.raises(TrajectoryError, match=r"'a' turns by 110 deg from [\d.]+ s to [\d.]+ s") as told:
        resample(fast)
    assert "90 deg" in str(told.value)
    q = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    q[20:] = [0.0, 0.0, np.sin(1.0), np.cos(1.0)]  # 2 rad at once
    with pytest.raises(TrajectoryError, match=r"'q' turns by 114.6 deg from 1.9 s to 2 s"):
        resample(gt.Trajectory(t, {"q": q}, {"q": "1"}))
    q[20:] = q[0]
    q[7] *= 0.004
    with pytest.raises(TrajectoryError, match=r"1 of its 40 rows .* at 0.7 s, the worst .*0.004"):
        resample(gt.Trajectory(t, {"q": q + 1e-4 * np.sin(t)[:, None]}, {"q": "1"}))


def alarmed(seed: int, damage: int | None) -> bool:
    """Whether the study of a synthetic recording of two clocks raises an alarm, and else gives rotations."""
    rng = np.random.default_rng(seed)
    t = uneven(rng)
    log = recorded(rng, t, NOISE, seed)
    values = {n: log[n].copy() for n in log.names if n != "m"}
    late = STEP * np.arange(ROWS) * (1 + 2e-5) + rng.uniform(-0.2, 0.2)
    y = np.sin(3 * late) + 0.5 * np.sin(5.3 * late + 1) + NOISE * rng.normal(size=ROWS)
    at = int(rng.integers(50, 250))
    if damage == 0:  # lengths as they were seen: 0.004 to 1.2
        values["q"][at : at + 3] *= rng.choice([rng.uniform(0.004, 0.9), 1.2])
    elif damage == 1:  # the frame of the sensor flips for a stretch
        flip = Rotation.from_rotvec(np.pi * rng.permutation(np.eye(3))[0])
        values["q"][at : at + 60] = np.array((Rotation.from_quat(values["q"][at : at + 60]) * flip).as_quat(), float)
    elif damage == 2:  # it turns by 0.3 to 0.45 turns from row to row
        turn = 2 * np.pi * rng.uniform(0.3, 0.45)
        values["a"] = (turn * np.arange(len(t)) + np.pi) % (2 * np.pi) - np.pi
    elif damage == 3:  # another motion
        y = np.sin(4.1 * late + 0.1 * late**2 + 0.3) + NOISE * rng.normal(size=ROWS)
    first = gt.Trajectory(t, values, {n: log.unit(n) for n in values}, synthetic=log.synthetic)
    second = gt.Trajectory(STEP * np.arange(ROWS), {"y": y}, {"y": "m"}, synthetic=log.synthetic)
    try:
        study = resampling_study({"robot": first, "tracker": second}, EvenGrid(sample_time=STEP), [AlignBy("x", "y")])
    except ArgumentError:
        return True
    made = study.trajectory
    assert made is not None
    np.testing.assert_allclose(np.linalg.norm(made["q"], axis=1), 1.0, atol=1e-14)
    return study.status is not gt.results.SolveStatus.SOLVED


@pytest.mark.parametrize("few", [True, pytest.param(False, marks=pytest.mark.proof)])
def test_clean_recordings_raise_no_alarm_and_damaged_ones_do(few: bool) -> None:
    clean, damaged = (seeds[:FEW] if few else seeds for seeds in (CLEAN, DAMAGED))
    raised = sum(alarmed(seed, None) for seed in clean)
    seen = sum(alarmed(seed, seed % 4) for seed in damaged)
    assert raised <= (0 if few else MOST_ALARMS)
    assert seen >= (FEW if few else LEAST_SEEN)
