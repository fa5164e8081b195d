"""A log that is larger than the memory that reading it may take: 1 GB in at most 500 MB, with progress."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory is read from /proc")
MEGABYTE = 1 << 20
MOST = 500  # MB of the whole process
ROWS_AT_ONCE = 20_000
READING = """
import json, sys
from gtmodel.measurements import Column, inspect, read_log
shown = []
def progress(stage=None, fraction=None, numbers=None):
    shown.append(fraction)
def most():  # of this program; ru_maxrss is that of the process which started it, where that was larger
    (line,) = (x for x in open("/proc/self/status") if x.startswith("VmHWM"))
    return int(line.split()[1]) / 1024
before = most()
if sys.argv[2] == "read":
    columns = {"q": Column(("q_1", "q_2"), "mm")}
    (session,) = read_log(sys.argv[1], columns, time=Column("t_ms", "ms"), progress=progress)
    rows, last = len(session.trajectory), float(session.trajectory["q"][-1, 1])
else:
    (stream,) = inspect(sys.argv[1], progress=progress).inspected
    rows, last = stream.rows, stream.columns[2].last / 1000
print(json.dumps([rows, last, before, most(), len(shown), shown == sorted(shown), shown[-1]]))
"""


def write(path: Path, megabytes: float) -> tuple[int, float]:
    """A synthetic log, seed 7: a time and ten columns of seven digits. Returns rows, and the last q_2 in m."""
    rng = np.random.default_rng(7)
    tails = [",".join(f"{x:.6f}" for x in row) for row in rng.uniform(-9, 9, (997, 10))]
    rows = 0
    with path.open("w") as file:
        file.write("t_ms," + ",".join(f"q_{k}" for k in range(1, 11)) + "\n")
        while file.tell() < megabytes * MEGABYTE:
            file.write("".join(f"{4 * k},{tails[k % 997]}\n" for k in range(rows, rows + ROWS_AT_ONCE)))
            rows += ROWS_AT_ONCE
    return rows, float(tails[(rows - 1) % 997].split(",")[1]) / 1000


def run(path: Path, what: str) -> tuple[int, float, float, float, int, bool, float]:
    done = subprocess.run(
        [sys.executable, "-c", READING, str(path), what], capture_output=True, text=True, check=False, cwd=path.parent
    )
    assert done.returncode == 0, done.stderr
    return tuple(json.loads(done.stdout))


@pytest.mark.parametrize("what", ["read", "inspect"])
def test_30_megabytes(tmp_path: Path, what: str) -> None:
    rows, last = write(tmp_path / "log.csv", 30)
    read, value, before, most, reports, in_order, end = run(tmp_path / "log.csv", what)
    assert (read, value) == (rows, pytest.approx(last, rel=1e-12))
    assert reports > 50 and in_order and end == 1.0
    # what is kept are 24 bytes a row; all cells as Python's texts would be 200 MB
    assert most - before < 40


@pytest.mark.proof
@pytest.mark.parametrize("what", ["read", "inspect"])
def test_a_gigabyte(tmp_path: Path, what: str) -> None:
    rows, last = write(tmp_path / "log.csv", 1024)
    read, value, _, most, reports, in_order, end = run(tmp_path / "log.csv", what)
    assert (read, value) == (rows, pytest.approx(last, rel=1e-12))
    assert reports > 1000 and in_order and end == 1.0
    assert most < MOST
