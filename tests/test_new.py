"""gtmodel new: a file of every kind means what the shipped one means, and works where it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel import _new
from gtmodel.problem_files import names
from gtmodel.problem_files.base import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import call_of
from tests.support.commands import Commands

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Commands:
    monkeypatch.chdir(tmp_path)
    return Commands(capsys)


@pytest.mark.parametrize("kind", names())
def test_a_new_file_of_a_kind_means_the_shipped_problem(kind: str, tmp_path: Path) -> None:
    """Equal keys and equal files beside it: the shipped problem itself is solved by the tests of its kind."""
    paths, command = _new.write(kind, "mine", place=tmp_path)
    assert paths[0] == tmp_path / "mine.toml" and command.startswith("gtmodel")
    shipped = PROBLEMS / f"{_new.example_of(kind)}.toml"
    assert load(paths[0]).problem == load(shipped).problem
    assert all(path.read_bytes() == (PROBLEMS / path.relative_to(tmp_path)).read_bytes() for path in paths[1:])
    text = paths[0].read_text()
    assert "#:schema" not in text and text.count("#") > 5 and max(map(len, text.splitlines())) <= 2 * _new.WIDTH
    if len(paths) > 1:
        call_of(paths[0])  # finds its models and data where it stands


def test_a_new_model_and_a_new_robot_work(gtmodel: Commands, tmp_path: Path) -> None:
    assert gtmodel("new", "model", "belt").code == 0
    assert {p.name for p in tmp_path.iterdir()} == {"belt.toml", "belt.py"}
    assert gtmodel("solve", "belt.toml", "--set", "final_time_s=0.5", "--report").code == 0
    assert "Further keys" not in Path("belt-result/report.html").read_text()  # its author did not write that
    assert "try: gtmodel solve 'my belt.toml'" in gtmodel("new", "model", "my belt").out
    done = gtmodel("new", "robot", "arm")
    assert done.code == 0 and "try: gtmodel explain arm.toml" in done.out
    assert gtmodel("explain", "arm.toml").code == 0


@pytest.mark.proof
@pytest.mark.parametrize("kind", names())
def test_a_new_file_solves(kind: str, gtmodel: Commands) -> None:
    done = gtmodel("new", kind, "mine")
    words = done.out.rpartition("try: gtmodel ")[2].split()
    assert gtmodel(*words).code == 0


def test_a_calibration_from_a_log(gtmodel: Commands, tmp_path: Path) -> None:
    rows = np.loadtxt(PROBLEMS / "data" / "l1_synthetic.csv", delimiter=",", skiprows=3)
    head = "cart1 [m],cart2 [m],cart3 [m],x [mm],y [mm],z [mm]"
    np.savetxt("log.csv", rows * np.repeat([1e-3, 1.0], 3), "%.7f", ",", header=head, comments="")
    assert gtmodel("new", "calibration", "sub/mine", "--from", "log.csv").code == 0
    text = (tmp_path / "sub" / "mine.toml").read_text()
    assert 'file = "../log.csv"' in text
    assert 'q = { column = ["cart1", "cart2", "cart3"], unit = "m" }  # unit: stated in the header' in text
    shipped, mine = (
        call_of(path).arguments[1].measurements for path in (PROBLEMS / "calibrate_l1.toml", "sub/mine.toml")
    )
    for name in ("q", "T"):
        assert np.allclose(mine.values[name], shipped.values[name], rtol=0, atol=1e-7)  # digits of the log [m]
    np.savetxt(
        "ends.csv", rows, "%.4f", ",", header="axis1_mm,axis2_mm,axis3_mm,tcp_x_mm,tcp_y_mm,tcp_z_mm", comments=""
    )
    assert gtmodel("new", "calibration", "ends", "--from", "ends.csv").code == 0  # the unit is no part of the name
    assert 'T = { column = ["tcp_x_mm", "tcp_y_mm", "tcp_z_mm"], unit = "mm" }' in (tmp_path / "ends.toml").read_text()
    assert gtmodel("new", "problem", "--kind", "calibration", "--from", "ends.csv").code == 0
    assert (tmp_path / "calibration.toml").read_text() == (tmp_path / "ends.toml").read_text()
    np.savetxt("bare.csv", rows, "%.4f", ",", header="a,b,c,x,y,z", comments="")
    done = gtmodel("new", "calibration", "other", "--from", "bare.csv")
    assert done.code == 2 and "cannot tell which columns are q" in done.err and not (tmp_path / "other.toml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("calibratoin", "x"), "did you mean 'calibration'"),
        (("problem", "x"), "gtmodel new calibration x"),
        (("problem", "x", "--kind", "calibratoin"), "did you mean 'calibration'"),
        (("model", "x", "--kind", "friction"), "gtmodel new problem --kind friction"),
        (("friction", "there"), "is there already"),
        (("friction", ".."), "cannot be the name"),
        (("calibration", "x", "--from", "empty.csv"), "empty.csv: is empty"),
        (("friction", "x", "--from", "there.toml"), "of kind 'friction'"),
    ],
)
def test_what_is_wrong_is_refused(words: tuple[str, ...], said: str, gtmodel: Commands, tmp_path: Path) -> None:
    (tmp_path / "there.toml").write_text("mine")
    (tmp_path / "empty.csv").write_text("")
    done = gtmodel("new", *words)
    assert done.code == 2 and said in done.sentence and (tmp_path / "there.toml").read_text() == "mine"
    kind = words[3] if "--kind" in words else None
    with pytest.raises(InputError):
        _new.write(_new.of_kind(words[0], kind), words[1], Path("a") if "--from" in words else None, tmp_path)
