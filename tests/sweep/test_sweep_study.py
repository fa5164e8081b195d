"""Sweeps of a function: equal tables for any number of workers, on a cluster, after kill -9, and in parts."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from gtmodel.results.work import CREW, Crew
from gtmodel.sweep.sweep_study import csv_of
from tests.support.commands import environment
from tests.sweep.tasks import counted, fails_at_two, worker_killed_once

needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
X = [float(x) for x in range(12)]


@pytest.fixture
def ran(tmp_path: Path) -> Path:
    """A folder in which each run of a row leaves a file."""
    folder = tmp_path / "ran"
    folder.mkdir()
    return folder


def swept(task: Any, x: list[float], crew: Crew, **given: Any) -> str:
    """The table of a sweep that a crew runs."""
    before = CREW.set(crew)
    try:
        return csv_of(gt.sweep.study(task, {"x": x}, **given).table)
    finally:
        CREW.reset(before)


def runs_of(folder: Path) -> list[str]:
    return sorted(p.name.rpartition("_")[0] for p in folder.iterdir() if "_" in p.name)


def test_workers_change_nothing_in_the_table(ran: Path, crew: Crew) -> None:
    there, here = (swept(partial(counted, ran, 0.0), X, who) for who in (crew, Crew()))
    lines = here.splitlines()
    assert there == here and lines[0] == "row,x,status,value,norm,message" and len(lines) == 13
    assert float(lines[3].split(",")[3]) == math.sin(2.0)


@needs_signals
def test_a_worker_killed_in_the_middle_changes_nothing(ran: Path, tmp_path: Path, crew: Crew) -> None:
    there = swept(partial(worker_killed_once, ran), X, crew, folder=tmp_path / "out", identity="one")
    assert (ran / "killed").exists() and there == swept(partial(counted, ran, 0.0), X, Crew())


SCRIPT = """
import sys
from functools import partial
from pathlib import Path
import gtmodel as gt
from tests.sweep.tasks import counted
if __name__ == "__main__":
    ran, out = map(Path, sys.argv[1:])
    gt.sweep.study(partial(counted, ran, 0.06), {"x": [k / 8 for k in range(200)]}, workers=2, folder=out, identity="1")
"""


@needs_signals
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_200_rows_stopped_at_the_half_resume_without_repeating_one(number: int, ran: Path, tmp_path: Path) -> None:
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SCRIPT)
    words = [sys.executable, str(script), str(ran), str(out)]
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a job in the background would not hear Ctrl-C
    with subprocess.Popen(words, env=environment(), stderr=subprocess.DEVNULL, preexec_fn=heard) as process:
        deadline = time.monotonic() + 60
        while len(list(out.glob("rows/*/*.json"))) < 100 and time.monotonic() < deadline:
            time.sleep(0.02)
        os.kill(process.pid, number)
    time.sleep(0.5)  # workers of a killed parent end by themselves
    kept = len(list(out.glob("rows/*/*.json")))
    assert 100 <= kept < 200
    under_way = len(runs_of(ran)) - kept  # ended in a worker, and not yet kept
    assert under_way <= 4
    task = partial(counted, ran, 0.0)
    values = {"x": [k / 8 for k in range(200)]}
    resumed = gt.sweep.study(task, values, folder=out, identity="1")
    assert resumed.status.ok and resumed.rows_done == 200
    assert len(runs_of(ran)) == 200 + under_way
    whole = gt.sweep.study(task, values, workers=0)
    assert (out / "table.csv").read_text() == csv_of(whole.table)


def test_parts_share_a_folder_and_merge(ran: Path, tmp_path: Path) -> None:
    task, out = partial(counted, ran, 0.0), tmp_path / "out"
    given: dict[str, Any] = dict(workers=0, folder=out, identity="1")
    parts = [gt.sweep.study(task, {"x": X}, part=(i, 3), **given) for i in (1, 2, 3)]
    assert [p.table["row"] for p in parts] == [[0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11]]
    merged = gt.sweep.study(task, {"x": X}, only_merge=True, **given)
    assert merged.status.ok and len(runs_of(ran)) == 12
    assert (out / "table.csv").read_text() == csv_of(gt.sweep.study(task, {"x": X}, workers=0).table)
    wider = gt.sweep.study(task, {"x": [*X, 12.0]}, only_merge=True, **given)
    assert not wider.status.ok and wider.rows_done == 12 and wider.rows_declared == 13


def test_a_failed_row_stays_and_fails_the_sweep() -> None:
    swept = gt.sweep.study(fails_at_two, {"x": [1.0, 2.0, 3.0]}, workers=0)
    assert swept.status is gt.SolveStatus.CHECK_FAILED and swept.failed == [1] and swept.rows_solved == 2
    assert swept.table["status"] == ["solved", "failed", "solved"] and swept.table["value"] == [-1.0, None, 1.0]
    assert "ZeroDivisionError" in swept.table["message"][1]


def test_a_row_with_an_unexpected_error_is_repeated(tmp_path: Path) -> None:
    given: dict[str, Any] = dict(workers=0, folder=tmp_path / "out", identity="1")
    assert gt.sweep.study(fails_at_two, {"x": [1.0, 2.0]}, **given).failed == [1]
    assert len(list(tmp_path.glob("out/rows/*/*.json"))) == 1


@pytest.mark.parametrize("text", ["", '{"status": "sol', "[]", "{}"])
def test_a_damaged_record_is_made_again(text: str, ran: Path, tmp_path: Path) -> None:
    given: dict[str, Any] = dict(workers=0, folder=tmp_path / "out", identity="1")
    first = gt.sweep.study(partial(counted, ran, 0.0), {"x": [1.0, 2.0]}, **given)
    next(tmp_path.glob("out/rows/*/*.json")).write_text(text)
    assert csv_of(gt.sweep.study(partial(counted, ran, 0.0), {"x": [1.0, 2.0]}, **given).table) == csv_of(first.table)
    assert len(runs_of(ran)) == 3


def test_a_function_without_an_identity_keeps_no_rows(ran: Path, tmp_path: Path) -> None:
    for _ in range(2):
        gt.sweep.study(partial(counted, ran, 0.0), {"x": [1.0]}, workers=0, folder=tmp_path / "out")
    assert len(runs_of(ran)) == 2 and (tmp_path / "out" / "table.csv").exists()


@pytest.mark.parametrize("method", ["random", "sobol", "lhs"])
def test_samples_follow_their_distributions_and_their_seed(method: Any) -> None:
    vary = {
        "u": gt.sweep.Uniform(2.0, 4.0), "l": gt.sweep.LogUniform(1.0, 100.0), "n": gt.sweep.Normal(5.0, 2.0),
        "c": gt.sweep.OneOf(("a", "b")),
    }  # fmt: skip
    rows = gt.sweep.design(vary, samples=1024, seed=3, method=method)
    drawn = [rows[k] for k in range(len(rows))]
    assert drawn == [gt.sweep.design(vary, samples=1024, seed=3, method=method)[k] for k in range(1024)]
    assert drawn[7] != gt.sweep.design(vary, samples=1024, seed=4, method=method)[7]
    u, log, n = (np.array([row[name] for row in drawn]) for name in ("u", "l", "n"))
    # five standard errors of means of 1,024 independent draws; the other designs are nearer
    assert abs(u.mean() - 3.0) < 5 * (2 / math.sqrt(12)) / 32
    assert abs(np.log(log).mean() - math.log(10.0)) < 5 * (math.log(100.0) / math.sqrt(12)) / 32
    assert abs(n.mean() - 5.0) < 5 * 2.0 / 32 and abs(n.std() - 2.0) < 5 * 2.0 / 32 / math.sqrt(2)
    assert abs(sum(row["c"] == "a" for row in drawn) - 512) < 5 * 16


def test_a_latin_hypercube_has_one_sample_in_each_stratum() -> None:
    rows = gt.sweep.design({"u": gt.sweep.Uniform(0.0, 1.0)}, samples=50, seed=1, method="lhs")
    assert sorted(int(50 * rows[k]["u"]) for k in range(50)) == list(range(50))


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("vary", dict(vary={})),
        ("vary", dict(vary={"x": []})),
        ("vary", dict(vary={"x": 3.0})),
        ("vary", dict(vary={"status": [1.0]})),
        ("vary", dict(vary={"x": [1.0]}, rows=[{"x": 2.0}])),
        ("rows", dict(vary={}, rows=[{"x": 2.0}, {"y": 1.0}])),
        ("samples", dict(vary={"x": gt.sweep.Uniform(0.0, 1.0)})),
        ("samples", dict(vary={"x": [1.0]}, samples=3)),
        ("part", dict(vary={"x": [1.0]}, part=(3, 2))),
        ("folder", dict(vary={"x": [1.0]}, part=(1, 2))),
        ("show", dict(vary={"x": [1.0]}, show=["no_such"])),
    ],
)
def test_wrong_arguments_are_named(argument: str, options: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError) as caught:
        gt.sweep.study(fails_at_two, workers=0, **options)
    assert caught.value.argument == argument


def test_rows_are_the_index_for_pandas() -> None:
    pytest.importorskip("pandas")
    frame = gt.sweep.study(fails_at_two, {"x": [1.0, 2.0, 3.0]}, workers=0).frame()
    assert list(frame.index) == [0, 1, 2] and frame["value"].isna().tolist() == [False, True, False]


def test_pictures_of_one_key_two_keys_and_samples() -> None:
    def surface(x: float, y: float = 0.0) -> dict[str, float]:
        return {"a": x + y, "b": x * y, "same": 1.0}

    one = gt.sweep.study(surface, {"x": [1.0, 2.0, 3.0]}, workers=0).figure("sweep")
    assert [axes.get_ylabel() for axes in one.axes] == ["a"]
    np.testing.assert_array_equal(one.axes[0].lines[0].get_ydata(), [1.0, 2.0, 3.0])
    two = gt.sweep.study(surface, {"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0]}, workers=0, show=["b"]).figure("sweep")
    mesh = two.axes[0].collections[0]
    np.testing.assert_array_equal(np.reshape(mesh.get_array(), (2, 3)), [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]])
    words = gt.sweep.study(surface, {"x": [1.0, 2.0, 3.0]}, rows=[{"y": 1.0}, {"y": 2.0}], workers=0)
    assert len(words.figure("sweep").axes) == 4  # two maps with their bars
