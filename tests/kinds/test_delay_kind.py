"""The kind "delay" through its files: logs of several forms, several clocks, wrong ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import SyntheticDelay, made_pair
from tests.support.commands import CLONE, Commands
from tests.support.recordings import recording

PROBLEM = """kind = "delay"
[log]
files = ["rec.mat"]
time = { column = "rec.t", unit = "s" }
[[pair]]
name = "axis"
reference = { column = "rec.motor[1]", unit = "deg" }
late = { column = "rec.link[1]", unit = "deg", time = { column = "rec.t2", unit = "ms" } }
"""
KR300 = recording("kr300/data_A.mat")


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A struct of matrices (2, n) with two clocks, as loggers write it; synthetic, 3.04 ms late."""
    first, late = made_pair(SyntheticDelay(delay=0.00304, duration=6.0, missing=0.02, jitter=0.2))
    rec = {"t": first.time, "t2": 1e3 * late.time}
    for name, part in (("motor", first), ("link", late)):
        rec[name] = np.degrees(np.vstack([0 * part["q"], part["q"]]))
    savemat(tmp_path / "rec.mat", {"rec": rec})
    (tmp_path / "p.toml").write_text(PROBLEM)
    return tmp_path


def test_two_clocks_of_a_struct(folder: Path, gtmodel: Commands) -> None:
    done = gtmodel("solve", folder / "p.toml", "--json")
    values = done.json["values"]
    low, high = values["delay_interval_s"][0]
    assert done.code == 0 and low < 0.00304 < high and high - low < 2e-4
    assert "reference 1" in gtmodel("explain", folder / "p.toml").out


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('column = "rec.link[1]"', 'column = "rec.links[1]"', "log"),
        ('column = "rec.link[1]", unit = "deg"', 'column = "rec.link[1]", unit = "mm"', "pair"),
        ('column = "rec.link[1]"', 'column = "rec.link[0]"', "pair"),
        (
            '[[pair]]\nname = "axis"',
            '[search]\nlongest_delay_s = 0.0\n[[pair]]\nname = "axis"',
            "search.longest_delay_s",
        ),
        ("rec.mat", "other.mat", "log.files[0]"),
        ("[log]", "[synthetic]\n[log]", "log"),
    ],
)
def test_wrong_files(folder: Path, old: str, new: str, key: str, gtmodel: Commands) -> None:
    (folder / "p.toml").write_text(PROBLEM.replace(old, new))
    done = gtmodel("solve", folder / "p.toml")
    assert done.code == 2 and f": {key}" in done.sentence


def test_a_message_calls_a_signal_by_its_column(folder: Path, gtmodel: Commands) -> None:
    """It was "'reference_0' does not vary", a name that stands in no file."""
    (folder / "p.toml").write_text(PROBLEM.replace("rec.motor[1]", "rec.motor[0]"))
    done = gtmodel("solve", folder / "p.toml")
    assert done.code == 2 and "'rec.motor[0]' does not vary" in done.err


@pytest.mark.skipif(not KR300.is_file(), reason="the KR300 recording is not shipped")
def test_the_measured_arm(tmp_path: Path, gtmodel: Commands) -> None:
    problem = (CLONE / "tests" / "kinds" / "delay_kr300.toml").read_text().replace("data/kr300/data_A.mat", str(KR300))
    (tmp_path / "p.toml").write_text(problem)
    values = gtmodel("solve", tmp_path / "p.toml", "--json").json["values"]
    assert 1e3 * np.array(values["delay_s"]) == pytest.approx([3.04, 3.08, 3.06], abs=0.1)
    assert all(
        low < delay < high for (low, high), delay in zip(values["delay_interval_s"], values["delay_s"], strict=True)
    )
