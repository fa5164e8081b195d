"""The command line inside this process, and as a process of its own."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gtmodel.cli import main

CLONE = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Done:
    """Exit code and what was printed."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one object on stdout; fails when anything else is there or a NaN is in it."""
        return json.loads(self.out, parse_constant=lambda word: pytest.fail(f"{word} in the JSON"))

    @property
    def sentence(self) -> str:
        """The one line on stderr."""
        (line,) = self.err.splitlines()
        return line


class Commands:
    """Runs `gtmodel ...` in this process, in the current folder."""

    def __init__(self, captured: pytest.CaptureFixture[str]) -> None:
        self._captured = captured

    def __call__(self, *words: str | Path) -> Done:
        self._captured.readouterr()
        code = main([str(w) for w in words])
        printed = self._captured.readouterr()
        return Done(code, printed.out, printed.err)


def command(*words: str | Path) -> list[str]:
    """The command line of a process of its own, as a shell script would call it."""
    return [sys.executable, "-m", "gtmodel.cli", *map(str, words)]


def environment(**more: str) -> dict[str, str]:
    """Variables under which that process finds this clone, from any folder."""
    return {**os.environ, "PYTHONPATH": str(CLONE), **more}


def process(*words: str | Path, cwd: Path, **variables: str) -> Done:
    """Run `gtmodel ...` as a process of its own."""
    done = subprocess.run(
        command(*words), cwd=cwd, env=environment(**variables), capture_output=True, text=True, timeout=120
    )
    return Done(done.returncode, done.stdout, done.stderr)
