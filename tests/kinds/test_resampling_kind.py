"""The kind "resampling" through its files: the shipped recording, a sensor of several streams, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.measurements import Column, read_log
from tests.measurements.test_real_logs import imu_twin
from tests.support import two_clocks
from tests.support.commands import CLONE, Commands
from tests.support.recordings import recording

SHIPPED = CLONE / "problems" / "resample_synthetic.toml"
IMU_PROBLEM = CLONE / "tests" / "kinds" / "resampling_abb_imu.toml"
IMU = recording("abb_imu/V1000_path3_MPU9150.mat")


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    two_clocks.write(tmp_path / "data")
    (tmp_path / "p.toml").write_text(SHIPPED.read_text())
    return tmp_path


def test_the_shipped_recording(folder: Path, gtmodel: Commands) -> None:
    for name in (two_clocks.ROBOT, two_clocks.TRACKER):
        shipped = CLONE / "problems" / "data" / name
        assert (folder / "data" / name).read_bytes() == shipped.read_bytes()
        assert shipped.read_text().startswith("# synthetic: seed 2026")
    out = folder / "out"
    done = gtmodel("solve", SHIPPED, "--json", "--plot", "--out", out)
    values = done.json["values"]
    assert done.code == 0 and values["clocks"] == [two_clocks.ROBOT, two_clocks.TRACKER]
    for name, truth in (("offset", two_clocks.OFFSET), ("drift", two_clocks.DRIFT)):
        ((low, high),) = values[f"{name}_interval" + ("_s" if name == "offset" else "")].values()
        assert low < truth < high
    assert "synthetic" in (out / "result.json").read_text() and (out / "signals.png").is_file()
    # the written log is read back by name and unit, bit for bit, and is what the motion was
    columns = {n: Column(n, unit) for n, unit in (("angle", "rad"), ("tracker_angle", "rad"), ("force", "N"))}
    (session,) = read_log(out / "trajectory.csv", columns)
    made = gt.load(SHIPPED)().trajectory
    assert session.trajectory.synthetic and np.array_equal(session.trajectory.time, made.time)
    assert all(np.array_equal(session.trajectory[n], made[n]) for n in columns)
    t = made.time
    assert np.rad2deg(made["angle"]) == pytest.approx(two_clocks.angle(t), abs=0.1)
    assert np.rad2deg(made["tracker_angle"]) == pytest.approx(two_clocks.angle(t), abs=0.3)  # gaps of 80 ms are in it
    assert np.std(made["force"] - two_clocks.force(t)) < 0.6


def test_explain_names_the_clocks(folder: Path, gtmodel: Commands) -> None:
    text = gtmodel("explain", folder / "p.toml").out
    assert (
        "3 gaps: tracker_angle, force" in text
        and "the clock of 'tracker_angle' is aligned with the clock of 'angle'" in text
    )


@pytest.mark.parametrize(
    ("old", "new", "key", "part"),
    [
        ('column = "q1"', 'column = "q9"', "log", "q9"),
        ('column = "q1"\nunit = "deg"', 'column = "q1"\nunit = "mm"', "log", "deg"),
        ("sample_time_s = 0.01", "sample_time_s = 0.0", "grid.sample_time_s", "0"),
        ("sample_time_s = 0.01", "sample_time_s = 60.0", "grid.sample_time_s", "rows; expected at least 3"),
        ("longest_gap_s = 0.1", "longest_gap_s = 0.001", "grid.longest_gap_s", "step of the rows, 0.01 s"),
        ("longest_gap_s = 0.1", "longest_gap_s = 0.1\nstart_s = 50.0", "grid", "0 times are common"),
        ('method = "cubic"', 'method = "best"', "grid.method", "cubic"),
        ('other = "tracker_angle"', 'other = "force"', "align[0]", "one unit"),
        ('other = "tracker_angle"', 'other = "angles"', "align[0].other", "there is no signal 'angles'"),
        ('reference = "angle"', 'reference = "force"', "align[0].other", "reference clock"),
        ('other = "tracker_angle"', 'other = "tracker_angle"\noffset_range_s = [1.0, -1.0]', "align[0].offset_range_s",
         "lower bound comes first"),
        ('[[align]]', '[[align]]\nreference = "angle"\nother = "force"\n[[align]]', "align[1].other", "already"),
        ('[[align]]', '[[aligned]]', "aligned", "align"),
        ('[signals.force]', '[signals.session]', "log", "is reserved"),
        ("robot_synthetic", "robot", "log.files[0]", "there is no file"),
        ('unit = "s" }', 'unit = "s" }\njitter = 0.2', "log.jitter", ""),
    ],
)  # fmt: skip
def test_wrong_files(folder: Path, old: str, new: str, key: str, part: str, gtmodel: Commands) -> None:
    text = (folder / "p.toml").read_text()
    assert old in text
    if key.startswith("grid"):  # no clock is aligned before the grid is refused
        text = text[: text.index("[[align]]")]
    (folder / "p.toml").write_text(text.replace(old, new, 1))
    done = gtmodel("solve", folder / "p.toml")
    assert (
        done.code == 2 and f": {key}" in done.sentence and part in done.sentence and "\n" not in done.sentence.strip()
    )


def test_a_file_without_signals_is_refused(folder: Path, gtmodel: Commands) -> None:
    text = (folder / "p.toml").read_text()
    (folder / "p.toml").write_text(text[: text.index("[signals.angle]")] + "[signals]\n")
    assert (
        ": signals: is empty; expected at least one entry (signals, by" in gtmodel("solve", folder / "p.toml").sentence
    )


def test_clocks_that_are_not_brought_together_have_nothing_in_common(folder: Path, gtmodel: Commands) -> None:
    text = (folder / "p.toml").read_text()
    (folder / "p.toml").write_text(text[: text.index("[[align]]")])
    done = gtmodel("solve", folder / "p.toml")
    assert done.code == 2 and "0 times are common to all signals" in done.sentence and ": log" in done.sentence


@pytest.fixture
def twin(tmp_path: Path) -> Path:
    """A synthetic recording with the variables of the measured one."""
    imu_twin(tmp_path / "twin.mat")
    raw = {k: v for k, v in scipy.io.loadmat(tmp_path / "twin.mat").items() if k[0] != "_"}
    scipy.io.savemat(tmp_path / "twin.mat", {**raw, "ABBposition": np.zeros((3, 1200))})
    return tmp_path / "twin.mat"


def imu_problem(file: Path, folder: Path) -> Path:
    problem = folder / "p.toml"
    problem.write_text(IMU_PROBLEM.read_text().replace("data/abb_imu/V1000_path3_MPU9150.mat", str(file)))
    return problem


MEASURED = pytest.mark.skipif(not IMU.is_file(), reason="the IMU recording may not be shipped")


@pytest.mark.parametrize("of", [pytest.param("measured", marks=MEASURED), "twin"])
def test_an_imu_is_interpolated_as_by_hand(of: str, twin: Path, tmp_path: Path, gtmodel: Commands) -> None:
    """Resampled by TOML alone it is what numpy.interp gives on columns that were read by hand."""
    file = IMU if of == "measured" else twin
    done = gtmodel("solve", imu_problem(file, tmp_path), "--json", "--out", tmp_path / "out")
    assert done.code == 0 and done.json["values"]["rows_left_out"] == [1]
    lines = [line for line in (tmp_path / "out" / "trajectory.csv").read_text().splitlines() if line[0] != "#"]
    written = dict(zip(lines[0].split(","), np.loadtxt(lines[1:], delimiter=",").T, strict=True))
    raw = scipy.io.loadmat(file)
    time, gyro, acceleration = raw["MATLABtime"][0], raw["SENSgyro"], raw["SENSacc"]
    whole = np.isfinite(gyro).all(axis=0)
    grid = written["time [s]"]
    assert grid[0] == time[0] and np.allclose(np.diff(grid), 0.01, atol=1e-12) and grid[-1] > time[-1] - 0.01
    for k in range(3):
        rate = np.interp(grid, time[whole], np.deg2rad(gyro[k][whole]))
        assert written[f"rate[{k}] [rad/s]"] == pytest.approx(rate, abs=1e-12)
        by_hand = np.interp(grid, time[whole], acceleration[k][whole])
        assert written[f"acceleration[{k}] [1]"] == pytest.approx(by_hand, abs=1e-12)


@MEASURED
def test_the_measured_imu_rests_at_1_g(tmp_path: Path, gtmodel: Commands) -> None:
    done = gtmodel("solve", imu_problem(IMU, tmp_path), "--json", "--set", "grid.end_s=1.3")
    length = done.json["values"]["length"]
    assert length["acceleration"] == pytest.approx(1.0, abs=2e-3)  # before the robot moves
    assert length["rate"] < np.deg2rad(0.5)
