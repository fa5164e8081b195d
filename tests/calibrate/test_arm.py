"""A six-axis arm by tracker positions alone, problems/calibrate_arm.toml: its data, what they determine and not."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.problem_files import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import answer
from tests.support import arm_poses

PROBLEM = arm_poses.PROBLEMS / "calibrate_arm.toml"


def solved(*settings: str):
    return answer(load(PROBLEM, list(settings)), Context(folder=arm_poses.PROBLEMS))


@pytest.fixture(scope="module")
def study():
    return solved("sensitivity_step=0")


def test_the_data_are_those_of_the_stated_seed() -> None:
    shipped = np.loadtxt(arm_poses.PROBLEMS / "data" / "arm_synthetic.csv", delimiter=",", skiprows=2)
    made = np.array([line.split(",") for line in arm_poses.text().splitlines()[2:]], float)
    np.testing.assert_allclose(shipped, made, atol=2e-4)  # one digit of the last place


def test_the_problem_frees_what_can_be_determined() -> None:
    free = load(PROBLEM, []).problem.free
    assert [*free[:-1], *(f"tool_xyz[{k}]" for k in range(3))] == arm_poses.free()


def test_true_numbers_are_found(study) -> None:
    assert study.status.ok and all(c.passed for c in study.checks.values()), study.checks
    e, true = study.estimate, arm_poses.true_arm()
    assert len(e.names) == 27 and not e.undetermined
    deviations = []
    for name in arm_poses.free():
        array, index = name[:-1].split("[")
        off = e.value(name) - np.asarray(getattr(true, array))[int(index)]
        deviations.append(off / e.std[e.names.index(name)])
    assert np.max(np.abs(deviations)) < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6  # they are deviations, not smaller
    places = [e.value(f"T.device.t[{k}]") for k in range(3)]
    np.testing.assert_allclose(places, arm_poses.DEVICE_T, atol=3e-4)
    assert study.synthetic.startswith("seed 2026") and "(synthetic)" in study.title


def test_the_calibrated_arm_is_the_true_one(study, tmp_path) -> None:
    (tmp_path / "parameters.toml").write_text(study.files["parameters.toml"])
    (tmp_path / "models").mkdir()
    name = "six_axis_arm.toml"
    (tmp_path / "models" / name).write_text((arm_poses.PROBLEMS / "models" / name).read_text())
    calibrated = resolve("parameters.toml", Context(folder=tmp_path))
    q = np.random.default_rng(1).uniform(-0.8, 0.8, (40, 6))
    places = [
        arm.causal(known="q", targets="T")(q)[0] for arm in (calibrated, arm_poses.true_arm(), arm_poses.nominal())
    ]
    off, before = (np.linalg.norm(T - places[1], axis=1) for T in (places[0], places[2]))
    assert off.max() < 1e-4 and before.max() > 3e-3  # m


def test_redundant_numbers_are_named() -> None:
    """All numbers of all links and both frames: 12 of 39 are a matter of choice."""
    every = solved("sensitivity_step=0", 'free=["theta", "d", "a", "alpha", "beta", "tool_xyz"]')
    assert every.status.ok
    shown = "; ".join(str(row) for row in every.rows)
    assert "27 of 39 parameters or combinations are determined" in shown
    for sentence in ("d[1] moves with d[2]", "d[0] moves with T.device.t[2]", "tool_xyz[2] moves with d[5]"):
        assert sentence in shown
