"""What must stay with a result: files not to be used that it rests on, models whose home was moved, failed pictures."""

from __future__ import annotations

import ast
import io
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

import gtmodel as gtmodel_package
from gtmodel.problem_files import run
from gtmodel.problem_files.base import Context, at_most
from gtmodel.problem_files.load import load
from gtmodel.results import SolveStatus, Study, written
from gtmodel.results.disk import marked
from tests.support.commands import Commands

SOURCES = sorted(Path(gtmodel_package.__file__).parent.rglob("*.py"))
SAID = "says that it is not to be used"
ROBOT = """family = "three_link"
A_m = [[0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, -0.5, 0.9]]
v = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
L_m = [1.3, 1.3, 1.3]
"""
KINEMATICS = """kind = "kinematics"
robot = "robot.toml"
known = ["T"]
targets = ["q"]
points = "points.csv"
"""
CODEGEN = """kind = "codegen"
robot = "robot.toml"
[[functions]]
name = "ik"
known = ["T"]
targets = ["q"]
"""
POINTS = "T[0],T[1],T[2]\n0.8,-0.5,0.3\n"
MODEL = '''
import gtmodel as gt


class Rod(gt.Model):
    """A rod on two carts; its start values do not satisfy its equation."""

    x = gt.variable(start={start})
    y = gt.variable(start=0.9)

    def equations(self):
        yield self.x**2 + self.y**2 == 1.0
'''
OWN = """kind = "kinematics"
robot = "rod.py:Rod"
known = ["x"]
targets = ["y"]
points = "points.csv"
"""


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


def _folder(place: Path, *spoilt: str, **files: str) -> Path:
    texts = {"robot.toml": ROBOT, "k.toml": KINEMATICS, "c.toml": CODEGEN, "points.csv": POINTS, **files}
    for name, text in texts.items():
        content = text.encode()
        (place / name).write_bytes(marked(name, content, "1 of 3 checks failed") if name in spoilt else content)
    return place


@pytest.mark.parametrize("spoilt", ["robot.toml", "points.csv"])
def test_a_study_on_a_marked_file_says_so_and_keeps_it(
    gtmodel: Commands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoilt: str
) -> None:
    monkeypatch.chdir(_folder(tmp_path))
    clean = gtmodel("solve", "k.toml", "--json")
    assert clean.code == 0 and "notes" not in clean.json["values"], clean.err
    _folder(tmp_path, spoilt)
    done = gtmodel("solve", "k.toml", "--out", "a")
    assert done.code == 0
    assert f"{spoilt} {SAID}" in done.out and f"{spoilt} {SAID}" in done.err
    stored = json.loads((tmp_path / "a" / "result.json").read_text())["values"]
    assert [n for n in stored["notes"] if n.startswith(f"the first line of {spoilt} {SAID}")] == stored["notes"]


def test_code_for_a_machine_is_not_made_from_a_marked_robot(
    gtmodel: Commands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(_folder(tmp_path, "robot.toml"))
    refused = gtmodel("codegen", "c.toml", "--out", "a")
    assert refused.code == 2 and f"robot.toml {SAID}" in refused.err.splitlines()[-1]
    assert not (tmp_path / "a").exists()
    for n, words in enumerate(([], ["--check"])):
        done = gtmodel("codegen", "c.toml", "--out", f"b{n}", "--write-failed", *words)
        assert done.code == 1 and "check_failed" in done.out
        for path in (tmp_path / f"b{n}").glob("*.c"):
            assert "NOT TO BE USED" in path.read_text().splitlines()[0]


@pytest.mark.parametrize("write_failed", [False, True])
def test_the_mark_goes_on_to_what_rests_on_it(tmp_path: Path, write_failed: bool) -> None:
    """A motion planned with a robot that is not to be used must not be driven either."""
    _folder(tmp_path, "robot.toml")

    def solved(problem: Any, context: Context) -> Study:
        context.take("robot", tmp_path / "robot.toml")
        checks = {"error_mm": at_most(1.0, 2.0)}
        return Study(
            status=SolveStatus.SOLVED, checks=checks, files={"motion.mod": "MODULE A\n"}, machine_files=("motion.mod",)
        )

    loaded = replace(
        load("table_3_1.toml"), kind=SimpleNamespace(call=lambda problem, context: lambda **_: solved(problem, context))
    )
    heard: list[str] = []
    finished = run.solve(loaded, Context(notice=heard.append), out=tmp_path / "a", write_failed=write_failed)
    assert finished.outcome.status is SolveStatus.CHECK_FAILED and len(heard) == 1
    assert "robot.toml" in finished.outcome.message
    file = tmp_path / "a" / "motion.mod"
    assert file.exists() is write_failed
    assert not write_failed or "NOT TO BE USED" in file.read_text().splitlines()[0]


def test_a_failed_result_on_a_marked_file_names_both(tmp_path: Path) -> None:
    _folder(tmp_path, "robot.toml")

    def solved(problem: Any, context: Context) -> Study:
        context.take("robot", tmp_path / "robot.toml")
        return Study(status=SolveStatus.SOLVED, checks={"error_mm": at_most(3.0, 2.0)}, machine_files=("motion.mod",))

    loaded = replace(
        load("table_3_1.toml"), kind=SimpleNamespace(call=lambda problem, context: lambda **_: solved(problem, context))
    )
    message = run.solve(loaded, Context()).outcome.message
    assert "error_mm" in message and "robot.toml" in message


def test_every_file_that_a_kind_reads_is_looked_at() -> None:
    """`Context.take` is the only way into the inputs, but for the earlier result, which holds its status."""
    for path in SOURCES:
        text = path.read_text()
        if path.name == "base.py" or ".inputs[" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
                target = ast.unparse(node.targets[0])
                assert ".inputs[" not in target or target == "context.inputs['start']", f"{path.name}:{node.lineno}"


@pytest.mark.parametrize(("start", "told"), [("5.0", True), ("0.436", False)])
def test_a_home_that_had_to_be_moved_is_told_with_the_result(
    gtmodel: Commands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, start: str, told: bool
) -> None:
    text = CODEGEN.replace("robot.toml", "rod.py:Rod").replace('"T"', '"x"').replace('"q"', '"y"')
    files = {"rod.py": MODEL.format(start=start), "own.toml": OWN, "gen.toml": text, "points.csv": "x\n0.3\n"}
    monkeypatch.chdir(_folder(tmp_path, **files))
    done = gtmodel("solve", "own.toml", "--out", "a")
    assert done.code == 0, done.err
    values = json.loads((tmp_path / "a" / "result.json").read_text())["values"]
    assert done.out.count("the home pose moves") == int(told)
    assert len(values.get("notes", [])) == int(told)
    made = gtmodel("codegen", "gen.toml", "--out", "c")
    assert made.code == 0 and made.out.count("the home pose moves") == int(told)


def _drawn(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0])
    axes.set_title("a title")
    return figure


def _picture(status: SolveStatus, size: tuple[float, float], message: str = "") -> np.ndarray:
    files: dict[str, bytes] = {}
    outcome = Study(status=status, message=message, figures={"a": lambda: _drawn(*size)})
    assert written.pictured(outcome, files) == []
    return imread(io.BytesIO(files["a.png"]))[..., :3]


@cache
def _good(size: tuple[float, float]) -> np.ndarray:
    return _picture(SolveStatus.SOLVED, size)


# the other two differ by the first words only
OTHERS = [pytest.param(s, marks=pytest.mark.proof) for s in (SolveStatus.INTERRUPTED, SolveStatus.INFEASIBLE)]


@pytest.mark.parametrize("status", [SolveStatus.CHECK_FAILED, *OTHERS])
@pytest.mark.parametrize("size", [(3.0, 2.0), (6.4, 4.8), (12.0, 3.0)])
@pytest.mark.parametrize("words", [0, 5, 80])
def test_a_picture_of_what_is_not_to_be_used_says_so(
    status: SolveStatus, size: tuple[float, float], words: int
) -> None:
    """Above the picture, which stays as it was, in red, and wholly on the paper."""
    message = " ".join(["a_quantity_mm (3 mm, at most 2 mm)"] * words)
    good, bad = _good(size), _picture(status, size, message)
    added = len(bad) - len(good)
    assert added > 20 and bad.shape[1] == good.shape[1]
    assert np.abs(bad[added:] - good).max() < 0.02
    inked = np.abs(bad[:added] - 1.0).max(axis=2) > 0.3
    assert inked.sum() > 50 and np.all(bad[:added][inked][:, 0] > bad[:added][inked][:, 1:].max(axis=1))
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    assert rows[0] > 2 and rows[-1] < added - 2 and columns[0] > 2 and columns[-1] < bad.shape[1] - 3


def test_a_picture_of_what_may_be_used_is_as_drawn() -> None:
    assert _picture(SolveStatus.SOLVED, (4.0, 3.0)).shape[:2] == (450, 600)


def test_a_marked_file_that_cannot_be_read_is_left_to_its_reader(tmp_path: Path) -> None:
    context = Context()
    context.take("robot", tmp_path / "none.toml")
    context.take("folder", tmp_path)
    assert context.notes == [] and len(context.inputs) == 2
