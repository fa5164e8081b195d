"""What is said of tables that a person got wrong names what is wrong, and nothing that is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel.calibrate.measured.column_checks import other_unit
from gtmodel.measurements.signal_table import CsvTable
from gtmodel.results import Check, Study
from gtmodel.results.refusal import ArgumentError
from gtmodel.results.status import SolveStatus


def table(folder: Path, text: str, encoding: str = "utf-8") -> CsvTable:
    path = folder / "poses.csv"
    path.write_text(text, encoding=encoding)
    return CsvTable(path)


def test_a_column_that_is_there_twice_is_no_column_that_is_missing(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="twice"):
        table(tmp_path, "q[0],q[1],q[1]\n1,2,3\n").place("q[1]")


@pytest.mark.parametrize("sign", ["\t", ";", "|", " ", ","])
def test_other_separators_are_recognised(tmp_path: Path, sign: str) -> None:
    read = table(tmp_path, f"a{sign}b\n1{sign}2\n")
    assert read.names == ["a", "b"] and read.numbers("b").tolist() == [2.0]


def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path: Path) -> None:
    assert table(tmp_path, "a,b\n1,2\n", "utf-8-sig").names == ["a", "b"]


def test_one_bad_cell_is_a_pose_and_no_unit() -> None:
    rows = np.random.default_rng(3).uniform(0.0, 1.0, (20, 3))
    wrong = rows.copy()
    wrong[6, 1] *= 1000.0
    found = other_unit("X", wrong, 1.0, "m")
    assert found is not None and "pose 7" in found.sentence and "mm" not in found.sentence
    found = other_unit("X", rows * 1000.0, 1.0, "m")
    assert found is not None and "probably in mm" in found.sentence
    assert other_unit("X", rows, 1.0, "m") is None


@pytest.mark.parametrize(("value", "shown"), [(0.1837, False), (0.5, True)])
def test_a_bound_that_does_not_explain_the_verdict_is_not_shown(value: float, shown: bool) -> None:
    study = Study(status=SolveStatus.SOLVED, checks={"error_mm": Check(value, 0.3, judged=False)})
    assert study.status is SolveStatus.CHECK_FAILED
    assert ("at most 0.3" in str(study)) is shown and ("at most 0.3" in study.message) is shown
