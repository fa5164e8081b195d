"""A gyro whose bias drifts: derivatives by differences, named if left out, estimated; synthetic, by seed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.filtering import AttitudeRecording, RateCorrection
from gtmodel.filtering.attitude.gyro_path import gyro_path
from gtmodel.measurements.drift import DriftBasis
from gtmodel.results import ArgumentError, Trajectory
from gtmodel.results.suspicion import alarms

DRIFT = np.array([4e-4, -2e-4, 3e-4])  # rad/s2, 0.02 deg/s in a second: a low-cost gyro that warms up
MADE = gt.filtering.SyntheticAttitude(duration=11.0, relative=0.002)


def test_the_path_with_a_drift_is_that_of_corrected_readings_and_its_derivative_that_of_differences() -> None:
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 4.0, 401)
    reading = np.cumsum(rng.normal(size=(401, 3)), axis=0) / 20
    columns = np.column_stack([time - 4.0, np.sin(time)])
    at = np.array([0.0, 1.1, 2.5, 3.9])
    x = np.concatenate([np.eye(3).ravel(), [0.01, 0.02, -0.01, 0.0], 0.05 * rng.normal(size=6)])
    both = np.column_stack([reading, columns])
    path = gyro_path(time, both, at, RateCorrection.of(x), derivative=True)
    plain = gyro_path(time, reading - columns @ x[13:].reshape(2, 3), at, RateCorrection.of(x[:13]))
    assert np.abs((path.turn.inv() * plain.turn).magnitude()).max() < 1e-12
    assert path.derivative is not None and path.derivative.shape == (4, 3, 19)
    for k in range(13, 19):
        near = [gyro_path(time, both, at, RateCorrection.of(x + s * 1e-6 * np.eye(19)[k])).turn for s in (1, -1)]
        moved = (near[0] * near[1].inv()).as_rotvec() / 2e-6
        assert path.derivative[:, :, k] == pytest.approx(moved, abs=1e-6)


def drifting(condition: str, seed: int = 1, size: float = 1.0) -> AttitudeRecording:
    """A synthetic recording whose rate reads more by a drift of the sensor's own axes."""
    made = gt.filtering.synthetic_attitude(replace(MADE, seed=seed)).recording
    time = made.gyro.time
    kelvin = 300.0 + 10.0 * (1 - np.exp(-(time - time[0]) / 6.0))
    amount = time if condition == "linear" else 2.0 * (kelvin - 300.0)
    values = {name: made.gyro[name] for name in made.gyro.names}
    values["rate"] = values["rate"] + np.degrees(size * np.outer(amount, DRIFT))
    values["temperature"] = kelvin
    gyro = Trajectory(time, values, {"temperature": "K"}, synthetic=made.gyro.synthetic)
    return AttitudeRecording(gyro, made.reference)


def judged(recording: AttitudeRecording, **other: Any) -> Any:
    judging = gt.filtering.AttitudeJudging(gaps=(0.5,), sample_period=MADE.sample_period, **other)
    return gt.filtering.attitude_study(recording, judging)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("condition", "word", "per"),
    [pytest.param("linear", "drift", 1.0, marks=pytest.mark.proof), ("temperature", "thermal", 2.0)],
)
def test_a_drift_of_the_bias_is_named_and_once_estimated_its_interval_holds(
    condition: str, word: str, per: float
) -> None:
    left_out = judged(drifting(condition))
    failed = [name for name in ("gyro_drift", "gyro_temperature") if not left_out.checks[name].passed]
    assert failed
    assert any("judging.drift" in note and "rad/s" in note for note in left_out.notes)
    study = judged(drifting(condition), drift=condition)
    true = Rotation.from_rotvec([0.02, -0.03, 0.065]).as_matrix() @ DRIFT * per
    for k in range(3):
        low, high = study.interval(f"bias_{word}[{k}]", 0.999)
        assert low <= true[k] * 1.03 and true[k] * 0.97 <= high  # the stretch of the sensor is 2 %
        assert high - low < 1e-2
    assert all(study.checks[name].passed for name in ("gyro_drift", "gyro_temperature") if name in study.checks)
    assert any(row.label == f"bias_{word}[0]" for row in study.rows)


@pytest.mark.parametrize("count", [3, pytest.param(60, marks=pytest.mark.proof)])
def test_a_steady_bias_names_no_drift(count: int) -> None:
    """By the calibration alone, of which each takes a second."""
    named = 0
    for seed in range(10, 10 + count):
        made = gt.filtering.synthetic_attitude(replace(MADE, seed=seed)).recording
        time = gt.filtering.sampled_instants(made.gyro.time, MADE.sample_period)
        body = Rotation.from_quat(made.reference["quaternion"], scalar_first=True).inv()
        start = RateCorrection(np.eye(3), np.zeros(3))
        fit = gt.filtering.calibrate_gyro(time, np.radians(made.gyro["rate"]), made.reference.time, body, start)
        named += bool(alarms(fit.doubts))
    assert named <= gt.inference.binomial_band(count, 0.01)[1]


def test_a_drift_with_an_unknown_temperature_is_an_error() -> None:
    bare = drifting("linear")
    bare = AttitudeRecording(bare.gyro.select(["rate"]), bare.reference)
    for drift, argument in (("temperature", "recording"), ("blocks", "drift")):
        with pytest.raises(ArgumentError) as caught:
            judged(bare, drift=drift)
        assert caught.value.argument == argument


def test_the_basis_is_zero_at_its_origin() -> None:
    basis = DriftBasis(
        ("linear", "temperature"), np.arange(3.0), None, np.array([290.0, 291.0, 295.0]), origin=(1.0, 291.0)
    )
    assert [column.tolist() for _, _, column in basis.columns()] == [[-1.0, 0.0, 1.0], [-1.0, 0.0, 4.0]]


def test_a_synthetic_log_with_a_drift_is_judged_by_its_truth() -> None:
    study = gt.filtering.attitude_study(
        replace(MADE, drift=4e-4, seed=3),
        gt.filtering.AttitudeJudging(gaps=(0.5,), sample_period=MADE.sample_period, drift="linear"),
    )
    assert study.checks["true_numbers"].passed and study.checks["gyro_drift"].passed
    for k in range(3):
        low, high = study.interval(f"bias_drift[{k}]", 0.999)
        # the sensor's axes lie within 5 degrees of the body's
        assert low < 4e-4 * 1.1 and high > 4e-4 * 0.9
