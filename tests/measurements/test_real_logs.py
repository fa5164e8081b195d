"""The recordings of ../shared/realdata are read as they are; each has a synthetic twin of the same form that always
runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import Column, LogError, inspect, open_log, read_log, read_recording, sampling_of
from gtmodel.measurements.signal_table import read as read_table
from tests.support.recordings import EMPS, NO_EMPS, recording, write_synthetic_emps

SECONDS = Column("MATLABtime", "s")


def there(name: str) -> Path:
    path = recording(name)
    if not path.is_file():
        pytest.skip(f"{name} is not there; GTMODEL_RECORDINGS names the folder of recordings")
    return path


def at_hand(source: str | Callable[[Path], object], folder: Path) -> Path:
    """The recording of this name, or the synthetic twin that this function writes into the folder."""
    if isinstance(source, str):
        return there(source)
    source(folder / "twin.mat")
    return folder / "twin.mat"


# -- an inertial sensor on an arm: two clocks, a lost sample, rows in place of columns ----


def imu_twin(path: Path) -> None:
    """Synthetic, seed 3: a sensor at about 120 Hz with jitter and one lost sample, a robot at about 12 Hz."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.004, 0.0125, 1200))
    turn = 1.2 * np.sin(1.5 * time)
    gyro = np.vstack([np.rad2deg(1.8 * np.cos(1.5 * time)), 0 * time, 0 * time]) + rng.normal(0, 0.3, (3, 1200))
    acc = np.vstack([np.sin(turn), 0 * time, np.cos(turn)]) + rng.normal(0, 0.003, (3, 1200))
    acc[2, 100:900:40] += 1.5
    acc[2] = np.minimum(acc[2], 1.995)
    quaternion = np.vstack([np.cos(turn / 2), 0 * time, np.sin(turn / 2), 0 * time])
    time[368], gyro[:, 368], acc[:, 368] = 0.0, np.nan, np.nan
    slow = np.arange(0.03, time[-1], 0.08)
    savemat(
        path,
        {
            "MATLABtime": time[None], "SENSgyro": gyro, "SENSacc": acc, "ABBquaternion": quaternion,
            "ABBtime": slow[None], "TokenPosition": np.searchsorted(time, slow)[None].astype(np.uint16), "po": "q",
        },
    )  # fmt: skip


@pytest.mark.parametrize(
    ("source", "rows", "slow"), [("abb_imu/V1000_path3_MPU9150.mat", 2138, 219), (imu_twin, 1199, 124)]
)
def test_imu(source: str | Callable[[Path], object], rows: int, slow: int, tmp_path: Path) -> None:
    path = at_hand(source, tmp_path)
    columns = {
        "rate": Column("SENSgyro", "deg/s", SECONDS),
        "acceleration": Column("SENSacc", "1", SECONDS),
        "at": Column("TokenPosition", "1", Column("ABBtime", "s")),
    }
    with pytest.raises(LogError, match="sample 369, variable 'SENS"):
        read_recording(path, columns)
    recording = read_recording(path, columns, empty_rows="drop", late_rows="drop")
    assert list(recording) == ["MATLABtime", "ABBtime"]
    sensor, robot = recording.values()
    assert sensor["rate"].shape == (rows, 3) and sensor["acceleration"].shape == (rows, 3) and len(robot) == slow
    sampling = sampling_of(sensor.time)
    assert 90 < sampling.rate < 150 and sampling.jitter > 0.1 and sampling.late == 0
    assert 10 < sampling_of(robot.time).rate < 16
    assert np.median(np.linalg.norm(sensor["acceleration"], axis=1)) == pytest.approx(1.0, abs=0.02)
    study = inspect(path)
    stream = next(s for s in study.inspected if "SENSacc[2]" in [c.name for c in s.columns])
    by_name = {c.name: (c, g) for c, g in zip(stream.columns, stream.guesses, strict=True)}
    assert by_name["SENSgyro[0]"][1].unit == "deg/s" and not by_name["SENSgyro[0]"][1].stated
    assert "probably g" in by_name["SENSacc[0]"][1].why and "quaternion" in by_name["ABBquaternion[0]"][1].why
    assert by_name["SENSacc[2]"][0].clipped >= 4 and not by_name["SENSacc[0]"][0].clipped
    assert stream.clock is not None and stream.clock.name == "MATLABtime" and stream.clock.resets == 1
    assert any("goes back once" in note for note in study.notes)


# -- a heavy arm: a struct of matrices with a row for each axis ----


def arm_twin(path: Path) -> None:
    """Synthetic, no noise: 2,501 samples at 4 ms of six axes."""
    t = 0.004 * np.arange(2501)
    q = np.rad2deg(np.sin(np.outer(np.arange(1, 7) / 3, t)))
    rec = {"time_cont": t[None], "act_pos_se_deg": q, "act_torque_abs_nm": 2 * q, "n": 1.0}
    savemat(path, {"rec": rec, "n_axis": 6.0, "name": "arm"})


@pytest.mark.parametrize("source", ["kr300/data_A.mat", arm_twin])
def test_arm(source: str | Callable[[Path], object], tmp_path: Path) -> None:
    path = at_hand(source, tmp_path)
    columns = {"q": Column("rec.act_pos_se_deg", "deg"), "force": Column("rec.act_torque_abs_nm", "N.m")}
    (session,) = read_log(path, columns, time=Column("rec.time_cont", "s"), sample_time=0.004)
    assert session.trajectory["q"].shape == (2501, 6) and session.sample_time == pytest.approx(0.004, rel=1e-6)
    raw = open_log(path)[0].read({"q": ["rec.act_pos_se_deg[1]"]}).values["q"]
    np.testing.assert_allclose(session.trajectory["q[1]"], np.deg2rad(raw[:, 0]), rtol=1e-15)
    stream = inspect(path).inspected[0]
    units = {c.name: g.unit for c, g in zip(stream.columns, stream.guesses, strict=True)}
    assert units["rec.act_pos_se_deg[1]"] == "deg" and units["rec.act_torque_abs_nm[1]"] == "N.m"
    assert {c.unit for c in stream.clocks if c.name == "rec.time_cont"} == {"s"}


# -- a drive: vectors at 1 kHz with printed digits ----


@pytest.mark.parametrize(
    ("source", "rows"),
    [
        pytest.param("emps/DATA_EMPS.mat", 24841, marks=pytest.mark.skipif(not EMPS.is_file(), reason=NO_EMPS)),
        (write_synthetic_emps, 4001),
    ],
)
def test_drive(source: str | Callable[[Path], object], rows: int, tmp_path: Path) -> None:
    path = at_hand(source, tmp_path)
    columns = {"q": Column("qm", "m"), "u": Column("vir", "V")}
    (session,) = read_log(path, columns, time=Column("t", "s"))
    assert len(session.trajectory) == rows and session.sample_time == pytest.approx(1e-3, rel=1e-4)
    (stream,) = inspect(path).inspected
    assert stream.clock is not None and stream.clock.sampling.even(0.01)


# -- tables of poses: CSV without units and without time ----


LEGS = {
    "q": ([f"leg_length_{k}" for k in range(1, 7)], "1"),
    "T": ([f"position_{x}" for x in "xyz"], "mm"),
    "e": ([f"orientation_{x}" for x in "wxyz"], "1"),
}
TOWERS = {"heights.csv": {"q": (["a", "b", "c"], "mm"), "h": (["height"], "mm")}}
TOWERS |= {"dist.csv": {f"q{n}": ([f"{x}{n}" for x in "abc"], "mm") for n in (1, 2)} | {"d": (["dist"], "mm")}}


PLATFORM = ["108_calibration_poses.csv", "rosbag_108_offset_origins.csv"]


def table_twin(path: Path, columns: dict[str, tuple[list[str], str]]) -> Path:
    """Synthetic, seed 4: 20 rows of these columns."""
    names = [name for members, _ in columns.values() for name in members]
    rows = np.random.default_rng(4).uniform(-1, 1, (20, len(names)))
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")
    return path


@pytest.mark.parametrize("name", PLATFORM)
def test_platform(name: str) -> None:
    (stream,) = inspect(there(f"hexapod/{name}")).inspected
    guesses = {c.name: g for c, g in zip(stream.columns, stream.guesses, strict=True)}
    assert guesses["position_x"].unit == "mm" and "quaternion" in guesses["orientation_x"].why


@pytest.mark.parametrize(
    ("columns", "name", "rows"),
    [
        *((LEGS, f"hexapod/{name}", 108) for name in PLATFORM),
        (TOWERS["heights.csv"], "klipper_v400/heights.csv", 7), (TOWERS["dist.csv"], "klipper_v400/dist.csv", 12),
        *((columns, "twin", 20) for columns in (LEGS, *TOWERS.values())),
    ],
)  # fmt: skip
def test_tables(columns: dict[str, tuple[list[str], str]], name: str, rows: int, tmp_path: Path) -> None:
    path = table_twin(tmp_path / "twin.csv", columns) if name == "twin" else there(name)
    shapes = {name: values.shape for name, values in read_table(path, columns).values.items()}
    assert shapes == {name: (rows, len(members)) for name, (members, _) in columns.items()}
    assert any("no time column" in note for note in inspect(path).notes)
