"""Kind "kinematics": keys of the file, and where refusals stand in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer
from tests.support.commands import Commands

FILE = 'kind = "kinematics"\nrobot = "l1_tape"\nknown = ["T"]\ntargets = ["q"]\npoints = "p.csv"\n'
BOX = "grid={center=[1.4, -0.9, 0.3], half_width=[0.2, 0.1, 0.1], counts=[2, 3, 4]}"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.toml").write_text(FILE)
    return tmp_path


def test_the_shipped_problem_is_solved() -> None:
    found = answer(load("problems/d1_orientation.toml", ["grid.counts=[2, 3, 3]"]), Context())
    assert found.status.ok and found.statuses == {"ok": 18} and len(found.values["zyz_range_deg"]) == 3


def test_command_line(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gtmodel = Commands(capsys)
    (here / "p.csv").write_text("T[0],T[1],T[2]\n1.4,-0.9,0.3\nnan,0,0\n1.4,9,0\n")
    done = gtmodel("solve", "p.toml", "--json", "--plot", "--out", "out")
    assert done.code == 0 and done.json["status"] == "solved"
    assert done.json["values"]["statuses"] == {"ok": 1, "out_of_range": 1, "not_finite": 1}
    assert sorted(p.name for p in (here / "out").iterdir()) == ["points.csv", "result.json", "run.toml", "targets.png"]
    first = (here / "out" / "points.csv").read_bytes()
    assert gtmodel("solve", "p.toml", "--out", "again").code == 0
    assert (here / "again" / "points.csv").read_bytes() == first
    assert json.loads((here / "out" / "result.json").read_text())["values"]["rows"] == 3
    assert "sphere" not in gtmodel("explain", "p.toml").out and "quadratic" in gtmodel("explain", "p.toml").out
    assert gtmodel("schema", "kinematics").code == 0
    done = gtmodel("solve", "p.toml", "--set", "targets=['w']")
    assert done.code == 2 and "targets[0]" in done.sentence


def test_the_file_of_points_is_entered(here: Path) -> None:
    (here / "p.csv").write_text("T[0],T[1],T[2]\n1.4,-0.9,0.3\n")
    context = Context(folder=here)
    assert answer(load("p.toml"), context).count == 1 and context.inputs["points"] == here / "p.csv"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ([BOX], "points"),
        (["points=''"], "points"),
        ([], "points"),
        (["points=''", BOX, "known=['Q']"], "known[0]"),
        (["points=''", BOX, "known=['T', 'q']"], "known"),
        (["points=''", BOX, "targets=['der(q)']"], "targets"),
        (["points=''", BOX, "branches={plate=1}"], "branches"),
        (["points=''", BOX, "orientation={of='tau'}"], "orientation.of"),
        (["points=''", BOX, "grid.counts=[200, 200, 200]"], "grid.counts"),
        (["points=''", BOX, "grid.counts=[2, 0, 2]"], "grid.counts[1]"),
        (["points=''", BOX, "grid.half_width=[0.1, 0.1]"], "grid.half_width"),
        (["points=''", BOX, "grid.directions=[[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]"], "grid.directions"),
        (["points=''", BOX, "grid.center_where={q=[0.0, 0.0, 0.0]}"], "grid.center"),
        (["points=''", BOX, "robot='d1_six_link'", "inertia='model_2'"], "inertia"),
        (["points=''", BOX, "robot='d1_six_link'", "parameters={LL=1.0}"], "parameters"),
    ],
)
def test_wrong_inputs_name_their_key(here: Path, changes: list[str], key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load("p.toml", changes), Context())
    assert caught.value.key == key and len(str(caught.value).splitlines()) == 1
