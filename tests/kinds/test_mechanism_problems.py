"""Shipped problems of three mechanisms: a delta, a five-bar and a 3-RRR. Motion, calibration, C code and units."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from problems.models import mechanisms
from tests.support import mechanism_poses
from tests.support.mechanism_poses import PROBLEMS

MODELS = {"delta": mechanisms.Delta, "five_bar": mechanisms.FiveBar, "planar_3rrr": mechanisms.ThreeArms}
CALIBRATED = {"delta": "rotary_delta"}  # others are called as their mechanism
TORQUE = {"delta": 20.0, "five_bar": 12.0, "planar_3rrr": 5.0}  # N.m
# between the nodes the torque of the exact motion exceeds the linear one by the reported violation; measured: 1e-3
OVER = 1.01
CHEAP = ["five_bar", *(pytest.param(n, marks=pytest.mark.proof) for n in ("delta", "planar_3rrr"))]


@pytest.mark.parametrize("name", CHEAP)
def test_the_fastest_motion_uses_a_motor_up_to_its_limit_by_inverse_dynamics_and_not_beyond(name):
    run = gt.load(PROBLEMS / f"{name}_motion.toml")()
    assert run.status.ok
    trajectory = run.trajectory
    robot = MODELS[name]()
    drive = robot.causal("q", "tau")
    q = [trajectory[n] for n in ("robot.q", "der(robot.q)", "der(robot.q,2)")]
    tau, status = drive(*q)
    assert np.all(status == gt.Status.OK)
    used = np.abs(tau).max(axis=1) / TORQUE[name]
    assert used.max() < OVER
    assert np.mean(used > 0.98) > 0.5  # of the time: the least time is bang-bang, smoothed by the cost of effort


@pytest.mark.parametrize("name", MODELS)
def test_a_calibration_finds_the_parameters_that_made_the_synthetic_poses(name):
    study = gt.load(PROBLEMS / f"calibrate_{CALIBRATED.get(name, name)}.toml", "sensitivity_step=0.0")()
    assert study.status.ok
    truth = mechanism_poses.ALL[name].truth
    inside = []
    for text in study.parameters:
        parameter, _, place = text.rstrip("]").partition("[")
        if "." in text or not place:  # of a part: not free
            continue
        index = tuple(int(k) for k in place.split(","))
        low, high = study.interval(text, 0.999)
        inside.append(low <= np.asarray(getattr(truth, parameter))[index] <= high)
    assert len(inside) == {"delta": 12, "five_bar": 10, "planar_3rrr": 21}[name]
    assert all(inside)  # a level of 0.999 for 43 parameters and one seed
    assert study.held_out["mean"] < study.a_priori["mean"] / 30


@pytest.mark.parametrize("name", MODELS)
def test_synthetic_poses_are_those_that_the_script_writes(name):
    shipped, made = mechanism_poses.file_of(name).read_text(encoding="utf-8"), mechanism_poses.text(name)
    assert shipped.splitlines()[:2] == made.splitlines()[:2]
    tables = [np.loadtxt(text.splitlines()[2:], delimiter=",") for text in (shipped, made)]
    assert np.allclose(*tables, rtol=0.0, atol=1.5e-5)  # the last digit may be rounded otherwise elsewhere


@pytest.mark.proof
@pytest.mark.parametrize("name", ["rotary_delta", "five_bar", "planar_3rrr"])
@pytest.mark.parametrize("fmu", [None, "both"])
def test_code_and_units_equal_python(name, fmu, tmp_path):
    loaded = load(PROBLEMS / f"{name}_controller.toml", ["check.points=100"])
    study = loaded.kind.write(loaded.problem, Context(folder=PROBLEMS), tmp_path / "out", verify=True, fmu=fmu)
    assert study.status.ok
    assert all(c.passed for c in study.checks.values())
