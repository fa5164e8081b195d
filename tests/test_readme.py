"""The README is true: its demo table is what the problem gives, its Python runs as printed."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.kinds.identification.keys import IdentificationLogSection
from gtmodel.problem_files.keys import MeasuredSignalSection

CLONE = Path(__file__).parents[1]
README = (CLONE / "README.md").read_text(encoding="utf-8")
# printed to six digits; other optima of the same quality lie a few 1e-5 apart on another processor
PRINTED = 5e-4


def test_demo_table_and_prose_hold_the_numbers_of_the_problem() -> None:
    command = [sys.executable, "-m", "gtmodel.cli", "solve", "problems/l1_min_time.toml", "--json"]
    values = json.loads(subprocess.run(command, cwd=CLONE, capture_output=True, check=True).stdout)["values"]
    names = {
        "final time": ("exported_final_time_s", 1.0),
        "end error, re-simulated": ("exported_end_error_m", 1e3),
        "largest force at any instant": ("exported_peak_force_N", 1.0),
    }
    for label, (name, scale) in names.items():
        found = re.search(rf"^ {re.escape(label)} +([0-9.]+) ", README, re.M)
        assert found, label
        assert float(found[1]) == pytest.approx(scale * values[name], rel=PRINTED), label


def fences(language: str, text: str = README) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.S | re.M)


def test_every_fence_has_a_language_that_is_tested_here() -> None:
    opened = re.findall(r"^```(.*)$", README, re.M)[::2]
    assert sorted(opened) == ["python", "sh", "text"]


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 120


def test_every_link_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert len(links) > 40
    assert not [link for link in links if not link.startswith("http") and not (CLONE / link).exists()]


def test_commands_name_problems_that_are_shipped() -> None:
    problems = re.findall(r"`gtmodel (?:solve|codegen) (\S+)", README)
    assert len(problems) > 8
    assert not [problem for problem in problems if not (CLONE / problem).exists()]


def test_commands_of_the_readme_are_targets_of_make() -> None:
    makefile = (CLONE / "Makefile").read_text(encoding="utf-8")
    commands = [line.split("#")[0].split() for line in fences("sh")[0].splitlines()]
    assert len(commands) == 2
    for make, target in commands:
        assert make == "make" and re.search(rf"^{target}:", makefile, re.M)


def test_the_log_of_the_page_on_logs_is_one_of_a_problem() -> None:
    page = (CLONE / "docs/howto/logs.md").read_text(encoding="utf-8")
    given, *others = (tomllib.loads(text)["log"] for text in fences("toml", page))
    for other in others:  # in several files
        assert IdentificationLogSection(**given | other)
    assert isinstance(IdentificationLogSection(**given).effort, MeasuredSignalSection)
    table = re.split(r"Tables of poses|## One recording", page.partition("| key | for |")[2])[0]
    keys = re.findall(r"`([\w.]+) = ([^`]+)`", table)
    assert len(keys) > 10
    for key, value in keys:
        more = tomllib.loads(f"{key} = {value}")
        assert IdentificationLogSection(**given | more)


def test_python_blocks_run_as_printed(capsys: pytest.CaptureFixture[str]) -> None:
    scope: dict[str, Any] = {}
    for block in fences("python"):
        exec(block, scope)
    assert scope["status"].name == "OK" and np.isfinite(scope["tension"])
    assert "root of y" in capsys.readouterr().out
