"""Trajectory: CSV and npz files, exact both ways, and what their readers refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from gtmodel.results import Trajectory, TrajectoryError
from tests.results.trajectories import ROUNDING, example, quick, trajectories


@pytest.mark.parametrize(
    ("write", "read"), [(Trajectory.to_csv, Trajectory.from_csv), (Trajectory.to_npz, Trajectory.from_npz)]
)
@quick
@given(traj=trajectories())
def test_round_trips_are_exact(tmp_path: Path, write: Any, read: Any, traj: Trajectory) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    write(traj, first, overwrite=True)
    again = read(first)
    assert again == traj
    for name in traj.names:
        assert again[name].tobytes() == traj[name].tobytes()  # -0.0 too
    write(again, second, overwrite=True)
    assert first.read_bytes() == second.read_bytes()


def test_text_of_a_csv_file(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    traj = Trajectory(
        [0.0, 0.1],
        {"T": [[1.0, -0.0], [1e-5, 1 / 3]], "x[0]": [2, 3]},
        {"T": "m", "x[0]": "rad/s"},
        title="Line",
        provenance={"b": 1, "a": [2.5]},
        synthetic="seed 1",
    )
    traj.to_csv(path)
    assert path.read_bytes() == (
        b"# title: Line\n"
        b"# synthetic: seed 1\n"
        b'# provenance: {"a": [2.5], "b": 1}\n'
        b"# scalar: x[0]\n"
        b"time [s],T[0] [m],T[1] [m],x[0] [rad/s]\n"
        b"0.0,1.0,-0.0,2.0\n"
        b"0.1,1e-05,0.3333333333333333,3.0\n"
    )
    assert Trajectory.from_csv(path) == traj
    plain = tmp_path / "plain.csv"
    Trajectory([0.0], {"x": [1.0]}).to_csv(plain)
    assert plain.read_bytes() == b"time [s],x [1]\n0.0,1.0\n"


def test_a_measurement_is_read_and_converted_to_si(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(
        b"\xef\xbb\xbf# laser tracker\r\n# Title: Run 7\r\ntime [ms], q[0] [mm] ,q[1] [mm],speed [rpm]\r\n"
        b"0,1, 2,60\r\n9,1.5,2e1,-60\r\n# synthetic: seed 5\r\n\r\n"
    )
    traj = Trajectory.from_csv(path)
    assert traj.time.tolist() == [0.0, 0.009]
    assert traj["q"].tolist() == [[0.001, 0.002], [0.0015, 0.02]]
    assert (traj.unit("q"), traj.unit("speed"), traj.title, traj.synthetic) == (
        "m",
        "rad/s",
        "Run 7",
        "seed 5",
    )
    np.testing.assert_allclose(traj["speed"], [2 * np.pi, -2 * np.pi], rtol=ROUNDING)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("q[0] [m],q[1] [m]", ("q",)),
        ("q[0] [m],q[1] [rad]", ("q[0]", "q[1]")),
        ("q[1] [m],q[0] [m]", ("q[1]", "q[0]")),
        ("q[1] [m],q[2] [m]", ("q[1]", "q[2]")),
        ("q[0] [m],q[2] [m]", ("q[0]", "q[2]")),
        ("q[0] [m],x [m],q[1] [m]", ("q[0]", "x", "q[1]")),
        ("q [m],q[0] [m],q[1] [m]", ("q", "q[0]", "q[1]")),
        ("q[0] [m],q[1] [mm]", ("q",)),
        ("q[00] [m],q[01] [m]", ("q[00]", "q[01]")),
        ("q[0][0] [m],q[0][1] [m],q[1][0] [m]", ("q[0]", "q[1]")),
        ("arm[0].x [m],arm[1].x [m]", ("arm[0].x", "arm[1].x")),
        ("time[0] [m]", ("time[0]",)),
    ],
)
def test_which_columns_become_a_vector(tmp_path: Path, header: str, expected: tuple[str, ...]) -> None:
    path = tmp_path / "h.csv"
    path.write_text(f"time [s],{header}\n0{',1' * (header.count(',') + 1)}\n")
    assert Trajectory.from_csv(path).names == expected


def test_files_are_not_overwritten_unasked(tmp_path: Path) -> None:
    traj = example()
    for write, path in ((traj.to_csv, tmp_path / "a.csv"), (traj.to_npz, tmp_path / "a.npz")):
        path.write_text("precious")
        with pytest.raises(FileExistsError) as caught:
            write(path)
        assert str(caught.value) == (
            f"{path} exists already and was not changed; choose another path or pass overwrite=True"
        )
        assert path.read_text() == "precious"
        write(path, overwrite=True)
        assert path.read_bytes() != b"precious"


def test_npz_of_another_program(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(TrajectoryError, match=r"other.npz is not a trajectory written by to_npz\(\)"):
        Trajectory.from_npz(path)
    path.write_text("hello")
    with pytest.raises(TrajectoryError, match="is not a trajectory"):
        Trajectory.from_npz(path)
    for read in (Trajectory.from_npz, Trajectory.from_csv):
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "missing")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "FILE has no header; expected a line such as 'time [s],q[0] [m]'"),
        ("# title: x\n", "FILE has no header; expected a line such as 'time [s],q[0] [m]'"),
        ("time [s],x [m]\n\n", "FILE has a header but no rows; expected a row of numbers for each time"),
        (
            "time [s],T[0]\n0,1\n",
            "FILE line 1, column 2: 'T[0]' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "time,x [m]\n0,1\n",
            "FILE line 1, column 1: 'time' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "time [s],x []\n0,1\n",
            "FILE line 1, column 2: 'x []' has no unit; expected 'name [unit]', such as 'q[0] [m]'",
        ),
        (
            "# note\ntime [s],x [kgg]\n0,1\n",
            "FILE line 2, column 2: unit 'kgg' has the unknown symbol 'kgg'; close matches are 'kg', 'g', 'kg.g'",
        ),
        (
            "t [s],x [m]\n0,1\n",
            "FILE line 1, column 1: found 't [s]'; expected the time, as 'time [s]' or 'time [ms]'",
        ),
        (
            "time [m],x [m]\n0,1\n",
            "FILE line 1, column 1: found 'time [m]'; expected the time, as 'time [s]' or 'time [ms]'",
        ),
        (
            "time [s],x [m],x [m]\n0,1,2\n",
            "FILE line 1, column 3: the name 'x' occurs twice; give every column a different name",
        ),
        (
            "time [s],time [s]\n0,1\n",
            "FILE line 1, column 2: a signal is named 'time', the name of the time grid; choose another name",
        ),
        (
            "time [s]\n0\n",
            "FILE line 1: there is no column besides the time; expected at least one signal",
        ),
        (
            "time [s];x [m]\n0;1\n",
            "FILE line 1: the columns are not separated by ','; save the file with commas and decimal points",
        ),
        (
            "# a\ntime [s],x [m]\n0,1\n1,abc\n",
            "FILE line 4, column 'x': found 'abc'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],T[0] [m],T[1] [m]\n0,1,nan\n",
            "FILE line 2, column 'T[1]': found 'nan'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,\n",
            "FILE line 2, column 'x': found ''; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1e999\n",
            "FILE line 2, column 'x': found '1e999'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1_0\n",
            "FILE line 2, column 'x': found '1_0'; expected a finite number such as 1.5e-3",
        ),
        (
            "time [s],x [m]\n0,1\n1,2,3\n",
            "FILE line 3: found 3 cells; expected 2, one for each column of the header",
        ),
        (
            "time [s],x [m]\n0,1\n\n1,2\n",
            "FILE line 3: found 1 cells; expected 2, one for each column of the header",
        ),
        (
            "time [ms],x [m]\n0,1\n# pause\n4,1\n4,2\n",
            "FILE line 5, column 'time': 4.0 ms does not come after 4.0 ms in line 4; time must increase "
            "strictly, so average the rows with equal time or keep the first",
        ),
        (
            "# synthetic:\ntime [s],x [m]\n0,1\n",
            "FILE: synthetic is empty; give seed and noise in one line, or None for real data",
        ),
        (
            "# provenance: [1]\ntime [s],x [m]\n0,1\n",
            "FILE: the note '# provenance:' must be one JSON object on one line",
        ),
        (
            "# provenance: {\ntime [s],x [m]\n0,1\n",
            "FILE: the note '# provenance:' is not JSON (Expecting property name enclosed in double quotes: "
            "line 1 column 2 (char 1)); correct or remove it",
        ),
    ],
)
def test_what_from_csv_refuses(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError) as caught:
        Trajectory.from_csv(path)
    assert str(caught.value) == sentence.replace("FILE", str(path))


def test_lines_that_end_in_carriage_returns_alone(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_bytes(b"time [s],x [m]\r0,1\r1,2\r")
    with pytest.raises(TrajectoryError, match="line 1 has a carriage return"):
        Trajectory.from_csv(path)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(b"time [s],x [m]\n0,\xff\n")
    with pytest.raises(TrajectoryError, match=r"is not a UTF-8 text file .*; save it as UTF-8"):
        Trajectory.from_csv(path)
