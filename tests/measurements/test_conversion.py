"""Drives between column and quantity: signs, gear ratios, motor constants, coupled joints, in every reader."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import Measured, MeasuredSignal, read_poses
from gtmodel.measurements import Column, Conversion, Corrections, LogError, Signal

GEARS, SIGNS = (100.0, 80.0, -50.0), (1.0, -1.0, 1.0)
COUPLING = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -0.25, 1.0))


@pytest.fixture
def joints() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(40, 3))


def motors(q: np.ndarray) -> np.ndarray:
    """Motor angles of joint angles, solved joint by joint: the other road."""
    uncoupled = np.array([[a, b, c + 0.25 * b] for a, b, c in q])
    return uncoupled * GEARS * SIGNS


def logged(path: Path, columns: dict[str, np.ndarray]) -> None:
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")


def table(q: np.ndarray, turns: np.ndarray, current: np.ndarray) -> dict[str, np.ndarray]:
    named = {"time": 0.004 * np.arange(len(q))}
    for name, rows in {"turns": turns, "i": current}.items():
        named |= {f"{name}[{k}]": rows[:, k] for k in range(3)}
    return named


def test_a_motor_angle_becomes_a_joint_angle(joints: np.ndarray) -> None:
    conversion = Conversion(scale=SIGNS, gear_ratio=GEARS, coupling=COUPLING)
    assert np.allclose(conversion.apply(motors(joints), ["rad"]), joints, rtol=0, atol=1e-13)


def test_power_is_kept_between_motor_and_joint(joints: np.ndarray) -> None:
    """Efforts take the inverse transpose of the positions' coupling: motor power equals joint power."""
    inverse = tuple(map(tuple, np.linalg.inv(COUPLING).T))
    speeds = Conversion(scale=SIGNS, gear_ratio=GEARS, coupling=COUPLING).apply(motors(joints), ["rad"])
    torque = np.random.default_rng(4).normal(size=joints.shape)
    efforts = Conversion(scale=SIGNS, gear_ratio=GEARS, coupling=inverse).apply(torque, ["N.m"])
    assert np.allclose((torque * motors(joints)).sum(axis=1), (efforts * speeds).sum(axis=1), rtol=1e-12)


@pytest.mark.parametrize("uneven", [False, True])
def test_every_reader_of_logs_reads_the_same(tmp_path: Path, joints: np.ndarray, uneven: bool) -> None:
    current = np.random.default_rng(5).normal(size=joints.shape)
    path = tmp_path / "log.csv"
    logged(path, table(joints, motors(joints) / (2 * np.pi), current))
    drives = {"gear_ratio": GEARS, "coupling": COUPLING}
    effort = Conversion(motor_constant=(0.5, 0.4, 0.3), gear_ratio=GEARS)
    by_hand = current * np.array([0.5, 0.4, 0.3]) * GEARS
    if uneven:
        columns = {
            "q": Column("turns", "rev", conversion=Conversion(scale=SIGNS, **drives)),
            "tau": Column("i", "A", conversion=effort),
        }
        (trajectory,) = gt.measurements.read_recording(path, columns).values()
    else:
        signals = {
            "q": Signal("turns", "rev", scale=SIGNS, quantity_unit="rad", **drives),
            "tau": Signal("i", "A", motor_constant=(0.5, 0.4, 0.3), gear_ratio=GEARS, quantity_unit="N.m"),
        }
        (session,) = Corrections(signals, gt.measurements.read_signals([path], signals)).apply()
        trajectory = session.trajectory
    assert np.allclose(trajectory["q"], joints, rtol=0, atol=1e-13)
    assert np.allclose(trajectory["tau"], by_hand, rtol=1e-14)
    assert trajectory.units == {"q": "rad", "tau": "N.m"}


def test_poses_of_a_calibration_too(tmp_path: Path, joints: np.ndarray) -> None:
    path = tmp_path / "poses.csv"
    logged(path, table(joints, np.degrees(motors(joints)), joints))
    q = MeasuredSignal(
        "turns", "deg", scale=list(SIGNS), gear_ratio=list(GEARS), coupling=[list(row) for row in COUPLING],
        offset=[0.1, 0.2, 0.3],
    )  # fmt: skip
    measured = Measured({"q": q, "T": MeasuredSignal("i", "m")})
    values = read_poses(path, measured).measurements.values["q"]
    assert np.allclose(values, joints - [0.1, 0.2, 0.3], rtol=0, atol=1e-13)
    assert MeasuredSignal("q", "deg", scale=-2.0, gear_ratio=100.0, deviation=1.0).noise_in_si == pytest.approx(
        np.radians(0.02)
    )


def test_delays_and_offsets_by_column() -> None:
    time = 0.002 * np.arange(400)
    raw = np.column_stack([np.sin(5 * (time - 0.004)), np.sin(5 * (time - 0.010))])
    session = gt.measurements.session_of(gt.Trajectory(time, {"x": raw}, {"x": "m"}))
    signal = Signal("x", "m", delay=(0.004, 0.010), offset=(0.0, 1.0))
    (corrected,) = Corrections({"x": signal}, [session]).apply()
    both = corrected.trajectory["x"]
    assert np.allclose(both[:, 0], both[:, 1] + 1.0, atol=1e-7)  # spline of 2 ms at 5 rad/s: below (h w)^4


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"scale": (1.0, 0.0)}, "scale"),
        ({"gear_ratio": 0.0}, "gear_ratio"),
        ({"gear_ratio": float("nan")}, "gear_ratio"),
        ({"coupling": ((1.0, 0.0),)}, "coupling"),
        ({"coupling": ((1.0, 1.0), (1.0, 1.0))}, "coupling"),
    ],
)
def test_wrong_factors_are_named(wrong: dict, word: str) -> None:
    with pytest.raises(LogError, match=word):
        Conversion(**wrong)


@pytest.mark.parametrize("name", ["scale", "offset", "gear_ratio", "motor_constant", "coupling"])
def test_another_number_of_factors_is_named(name: str) -> None:
    value = ((1.0, 0.0), (0.0, 1.0)) if name == "coupling" else (1.0, 2.0)
    with pytest.raises(LogError, match=f"{name}: has 2"):
        replace(Conversion(), **{name: value}).apply(np.ones((5, 3)), ["A" if name == "motor_constant" else "m"])


def test_a_motor_constant_needs_a_current() -> None:
    with pytest.raises(LogError, match="current"):
        Signal("u", "V", motor_constant=0.5)
    with pytest.raises(LogError, match="scale"):
        Column("u", "V", conversion=Conversion(quantity_unit="N")).conversion.check(["V"], "u")
