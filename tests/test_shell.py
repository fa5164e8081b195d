"""The command line in shells as they are: other encodings, full disks, Ctrl-C too soon, names that no disk takes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gtmodel.problem_files.python_models import LONGEST
from tests.support.commands import Commands, command, environment, process
from tests.support.own_models import PENDULUM

LONG = "a" * 300
SWING = """
kind = "simulation"
robot = "pendulum.py:Pendulum"
final_time_s = 0.01
step_s = 0.01
[start]
phi = 0.1
"der(phi)" = 0.0
[inputs]
"""
SOLVE = ("solve", "compliance_l1", "--set", "section.step_m=0.4")


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Commands:
    monkeypatch.chdir(tmp_path)
    return Commands(capsys)


@pytest.mark.parametrize(("encoding", "title"), [("cp1252", "Größe u"), ("ascii", "Gro?e u")])
def test_a_sign_that_the_encoding_lacks_is_spelled(encoding: str, title: str, tmp_path: Path) -> None:
    done = subprocess.run(
        command(*SOLVE, "--set", 'title="Größe μ"'), cwd=tmp_path, env=environment(PYTHONIOENCODING=encoding),
        capture_output=True, timeout=240,
    )  # fmt: skip
    printed = done.stdout.decode(encoding)
    assert done.returncode == 0 and printed.startswith(title) and "---" in printed


def test_json_escapes_what_the_encoding_lacks(tmp_path: Path) -> None:
    (tmp_path / "größe.toml").write_text('kind = "modes"\n', encoding="utf-8")
    done = process("solve", "größe.toml", "--json", cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert done.out.isascii() and json.loads(done.out)["problem"] == "größe.toml"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("words", [("list",), ("schema", "modes"), ("--help",), SOLVE], ids=lambda w: w[0])
def test_a_full_disk_behind_stdout_is_a_sentence(words: tuple[str, ...], tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gtmodel", *words], cwd=tmp_path, env=environment(), stdout=full,
            stderr=subprocess.PIPE, text=True, timeout=120,
        )  # fmt: skip
    assert done.returncode == 1 and "Traceback" not in done.stderr and "internal error" not in done.stderr
    assert "printed" in done.stderr.splitlines()[-1]


@pytest.mark.skipif(os.name == "nt", reason="no closed streams by a shell there")
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_streams_cost_no_result(closed: str, tmp_path: Path) -> None:
    """What a solver prints by its own means must not land in a file that has got the number of a closed stream."""
    (tmp_path / "pendulum.py").write_text(PENDULUM)
    (tmp_path / "swing.toml").write_text(f"{SWING}tau = 0.0\n")
    words = f"'{sys.executable}' -m gtmodel solve swing.toml --out out {closed}"
    done = subprocess.run(words, shell=True, cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, timeout=120)
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    assert json.loads((tmp_path / "out" / "result.json").read_text())["kind"] == "simulation"


@pytest.mark.skipif(os.name == "nt", reason="links need a right of their own there")
def test_a_link_to_no_folder_is_named(gtmodel: Commands) -> None:
    Path("pendulum.py").write_text(PENDULUM)
    Path("swing.toml").write_text(f"{SWING}tau = 0.0\n")
    Path("out").symlink_to("nowhere")
    done = gtmodel("solve", "swing.toml", "--out", "out")
    assert done.code == 2 and "is a link to nowhere" in done.sentence and not Path("nowhere").exists()


@pytest.mark.skipif(os.name == "nt", reason="SIGINT cannot be sent to one process there")
@pytest.mark.parametrize("after_s", [0.4, 0.8])
def test_ctrl_c_during_the_imports_shows_no_traceback(after_s: float, tmp_path: Path) -> None:
    started = subprocess.Popen(
        [sys.executable, "-m", "gtmodel", "list"], cwd=tmp_path, env=environment(), stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    imported = False
    while started.poll() is None and not imported:  # Python itself has started once NumPy is mapped
        imported = "numpy" in Path(f"/proc/{started.pid}/maps").read_text() if Path("/proc").exists() else True
        time.sleep(0.01)
    time.sleep(after_s - 0.4)
    started.send_signal(signal.SIGINT)
    _, said = started.communicate(timeout=60)
    assert "Traceback" not in said and len(said.splitlines()) <= 1


@pytest.mark.parametrize(
    "words",
    [("solve", LONG), ("explain", LONG), ("solve", "table_3_1", "--out", LONG), ("schema", LONG), ("list", LONG)],
)
def test_a_name_longer_than_any_file_is_bad_input(gtmodel: Commands, words: tuple[str, ...]) -> None:
    done = gtmodel(*words)
    assert done.code == 2 and len(done.err.splitlines()[-1]) <= LONGEST and "internal" not in done.err


@pytest.mark.parametrize(
    "text", ["kind = 'modes'\na = " + "[" * 3000 + "]" * 3000, "[" + ".".join("a" * 4000) + "]\nx = 1"]
)
def test_toml_of_any_depth_is_bad_input(gtmodel: Commands, text: str) -> None:
    Path("deep.toml").write_text(text)
    done = gtmodel("solve", "deep.toml")
    assert done.code == 2 and done.sentence.startswith("deep.toml")


def test_a_byte_order_mark_is_no_part_of_the_text(gtmodel: Commands) -> None:
    Path("marked.toml").write_bytes(b"\xef\xbb\xbf" + b'kind = "nothing"\n')
    assert "marked.toml: kind" in gtmodel("solve", "marked.toml").sentence


@pytest.mark.parametrize("given", ["-x", "--json"])
def test_an_option_is_no_folder(gtmodel: Commands, given: str) -> None:
    done = gtmodel("solve", "table_3_1", "--out", given)
    assert done.code == 2 and f"./{given}" in done.err and not Path(given).exists()


def test_a_mistyped_command_names_the_help_that_is_there(gtmodel: Commands) -> None:
    assert "'gtmodel --help'" in gtmodel("slove", "--help").sentence
    assert "'gtmodel solve --help'" in gtmodel("solve", "--hepl").sentence


def test_python_m_gtmodel_is_the_command(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gtmodel", "--version"], cwd=tmp_path, env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 0 and done.stdout.startswith("gtmodel ")


@pytest.mark.parametrize(("words", "there"), [("solve compl", "compliance_l1"), ("schema m", "milling")])
def test_a_shell_completes_names(words: str, there: str, tmp_path: Path) -> None:
    done = process(
        cwd=tmp_path,
        _GTMODEL_COMPLETE="complete_bash",
        COMP_WORDS=f"gtmodel {words}",
        COMP_CWORD=str(words.count(" ") + 1),
    )
    assert there in done.out.split()


def test_explain_takes_a_shipped_name_and_says_that_it_runs_python(gtmodel: Commands) -> None:
    assert gtmodel("explain", "vibration_two_mass").code == 0
    assert "runs that file" in " ".join(gtmodel("explain", "--help").out.split())


def test_what_numpy_remarks_on_the_way_is_not_printed(tmp_path: Path) -> None:
    """In a process of its own: pytest keeps warnings to itself."""
    (tmp_path / "pendulum.py").write_text(f"import numpy as np\n\nnp.log(np.zeros(1))\n{PENDULUM}", encoding="utf-8")
    (tmp_path / "swing.toml").write_text(f"{SWING}tau = 0.0\n", encoding="utf-8")
    done = process("solve", "swing.toml", cwd=tmp_path)
    assert done.code == 0 and not done.err


def test_a_folder_in_place_of_a_file_is_called_a_folder(gtmodel: Commands) -> None:
    Path("logs").mkdir()
    Path("pendulum.py").write_text(PENDULUM, encoding="utf-8")
    Path("swing.toml").write_text(f'{SWING}tau = {{file = "logs"}}\n', encoding="utf-8")
    done = gtmodel("solve", "swing.toml")
    assert done.code == 2 and "'logs' is a folder; expected a file" in done.sentence and "no file" not in done.sentence
