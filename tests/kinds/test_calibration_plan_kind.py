"""Kind "calibration_plan": the declared plan from room to robot program, and where refusals stand in the file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate.plan import (
    Criteria,
    PlanLimits,
    PlanSimulation,
    PosesToMeasure,
    Room,
    Safety,
    Tracker,
    plan_study,
)
from gtmodel.kinematics.workspace import Bodies, Box
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from tests.support.commands import CLONE, Commands

FILE = CLONE / "problems" / "plan_calibration_l1.toml"
# coarser than declared: seconds less
COARSE = ["room.step_m=0.2", "curve=[12, 24]", "simulation.runs=6", "poses.held_out=5", "poses.starts=1"]
SAME_POINT = 1e-4  # mm, the files' last decimal


def numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in re.findall(r"-?\d+\.\d+", text)])


def test_the_declared_plan_goes_from_the_room_to_the_robot_program(capsys, tmp_path: Path):
    sets = [part for s in COARSE for part in ("--set", s)]
    done = Commands(capsys)("solve", FILE, *sets, "--json", "--out", tmp_path / "out")
    assert done.code == 0 and done.json["status"] == "solved"
    v = done.json["values"]
    assert v["approved"] and v["verdict"].startswith("approved: 20 poses and 5 held-out")
    assert list(v["stages"]) == ["workspace", "obstacles", "safety", "device", "safety distance"]
    counts = list(v["stages"].values())
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[1] > counts[2]
    assert v["workspace_left"] == pytest.approx(counts[-1] / counts[0])
    assert v["parameters"] == v["rank"] == 21 and len(v["parameter_std"]) == 21
    assert v["condition"] == pytest.approx(1 / v["o2"]) and v["o4"] == pytest.approx(v["o2"] * v["o3"])
    assert v["simulated_error_m"] == pytest.approx(v["predicted_error_m"], rel=0.3)  # six runs
    assert v["predicted_greatest_m"] > v["predicted_error_m"]
    few, many = v["curve"]
    assert few["predicted_error_m"] > v["predicted_error_m"] > many["predicted_error_m"]
    assert v["enough_poses"] <= 20
    assert all(check["passed"] for check in done.json["checks"].values())
    rows = (tmp_path / "out" / "poses.csv").read_text().splitlines()
    table = [line.split(",") for line in rows if not line.startswith("#")]
    assert table[0] == ["pose", "purpose", *(f"{n}[{k}] [mm]" for n in "qT" for k in range(3))]
    purposes = [line[1] for line in table[1:]]
    assert purposes.count("calibrate") == 20 and purposes.count("verify") == 5
    assert purposes != sorted(purposes)  # in random order
    program = (tmp_path / "out" / "poses.mod").read_text()
    targets = [numbers(line) for line in program.splitlines() if line.startswith("    [[")]
    values = np.array([line[2:] for line in table[1:]], float)
    np.testing.assert_allclose(targets, np.hstack([values[:, 3:], values[:, :3]]), atol=SAME_POINT)
    A, L = np.array([[0.04, 0, 1.44], [0.25, -1.31, 1.46], [0, 0, 0]]), [2.05, 1.82, 1.81]
    d = values[:, None, 3:] / 1e3 - A - values[:, :3, None] / 1e3 * np.array([1.0, 0, 0])
    np.testing.assert_allclose(np.linalg.norm(d, axis=2), np.tile(L, (25, 1)), atol=1e-6)
    assert "MoveJ GtPoses{i}, v200, fine" in program and "tested against no controller" in program


def test_the_call_on_objects_gives_the_values_of_the_file():
    by_file = answer(load(FILE, [*COARSE, "curve=[]", "simulation.runs=0"]), Context())
    by_call = plan_study(
        gt.robots.gantry_tau("l1_tape"),
        Tracker([1.0, -4.5, 0.8]),
        Room([0.0, -1.6, -0.2], [2.6, 0.4, 1.8], step=0.2),
        limits=PlanLimits(actuators=[[-1.0, 1.0]] * 3, cone=np.radians(45.0)),
        bodies=Bodies(link_radius=0.02, plate_radius=0.15),
        obstacles=[
            Box(name="table", low=[0.0, -1.6, -0.2], high=[1.0, -0.9, 0.2]),
            Box(name="second robot", low=[2.2, -0.5, -0.2], high=[2.6, 0.4, 1.2]),
        ],
        safety=Safety(cone=np.radians(5.0)),
        poses=PosesToMeasure(20, held_out=5, starts=1),
        curve=[],
        simulation=PlanSimulation(runs=0),
        criteria=Criteria(accuracy=5e-5),
    )
    assert str(by_call.values) == str(by_file.values) and by_call.checks == by_file.checks


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("device.kind='sextant'", "device"),
        ("device.at_m=[1.0, 2.0]", "device.at_m"),
        ("device.farthest_m=0.0", "device.farthest_m"),
        ("device.target_axis=[0, 0, 0]", "device.target_axis"),
        ("room.high_m=[2.0, -1.6, 2.0]", "room.high_m"),
        ("room.step_m=0.001", "room.step_m"),
        ("room.turns_deg=[[5, 0, 0]]", "room.turns_deg"),
        ("room.low_m=[2.59, 0.39, 1.79]", "room"),
        ("limits.axes_deg=[[-9, 9]]", "limits.axes_deg"),
        ("limits.actuators_m=[[-9, 9]]", "limits.actuators_m"),
        ("safety.cone_deg=45.0", "safety.cone_deg"),
        ("poses.number=4", "poses.number"),
        ("bodies.link_clearance=true", "bodies.link_clearance"),
        ("obstacles=[{low_m=[0, 0, 0], high_m=[0, 1, 1]}]", "obstacles[0].high_m"),
    ],
)
def test_wrong_input_names_its_key(setting, key):
    with pytest.raises(InputError) as caught:
        answer(load(FILE, [setting]), Context())
    assert caught.value.key == key and caught.value.message


def test_a_start_is_refused():
    with pytest.raises(InputError, match="--start"):
        answer(load(FILE), Context(start={}))


def test_the_plan_explains_its_steps():
    text = explain(load(FILE), Context())
    for step in (
        "workspace:",
        "safety:",
        "device: range of the laser tracker",
        "20 to 60 poses, chosen by I, and 20 held out",
    ):
        assert step in text
