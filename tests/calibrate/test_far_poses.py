"""A raw log with a gross outlier: the arm's shipped poses, one reading changed by 3.7 mm, or one cell empty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.calibrate import MeasuredPoses, Measurements, read_poses
from gtmodel.measurements.inspection.residual_tests import outliers
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer
from tests.calibrate.shipped import data, file_of, measured, solved
from tests.support import arm_poses

PROBLEM = arm_poses.PROBLEMS / "calibrate_arm.toml"
OFF = 3.7  # mm
FITTED, HELD = 42, 44  # lines; every third pose from line 3 is held out: 5, 8, ...


def file_with(folder: Path, changes: dict[int, float | None]) -> Path:
    """The shipped file with T[1] of these lines changed [mm], or empty."""
    lines = (arm_poses.PROBLEMS / "data" / "arm_synthetic.csv").read_text().splitlines()
    place = lines[1].split(",").index("T[1]")
    for line, change in changes.items():
        cells = lines[line - 1].split(",")
        cells[place] = "" if change is None else str(float(cells[place]) + change)
        lines[line - 1] = ",".join(cells)
    path = folder / "raw.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def calibrated(path: Path, *settings: str) -> Any:
    keys = [f'measurements.file="{path}"', "sensitivity_step=0", *settings]
    return answer(load(PROBLEM, keys), Context(folder=arm_poses.PROBLEMS))


@pytest.mark.parametrize("line", [FITTED, HELD])
def test_an_outlier_is_named_first_with_its_column(tmp_path: Path, line: int) -> None:
    s = calibrated(file_with(tmp_path, {line: OFF}))
    (outlier,) = s.outliers
    assert outlier["line"] == line and outlier["held_out"] == (line == HELD) and outlier["column"] == "T[1]"
    assert outlier["off_mm"] == pytest.approx(-OFF, abs=0.15)  # predicted less measured, without its own influence
    assert outlier["others_mm"] < 0.1 and np.isfinite(outlier["times"])
    assert f"line {line}" in s.verdict[0] and f"measurements.leave_out = [{line}]" in s.verdict[0]
    rows = [(row.label, str(row.value)) for row in s.rows]
    assert rows[0] == ("verdict", s.verdict[0])
    assert sum(label == "outlier" for label, _ in rows) == 1 and "inf" not in dict(rows)["outlier"]
    part = "held-out" if line == HELD else "fitted"
    assert f"line {line}" in dict(rows)[f"largest error, {part} poses"]
    assert "outlier may cause this" in s.verdict[-1]


def test_two_outliers_are_told_apart_from_the_poses_that_they_spoil(tmp_path: Path) -> None:
    s = calibrated(file_with(tmp_path, {FITTED: OFF, HELD: -OFF}))
    assert {o["line"] for o in s.outliers} == {FITTED, HELD}
    assert f"leave_out = [{FITTED}, {HELD}]" in s.verdict[0]


def test_a_pose_that_is_left_out_is_not_read(tmp_path: Path) -> None:
    """Also if one of its cells is empty. The others give what they give without the row."""
    s = calibrated(file_with(tmp_path, {FITTED: None}), f"measurements.leave_out=[{FITTED}]")
    assert s.poses == {"fitted": 60, "held_out": 29, "repeated": 0, "left_out": 1}
    assert not s.outliers and s.prediction_proven and any(f"line {FITTED}" in n for n in s.notes)
    assert all(entry["line"] != FITTED for entry in s.largest)


@pytest.mark.parametrize(
    ("left_out", "words"),
    [
        ("[]", ("line 42, column 'T[1]'", "empty", "leave_out = [42]")),
        ("[43]", ("line 42", "leave_out = [42, 43]")),
        ("[1, 42]", ("line 1,", "lines 3 to 92")),
        (str(list(range(3, 93))), ("all 90 rows",)),
    ],
)
def test_rows_that_cannot_be_read_or_left_out(tmp_path: Path, left_out: str, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        calibrated(file_with(tmp_path, {FITTED: None}), f"measurements.leave_out={left_out}")
    assert all(word in str(caught.value) for word in words)


def test_sessions_keep_to_their_rows_if_one_is_left_out(tmp_path: Path) -> None:
    head, rows = data("l1")
    head[-1] += ",session"
    path = file_of(tmp_path / "poses.csv", head, [[*r, str(k)] for k, r in enumerate(rows)])
    first = len(head) + 1
    m = read_poses(path, measured("l1", session="session", leave_out=[first + 1])).measurements
    assert m.sessions is not None and list(m.sessions[:3]) == ["0", "2", "3"] and len(m) == len(rows) - 1


def test_positions_of_a_tracker_at_an_unknown_place_are_asked_about(tmp_path: Path) -> None:
    s = calibrated(file_with(tmp_path, {}), 'measurements.frame="robot"')
    assert 'frame = "device"' in s.verdict[0] and not s.prediction_proven


def test_an_arm_without_its_variant_gets_one_note_on_undetermined_parameters(tmp_path: Path) -> None:
    text = PROBLEM.read_text().replace('variant = "serial"', "")
    (tmp_path / "p.toml").write_text(text)
    s: Any = answer(load(tmp_path / "p.toml", ["sensitivity_step=0"]), Context(folder=arm_poses.PROBLEMS))
    (note,) = [n for n in s.notes if "not determine" in n]
    assert 'variant = "serial"' in note and max(len(str(row.value)) for row in s.rows) < 400


def test_angles_are_in_the_unit_of_the_file(tmp_path: Path) -> None:
    s = calibrated(file_with(tmp_path, {}))
    rows = {row.label: row for row in s.rows}
    assert rows["alpha[0]"].unit == "deg" and str(rows["alpha[0]"].value).startswith("-90 -> -8")
    (alpha,) = [u for u in s.unknowns if u["name"] == "alpha[0]"]
    assert alpha["unit"] == "rad" and alpha["start"] == pytest.approx(-np.pi / 2)
    assert not solved("l1").degrees


def test_a_deleted_residual_leaves_those_of_other_groups() -> None:
    """Two groups that share unknowns: the sums of squares are those of a fit without the row."""
    rng = np.random.default_rng(3)  # synthetic: seed 3
    J, e = rng.normal(size=(40, 4)), rng.normal(size=40)
    e[7] += 60.0
    groups = np.arange(40) % 2
    U = np.linalg.qr(J)[0]
    found = outliers(e - U @ (U.T @ e), U, groups)
    rest = np.arange(40) != 7
    r = e[rest] - J[rest] @ np.linalg.lstsq(J[rest], e[rest], rcond=None)[0]
    spare = 20 - np.sum(U[groups == 1] ** 2) - 1
    sigma = np.sqrt(np.sum(r[groups[rest] == 1] ** 2) / spare)
    deleted = (e - U @ (U.T @ e))[7] / np.sqrt(1 - U[7] @ U[7])
    assert found.beyond().tolist() == [7] and found.times[7] == pytest.approx(deleted / sigma, rel=1e-9)


def test_poses_in_memory_are_named_by_their_number() -> None:
    """They have no file to leave a line out of."""
    head, rows = data("l1")
    columns = head[-1].split(",")
    numbers = 1e-3 * np.array(rows, float)
    T = numbers[:, [columns.index(f"T[{k}]") for k in range(3)]]
    T[40, 0] += 0.03
    q = numbers[:, [columns.index(f"q[{k}]") for k in range(3)]]
    s: Any = solved("l1", MeasuredPoses(Measurements({"q": q, "T": T})))
    assert "pose 41" in s.verdict[0] and "leave_out" not in s.verdict[0]
