"""The core stands without the robots: a copy of the package without that folder passes the compiler's tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gtmodel

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(gtmodel.__file__).resolve().parent
ALONE = "GTMODEL_WITHOUT_ROBOTS"  # set in the copy, so that the test does not start itself again

PROGRAM = """
import importlib.util, sys
import gtmodel
assert gtmodel.__file__.startswith(sys.argv[1]), gtmodel.__file__
assert importlib.util.find_spec("gtmodel.robots") is None
assert not any(name.startswith("gtmodel.robots") for name in sys.modules)
"""


@pytest.mark.skipif(ALONE in os.environ, reason="this is the copy without robots")
def test_the_compilers_tests_pass_in_a_copy_without_robots(tmp_path):
    leave = shutil.ignore_patterns("__pycache__", "robots", "*.so")
    shutil.copytree(PACKAGE, tmp_path / "gtmodel", ignore=leave)
    for name in ("compiler", "oracle", "support"):
        shutil.copytree(ROOT / "tests" / name, tmp_path / "tests" / name, ignore=leave)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    assert not (tmp_path / "gtmodel" / "robots").exists()
    environment = {**os.environ, ALONE: "1", "PYTHONPATH": str(tmp_path)}

    def run(*arguments: str) -> str:
        command = [sys.executable, *arguments]
        result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
        assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]
        return result.stdout

    run("-c", PROGRAM, str(tmp_path))
    # determinism runs two processes more and says nothing about robots
    summary = run("-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/compiler", "--deselect", DETERMINISM)
    assert " passed" in summary
    assert " failed" not in summary


DETERMINISM = "tests/compiler/test_determinism.py"


@pytest.mark.skipif(ALONE in os.environ, reason="there are no robots to ask for")
def test_robots_are_there_when_asked_for():
    assert "l1_tape" in gtmodel.robots.names()
    with pytest.raises(AttributeError, match="module 'gtmodel' has no attribute 'robot'"):
        _ = gtmodel.robot
