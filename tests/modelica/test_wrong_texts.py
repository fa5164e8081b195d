"""Wrong texts: each error message names the line and the fault."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.modelica.reader import parse

pytest.importorskip("lark")

WRONG = tomllib.loads((Path(__file__).parents[1] / "suites" / "wrong_modelica.toml").read_text(encoding="utf-8"))[
    "text"
]


@pytest.mark.parametrize("row", WRONG, ids=range(len(WRONG)))
def test_a_wrong_text_is_rejected_with_its_line(tmp_path: Path, row: dict[str, Any]) -> None:
    text, line, word = row["text"], row["line"], row["word"]
    file = tmp_path / "wrong.mo"
    file.write_text(text)
    name = (
        ""
        if text.startswith(("model", "modell", "partial", "optimization"))
        else ":P.M"
        if "package P" in text
        else ":M"
    )
    with pytest.raises(gt.ModelError) as caught:
        gt.modelica.load(f"{file}{name}")
    error = caught.value
    assert word in str(error), error
    if line:
        assert isinstance(error, gt.modelica.ModelicaError)
        assert error.where is not None and (error.where.file.endswith("wrong.mo"), error.where.line) == (True, line), (
            error
        )


def test_number_of_cases() -> None:
    assert len(WRONG) >= 60


@pytest.mark.parametrize("letter", "([{")
def test_ten_megabytes_of_brackets_are_rejected_at_once(letter: str) -> None:
    with pytest.raises(gt.modelica.ModelicaError, match="limit"):
        parse(letter * 10_000_000)
    with pytest.raises(gt.modelica.ModelicaError, match="nested brackets"):
        parse("model M Real x = " + letter * 200)


def test_a_file_that_is_too_large_is_rejected(tmp_path: Path) -> None:
    file = tmp_path / "large.mo"
    file.write_bytes(b"(" * 10_000_000)
    with pytest.raises(gt.modelica.ModelicaError, match="10000000 bytes"):
        gt.modelica.load(file)


def test_a_text_cannot_call_python(tmp_path: Path) -> None:
    """Names of Python's own are names like others: there is no such variable."""
    file = tmp_path / "bad.mo"
    for name in ("open", "exec", "self", "gt", "print"):
        file.write_text(f"model M Real x = {name}(time); end M;")
        with pytest.raises(gt.modelica.ModelicaError, match=f"no function '{name}'"):
            gt.modelica.load(file)
    file.write_text("model M Real self = 1; Real gt = 2; Real lambda = self + gt; end M;")
    assert gt.modelica.load(file)().causal(targets="lambda")()[0] == 3.0
