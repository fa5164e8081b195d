"""A failed check is the verdict on the whole result: no "solved", no exit 0, nothing for a machine."""

import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from gtmodel.problem_files.base import Check, at_least, at_most
from gtmodel.results import SolveStatus, Study, Trajectory
from gtmodel.results.disk import marked
from tests.support.commands import Commands

PROBLEM = "l1_min_time"
# 85 mm of end error where 5 are allowed, and no finer mesh to mend it
COARSE = ("--set", "mesh.elements=8", "--set", "mesh.most_elements=8")


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@given(st.lists(st.booleans(), max_size=5), st.sampled_from(SolveStatus))
def test_solved_means_that_every_check_passed(passed: list[bool], status: SolveStatus) -> None:
    checks = {f"check_{n}_mm": Check(1.0, 0.5, "measure again", judged=p) for n, p in enumerate(passed)}
    outcome = Study(status=status, message="as it was", checks=checks)
    if status is not SolveStatus.SOLVED or all(passed):
        assert outcome.status is status and outcome.message == "as it was"
        return
    assert outcome.status is SolveStatus.CHECK_FAILED and not outcome.status.ok and outcome.status.converged
    for name, check in checks.items():
        assert (name in outcome.message) is not check.passed
    assert outcome.message.count("measure again") == 1


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_value_that_is_no_number_passes_nothing_it_should_not(value: float) -> None:
    assert at_most(value, 1.0).passed is (value < 0) and at_least(value, 1.0).passed is (value > 1)


def test_nothing_for_a_machine_is_written(gtmodel: Commands, tmp_path: Path) -> None:
    done = gtmodel("solve", PROBLEM, *COARSE, "--out", str(tmp_path / "a"), "--json")
    assert done.code == 1 and done.json["status"] == "check_failed"
    assert "exported_end_error_m" in done.json["message"] and "motion.mod" in done.json["message"]
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"result.json", "run.toml", "trajectory.csv"}


def test_asked_for_it_is_written_and_says_so_first(gtmodel: Commands, tmp_path: Path) -> None:
    done = gtmodel("solve", PROBLEM, *COARSE, "--out", str(tmp_path / "a"), "--write-failed")
    assert done.code == 1
    for name in ("motion.mod", "reference.csv"):
        first = (tmp_path / "a" / name).read_text().splitlines()[0]
        assert "NOT TO BE USED" in first and "exported_end_error_m" in first
    reference = Trajectory.from_csv(tmp_path / "a" / "reference.csv")
    assert np.all(np.isfinite(reference["tau"]))


@pytest.mark.parametrize("text", ["a check failed", "of two\nlines", "of C */ int main(void) { return 1; } /*"])
def test_a_mark_is_a_comment(text: str, tmp_path: Path) -> None:
    assert tomllib.loads(marked("a.toml", b"x = 1\n", text).decode()) == {"x": 1}
    (tmp_path / "a.c").write_bytes(marked("a.c", b"int main(void) { return 0; }\n", text))
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "a.c", "-o", "a"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "a"], check=True)
    assert marked("a.mod", b"MODULE A\n", text).splitlines()[1:] == [b"MODULE A"]


def test_a_file_that_cannot_be_marked_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a\.png"):
        marked("a.png", b"", "a check failed")
