"""Logs: what is read, and that each fault of a file is told with its line."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.measurements import Column, LogError, read_log, session_of
from gtmodel.results import Trajectory, TrajectoryError

COLUMNS = {"q": Column("pos", "mm"), "force": Column("cur", "N")}
GOOD = [f"{k * 4},{k * 10},{k * 0.5},7" for k in range(6)]


def write(folder: Path, lines: list[str], header: str = "t [ms],pos [mm],cur,temp") -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join(["# synthetic: seed 1, no noise", header, *lines]) + "\n", encoding="utf-8")
    return path


def read(path: Path, **options: object):
    return read_log(path, COLUMNS, time=Column("t", "ms"), **options)  # type: ignore[arg-type]


def test_columns_arrive_in_si_units_and_further_ones_are_left_alone(tmp_path: Path) -> None:
    (session,) = read(write(tmp_path, GOOD))
    trajectory = session.trajectory
    assert trajectory.names == ("q", "force") and trajectory.unit("q") == "m"
    assert np.allclose(trajectory["q"], 0.01 * np.arange(6), atol=1e-15)
    assert session.sample_time == pytest.approx(0.004, rel=1e-12)
    assert trajectory.synthetic == "seed 1, no noise" and session.name == "log.csv"


def test_a_vector_is_named_once(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q[0],q[1],q[2]\n0,1,2,3\n1,1,2,3\n2,1,2,4\n", encoding="utf-8")
    (session,) = read_log(path, {"q": Column("q", "m")})
    assert session.trajectory["q"].shape == (3, 3) and session.trajectory["q"][2, 2] == 4.0


def test_a_session_column_parts_the_rows(tmp_path: Path) -> None:
    lines = [f"{4 * k},{k},0,{s}" for s in (1, 2) for k in range(4)]
    sessions = read(write(tmp_path, lines, "t [ms],pos [mm],cur,run"), session="run")
    assert [len(s.trajectory) for s in sessions] == [4, 4]
    assert [s.name for s in sessions] == ["log.csv run 1", "log.csv run 2"]
    with pytest.raises(LogError, match=r"line 11: run 1 begins again after another one"):
        read(write(tmp_path, [*lines, "0,0,0,1"], "t [ms],pos [mm],cur,run"), session="run")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(header="t [ms],position [mm],cur,temp"), r"log.csv line 2: there is no column 'pos'; did you mean"),
        (dict(header="t [ms],pos [m],cur,temp"), r"line 2: 'pos' is in m here and declared in mm; correct one"),
        (dict(header="t [ms],pos [parsec],cur,temp"), r"line 2, column 'pos': unit 'parsec'"),
        (dict(header="t [ms],pos,pos,cur"), r"line 2: 'pos' occurs twice, in columns 2 and 3"),
        (dict(row=(2, "8,nan,1,7")), r"line 5, column 'pos': found 'nan'; expected a finite number"),
        (dict(row=(2, "8,1,7")), r"line 5: found 3 cells; expected 4"),
        (dict(row=(2, "3,20,1,7")), r"line 5, column 't': 3.0 ms does not come after 4.0 ms in line 4"),
        (dict(row=(2, "9,20,1,7")), r"line 5: 5 ms after the row before; expected 4 ms within 10 %: the step jitters"),
        (dict(drop=2), r"line 5: 8 ms after the row before; expected 4 ms within 10 %: about 1 sample is missing"),
        (dict(sample_time=0.002), r"the samples are 4 ms apart; expected 2 ms"),
        (dict(keep=2), r"line 3: a recording has 2 rows; expected at least 3"),
    ],
)
def test_faults_are_told_with_their_line(tmp_path: Path, change: dict, said: str) -> None:
    lines = list(GOOD)
    if "row" in change:
        lines[change["row"][0]] = change["row"][1]
    if "drop" in change:
        del lines[change["drop"]]
    path = write(tmp_path, lines[: change.get("keep")], change.get("header", "t [ms],pos [mm],cur,temp"))
    with pytest.raises(TrajectoryError, match=said) as caught:
        read(path, sample_time=change.get("sample_time"))
    assert "\n" not in str(caught.value)


def test_a_nan_in_a_column_that_nobody_asked_for_is_no_fault(tmp_path: Path) -> None:
    lines = [line.replace(",7", ",nan") for line in GOOD]
    assert len(read(write(tmp_path, lines))[0].trajectory) == len(GOOD)


def test_a_matlab_file(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    rows = np.arange(5.0)
    data = {"t": 4 * rows[:, None], "pos": rows[:, None], "cur": rows, "gain": 3.0, "bad": rows * np.nan}
    savemat(path, data)
    (session,) = read(path)
    assert np.allclose(session.trajectory["q"], rows / 1000, atol=1e-15)
    savemat(path, {"t": 4 * rows[:, None], "q": np.column_stack([rows, 2 * rows, 3 * rows])})
    (vector,) = read_log(path, {"q": Column("q", "m")}, time=Column("t", "ms"))
    assert np.array_equal(vector.trajectory["q"][2], [2.0, 4.0, 6.0])
    savemat(path, data)
    for columns, said in (
        ({"q": Column("position", "m")}, r"log.mat: there is no column 'position'; did you mean 'pos'"),
        ({"q": Column("gain", "1")}, r"the variable 'gain' holds 1 x 1 values; expected 5"),
        ({"q": Column("bad", "m")}, r"log.mat sample 1, variable 'bad': found 'nan'"),
    ):
        with pytest.raises(LogError, match=said):
            read_log(path, columns, time=Column("t", "ms"))
    path.write_bytes(b"no matlab file at all" * 20)
    with pytest.raises(LogError, match=r"cannot be read as a MATLAB file"):
        read(path)


def test_a_declaration_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"the unit declared for 'q': unit 'furlong'"):
        read_log(write(tmp_path, GOOD), {"q": Column("pos", "furlong")}, time=Column("t", "ms"))
    with pytest.raises(LogError, match=r"the time is declared in m; expected a unit of time"):
        read_log(write(tmp_path, GOOD), COLUMNS, time=Column("t", "m"))


def test_quoted_cells_and_empty_columns_of_a_spreadsheet(tmp_path: Path) -> None:
    plain = write(tmp_path, ["0,1.5,2,3", "1,1.6,2,3", "2,1.7,2,3"])
    expected = read(plain)[0].trajectory
    quoted = ['"0","1.5","2","3",,', '1,"1.6",2,3,,', '2,1.7,2,"3",,']
    found = read(write(tmp_path, quoted, header='"t [ms]","pos [mm]",cur,temp,,'))[0].trajectory
    for name in expected.names:
        np.testing.assert_array_equal(found[name], expected[name])
    for cell in ('"1.6', '"1.6"2"', '"1,6"', '""'):
        rows = ["0,1.5,2,3", f"1,{cell},2,3", "2,1.7,2,3"]
        with pytest.raises(TrajectoryError, match="line 4"):
            read(write(tmp_path, rows))


def test_a_long_cell_is_not_repeated_whole(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="line 3") as error:
        read(write(tmp_path, ["0," + "9" * 5000 + ",2,3", "1,1.6,2,3", "2,1.7,2,3"]))
    assert len(str(error.value)) < 500


def test_a_trajectory_in_memory_is_a_session_where_its_rows_are_even():
    time = 0.01 * np.arange(50)
    session = session_of(Trajectory(time, {"q": time}, {"q": "m"}), "here")
    assert session.name == "here" and session.sample_time == pytest.approx(0.01)
    for wrong in (np.where(time > 0.2, time + 0.005, time), time[:2]):
        with pytest.raises(LogError):
            session_of(Trajectory(wrong, {"q": wrong}, {"q": "m"}))
