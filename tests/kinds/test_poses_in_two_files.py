"""Poses of the robot in one file, of the tracker in another: joined by number or by order, as by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import Measured, MeasuredPoses, MeasuredSignal, read_poses
from gtmodel.problem_files import InputError
from gtmodel.results import ArgumentError
from tests.calibrate.shipped import PROBLEMS

L1 = PROBLEMS / "calibrate_l1.toml"


def shipped() -> np.ndarray:
    lines = (PROBLEMS / "data" / "l1_synthetic.csv").read_text().splitlines()
    rows = [line for line in lines if not line.startswith("#")]
    names = rows[0].split(",")
    places = [names.index(f"{v}[{k}] [mm]") for v in "qT" for k in range(3)]
    return np.array([[float(line.split(",")[k]) for k in places] for line in rows[1:]])


def written(path: Path, head: str, rows: np.ndarray) -> None:
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.17g")


ROWS = shipped()
NUMBERS = np.arange(1.0, len(ROWS) + 1)
Q, T = "pose,q[0],q[1],q[2]", "pose,T[0],T[1],T[2]"
SHUFFLED = np.random.default_rng(2).permutation(len(ROWS))


def both(
    folder: Path, order: np.ndarray = SHUFFLED, join: str | None = "pose", held_out: Path | None = None
) -> MeasuredPoses:
    written(folder / "robot.csv", Q, np.column_stack([NUMBERS, ROWS[:, :3]]))
    written(folder / "tracker.csv", T, np.column_stack([NUMBERS, ROWS[:, 3:]])[order])
    signals = {"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal("T", "mm", file="tracker.csv", join=join)}
    return read_poses(folder / "robot.csv", Measured(signals), held_out)


@pytest.mark.parametrize(("order", "join"), [(SHUFFLED, "pose"), (np.arange(len(ROWS)), None)])
def test_two_files_are_the_file_joined_by_hand(tmp_path: Path, order: np.ndarray, join: str | None) -> None:
    written(tmp_path / "whole.csv", "q[0],q[1],q[2],T[0],T[1],T[2]", ROWS)
    whole = read_poses(
        tmp_path / "whole.csv", Measured({"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal("T", "mm")})
    )
    made = both(tmp_path, order, join)
    for name in ("q", "T"):
        assert np.array_equal(made.measurements.values[name], whole.measurements.values[name])
    assert made.lines is not None and whole.lines is not None
    assert list(made.columns) == list(whole.columns) and made.lines.tolist() == whole.lines.tolist()


def test_the_numbers_of_a_held_out_file_are_in_the_same_tracker_file(tmp_path: Path) -> None:
    written(tmp_path / "rest.csv", Q, np.column_stack([NUMBERS + 900, ROWS[:, :3]])[:4])
    held_out = tmp_path / "rest.csv"
    with pytest.raises(ArgumentError, match=r"rest.csv line 2: no row of 'tracker.csv' has 'pose' 901"):
        both(tmp_path, held_out=held_out)
    with pytest.raises(ArgumentError, match="join"):
        both(tmp_path, join=None, held_out=held_out)
    signals = {"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal("T", "mm", file="tracker.csv", join="pose")}
    numbered = np.column_stack([NUMBERS, ROWS[:, :3]])
    written(tmp_path / "robot.csv", Q, numbered[4:])
    written(tmp_path / "rest.csv", Q, numbered[:4])
    made = read_poses(tmp_path / "robot.csv", Measured(signals), held_out)
    assert made.held_out is not None and made.held_out.sum() == 4
    np.testing.assert_allclose(
        np.asarray(made.measurements.values["T"], float), np.roll(ROWS[:, 3:], -4, axis=0) / 1e3, rtol=1e-15
    )


def test_a_shipped_problem_in_two_files_has_the_same_result(tmp_path: Path) -> None:
    both(tmp_path)
    settings = [
        f"measurements.file='{tmp_path / 'robot.csv'}'", f"measurements.signals.T.file='{tmp_path / 'tracker.csv'}'",
        "measurements.signals.T.join='pose'",
    ]  # fmt: skip
    whole, parts = gt.load(L1)(), gt.load(L1, *settings)()
    assert parts.parameters == pytest.approx(whole.parameters, rel=1e-12)
    with pytest.raises(InputError) as caught:
        gt.load(L1, *settings[:1], "measurements.signals.T.file='nowhere.csv'")()
    assert caught.value.key == "measurements.signals.T.file"
    with pytest.raises((InputError, ArgumentError), match=r"T.join: .*no column 'number'"):
        gt.load(L1, *settings[:2], "measurements.signals.T.join='number'")()


LAST = len(ROWS) - 1


@pytest.mark.parametrize(
    ("order", "join", "said"),
    [
        (np.arange(LAST), "pose", f"robot.csv line {LAST + 2}: no row of 'tracker.csv' has 'pose' {LAST + 1}"),
        (np.append(np.arange(LAST + 1), 3), "pose", f"tracker.csv line {LAST + 3}: 'pose' is 4 again, as in line 5"),
        (np.arange(LAST), None, f"robot.csv line {LAST + 2}: this row has no partner"),
        (np.append(np.arange(LAST + 1), 3), None, f"tracker.csv line {LAST + 3}: this row has no partner"),
    ],
)
def test_a_row_without_a_partner(tmp_path: Path, order: np.ndarray, join: str | None, said: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        both(tmp_path, order, join)
    assert said in str(caught.value), str(caught.value)


def test_further_rows_of_the_tracker_and_joins_without_a_file(tmp_path: Path) -> None:
    both(tmp_path)
    signals = {"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal("T", "mm", file="tracker.csv", join="pose")}
    written(tmp_path / "robot.csv", Q, np.column_stack([NUMBERS, ROWS[:, :3]])[1:])
    with pytest.raises(ArgumentError, match=r"tracker.csv line \d+: no row of 'robot.csv' has 'pose' 1;"):
        read_poses(tmp_path / "robot.csv", Measured(signals))
    with pytest.raises(ArgumentError, match="name the file of this signal"):
        MeasuredSignal("T", "mm", join="pose")
    alone = {n: MeasuredSignal(n, "mm", file="tracker.csv") for n in "qT"}
    with pytest.raises(ArgumentError, match="every signal names a file of its own"):
        read_poses(tmp_path / "robot.csv", Measured(alone))
