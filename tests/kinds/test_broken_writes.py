"""Writes that are killed, that find the disk full, or that meet another run: nothing is lost, nothing is locked."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gtmodel import optimize
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, solve
from gtmodel.results.folder import FolderError, holding
from tests.support.commands import CLONE, Commands, command, environment
from tests.support.own_models import FILES

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL, no fork and no file locks on Windows")

TIMED = ("run.toml",)  # holds the wall time


def own_files(folder: Path) -> Path:
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


# code is written as results are, in more files
JOBS = ["solve", "codegen 3", pytest.param("codegen", marks=pytest.mark.proof)]


@pytest.fixture(scope="module", params=JOBS)
def broken(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """The three whole folders, and one record per broken write; see tests.support.killed."""
    place = str(own_files(tmp_path_factory.mktemp("k")))
    words = [sys.executable, "-m", "tests.support.killed", place, *request.param.split()]
    done = subprocess.run(words, cwd=CLONE, env=environment(), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def timeless(files: dict[str, str]) -> dict[str, str]:
    """Files of a result, without a person's and without what holds a time."""
    return {k: "" if k in TIMED else v for k, v in files.items() if k not in ("notes.txt", ".gtmodel-writing")}


def of(broken: list[dict[str, Any]], what: str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    whole = {name: timeless(files) for name, files in broken[0].items()}
    cases = [record for record in broken[1:] if what in record["scenario"]]
    assert len(cases) >= 6
    assert cases[0]["ended"] != "done" and cases[-1]["ended"] == "done"
    return ((whole, record) for record in cases)


def test_no_file_is_ever_half_written(broken: list[dict[str, Any]]) -> None:
    """Whatever is there is as one of the two runs wrote it; and whole folders are all there before and after."""
    for whole, record in of(broken, ""):
        for name, text in timeless(record["after"]).items():
            wanted = [whole[run].get(name) for run in ("first", "second")]
            assert text in wanted, (record["scenario"], record["case"], name)
        if "full" in record["scenario"] and record["ended"] != "done":
            before = {} if "new" in record["scenario"] else whole["first"]
            assert timeless(record["after"]) == before, record["case"]


def test_the_next_run_goes_on(broken: list[dict[str, Any]]) -> None:
    for whole, record in of(broken, ""):
        if record["edited"]:
            continue
        assert record["again"].startswith("done"), (record["scenario"], record["case"], record["again"])
        assert timeless(record["then"]) == whole["wanted"], (record["scenario"], record["case"])
        assert ".gtmodel-writing" not in record["then"] and record["folders"] == []


def test_a_persons_files_stay(broken: list[dict[str, Any]]) -> None:
    for _, record in of(broken, ""):
        if "new" not in record["scenario"]:
            assert record["after"]["notes.txt"] == record["then"]["notes.txt"] == "mine"


def test_what_a_person_changes_after_the_break_stays(broken: list[dict[str, Any]]) -> None:
    for _, record in of(broken, "edited"):
        assert record["then"][record["edited"]] == "mine too", record["case"]
        assert "Error" in record["again"] and record["edited"] in record["again"]


def test_the_next_run_says_that_one_broke_off(broken: list[dict[str, Any]]) -> None:
    """Exactly where the killed run had left its mark."""
    if "result.json" not in broken[0]["first"]:
        pytest.skip("the second job writes by a call of the library, which prints nothing")
    for _, record in of(broken, "kill"):
        if not record["edited"]:
            left = bool(record["after"].get(".gtmodel-writing"))
            assert ("an earlier run" in record["again"]) == left, (record["scenario"], record["case"])


# -- two runs at a time ----------------------------------------------------------------------------


def test_two_runs_into_one_folder_do_not_mix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second comes while the first writes its pictures, its files, or anything."""
    monkeypatch.chdir(own_files(tmp_path))
    first, second = (load("swing.toml", [f"mesh.elements={n}"]) for n in (3, 4))
    said: list[str] = []

    study = optimize.optimization_study

    def meanwhile(*arguments: Any, **options: Any) -> Any:
        monkeypatch.undo()
        monkeypatch.chdir(tmp_path)
        with pytest.raises(InputError) as refused:
            solve(second, context_of(second), out=tmp_path / "out")
        said.append(str(refused.value))
        return study(*arguments, **options)

    monkeypatch.setattr(optimize, "optimization_study", meanwhile)
    solve(first, context_of(first), out=tmp_path / "out")
    assert "another run of gtmodel" in said[0]
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    assert len(stored["trajectory"]["time_s"]) and not (tmp_path / "out" / ".gtmodel-writing").exists()
    solve(second, context_of(second), out=tmp_path / "out")


def test_a_process_at_work_keeps_others_out(tmp_path: Path) -> None:
    own_files(tmp_path)
    slow = "import sys\nprint('ready', file=sys.stderr, flush=True)\nsys.stdin.readline()\n"
    (tmp_path / "pendulum.py").write_text(slow + FILES["pendulum.py"])
    words, pipe = command("solve", "swing.toml", "--out", "out"), subprocess.PIPE
    with subprocess.Popen(
        words, cwd=tmp_path, env=environment(), stdin=pipe, stdout=pipe, stderr=pipe, text=True
    ) as run:
        assert run.stderr is not None and run.stderr.readline() == "ready\n"
        with pytest.raises(FolderError, match=f"process {run.pid}"), holding(tmp_path / "out"):
            pass
        run.communicate("go\n", timeout=60)
        assert run.returncode == 0
    with holding(tmp_path / "out") as folder:
        assert folder.message == ""


# -- found before the work, and kept behind it -----------------------------------------------------


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Commands:
    monkeypatch.chdir(own_files(tmp_path))
    return Commands(capsys)


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever begins to compute fails."""

    def refuse(*_: Any, **__: Any) -> None:
        pytest.fail("the work was begun")

    monkeypatch.setattr("gtmodel.optimize.study.solve", refuse)
    monkeypatch.setattr("gtmodel.kinds.codegen.kind.functions_of", refuse)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("words", [("solve", "swing.toml", "--out"), ("codegen", "pendulum_code.toml", "-o")])
def test_a_folder_that_cannot_be_written_is_found_before_the_work(gtmodel: Commands, words: tuple[str, ...]) -> None:
    Path("file").write_text("mine")
    for out in ("file/below", "/proc/gtmodel"):
        done = gtmodel(*words, out)
        assert done.code == 2 and "cannot be written" in done.sentence and out in done.sentence


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("title", ["two\nlines", "back\rto the start", "a\x0bform", "next\u2028line"])
def test_a_title_of_two_lines_is_found_before_the_work(gtmodel: Commands, title: str) -> None:
    text = FILES["swing.toml"].replace("Swing of a pendulum", json.dumps(title)[1:-1])
    Path("swing.toml").write_text(text)
    done = gtmodel("solve", "swing.toml", "--out", "out")
    assert done.code == 2 and "title" in done.sentence and not Path("out").exists()


def test_a_refused_problem_leaves_no_folder(gtmodel: Commands) -> None:
    assert gtmodel("solve", "swing.toml", "--set", "model=nowhere.py:A", "--out", "a/deep/out").code == 2
    assert not Path("a").exists()


def test_a_result_that_its_folder_does_not_take_is_kept_elsewhere(
    gtmodel: Commands, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("other").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(Path("other").resolve()))
    wanted = gtmodel("solve", "swing.toml", "--out", "whole")
    assert wanted.code == 0
    text = FILES["pendulum.py"] + "\nfrom pathlib import Path\nPath('out', 'result.json').write_text('mine')\n"
    Path("pendulum.py").write_text(text)
    done = gtmodel("solve", "swing.toml", "--out", "out", "--set", "model=./pendulum.py:SwingUp")
    assert done.code == 1 and "final time" in done.out and "instead" in done.err
    assert Path("out", "result.json").read_text() == "mine"
    (kept,) = Path("other").iterdir()
    assert json.loads((kept / "result.json").read_bytes())["values"]["final_time_s"] == pytest.approx(1.0, rel=1e-5)


def test_a_picture_that_fails_costs_no_numbers(gtmodel: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> None:
        raise ValueError("no ink")

    study = optimize.optimization_study
    monkeypatch.setattr(optimize, "optimization_study", lambda *a, **k: study(*a, **k).with_(figures={"empty": fails}))
    done = gtmodel("solve", "swing.toml", "--out", "out", "--plot")
    assert done.code == 1 and "no ink" in done.err and "final time" in done.out
    assert {p.name for p in Path("out").iterdir()} == {"result.json", "trajectory.csv", "run.toml"}
