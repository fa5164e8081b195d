"""``gtmodel sweep``: what it reads, writes and refuses; the problems run as `gtmodel solve` runs them."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel import _crew, _sweep_command
from gtmodel.problem_files import InputError
from gtmodel.results import ArgumentError
from tests.support.commands import Commands, command, environment


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture
def problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A compliance study of few points: the cheapest problem with a robot."""
    monkeypatch.chdir(tmp_path)
    text = gt.shipped("compliance_l1.toml").read_text()
    file = tmp_path / "soft.toml"
    file.write_text(text.replace("#:schema ./schemas/compliance.schema.json\n", ""))
    return file


SMALL = ("--set", "section.step_m=0.5", "--workers", "0", "--quiet")


def table_of(folder: Path) -> list[dict[str, str]]:
    with open(folder / "table.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_rows_equal_single_solves_and_their_folders_are_those_of_solve(run: Commands, problem: Path) -> None:
    done = run("sweep", problem, "--vary", "payload_kg=5:15:2", *SMALL, "-o", "out", "--runs", "--plot", "--json")
    assert done.code == 0 and done.json["values"]["rows_solved"] == 2, done.err
    rows = table_of(Path("out"))
    for row, mass in zip(rows, (5, 15), strict=True):
        assert run("solve", problem, "--set", f"payload_kg={mass}", *SMALL[:2], "--quiet", "--out", "one").code == 0
        alone = json.loads(Path("one/result.json").read_text())
        assert Path("out", "runs", row["run"], "result.json").read_bytes() == Path("one/result.json").read_bytes()
        numbers = {name: x for name, x in alone["values"].items() if isinstance(x, float)}
        assert numbers and {name: float(row[name]) for name in numbers} == numbers
    assert Path("out/sweep.png").exists()


def test_in_python_a_loaded_problem_is_swept_with_equal_numbers(run: Commands, problem: Path) -> None:
    run("sweep", problem, "--vary", "payload_kg=5,15", *SMALL, "-o", "out")
    call = gt.load(problem, "section.step_m=0.5")
    swept = gt.sweep.study(call, {"payload_kg": [5, 15]}, workers=0, folder="out")
    assert (Path("out/table.csv").read_text()) == gt.sweep.sweep_study.csv_of(swept.table)
    call.options["frequencies"] = 1
    with pytest.raises(InputError):
        gt.sweep.study(call, {"payload_kg": [5, 15]}, workers=0)


def test_a_row_is_run_again_when_the_problem_or_a_file_it_reads_changed(run: Commands, problem: Path) -> None:
    words = ("sweep", problem, "--vary", "payload_kg=5,15", *SMALL, "-o", "out")
    run(*words)
    first = sorted(Path("out/rows").rglob("*.json"))
    run(*words)
    assert sorted(Path("out/rows").rglob("*.json")) == first
    problem.write_text(problem.read_text() + "\n# another comment\n")
    run(*words)
    assert len(sorted(Path("out/rows").rglob("*.json"))) == 2 * len(first)


def test_a_bad_row_fails_the_sweep_and_stays(run: Commands, problem: Path) -> None:
    Path("rows.csv").write_text("payload_kg,robot\n5,l1_tape\n5,l1_tap\n")
    done = run("sweep", problem, "--vary", "rows.csv", *SMALL, "-o", "out")
    rows = table_of(Path("out"))
    assert done.code == 1 and [row["status"] for row in rows] == ["solved", "bad_input"]
    assert "l1_tap" in rows[1]["message"] and str(problem.parent) not in rows[1]["message"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--vary", "payload_k=5,15"), "payload_k"),
        (("--vary", "payload_kg=5,heavy"), "payload_kg"),
        (("--vary", "payload_kg"), "--vary payload_kg"),
        (("--vary", "no_such.csv"), "no_such.csv"),
        (("--vary", "payload_kg=5:15:0"), "--vary payload_kg"),
        (("--vary", "payload_kg=uniform(5,15)"), "--random N"),
        (("--vary", "payload_kg=uniform(5)", "--random", "3"), "--vary payload_kg"),
        (("--vary", "payload_kg=5,15", "--random", "3"), "--random"),
        (("--vary", "payload_kg=5,15", "--vary", "payload_kg=7"), "twice"),
        (("--vary", "payload_kg=5,15", "--set", "payload_kg=7"), "twice"),
        (("--vary", "payload_kg=5,15", "--part", "3/2"), "--part 3/2"),
        (("--vary", "payload_kg=5,15", "--merge"), "--out"),
        (("--vary", "payload_kg=5,15", "--design", "grid"), "--design"),
        ((), "--vary"),
    ],
)
def test_wrong_options_are_refused_before_the_work(
    words: tuple[str, ...], said: str, run: Commands, problem: Path
) -> None:
    done = run("sweep", problem, *words, "--workers", "0", "--quiet")
    assert done.code == 2 and said in done.sentence


def test_workers_and_a_cluster_exclude_each_other(run: Commands, problem: Path) -> None:
    done = run("sweep", problem, "--vary", "payload_kg=5", "--workers", "1", "--cluster", "tcp://127.0.0.1:9")
    assert done.code == 2 and "--cluster" in done.sentence


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("k=300:1000:3", [300, 650, 1000]),
        ("k=0:1:3", [0.0, 0.5, 1.0]),
        ("k=-1e-3:1e-3:3", [-1e-3, 0.0, 1e-3]),
        ("k=7:7:1", [7]),
        ("k=l1_tape,l1_tracker", ["l1_tape", "l1_tracker"]),
        ("k=1,2.5", [1, 2.5]),
        ("k=[0,1],[2,3]", [[0, 1], [2, 3]]),
        ("k=true,false", [True, False]),
        ('k="a,b",c.toml', ['"a', 'b"', "c.toml"]),
        ('k="a,b","c"', ["a,b", "c"]),
    ],
)
def test_values_of_a_key(text: str, values: list[object]) -> None:
    found, rows = _sweep_command._varied([text], 0)
    assert found == {"k": values} and not rows and list(map(type, found["k"])) == list(map(type, values))


def test_an_address_from_the_environment_is_used(problem: Path, run: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def refuse(address: str) -> None:
        asked.append(address)
        raise ArgumentError("no scheduler", "cluster")

    monkeypatch.setattr(_crew, "connected", refuse)
    monkeypatch.setenv("GTMODEL_CLUSTER", "tcp://here:1")
    done = run("sweep", problem, "--vary", "payload_kg=5", "--set", "section.step_m=0.5", "--quiet")
    assert done.code == 2 and asked == ["tcp://here:1"] and "GTMODEL_CLUSTER" in done.sentence


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM on Windows")
def test_sigterm_keeps_finished_rows_and_prints_the_table(problem: Path) -> None:
    words = command("sweep", problem, "--vary", "payload_kg=1:50:50", *SMALL[:2], "--workers", "1", "-o", "out")
    with subprocess.Popen(
        words, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline = time.monotonic() + 60
        while len(list(Path("out").glob("rows/*/*.json"))) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGTERM)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1 and "finished rows are kept" in err
    assert "interrupted" in out and 2 <= len(table_of(Path("out"))) < 50
