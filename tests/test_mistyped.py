"""A hundred and more slips of people, in models: each ends in one sentence that says where.

The table is tests/suites/slips_models.toml.
"""

from __future__ import annotations

import sys
import tomllib
import types
from pathlib import Path
from typing import Any

import pytest

from gtmodel.lang import ModelError
from gtmodel.problem_files.faults import LONGEST

SUITES = Path(__file__).parent / "suites"
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
