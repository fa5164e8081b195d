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
from collections.abc import Callable, Iterator
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
        return int(self.option("status") or 0)

    def option(self, name: str) -> str:
        """An option of a directive, "" where it has none of this name."""
        line = re.search(rf"^:{name}: *(.*)$", self.text, re.M)
        return line[1].strip() if line else ""


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


def files_of(page: Path) -> dict[str, str]:
    """Name -> content of what the reader of a page saves, on pages that it goes on from too."""
    others = re.findall(r"<!-- files of: (\S+) -->", page.read_text(encoding="utf-8"))
    files = [files_of(page.with_name(f"{name}.md")) for name in others]
    own = {fence.file: fence.text for fence in fences(page) if fence.file}
    return {name: text for saved in [*files, own] for name, text in saved.items()}


Run = Callable[[Path, list[str]], tuple[int, str]]


def run_page(
    page: Path, work: Path, *, long: bool, python: bool = True, run: Run | None = None
) -> list[tuple[Fence, str, int, str]]:
    """Run a page in a folder, and return its commands with exit codes and what they printed.

    long: False leaves out what takes long, and all Python below it.
    run: what runs a command, given as its words, in a folder; each is a process of its own unless it is given.
    """
    from .runs import run_in

    run = run or run_in
    for name in ("problems", "notebooks"):
        if not (work / name).exists():
            (work / name).symlink_to(CLONE / name)
    for name, text in files_of(page).items():
        (work / name).write_text(text, encoding="utf-8")
    scope: dict[str, Any] = {"__name__": "page"}
    ran = []
    for fence in fences(page):
        if fence.file:
            continue
        if fence.info == "python" and python:
            if fence.long and not long:
                python = False
                continue
            with contextlib.chdir(work), importable(work):
                exec(compile("\n" * fence.line + fence.text, str(page), "exec"), scope)
        elif long or not fence.long:
            ran += [(fence, command, *run(work, shlex.split(command)[1:])) for command in fence.commands]
    return ran


@contextlib.contextmanager
def importable(folder: Path) -> Iterator[None]:
    """Modules of a folder may be imported, and are forgotten afterwards."""
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            if (folder / f"{name}.py").exists():
                del sys.modules[name]


def main() -> None:
    """Runs a page whole and writes what its commands printed: page, folder, file."""
    page, work, target = map(Path, sys.argv[1:])
    with contextlib.redirect_stdout(open(os.devnull, "w")):
        ran = run_page(page, work, long=True)
    rows = [{"command": command, "code": code, "text": text} for _, command, code, text in ran]
    target.write_text(json.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
