"""What reading a file takes: a few doubles for each number, whatever the file takes for it."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from gtmodel.measurements import Column, read_log
from gtmodel.results import Trajectory

ROWS, COLUMNS = 6_000, 6
# bytes for each number: as read, in SI units, as a trajectory, and what growing takes meanwhile
MOST = 40


def written(folder: Path, unit: str, digits: int) -> Path:
    path = folder / "log.csv"
    values = np.random.default_rng(0).uniform(-1, 1, (ROWS, COLUMNS)).round(digits)
    lines = [",".join(["time [s]", *(f"q[{k}] [{unit}]" for k in range(COLUMNS))])]
    lines += [",".join([f"{0.004 * n:.3f}", *map(repr, row)]) for n, row in enumerate(values.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


def peak(read) -> tuple[float, object]:
    tracemalloc.start()
    try:
        found = read()
        return tracemalloc.get_traced_memory()[1] / (ROWS * (COLUMNS + 1)), found
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("digits", [1, 16])
@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_trajectory(tmp_path, unit, digits):
    path = written(tmp_path, unit, digits)
    most, found = peak(lambda: Trajectory.from_csv(path))
    assert isinstance(found, Trajectory) and found["q"].shape == (ROWS, COLUMNS)
    assert most < MOST


def test_a_log(tmp_path):
    path = written(tmp_path, "mm", 16)
    most, found = peak(lambda: read_log(path, {"q": Column("q", "mm")}))
    assert len(found[0].trajectory) == ROWS and most < 1.5 * MOST


def test_lines_are_told_all_the_same(tmp_path):
    path = written(tmp_path, "mm", 3)
    lines = path.read_text().split("\n")
    lines[5_345] = lines[5_345].replace("0.", "O.", 1)
    path.write_text("\n".join(lines))
    for read in (Trajectory.from_csv, lambda p: read_log(p, {"q": Column("q", "mm")})):
        with pytest.raises(ValueError, match=r"log\.csv line 5346, column"):
            read(path)
