"""Attitude between references: conventions that are found, the calibration, gaps bridged, on a synthetic twin of the
recording abb_imu, and on the recording itself where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.filtering import AttitudeJudging, AttitudeRecording, ReferenceNoise, SyntheticAttitude, smooth
from gtmodel.filtering.attitude import between_references, conventions as reading, gyro_calibration
from gtmodel.filtering.attitude.between_references import Bridge, HiddenStretch, gaps_of
from gtmodel.filtering.attitude.gyro_path import NoiseChain, RateCorrection, gyro_path
from gtmodel.filtering.attitude.recording import sampled_instants, synthetic_attitude
from gtmodel.results.refusal import ArgumentError
from tests.support.recordings import recording

FILE = recording("abb_imu/V1000_path3_MPU9150.mat")
PERIOD = 0.009963  # s, of the sensor by its own clock: SENScycle_time of the recording
CARRIED, CORRECTED, SLOW = 0, 1, 4


@pytest.fixture(scope="module")
def made() -> Any:
    return synthetic_attitude(SyntheticAttitude(seed=3))


@pytest.fixture(scope="module")
def twin() -> Any:
    return gt.filtering.attitude_study(
        SyntheticAttitude(seed=3), AttitudeJudging(calibrate_until=9.0, sample_period=PERIOD)
    )


def real_recording() -> AttitudeRecording:
    """As written: the lost sample, row 368, has no numbers; references are true at TokenPosition only."""
    data = loadmat(
        FILE, variable_names=["MATLABtime", "SENSgyro", "SENSacc", "TokenPosition", "ABBtime", "ABBquaternion"]
    )
    good = np.isfinite(data["SENSgyro"][0])
    place = data["TokenPosition"].ravel().astype(int) - 1
    there = place < good.size  # the last one lies behind the last sample
    quaternion = data["ABBquaternion"].T[place[there]]
    gyro = {"rate": data["SENSgyro"].T[good], "acceleration": data["SENSacc"].T[good]}
    return AttitudeRecording(
        gt.Trajectory(data["MATLABtime"].ravel()[good], gyro),
        gt.Trajectory(data["ABBtime"].ravel()[there], {"quaternion": quaternion}),
    )


def check_limits(study: Any, spline: tuple[float, float]) -> None:
    """The limits of the recording abb_imu, in degrees and factors, for gaps of 0.5 s and 1 s."""
    assert study.status.ok and study.gaps == (0.5, 1.0)
    error = np.degrees(study.error)
    assert np.all(error[:, CARRIED] <= [1.5, 2.5]) and np.all(error[:, CORRECTED] <= [0.9, 1.4])
    below = np.array(study.below_slerp)
    assert np.all(below[:, 0] >= [6, 10]) and np.all(below[:, 1] >= [10, 18])
    assert np.all(np.array(study.below_spline) >= spline)
    assert np.all(np.diff(error, axis=1)[:, 0] < 0) and np.all(np.array(study.starts) > 50)
    for first, second in zip(study.first_interval, study.second_interval, strict=True):
        assert first[0] <= second[1] and second[0] <= first[1]
    assert study.convention == "gyro in deg/s, quaternion w x y z, world to body"
    assert "sampled evenly" in study.clock and "read in g" in study.gravity


# -- the whole study ----------------------------------------------------------------------------------------


@pytest.mark.skipif(
    not FILE.is_file(), reason="abb_imu is not there; GTMODEL_RECORDINGS names the folder of recordings"
)
@pytest.mark.proof
def test_the_measured_arm() -> None:
    study = gt.filtering.attitude_study(real_recording(), AttitudeJudging(calibrate_until=9.0, sample_period=PERIOD))
    check_limits(study, (4, 9))
    assert study.synthetic is None and max(np.abs(np.degrees(study.numbers[9:12]))) < 0.02  # its rests show no bias
    assert 9.7 < float(study.gravity.split()[0]) < 9.9 and any("acceleration[2]" in note for note in study.notes)
    exchanged = np.degrees(study.exchanged)
    assert np.all(exchanged[:, CARRIED] <= [1.5, 2.5]) and np.all(exchanged[:, CORRECTED] <= [0.9, 1.4])


def test_the_twin(twin: Any, made: Any) -> None:
    check_limits(twin, (4, 9))
    assert "synthetic, seed 3" in twin.synthetic and twin.rows[-1].label == "SYNTHETIC"
    for name, true in zip(gyro_calibration.PART_NAMES, gyro_calibration.parts(made.correction.numbers), strict=True):
        low, high = twin.interval(name, 0.999)
        assert low < true < high, name
    assert 2e-3 < min(twin.timing) and max(twin.timing) < 4e-3  # 10 ms / sqrt(12) is 2.9 ms
    assert all(0.002 < r < 0.01 for r in twin.relative)
    assert all(c > 0.8 for row in twin.covered for c in row)
    assert all(f < 1.5 * row[CARRIED] for f, row in zip(twin.filtered, twin.error, strict=True))
    assert all(s < f for s, f in zip(twin.smoothed, twin.filtered, strict=True))
    assert twin.figure("errors").axes and twin.figure("residuals").axes
    table = twin.files["errors.csv"].splitlines()
    assert table[0].startswith("# synthetic") and len(table) > 500


def test_stops_and_says_so() -> None:
    study = gt.filtering.attitude_study(SyntheticAttitude(duration=6.0), max_seconds=1e-6)
    assert not study.status.ok and not study.error


@pytest.mark.parametrize(
    ("judging", "argument"),
    [
        (AttitudeJudging(calibrate_until=0.5), "judging.calibrate_until"),
        (AttitudeJudging(gaps=(30.0,)), "judging.gaps"),
    ],
)
def test_what_cannot_be_judged_is_refused(judging: AttitudeJudging, argument: str) -> None:
    with pytest.raises(gt.results.ArgumentError) as refused:
        gt.filtering.attitude_study(SyntheticAttitude(duration=6.0), judging)
    assert refused.value.argument == argument


def test_recordings_of_another_form_are_refused(made: Any) -> None:
    gyro, reference = made.recording.gyro, made.recording.reference
    for wrong in ((reference, gyro), (gt.Trajectory(gyro.time, {"rate": gyro["rate"][:, 0]}), reference)):
        with pytest.raises(gt.results.ArgumentError):
            AttitudeRecording(*wrong)


# -- conventions --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["deg/s", "rad/s", "counts of +-2000 deg/s"])
@pytest.mark.parametrize("direction", reading.DIRECTIONS)
@pytest.mark.parametrize("order", reading.ORDERS)
def test_however_it_is_written_it_is_found(made: Any, unit: str, direction: str, order: str) -> None:
    gyro, reference = made.recording.gyro, made.recording.reference
    time = sampled_instants(gyro.time, PERIOD)
    body = reading.rotations(reference["quaternion"], reading.ORDERS[0], reading.DIRECTIONS[1])
    written = (body if direction == reading.DIRECTIONS[0] else body.inv()).as_quat(
        scalar_first=order == reading.ORDERS[0]
    )
    rate = gyro["rate"] * reading.RATE_UNITS["deg/s"] / reading.RATE_UNITS[unit]
    written[::3] *= -1  # either sign is the same orientation
    units = ["deg/s", "rad/s", "mdeg/s", "counts of +-2000 deg/s", "counts of +-1000 deg/s"]
    tried = reading.conventions(time, rate, reference.time, written, rate_units=units)
    alike = [c for c in tried if c.log_likelihood > tried[0].log_likelihood - 1]
    assert {c.rate_unit for c in alike} == {unit} and len(alike) == 2
    assert tried[0].log_likelihood - tried[2].log_likelihood > 500
    rest = reading.resting(
        time, gyro["acceleration"], reference.time, written, alike, units=list(reading.ACCELERATION_UNITS)
    )
    assert rest is not None and rest.unit == "g"
    upright = alike[int(np.argmin([g.tilt for g in rest.gravity]))]
    assert (upright.order, upright.direction) == (order, direction)
    assert min(g.scatter for g in rest.gravity) < np.radians(2)


@pytest.mark.parametrize("unit", ["m/s2", "mg", "counts of +-2 g"])
def test_unit_of_the_accelerometer(made: Any, unit: str) -> None:
    gyro, reference = made.recording.gyro, made.recording.reference
    force = gyro["acceleration"] * reading.G / reading.ACCELERATION_UNITS[unit]
    one = reading.Convention("deg/s", *reading.ORDERS[:1], reading.DIRECTIONS[1], 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))
    time = sampled_instants(gyro.time, PERIOD)
    rest = reading.resting(
        time, force, reference.time, reference["quaternion"], [one], units=list(reading.ACCELERATION_UNITS)
    )
    assert rest is not None and rest.unit == unit and rest.length == pytest.approx(reading.G, rel=0.01)
    nothing = reading.resting(time, 0 * force, reference.time, reference["quaternion"], [one], units=["g"])
    assert nothing is None


def test_spikes_and_what_is_no_orientation_are_left_out() -> None:
    recorded = synthetic_attitude(SyntheticAttitude(seed=3, duration=9.0)).recording
    gyro, reference = recorded.gyro, recorded.reference
    quaternion = reference["quaternion"].copy()
    quaternion[40] *= 0.3  # interpolated through zero
    turned = Rotation.from_quat(quaternion[60], scalar_first=True) * Rotation.from_rotvec([0.4, 0.0, 0.0])
    quaternion[60] = turned.as_quat(scalar_first=True)
    wrong = AttitudeRecording(gyro, gt.Trajectory(reference.time, {"quaternion": quaternion}))
    study = gt.filtering.attitude_study(wrong, AttitudeJudging(sample_period=PERIOD, gaps=(0.5,)))
    assert study.left_out == [reference.time[40], reference.time[60]]
    assert any("left out" in note for note in study.notes)
    assert np.degrees(study.error[0][CORRECTED]) < 0.9


# -- instants -----------------------------------------------------------------------------------------------


def test_instants_of_rows_that_wait_in_a_buffer() -> None:
    rng = np.random.default_rng(0)
    taken = 0.01 * np.arange(400)
    late = rng.exponential(0.004, 400) * (rng.random(400) < 0.7)
    arrived = np.maximum.accumulate(np.maximum(taken + late, 1.2 + 0.001 * np.arange(400)))
    instants = sampled_instants(arrived, 0.01)
    np.testing.assert_allclose(instants, taken, atol=1e-12)
    lost = np.delete(arrived, [250, 300])  # instants step on, with the delay of the next prompt row
    wrong = sampled_instants(lost, 0.01) - np.delete(taken, [250, 300])
    assert wrong.min() > -1e-12 and wrong[252:].max() < 0.01 and np.sum(wrong[252:] > 1e-9) < 5  # before the second one
    for stamps, period, argument in ((arrived, 0.0, "period"), (arrived[::-1], 0.01, "stamps")):
        with pytest.raises(gt.results.ArgumentError) as refused:
            sampled_instants(stamps, period)
        assert refused.value.argument == argument


# -- calibration and gaps -----------------------------------------------------------------------------------


def test_parts_of_the_matrix() -> None:
    turn = Rotation.from_rotvec([0.1, -0.3, 0.2])
    stretch = np.array([[1.02, 0.01, -0.02], [0.01, 0.98, 0.03], [-0.02, 0.03, 1.01]])
    x = RateCorrection(turn.as_matrix() @ stretch, np.array([1.0, 2.0, 3.0]), 0.5).numbers
    expected = [0.1, -0.3, 0.2, 1.02, 0.98, 1.01, 0.03, -0.02, 0.01, 1.0, 2.0, 3.0, 0.5]
    np.testing.assert_allclose(gyro_calibration.parts(x), expected, atol=1e-14)


def test_without_noise_the_truth_comes_back() -> None:
    options = SyntheticAttitude(seed=5, duration=9.0, relative=0.0, noise=0.0, resolution=1e-6, lost=0)
    truth = synthetic_attitude(options)
    gyro, reference = truth.recording.gyro, truth.recording.reference
    time = sampled_instants(gyro.time, PERIOD)
    body = reading.rotations(reference["quaternion"], *("w x y z", "world to body"))
    fit = gt.filtering.calibrate_gyro(
        time, np.radians(gyro["rate"]), reference.time, body, RateCorrection(np.eye(3), np.zeros(3))
    )
    np.testing.assert_allclose(fit.correction.matrix, truth.correction.matrix, atol=2e-3)
    np.testing.assert_allclose(fit.correction.bias, truth.correction.bias, atol=5e-4)  # one count is 1e-3
    assert fit.correction.offset == pytest.approx(truth.correction.offset, abs=4e-4)  # the least delay is 0.3 ms


def test_covariance_of_residuals_against_drawn_ones() -> None:
    """Stamps and relative errors drawn as `ReferenceNoise` says, their residuals counted."""
    rng = np.random.default_rng(2)
    noise = ReferenceNoise(timing=2e-3, relative=0.01, floor=1e-4, persistence=0.2)
    time = 0.1 * np.arange(5)
    steps = Rotation.from_rotvec(rng.normal(0, 0.15, (4, 3)))
    rate = rng.normal(0, 2.0, (5, 3))
    C = noise.covariance(steps, rate, time)
    runs = 20000
    late = noise.timing * rng.standard_normal((runs, 5))
    at = late[:, :, None] * rate  # errors of the orientations, in the axes of the body there
    middle = (time[1:] + time[:-1]) / 2
    L = np.linalg.cholesky(noise.turn_covariance(steps.magnitude(), middle))
    own = np.einsum("kl,rlc->rkc", L, rng.standard_normal((runs, 4, 3)))
    back = steps.inv().as_matrix()
    r = at[:, 1:] - np.einsum("kab,rkb->rka", back, at[:, :-1]) + own
    drawn = np.einsum("ri,rj->ij", r.reshape(runs, -1), r.reshape(runs, -1)) / runs
    size = np.sqrt(np.diag(C))
    assert np.abs((drawn - C) / np.outer(size, size)).max() < 0.05


def test_gaps_hide_what_lies_inside() -> None:
    time = np.array([0.0, 0.1, 0.25, 0.5, 0.6, 0.75, 1.2])
    every = [(g.first, g.hidden.tolist(), g.last) for g in gaps_of(time, 0.5)]
    assert every == [(0, [1, 2], 3), (1, [2, 3], 4), (2, [3, 4], 5), (3, [4, 5], 6), (4, [5], 6)]


def test_the_correction_at_both_ends_is_the_smoother_of_the_filter() -> None:
    """The same gap by the closed form and by the error-state filter with its smoother, over all samples of the gyro."""
    rng = np.random.default_rng(4)
    time = 0.01 * np.arange(121)
    rate = np.column_stack([2 + np.sin(5 * time), 1.5 * np.cos(4 * time), -1 + time])
    at = np.array([0.0, 0.1, 0.25, 0.45, 0.6, 0.85, 1.0])
    noise = ReferenceNoise(timing=0.0, relative=0.02, floor=2e-5, persistence=1.5)
    path = gyro_path(time, rate, at, RateCorrection(np.eye(3), np.zeros(3)), derivative=True)
    reference = Rotation.random(rng=rng) * path.turn * Rotation.from_rotvec(np.outer(at, [0.03, -0.02, 0.04]))
    bridge = Bridge.over(HiddenStretch(0, np.arange(1, 6), 6), at, reference, path, noise, np.zeros((13, 13)))
    used = np.array([True, *[False] * 5, True])
    run = between_references.attitude_filter(time, rate, at, reference, noise, used)
    rows = np.searchsorted(run.time, at[1:6])
    size = (bridge.corrected[:-1] * bridge.carried[:-1].inv()).magnitude()
    causal = Rotation.from_quat(run["Q"][rows], scalar_first=True)
    assert (causal.inv() * bridge.carried[:-1]).magnitude().max() < 1e-5
    smoothed = Rotation.from_quat(smooth(run)["Q"][rows], scalar_first=True)
    assert np.all((smoothed.inv() * bridge.corrected[:-1]).magnitude() < 0.03 * size.max()) and size.max() > 0.02
    last = Rotation.from_quat(run["Q"][-1], scalar_first=True)
    assert (last.inv() * reference[6]).magnitude() < 1e-4


@pytest.mark.proof
def test_intervals_hold_the_truth() -> None:
    """Both parts of twelve synthetic recordings, thirteen numbers each: the gyro's error persists, so that few are
    independent, and intervals of the likeliest noise alone hold 88 % only."""
    held = []
    for seed in range(12):
        made = synthetic_attitude(SyntheticAttitude(seed=seed))
        gyro, reference = made.recording.gyro, made.recording.reference
        time = sampled_instants(gyro.time, PERIOD)
        body = reading.rotations(reference["quaternion"], reading.ORDERS[0], reading.DIRECTIONS[1])
        for part in (reference.time <= 9.0, reference.time > 9.0):
            rate, at, turned = np.radians(gyro["rate"]), reference.time[part], body[part]
            fit = gt.filtering.calibrate_gyro(time, rate, at, turned, reading.started(time, rate, at, turned, 0.0))
            low, high = fit.estimate.intervals()
            held.append((low < made.correction.numbers) & (made.correction.numbers < high))
    assert np.mean(held) >= 0.93 and np.mean(held, axis=0).min() >= 0.8


def bare_recording(**changed: Any) -> AttitudeRecording:
    """Without an accelerometer, some of its arrays replaced."""
    made = synthetic_attitude(SyntheticAttitude(duration=8.0, seed=3)).recording
    gyro, references = made.gyro, made.reference
    part = changed.pop("rows", slice(None))
    rate = gt.Trajectory(
        changed.get("time", gyro.time)[part], {"rate": changed.get("rate", gyro["rate"])[part]}, synthetic="synthetic"
    )
    quaternion = changed.get("quaternion", references["quaternion"])
    return AttitudeRecording(
        rate, gt.Trajectory(changed.get("at", references.time), {"quaternion": quaternion}, synthetic="synthetic")
    )


@pytest.mark.parametrize("what", ["rest", "another clock", "still references", "one row"])
def test_recordings_that_share_no_turn_are_refused(what: str) -> None:
    made = bare_recording()
    changed = {
        "rest": {"rate": 0 * made.gyro["rate"]},
        "another clock": {"at": made.reference.time + 100.0},
        "still references": {"quaternion": 0 * made.reference["quaternion"] + [1.0, 0.0, 0.0, 0.0]},
        "one row": {"rows": slice(0, 1)},
    }[what]
    with pytest.raises(ArgumentError, match="turn at no common time") as caught:
        gt.filtering.attitude_study(bare_recording(**changed))
    assert caught.value.argument == "recording"


def test_stamps_of_arrival_that_do_not_belong_to_the_references_are_refused() -> None:
    made = synthetic_attitude(SyntheticAttitude(seed=3)).recording  # seconds of rows wait when the reading begins
    with pytest.raises(ArgumentError, match="its stamps do not match") as caught:
        gt.filtering.attitude_study(AttitudeRecording(made.gyro.select(["rate"]), made.reference), AttitudeJudging(9.0))
    assert caught.value.argument == "judging.sample_period"


@pytest.mark.parametrize("noise", [(3e-3, 1e-2, 1e-4, 0.3), (1e-5, 1e-5, 0.1, 10.0), (0.02, 0.1, 1e-5, 5.0)])
def test_the_banded_likelihood_is_that_of_the_full_covariance(noise: tuple[float, float, float, float]) -> None:
    draw = np.random.default_rng(11)
    time = np.cumsum(draw.uniform(0.05, 0.1, 61))
    turn, rate = Rotation.from_rotvec(draw.normal(0, 0.1, (60, 3))), draw.normal(0, 1, (61, 3))
    rows, size = draw.normal(size=(180, 14)), ReferenceNoise(*noise)
    full = size.covariance(turn, rate, time)
    expected = rows.T @ np.linalg.solve(full, rows)
    gram, log_determinant = NoiseChain.of(turn, rate, time).gram(size, rows)
    close = 1e-14 * np.trace(full) / size.floor**2  # round-off of the inversion lemma
    assert np.allclose(gram, expected, rtol=0, atol=max(1e-12, close) * np.abs(expected).max())
    assert log_determinant == pytest.approx(np.linalg.slogdet(full)[1], abs=max(1e-9, 180 * close))
