"""Fences of a page: what is run of them, in the order of the page, in one folder.

<!-- long -->          above a fence: it takes more than some seconds, and runs in `make proof` only
<!-- file: NAME -->    above a fence: it is saved under this name, as the reader does; Python is not run besides
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CLONE = Path(__file__).parents[2]


@dataclass(frozen=True)
class Fence:
    """What stands between ``` and ```, with what is said of it above."""

    info: str
    text: str
    line: int
    long: bool
    file: str

    @property
    def commands(self) -> list[str]:
        """The calls of gtmodel in a fence of a shell or of the directive `run`."""
        if self.info not in ("sh", "{run}"):
            return []
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line.split("  #")[0].strip() for line in lines if line.startswith("gtmodel ")]

    @property
    def status(self) -> int:
        """The exit code that the option `status` of `run` expects."""
        option = re.search(r"^:status: (\d)$", self.text, re.M)
        return int(option[1]) if option else 0


def fences(page: Path) -> list[Fence]:
    """All fences of a page."""
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(r"^(?P<mark>```+)(?P<info>.*)\n(?P<body>(?:.*\n)*?)(?P=mark)$", re.M)
    made = []
    for m in pattern.finditer(text):
        above = text[: m.start()]
        comment = re.search(r"<!-- (long|file: \S+) -->\s*\Z", above)
        word = comment[1] if comment else ""
        file = word.removeprefix("file: ") if word.startswith("file: ") else ""
        made.append(Fence(m["info"].strip(), m["body"], above.count("\n") + 1, word == "long", file))
    return made


def run_page(page: Path, work: Path, *, long: bool, python: bool = True) -> list[tuple[Fence, str, int, str]]:
    """Run a page in a folder, and return its commands with exit codes and what they printed.

    long: False leaves out what takes long, and all Python below it.
    """
    from .runs import run_in

    for name in ("problems", "notebooks"):
        if not (work / name).exists():
            (work / name).symlink_to(CLONE / name)
    scope: dict[str, Any] = {"__name__": "page"}
    ran = []
    for fence in fences(page):
        if fence.file:
            (work / fence.file).write_text(fence.text, encoding="utf-8")
        elif fence.info == "python" and python:
            if fence.long and not long:
                python = False
                continue
            with contextlib.chdir(work):
                exec(compile("\n" * fence.line + fence.text, str(page), "exec"), scope)
        elif long or not fence.long:
            ran += [(fence, command, *run_in(work, shlex.split(command)[1:])) for command in fence.commands]
    return ran


def main() -> None:
    """Runs a page whole and writes what its commands printed: page, folder, file."""
    page, work, target = map(Path, sys.argv[1:])
    with contextlib.redirect_stdout(open(os.devnull, "w")):
        ran = run_page(page, work, long=True)
    rows = [{"command": command, "code": code, "text": text} for _, command, code, text in ran]
    target.write_text(json.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
