"""A tracker whose readings drift: named if left out, estimated, silent without a drift; synthetic, by seed.

A set: 80 poses of the three-link robot in random order over two hours, noise of 5 um (drives) and 20 um (tracker), and
0.3 mm of drift of the tracker over the recording, in its own frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.calibrate import Calibration, Choice, Measured, MeasuredSignal, Measurements, Pose, calibrate, read_poses
from gtmodel.calibrate.report.device_drift import device_drifts
from gtmodel.calibrate.report.findings import length_covariance
from gtmodel.measurements import ClockColumn
from gtmodel.results import ArgumentError
from gtmodel.results.suspicion import alarms

from .synthetic import disturbed, poses, true_robot

POSES, SIZE, SEED = 80, 3e-4, 431
TIME = np.linspace(-7200.0, 0.0, POSES)
KELVIN = 3.0 * np.exp(TIME / 1800.0) - 3.0 + 0.3 * np.sin(TIME / 300.0)
WAY = np.array([0.6, 0.0, -0.8])
TURN = scipy.spatial.transform.Rotation.from_rotvec([0.1, -0.2, 0.4])
NOISE = {"q": 5e-6, "T": 2e-5}
CONDITION = {"linear": TIME / 7200.0, "temperature": KELVIN / 3.0, "none": np.zeros(POSES)}


def drawn(kind: str, k: int, *, drift: tuple[Any, ...] = (), device: bool = True) -> Measurements:
    rng = np.random.default_rng([SEED, k])
    data = poses("three_link", POSES)
    T = data["T"] + SIZE * CONDITION[kind][:, None] * WAY
    if device:
        T = TURN.inv().apply(T - [0.3, 1.0, -0.2])
    values = {
        "q": data["q"] + NOISE["q"] * rng.normal(size=(POSES, 3)), "T": T + NOISE["T"] * rng.normal(size=(POSES, 3)),
        "time(T)": TIME, "temperature(T)": KELVIN,
    }  # fmt: skip
    start = ([0.3, 1.0, -0.2], TURN.as_quat(scalar_first=True))
    return Measurements(values, NOISE, poses=[Pose("T", device=device, device_start=start, drift=drift)])


def fitted(m: Measurements, device: bool) -> Calibration:
    choice = Choice(
        free=("L", *(("T.device.t", "T.device.u") if device else ()), *_drifts(m)),
        unit=("T.device.u",) if device else (),
    )
    return calibrate(disturbed(true_robot("three_link"), ("L",), 1e-3, 5), m, choice)


def _drifts(m: Measurements) -> list[str]:
    return [f"T.{word}" for kind, word in (("linear", "drift"), ("temperature", "thermal")) if kind in m.poses[0].drift]


def found(c: Calibration) -> set[str]:
    return {s.name for s in alarms(device_drifts(c, c.problem.measurements.poses[0], None))}


@pytest.mark.parametrize("device", [False, True], ids=["in the robot's frame", "in a device's frame"])
@pytest.mark.parametrize(("kind", "word", "unit"), [("linear", "drift", 7200.0), ("temperature", "thermal", 3.0)])
def test_a_drift_is_named_and_once_estimated_the_lengths_are_right(
    kind: str, word: str, unit: float, device: bool
) -> None:
    left_out = fitted(drawn(kind, 0, device=device), device)
    name = {"linear": "device_drift", "temperature": "device_temperature"}[kind]
    tests = device_drifts(left_out, left_out.problem.measurements.poses[0], None)
    strongest = min(tests, key=lambda s: s.p)
    assert strongest.name == name and f'measurements.drift = "{kind}"' in strongest.remedy
    if kind == "linear":
        assert "0.15 mm per hour" in strongest.evidence or "0.1" in strongest.evidence
    c = fitted(drawn(kind, 0, drift=(kind,), device=device), device)
    assert not found(c)
    true = true_robot("three_link").L
    for k in range(3):
        low, high = c.interval(f"T.{word}[{k}]", 0.999)
        assert low <= SIZE / unit * WAY[k] <= high
        low, high = c.interval(f"L[{k}]", 0.999)
        assert low <= true[k] <= high


@pytest.mark.parametrize("count", [30, pytest.param(100, marks=pytest.mark.proof)])
def test_clean_readings_name_no_drift(count: int) -> None:
    fits = [fitted(drawn("none", k, device=False), False) for k in range(count)]
    for noise in (lambda c: None, lambda c: length_covariance(c, "linear")):
        named = [alarms(device_drifts(c, c.problem.measurements.poses[0], noise(c))) for c in fits]
        assert sum(map(bool, named)) <= gt.inference.binomial_band(count, 0.01)[1]


def test_a_file_with_a_clock_is_read_and_the_study_says_what_to_set(tmp_path: Path) -> None:
    m = drawn("linear", 3, device=False)
    rows = np.column_stack([TIME + 9000.0, 1e3 * np.asarray(m.values["q"]), 1e3 * np.asarray(m.values["T"])])
    np.savetxt(tmp_path / "poses.csv", rows, delimiter=",", header="t,q[0],q[1],q[2],T[0],T[1],T[2]", comments="")
    signals = {"q": MeasuredSignal("q", "mm", deviation=5e-3), "T": MeasuredSignal("T", "mm", deviation=2e-2)}
    robot = disturbed(true_robot("three_link"), ("L",), 1e-3, 5)
    clock = ClockColumn("t")
    studies = [
        gt.calibrate.study(robot, read_poses(tmp_path / "poses.csv", Measured(signals, time=clock, drift=drift)),
                           gt.calibrate.Fit(free=["L"] if drift == "none" else ["L", "T.drift"]))
        for drift in ("none", "linear")
    ]  # fmt: skip
    assert not studies[0].checks["device_drift"].passed
    assert any('measurements.drift = "linear"' in note for note in studies[0].notes)
    assert "device_drift" not in studies[1].checks or studies[1].checks["device_drift"].passed
    rates = [studies[1].measurement[f"T.drift[{k}]"] for k in range(3)]
    assert rates == pytest.approx(SIZE / 7200.0 * WAY, abs=0.1 * SIZE / 7200.0)
    for other, argument in (({"drift": "linear"}, "measured.time"), ({"drift": "temperature"}, "measured.temperature")):
        with pytest.raises(ArgumentError) as caught:
            read_poses(tmp_path / "poses.csv", Measured(signals, **other))
        assert caught.value.argument == argument
