"""An arm under the law "predictive": the controller and the functions of the folder in single precision, in C."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.cgen import generate
from gtmodel.lang import Model
from gtmodel.loop import Disturbances, PredictiveLoop, study
from gtmodel.loop.one_run import joint_servo
from gtmodel.predictive import AxisServo, ControlHorizon, Measurement
from gtmodel.results import Trajectory
from tests.loop import test_joints

NEAR_MM = 1.0  # rms of T; a tolerance of the cost is 1 mrad


def motion(first: np.ndarray, by: np.ndarray) -> Trajectory:
    """From rest to rest in 0.4 s, every 4 ms."""
    s, T = np.linspace(0.0, 1.0, 101)[:, None], 0.4
    place, rate, second = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
    values = {"q": first + place * by, "der(q)": rate * by / T, "der(q,2)": second * by / T**2}
    return Trajectory(0.004 * np.arange(101), values, {"q": "rad", "der(q)": "rad/s", "der(q,2)": "rad/s2"})


def driven(robot: Model, first: np.ndarray, by: np.ndarray, torque: np.ndarray, place: Path) -> PredictiveLoop:
    drive = joint_servo(robot, first)
    law = gt.predictive.controller(
        robot,
        ControlHorizon(period=0.004, stages=6, length=0.01, preview=True, causality="inverse"),
        tolerances={"q": 1e-3, "der(q)": 0.1, "der(q,2)": 20.0},
        targets={"q": first + by},
        references=["q", "der(q)", "der(q,2)"],
        limits={"tau": np.column_stack([-torque, torque])},
        measured={"q": Measurement(deviation=3e-4, jump=0.05)},
        disturbance={"tau": 20.0},
        servo=AxisServo(drive.kp_N_m, drive.kd_N_s_m),
    )
    functions = {"fk": robot.causal("q", "T"), "inverse_dynamics": robot.causal("q", "tau")}
    generate({**functions, "law": law}, place, name="arm", real="float")
    found = study(robot, place, motion(first, by), peer="egm", seconds=0.5, law="predictive", in_lockstep=True,
                  disturbances=Disturbances(noise=1e-5, seed=1))  # fmt: skip
    assert isinstance(found, PredictiveLoop), found.message
    assert (found.unsolved, found.unread, found.refused, found.skipped) == (0, 0, 0, 0)
    assert found.torque_planned is not None and 0.0 < found.torque_planned <= torque.max()
    assert found.values["force_planned_N"] is None
    assert {row.unit for row in found.rows if "largest torque" in row.label} == {"N.m"}
    assert b"force[0] [N.m]" in found.files["loop_on.csv"]  # type: ignore[operator]
    assert 0.0 < found.spectral_radius < 1.0
    return found


def test_an_arm_in_single_precision_follows_within_its_torques(compiler: str, tmp_path: Path) -> None:
    found = driven(test_joints.ARM, np.array([0.3, 0.5]), np.array([0.3, -0.2]), np.array([90.0, 40.0]), tmp_path / "a")
    assert found.runs[1]["tcp_rms_mm"] < NEAR_MM
