"""Kind "workspace": keys of the file, and where refusals stand in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from tests.support.commands import Commands

COARSE = ["section.step_m=0.04", "volume.sections=5", "volume.tolerance=0.1"]


def test_the_shipped_problem(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    sets = [word for change in COARSE for word in ("--set", change)]
    done = Commands(capsys)("solve", "l1_workspace", *sets, "--json", "--plot", "--out", tmp_path / "out")
    assert done.code == 0 and done.json["status"] == "solved"
    values = done.json["values"]
    assert [cone["angle_deg"] for cone in values["cones"]] == [30.0, 45.0]
    assert [p["reachable"] for p in values["points"]] == [True, False, False] and values["volume_m3"] > 5
    files = {p.name for p in (tmp_path / "out").iterdir()}
    assert files == {"result.json", "boundary.csv", "section.png", "workspace.scene.json", "robot.png", "run.toml"}


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("home_m=[0.0, 9.0, 0.0]", "home_m"),
        ("limits.actuators_m=[[0.0, 1.0]]", "limits.actuators_m"),
        ("section.step_m=5.0", "section.step_m"),
        ("section.low_m=[9.0, 9.0]", "section.high_m"),
        ("bodies={link_clearance=true}", "bodies.link_clearance"),
        ("bodies={plate_joints_m=[[0.0, 0.0, 0.0]]}", "bodies.plate_joints_m"),
        ("obstacles=[{low_m=[0.0, 0.0, 0.0], high_m=[1.0, 1.0, 0.0]}]", "obstacles[0].high_m"),
        ("beams=[{from_m=[0.0, 0.0, 0.0], to_m=[1.0, 1.0, 0.0], skip_links=[4]}]", "beams[0].skip_links"),
        ("volume.high_m=-2.0", "volume.high_m"),
        ("volume.most_sections=5", "volume.most_sections"),
    ],
)
def test_wrong_inputs_name_their_key(change: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load("problems/l1_workspace.toml", [change]), Context())
    assert caught.value.key == key and caught.value.message


def test_a_start_is_refused_and_a_misspelt_key_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        answer(load("problems/l1_workspace.toml"), Context(start={}))
    (tmp_path / "w.toml").write_text('kind = "workspace"\nrobot = "l1_tape"\n[limits]\ncones_deg = 3.0\n')
    done = Commands(capsys)("solve", tmp_path / "w.toml")
    assert done.code == 2 and "cone_deg" in done.sentence


def test_explain_tells_the_tests_and_the_assumption() -> None:
    text = explain(load("problems/l1_workspace.toml"), Context())
    assert text.index("inverse kinematics") < text.index("actuator limits") < text.index("ball-joint cones of 40 deg")
    assert "not known" in text
