"""A hundred and more slips of people, in models, files and commands: each ends in one sentence that says where.

The tables are tests/suites/slips_models.toml and slips_files.toml.
"""

from __future__ import annotations

import sys
import tomllib
import types
from pathlib import Path
from typing import Any

import pytest

from gtmodel.lang import ModelError
from gtmodel.problem_files.python_models import LONGEST, shortened
from tests.support.commands import Commands

SUITES = Path(__file__).parent / "suites"
FILES: dict[str, Any] = tomllib.loads((SUITES / "slips_files.toml").read_text("utf-8"))
MODELS: dict[str, Any] = tomllib.loads((SUITES / "slips_models.toml").read_text("utf-8"))


def named(suite: dict[str, Any]) -> list[Any]:
    return [pytest.param(slip, id=slip["name"]) for slip in suite["slip"]]


def is_one_sentence(said: str, word: str) -> bool:
    return (
        len(said.splitlines()) == 1
        and len(said) <= LONGEST
        and word in said
        and not any(raw in said for raw in ("internal error", "Traceback", " object at 0x"))
    )


@pytest.mark.parametrize("slip", named(MODELS))
def test_a_slip_in_a_model_names_its_line(
    slip: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, text = tmp_path / "user" / "robot.py", MODELS["prelude"] + slip["code"]
    path.parent.mkdir()
    path.write_text(text)  # a traceback quotes it
    module = types.ModuleType("robot")
    monkeypatch.setitem(sys.modules, "robot", module)
    with pytest.raises(ModelError) as caught:
        exec(compile(text, str(path), "exec"), module.__dict__)
    said, to_blame = str(caught.value), [n for n, line in enumerate(text.splitlines(), 1) if "# <-" in line]
    assert is_one_sentence(said, slip["word"]), said
    assert any(f"(user/robot.py:{n})" in said for n in to_blame), said


def swapped(text: str, old: str, new: str) -> str:
    assert old in text, f"the slip changes nothing: '{old}' is not there"
    return text.replace(old, new)


def written(slip: dict[str, Any]) -> None:
    """Put the slip's problem and the files beside it into the current folder."""
    base = FILES["base"][slip["base"]]
    files = {"problem.toml": base["toml"], **base.get("files", {})}
    if swap := slip.get("swap"):
        files["problem.toml"] = swapped(files["problem.toml"], *swap)
    if swap := slip.get("swap_file"):
        files[swap[0]] = swapped(files[swap[0]], *swap[1:])
    for name, text in {**files, **slip.get("files", {})}.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("slip", named(FILES))
def test_a_slip_in_a_file_or_a_command_names_the_file(
    slip: dict[str, Any], capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(slip)
    done = Commands(capsys)(*slip.get("command", "solve problem.toml").split(" "))
    assert done.err.endswith("\n") and is_one_sentence(done.err.strip(), slip["word"]), done.err
    assert done.code == 2 and bool(done.out) == ("--json" in slip.get("command", ""))
    assert slip.get("file", "problem.toml") in done.err
    assert "line" not in slip or f"problem.toml: line {slip['line']}: " in done.err, done.err


def test_a_long_sentence_is_cut_at_blanks() -> None:
    cut = shortened("words of a sentence " * 30, 100)
    assert len(cut) <= 100 and {*cut.split()} == {"words", "of", "a", "sentence", "..."}
    assert len(shortened("x" * 200, 100)) <= 100
