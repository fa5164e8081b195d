"""gtmodel solve --report, for some kinds, and as a proof for every kind."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel._new import example_of
from gtmodel._report import asked
from gtmodel.problem_files import names
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of
from tests.kinds.test_stopped import KINDS, problem_of
from tests.support.commands import Commands
from tests.support.pages import drawn_in, faults_of, read
from tests.support.recordings import elsewhere

CHEAP = ("friction", "optimization")


@pytest.mark.parametrize("kind", [*CHEAP, *(pytest.param(k, marks=pytest.mark.proof) for k in KINDS if k not in CHEAP)])
def test_a_report_says_what_the_command_says(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, *settings = problem_of(kind)
    settings += elsewhere(name, tmp_path)
    words = [word for setting in settings for word in ("--set", setting)]
    done = Commands(capsys)("solve", name, *words, "--report", "--out", str(tmp_path / "out"), "--json")
    text = (tmp_path / "out" / "report.html").read_text()
    seen = [words for _, words in read(text).texts]
    assert faults_of(text) == [] and drawn_in(text)
    assert done.json["message"] in (*seen, SolveStatus.SOLVED.message)  # a verdict says more
    problem = load(name, settings).problem
    assert sum(problem.heading in words for words in seen) >= 2  # of the window and of the page
    assert f"gtmodel solve {name}.toml" in " ".join(seen) and str(tmp_path) not in text
    checks = sum(tag == "td" and words.startswith(("passed", "FAILED")) for tag, words in read(text).texts)
    assert checks == len(done.json["checks"])


def test_a_study_from_a_file_says_what_was_asked(tmp_path: Path) -> None:
    study = pickle.loads(pickle.dumps(gt.load("table_6_1", "printed.mass_kg=22.0")()))
    study.write(tmp_path / "out", report=True)
    seen = [words for _, words in read((tmp_path / "out" / "report.html").read_text()).texts]
    assert "printed.mass_kg" in seen
    assert "gtmodel solve table_6_1.toml --set printed.mass_kg=22.0 --report --out table_6_1-result" in seen


def test_generated_code_has_a_report_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gtmodel, file = Commands(capsys), tmp_path / "code.html"
    words = ("codegen", "l1_controller", "-o", str(tmp_path / "code"), "--report", str(file))
    assert gtmodel(*words).code == 0
    text = file.read_text()
    assert faults_of(text) == [] and "gt_l1_fk" in text
    assert "gtmodel codegen l1_controller.toml -o code --report code.html" in [words for _, words in read(text).texts]
    file.write_text("mine")
    assert gtmodel(*words).code == 2 and file.read_text() == "mine"


def test_every_key_has_a_meaning() -> None:
    """Also one in a table by name, such as signals.force.unit, and one value of a table, such as box.T."""
    for kind in names():
        about = asked(loaded := load(example_of(kind)), context_of(loaded))
        assert about.keys and [key for key, _, _, meaning in (*about.keys, *about.defaults) if not meaning] == [], kind
