"""Poses of the robot in one file, of the tracker in another: joined by number or by order, as by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import Measured, MeasuredPoses, MeasuredSignal, read_poses
from gtmodel.measurements import ClockColumn, RowJoin
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
        (
            np.append(np.arange(LAST + 1), 3),
            "pose",
            f"tracker.csv line {LAST + 3}: 'pose' is 4 again, as in tracker",
        ),
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


MOVE, REST, STEP = 0.6, 0.8, 0.004  # s: a motion, a rest, and the period of the robot's log
AT = MOVE + REST / 2 + (MOVE + REST) * np.arange(len(ROWS))  # s: middle of each rest


def robot_log(jitter: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and actuators of a robot that moves from pose to pose and rests there: synthetic, seed 5, white noise."""
    time = np.arange(0.0, AT[-1] + REST / 2, STEP)
    place = np.minimum((time / (MOVE + REST)).astype(int), len(ROWS) - 1)
    s = np.clip((time - place * (MOVE + REST)) / MOVE, 0.0, 1.0)[:, None]
    way = 10 * s**3 - 15 * s**4 + 6 * s**5
    before = np.maximum(place - 1, 0)
    q = ROWS[before, :3] + way * (ROWS[place, :3] - ROWS[before, :3])
    return time, q + jitter * np.random.default_rng(5).standard_normal(q.shape)


def in_time(folder: Path, late: float, jitter: float, join: RowJoin) -> MeasuredPoses:
    """The tracker's poses, in random order, with a robot's log; its stamps are late by `late`."""
    time, q = robot_log(jitter)
    written(folder / "robot.csv", "stamp,q[0],q[1],q[2]", np.column_stack([1e3 * time, q]))
    written(folder / "tracker.csv", "t,T[0],T[1],T[2]", np.column_stack([AT + late, ROWS[:, 3:]])[SHUFFLED])
    signals = {"q": MeasuredSignal("q", "mm", file="robot.csv", join=join), "T": MeasuredSignal("T", "mm")}
    return read_poses(folder / "tracker.csv", Measured(signals, time=ClockColumn("t")))


@pytest.mark.parametrize("late", [0.0, 0.25, -0.45])
def test_the_rest_of_a_robots_log_gives_the_poses_by_hand_with_less_noise(tmp_path: Path, late: float) -> None:
    jitter = 0.02  # mm; the mean of 50 rows has a seventh of it
    made = in_time(tmp_path, late, jitter, RowJoin("at_rest", tolerance=0.4, time=ClockColumn("stamp", "ms")))
    q = 1e3 * np.asarray(made.measurements.values["q"], float)
    assert np.std(q - ROWS[SHUFFLED, :3]) == pytest.approx(jitter / np.sqrt(50), rel=0.1)
    assert made.lines is not None and made.lines.tolist() == list(range(2, len(ROWS) + 2))


def test_the_nearest_and_the_interpolated_row_of_a_robots_log(tmp_path: Path) -> None:
    clock = ClockColumn("stamp", "ms")
    for join in (RowJoin("nearest", tolerance=0.003, time=clock), RowJoin("interpolated", time=clock)):
        made = in_time(tmp_path, 0.1, 0.0, join)
        assert np.allclose(1e3 * np.asarray(made.measurements.values["q"]), ROWS[SHUFFLED, :3], atol=1e-9)


@pytest.mark.parametrize(
    ("late", "join", "argument"),
    [
        (-0.7, RowJoin("at_rest", time=ClockColumn("stamp", "ms")), "measured.signals.q.join"),
        (
            -0.7,
            RowJoin("at_rest", tolerance=0.5, time=ClockColumn("stamp", "ms")),
            "measured.signals.q.join",
        ),
        (0.1, RowJoin("nearest", time=ClockColumn("stamp", "ms")), "measured.signals.q.join.tolerance"),
        (9.0, RowJoin("interpolated", time=ClockColumn("stamp", "ms")), "measured.signals.q.join"),
        (0.1, RowJoin("number"), "measured.signals.q.join.number"),
    ],
)
def test_a_pose_without_a_rest_is_named(tmp_path: Path, late: float, join: RowJoin, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        in_time(tmp_path, late, 0.02, join)
    assert caught.value.argument == argument, str(caught.value)
    if argument.endswith("join"):
        assert "tracker.csv line " in str(caught.value)


def test_a_left_out_line_and_a_problem_file_with_a_join_at_rest(tmp_path: Path) -> None:
    in_time(tmp_path, 0.0, 0.0, RowJoin("at_rest", time=ClockColumn("stamp", "ms")))
    settings = [
        f"measurements.file='{tmp_path / 'tracker.csv'}'", f"measurements.signals.q.file='{tmp_path / 'robot.csv'}'",
        "measurements.signals.q.join.match='at_rest'", "measurements.signals.q.join.time.column='stamp'",
        "measurements.signals.q.join.time.unit='ms'", "measurements.time.column='t'", "measurements.leave_out=[7]",
    ]  # fmt: skip
    assert gt.load(L1, *settings)().poses["left_out"] == 1
    with pytest.raises(InputError) as caught:
        gt.load(L1, *settings[:2], "measurements.signals.q.join.match='at_rest'")()
    assert caught.value.key == "measurements.time"
