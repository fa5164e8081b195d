"""The kind "stereo" through its files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.commands import CLONE, Commands

DATA = CLONE / "problems/data/opencv_stereo/corners.csv"
PROBLEM = f"""kind = "stereo"
[corners]
file = "{DATA}"
[board]
width_pixel = 640
height_pixel = 480
columns = 9
rows = 6
"""


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


def test_the_shipped_problem(gtmodel: Commands, tmp_path: Path) -> None:
    done = gtmodel("solve", "calibrate_stereo", "--json", "--plot", "--out", tmp_path / "out")
    values = done.json["values"]
    assert done.code == 0 and values["rms_pixel"] <= 0.2151
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"cameras.csv", "residuals.csv", "residuals.png"}
    assert "9 x 6 corners" in gtmodel("explain", "calibrate_stereo").out


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("rows = 6", "rows = 7", "board"),
        ("rows = 6", 'rows = 6\nlengths = "metres"', "board.square_mm"),
        ("columns = 9", "columns = 7", "corners.file"),
        ("width_pixel = 640", "width_pixel = 300", "corners.file"),
        (str(DATA), "nowhere.csv", "corners.file"),
        ("[board]", 'leave_out = ["99"]\n[board]', "corners.leave_out"),
        ("rows = 6", "rows = 6\n[start]\ntranslation = [1.0, 0.0]", "start.translation"),
        ("rows = 6", 'rows = 6\n[fit]\ndistortion = ["k4"]', "fit.distortion"),
    ],
)
def test_refusals_name_the_key(tmp_path: Path, gtmodel: Commands, old: str, new: str, key: str) -> None:
    file = tmp_path / "p.toml"
    file.write_text(PROBLEM.replace(old, new))
    done = gtmodel("solve", file)
    assert done.code == 2 and key in done.err


def test_pictures_that_are_left_out(tmp_path: Path, gtmodel: Commands) -> None:
    file = tmp_path / "p.toml"
    file.write_text(PROBLEM.replace("[board]", 'leave_out = ["08"]\n[board]'))
    done = gtmodel("solve", file, "--json")
    assert done.code == 0 and done.json["values"]["pictures"] == 12
