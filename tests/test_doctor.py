"""``gtmodel doctor``: one screen about this machine, and the exit code whether gtmodel can solve problems on it."""

from __future__ import annotations

import getpass
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gtmodel._doctor import machine, report, trials
from gtmodel._doctor.report import CRASHED, LINEAR_SOLVERS, Finding, Report, Trial
from gtmodel._doctor.requirements import Requirement, read, requirements
from tests.support.commands import CLONE, Commands, command, environment

SCREEN = 40  # lines


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture(scope="module")
def found() -> Report:
    return report.examined()


def works(**faults: str) -> dict[str, Trial]:
    """Trials that all succeed, but for these."""
    names = [name for name, _ in trials.trials()]
    return {name: Trial(faults.get(name.replace(" ", "_"), "")) for name in names}


def test_one_screen_for_people(gtmodel: Commands) -> None:
    done = gtmodel("doctor")
    assert done.code == 0 and done.err == "" and len(done.out.splitlines()) < SCREEN
    for word in ("gtmodel", "python", "platform", "casadi", "numpy", "scipy", "control", "matplotlib", "pydantic",
                 "BLAS", "ipopt with", "fatrop, osqp, qrqp", "cvodes, idas", "C compiler", "callgrind", "frama-c",
                 "extra dev", "cache", "problems", "gtmodel can solve problems here"):  # fmt: skip
        assert word in done.out, word
    lines = [line for line in done.out.splitlines() if not line.startswith((" gtmodel ", " cache "))]  # folders
    assert max(map(len, lines)) < 140


def test_json_is_one_object(gtmodel: Commands) -> None:
    done = gtmodel("doctor", "--json")
    assert done.code == 0 and done.json["ok"] is True and done.json["message"] == "gtmodel can solve problems here"
    rows = done.json["rows"]
    assert "mumps" in rows["ipopt with"]["state"].split(", ")
    absent = rows["ipopt with"]["remark"].removeprefix("not here: ").split(", ")
    assert sorted([*rows["ipopt with"]["state"].split(", "), *filter(None, absent)]) == sorted(LINEAR_SOLVERS)
    assert rows["shipped"]["state"].startswith(f"{len(list((CLONE / 'problems').glob('*.toml')))} problems")


def test_versions_are_those_of_pyproject(found: Report) -> None:
    project = tomllib.loads((CLONE / "pyproject.toml").read_text())["project"]
    wanted = requirements()
    assert wanted.python == project["requires-python"].removeprefix(">=")
    assert [str(p) for p in wanted.packages] == project["dependencies"]
    whats = [row.what for row in found.rows]
    assert {p.name for p in wanted.packages} <= set(whats)
    assert {f"extra {name}" for name in project["optional-dependencies"]} <= set(whats)
    assert {"pytest", "nbclient"} <= {p.name for p in wanted.extras["dev"]}  # dev names gtmodel[notebooks]


def test_an_installation_says_the_same_as_the_clone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    texts = ["casadi>=3.8", "numpy>=2.0", 'nbclient>=0.10; extra == "notebooks"', 'pytest>=8.4; extra == "dev"',
             'gtmodel[notebooks]; extra == "dev"']  # fmt: skip
    folder = tmp_path / "gtmodel-9.dist-info"
    folder.mkdir()
    extras = [f"Provides-Extra: {name}" for name in ("dev", "notebooks")]
    lines = ["Metadata-Version: 2.4", "Name: gtmodel", "Version: 9", "Requires-Python: >=3.11",
             *extras, *(f"Requires-Dist: {t}" for t in texts), ""]  # fmt: skip
    (folder / "METADATA").write_text("\n".join(lines))
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr("gtmodel._doctor.requirements.__file__", str(tmp_path / "a" / "b" / "c.py"))
    wanted = requirements()
    assert wanted.python == "3.11" and [str(p) for p in wanted.packages] == ["casadi>=3.8", "numpy>=2.0"]
    assert {k: sorted(p.name for p in v) for k, v in wanted.extras.items()} == {
        "dev": ["nbclient", "pytest"], "notebooks": ["nbclient"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("installed", "fault"),
    [
        ("", "missing"),
        ("3.7.9", "too old"),
        ("3.8", ""),
        ("3.8.0", ""),
        ("3.10.1", ""),
        ("4.0rc1", ""),
        ("3", "too old"),
    ],
)
def test_a_package_is_missing_or_too_old(monkeypatch: pytest.MonkeyPatch, installed: str, fault: str) -> None:
    monkeypatch.setattr(Requirement, "installed", lambda _self: installed)
    (casadi,) = read(["casadi>=3.8"])
    assert casadi.missing() == fault and str(casadi) == "casadi>=3.8"


def test_what_to_do_about_an_old_package(monkeypatch: pytest.MonkeyPatch, gtmodel: Commands) -> None:
    real = Requirement.installed
    monkeypatch.setattr(Requirement, "installed", lambda self: "3.6.7" if self.name == "casadi" else real(self))
    monkeypatch.setattr(report, "tried", works)
    done = gtmodel("doctor")
    assert done.code == 1
    assert done.sentence == (
        "gtmodel cannot solve problems here: casadi: too old: 3.8 or newer is needed; "
        "install it: python -m pip install 'casadi>=3.8'"
    )
    answer = gtmodel("doctor", "--json")
    assert answer.code == 1 and answer.json["ok"] is False and answer.json["message"] == done.sentence


def test_a_solver_that_is_needed_and_does_not_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "tried", lambda: works(ipopt_mumps="Invalid_Option", osqp="no plugin"))
    found = report.examined()
    rows = {row.what: row for row in found.rows}
    assert not found.ok and "ipopt mumps: Invalid_Option; reinstall casadi" in found.message
    assert rows["other solvers"].state == "fatrop, qrqp" and rows["other solvers"].remark == "osqp: no plugin"


def test_a_solver_that_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "tried", lambda: works(osqp="no plugin", ipopt_ma27="Invalid_Option"))
    assert report.examined().ok


def test_no_compiler_is_said_and_problems_are_solved_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(report, "tried", works)
    found = report.examined()
    row = next(r for r in found.rows if r.what == "C compiler")
    assert found.ok and row.state == "none" and "install one (package gcc), or set CC" in row.remark


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script in place of the compiler")
def test_a_compiler_that_fails(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho no licence >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    assert machine.compiler() == (f"{broken}: of unknown version", "it fails on a tiny function: no licence")


CRASHING = """
import json, os, sys
for name in ("mumps", "ma27", "ma57"):
    if name not in sys.argv[1:]:
        print(json.dumps({"begin": name}), flush=True)
        if name == "ma27":
            os.abort()
        print(json.dumps({"trial": name, "fault": "", "about": "fine"}), flush=True)
"""


def test_a_crash_costs_one_row(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "trials.py"
    program.write_text(CRASHING)
    monkeypatch.setattr(report, "TRIALS", program)
    done = report.tried()
    assert list(done) == ["mumps", "ma27", "ma57"] and done["mumps"] == done["ma57"] == Trial("", "fine")
    assert done["ma27"].fault.startswith(CRASHED)


def test_a_trial_that_does_not_end_costs_one_row(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "trials.py"
    program.write_text(CRASHING.replace("os.abort()", "import time; time.sleep(60)"))
    monkeypatch.setattr(report, "TRIALS", program)
    monkeypatch.setattr(report, "TRIALS_S", 0.5)
    done = report.tried()
    assert done["ma27"] == Trial("not done after 0.5 s") and done["ma57"] == Trial("", "fine")


def test_without_numpy_there_is_a_sentence_and_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('libopenblas is not there')\n")
    variables = environment(PYTHONPATH=f"{tmp_path}:{CLONE}")
    done = subprocess.run(command("doctor", "--json"), capture_output=True, text=True, env=variables, cwd=tmp_path)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
    answer = json.loads(done.stdout)
    assert answer["rows"]["import numpy"]["remark"] == "ImportError: libopenblas is not there"
    assert "import numpy: ImportError: libopenblas is not there; reinstall it" in answer["message"]


def test_wrong_answers_of_a_solver_are_a_fault() -> None:
    import casadi as ca

    with pytest.raises(RuntimeError, match=r"found \[1\.0, 3\.0\]; expected \[1\.0, 2\.0\]"):
        trials._equal(ca.DM([1, 3]), [1.0, 2.0])


def test_home_and_user_are_not_printed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    home = tmp_path / "homes" / "ada"
    home.mkdir(parents=True)
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setattr(getpass, "getuser", lambda: "ada")
    monkeypatch.setattr(report, "tried", works)
    for folder, shown in ((home / "cache", "~/cache"), (tmp_path / "scratch" / "ada", f"{tmp_path}/scratch/USER")):
        monkeypatch.setenv("GTMODEL_CACHE", str(folder))
        text = json.dumps(report.examined().document())
        assert shown in text and "/ada" not in text
    assert machine.discreet("a sentence about adaptive ada") == "a sentence about adaptive ada"


def test_the_cache_is_counted_and_left_as_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    monkeypatch.setenv("GTMODEL_CACHE", str(folder))
    assert machine.cache() == (f"{folder}: 0 libraries, 0.0 MB", "") and not folder.exists()
    folder.mkdir()
    (folder / "one.so").write_bytes(bytes(2_000_000))
    assert machine.cache()[0] == f"{folder}: 1 libraries, 2.0 MB"
    if sys.platform != "win32":
        folder.chmod(0o777)
        assert "can be written by other users" in machine.cache()[1]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no /proc here")
def test_a_folder_of_the_kernel_is_not_writable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere by permissions; no file can be made there."""
    monkeypatch.setenv("GTMODEL_CACHE", "/proc/cache")
    assert machine.cache()[1].startswith("cannot be written to: set GTMODEL_CACHE")


def test_several_faults_are_named_after_the_first() -> None:
    text = Report(
        (Finding("a", "none", "missing", "do this"), Finding("b", "x"), Finding("c", "none", "bad", "do that"))
    ).message
    assert text == "gtmodel cannot solve problems here: a: missing; do this; also wrong: c"
