"""The core stands without the robots: a copy of the package without that folder passes the compiler's tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gtmodel
from tests.support.examples import AGAIN

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(gtmodel.__file__).resolve().parent

PROGRAM = """
import importlib.util, sys
import gtmodel
assert gtmodel.__file__.startswith(sys.argv[1]), gtmodel.__file__
assert importlib.util.find_spec("gtmodel.robots") is None
assert not any(name.startswith("gtmodel.robots") for name in sys.modules)
"""

# language, aliases, blocks of every closed kind and calls; every other file is imported, but not run
DRAW = ("small_models", "alias", "connections")


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The package without robots, and the compiler's tests."""
    leave = shutil.ignore_patterns("__pycache__", "robots", "*.so")
    shutil.copytree(PACKAGE, tmp_path / "gtmodel", ignore=leave)
    for name in ("compiler", "oracle", "support"):
        shutil.copytree(ROOT / "tests" / name, tmp_path / "tests" / name, ignore=leave)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    assert not (tmp_path / "gtmodel" / "robots").exists()
    return tmp_path


def run(folder: Path, *arguments: str) -> str:
    environment = {**os.environ, AGAIN: "1", "PYTHONPATH": str(folder)}
    command = [sys.executable, *arguments]
    result = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]
    return result.stdout


PYTEST = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist")


@pytest.mark.skipif(AGAIN in os.environ, reason="this is the copy without robots")
class TestCopy:
    def test_imports(self, copy):
        run(copy, "-c", PROGRAM, str(copy))

    def test_compiler_tests_are_collected_and_a_draw_of_them_passes(self, copy):
        assert "error" not in run(copy, *PYTEST, "--collect-only", "tests/compiler").lower().splitlines()[-1]
        summary = run(copy, *PYTEST, *(f"tests/compiler/test_{name}.py" for name in DRAW))
        assert " passed" in summary

    @pytest.mark.proof
    def test_all_compiler_tests_pass(self, copy):
        summary = run(copy, *PYTEST, "tests/compiler")
        assert " passed" in summary


@pytest.mark.skipif(AGAIN in os.environ, reason="there are no robots to ask for")
def test_robots_are_there_when_asked_for():
    assert "l1_tape" in gtmodel.robots.names()
    with pytest.raises(AttributeError, match="module 'gtmodel' has no attribute 'robot'"):
        _ = gtmodel.robot
