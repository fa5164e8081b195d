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

# One process: the import first, then pytest. All test files are imported, those that -k names are run.
PROGRAM = """
import importlib.util, sys
import gtmodel, pytest
folder, *arguments = sys.argv[1:]
assert gtmodel.__file__.startswith(folder), gtmodel.__file__
assert importlib.util.find_spec("gtmodel.robots") is None
assert not any(name.startswith("gtmodel.robots") for name in sys.modules)
plain = ["-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
sys.exit(pytest.main([*plain, "tests/compiler", *arguments]))
"""

# language, aliases, blocks of every closed kind and calls
DRAW = "small_models or alias or connections"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The package without robots, and the compiler's tests."""
    # with what Python has compiled, which is as old as its source here too
    shutil.copytree(PACKAGE, tmp_path / "gtmodel", ignore=shutil.ignore_patterns("robots", "*.so"))
    for name in ("compiler", "oracle", "support"):
        leave = shutil.ignore_patterns("__pycache__", "*.so")
        shutil.copytree(ROOT / "tests" / name, tmp_path / "tests" / name, ignore=leave)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    assert not (tmp_path / "gtmodel" / "robots").exists()
    return tmp_path


def run(folder: Path, *arguments: str) -> str:
    environment = {**os.environ, AGAIN: "1", "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", PROGRAM, str(folder), *arguments]
    result = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]
    return result.stdout


@pytest.mark.skipif(AGAIN in os.environ, reason="this is the copy without robots")
class TestCopy:
    def test_a_draw_of_the_compilers_tests_passes(self, copy):
        assert " passed" in run(copy, "-k", DRAW)

    @pytest.mark.proof
    def test_all_of_them_pass(self, copy):
        assert " passed" in run(copy)


@pytest.mark.skipif(AGAIN in os.environ, reason="there are no robots to ask for")
def test_robots_are_there_when_asked_for():
    assert "l1_tape" in gtmodel.robots.names()
    with pytest.raises(AttributeError, match="module 'gtmodel' has no attribute 'robot'"):
        _ = gtmodel.robot
