"""RAPID modules: what a controller reads is one module, of ASCII, of poses; and several may be loaded at once."""

import re

import numpy as np
import pytest

from gtmodel import robots
from gtmodel.calibrate.plan.study import rapid_program
from gtmodel.geometry.quaternions import quaternion_matrix
from gtmodel.motion import reference as rapid
from gtmodel.motion.reference import COLUMNS, rapid_text, reference_text
from gtmodel.results import ArgumentError, Trajectory

REACHED = {"l1_tape": [1.4, -0.5, 0.8], "d1_six_link": [-1.6, -4.4, -0.1]}
TITLE = "two\nMoveJ lines \u2264 5\u00b5m"
AWAY = np.zeros((2, 3))


def reference(name: str, count: int = 2) -> Trajectory:
    values = {signal: np.zeros((count, 3)) for signal, _ in COLUMNS}
    values["T"] = np.tile(REACHED[name], (count, 1))
    return Trajectory(0.04 * np.arange(count), values, dict(COLUMNS))


def names_for_all(text: str) -> set[str]:
    """Names that every module of the task sees."""
    return set(re.findall(r"^ *(?:MODULE|PROC|CONST num|PERS num|CONST robtarget) +(\w+)", text, re.MULTILINE))


def texts() -> dict[str, str]:
    robot = robots.make("l1_tape")
    first, second = (rapid_text(robot, reference("l1_tape"), TITLE, n) for n in (1, 2))
    alone = rapid_text(robot, reference("l1_tape"), TITLE)
    return {"alone": alone, "first": first, "second": second, "plan": rapid_program(AWAY, AWAY, TITLE, 0.5)}


@pytest.mark.parametrize("which", ["alone", "plan"])
def test_a_title_stays_a_comment_of_ascii(which: str) -> None:
    text = texts()[which]
    assert text.isascii() and all(len(line) <= 130 for line in text.splitlines())
    assert all(line.startswith("  ! ") for line in text.splitlines() if "lines" in line)
    assert len(reference_text(reference("l1_tape"), TITLE).splitlines()) == 2 + 2


def test_no_name_of_a_module_is_that_of_another() -> None:
    found = [names_for_all(text) for text in texts().values()]
    assert len(set.union(*found)) == sum(map(len, found)) and all(len(name) <= 32 for name in set.union(*found))


def test_the_orientation_is_that_of_the_plate() -> None:
    """By the rotation matrix, which the robot computes on its own; the quaternion is not asked for it."""
    robot = robots.make("d1_six_link")
    R, status = robot.causal(known="T", targets="R")(REACHED["d1_six_link"])
    text = rapid_text(robot, reference("d1_six_link"), "")
    (row, _) = (line for line in text.splitlines() if line.startswith("    [["))
    e = np.array([float(x) for x in row.split("[")[3].split("]")[0].split(",")])
    assert status == 0 and np.linalg.norm(e) == pytest.approx(1.0, abs=1e-8)
    assert np.asarray(quaternion_matrix(e)) == pytest.approx(np.asarray(R).reshape(3, 3), abs=1e-7)
    assert "[1, 0, 0, 0], [0, 0, 0, 0]" in texts()["alone"]  # a plate that does not turn


@pytest.mark.parametrize(
    ("T", "q"),
    [
        ([[np.nan, 0, 0]], [[0, 0, 0]]),
        ([[0, 0, 0]], [[0, np.inf, 0]]),
        ([[1e4, 0, 0]], [[0, 0, 0]]),
        ([[0, 0, 0, 0.6, 0.8, 0.1, 0]], [[0] * 6]),
    ],
)
def test_what_is_no_pose_is_refused(T: list[list[float]], q: list[list[float]]) -> None:
    with pytest.raises(ArgumentError, match="target 0 is invalid"):
        rapid.robtargets(np.array(T, float), np.array(q, float))


def test_numbers_have_no_minus_before_zero() -> None:
    (row,) = rapid.robtargets(np.array([[-1e-9, 0, 1.0]]), np.array([[-0.0, -1e-9, 0.1]]))
    assert row == "[[0.0000, 0.0000, 1000.0000], [1, 0, 0, 0], [0, 0, 0, 0], [0.0000, 0.0000, 100.0000, 9E9, 9E9, 9E9]]"
