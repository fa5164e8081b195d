"""docs/theses.toml: every row is whole, its verdict follows from its numbers, its command is there and gives them."""

from __future__ import annotations

import ast
import re
import shlex
from collections import Counter
from functools import cache
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from docs._ext import theses
from tests.theses.table import CLONE, SHOWN, rows

VERDICTS = {"reproduced", "corrected", "refuted", "not checkable"}
FIELDS = {"id", "where", "what", "printed", "unit", "tolerance", "verdict", "command", "note"}
LONG = {"table_3_1", "calibrate_f1", "l1_workspace", "milling_pose"}
"""Problems of about two seconds and more: solved by `make proof`."""
ROWS = [pytest.param(row, id=name) for name, row in rows().items()]


def numbers(value: Any) -> np.ndarray | None:
    """Numbers of a field; None for text and for a field that is left out."""
    return None if value is None or isinstance(value, str) else np.atleast_1d(np.asarray(value, float))


def test_there_are_enough_rows_and_no_id_is_used_twice() -> None:
    assert len(theses.rows()) == len(rows()) >= 60
    assert set(Counter(row["verdict"] for row in theses.rows())) == VERDICTS


@pytest.mark.parametrize("row", ROWS)
def test_a_row_is_whole(row: dict[str, Any]) -> None:
    assert set(row) >= FIELDS and set(row) <= FIELDS | {"ours", "value"}
    assert row["verdict"] in VERDICTS and row["tolerance"] >= 0 and row["unit"]
    assert re.search(r"Table|Fig\.|section|appendix|\(\d", row["where"])
    assert "ours" in row or row["verdict"] == "not checkable"
    assert row["note"] or row["verdict"] == "reproduced"


def compared(row: dict[str, Any]) -> bool:
    """Whether a row has numbers of both sides."""
    return row["verdict"] != "not checkable" and not any(numbers(row.get(n)) is None for n in ("printed", "ours"))


@pytest.mark.parametrize("row", [pytest.param(r, id=name) for name, r in rows().items() if compared(r)])
def test_its_verdict_follows(row: dict[str, Any]) -> None:
    printed, ours = np.atleast_1d(row["printed"]), np.atleast_1d(row["ours"])
    assert printed.shape == ours.shape
    within = np.abs(ours - printed) <= row["tolerance"] * np.abs(printed) + 1e-12
    assert within.all() if row["verdict"] == "reproduced" else not within.all()


def problem_of(command: str) -> str | None:
    """Stem of the problem that a command solves."""
    found = re.fullmatch(r"gtmodel solve problems/(\w+)\.toml", command)
    return found[1] if found else None


@cache
def functions_of(file: str) -> dict[str, bool]:
    """Tests of a file, "function" or "Class::function", and whether they are of `make proof`."""
    tree = ast.parse((CLONE / file).read_text(encoding="utf-8"))
    found = {}
    for node in tree.body:
        inside = node.body if isinstance(node, ast.ClassDef) else [node]
        before = f"{node.name}::" if isinstance(node, ast.ClassDef) else ""
        for function in inside:
            if isinstance(function, ast.FunctionDef) and function.name.startswith("test_"):
                marks = [ast.unparse(d) for d in function.decorator_list]
                found[before + function.name] = "pytest.mark.proof" in marks
    return found


@pytest.mark.parametrize("row", ROWS)
def test_its_command_is_there(row: dict[str, Any]) -> None:
    program, *arguments = shlex.split(row["command"])
    if program == "gtmodel":
        problem = problem_of(row["command"])
        assert arguments == ["list", "robots"] or (problem and (CLONE / "problems" / f"{problem}.toml").exists())
    else:
        file, _, test = arguments[-1].partition("::")
        assert program == "pytest" and arguments[:-1] == (["-m", "proof"] if functions_of(file)[test] else [])
    assert "value" not in row or problem_of(row["command"])


@cache
def values(problem: str) -> dict[str, Any]:
    """The values of a shipped problem, as they stand in its result.json."""
    return gt.load(CLONE / "problems" / f"{problem}.toml")().values


def value(name: str, of: Any) -> float:
    """`a.b[0]`: entry 0 of what stands under b of what stands under a; a whole key may have brackets."""
    while name:
        if isinstance(of, dict):
            key = name if name in of else re.match(r"[^.\[]+", name)[0]  # type: ignore[index]
            if key not in of:
                key = name.partition(".")[0]
            of, name = of[key], name[len(key) :].lstrip(".")
        else:
            index = re.match(r"\[(\d+)\]\.?", name)
            assert index, name
            of, name = of[int(index[1])], name[index.end() :]
    return of


WITH_VALUES = [
    pytest.param(row, id=name, marks=pytest.mark.proof if problem_of(row["command"]) in LONG else ())
    for name, row in rows().items() if "value" in row
]  # fmt: skip


@pytest.mark.parametrize("row", WITH_VALUES)
def test_the_problem_gives_the_number(row: dict[str, Any]) -> None:
    names, found = row["value"], values(str(problem_of(row["command"])))
    computed = value(names, found) if isinstance(names, str) else [value(name, found) for name in names]
    np.testing.assert_allclose(computed, row["ours"], rtol=SHOWN)


def test_the_page_shows_every_row() -> None:
    text = "\n".join(theses.lines())
    assert all(row["command"].partition("::")[2] in text for row in theses.rows())
    assert sum(line.startswith("| ") for line in text.splitlines()) >= len(theses.rows())
