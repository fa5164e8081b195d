"""Commands of the pages, run as a person runs them, in a folder of their own with the shipped problems in it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pty
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .fences import files_of

CLONE = Path(__file__).parents[2]
KEPT = CLONE / "build" / "site" / "runs"
WIDTH = "116"  # columns of the printed tables
PROGRESS = re.compile(r"\d+:\d\d:\d\d ")  # a line every ten seconds, where a machine is slow enough for one


@dataclass(frozen=True)
class Result:
    """What a command printed, its exit code, and the pictures that it drew."""

    text: str
    code: int
    pictures: list[Path]


@cache
def _sources() -> str:
    """A digest of gtmodel and of the shipped problems: what a command prints depends on nothing else.

    With SITE_DRAFT in the environment all that was run before is taken as it is: for writing, not for publishing.
    """
    if "SITE_DRAFT" in os.environ:
        return "draft"
    digest = hashlib.sha256()
    for folder in ("gtmodel", "problems", "codegen"):
        for path in sorted((CLONE / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.relative_to(CLONE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def run(command: str) -> Result:
    """Run `gtmodel ...`, or take what an earlier build kept. Commands that write do so under `out`."""
    program, *arguments = shlex.split(command)
    if program != "gtmodel":
        raise ValueError(f"pages run gtmodel only; found '{command}'")
    folder = KEPT / hashlib.sha256(f"{_sources()}\0{command}".encode()).hexdigest()[:24]
    if not (folder / "run.json").exists():
        with tempfile.TemporaryDirectory() as work:
            for name in ("problems", "notebooks"):
                (Path(work) / name).symlink_to(CLONE / name)
            code, text = run_in(Path(work), arguments)
            folder.mkdir(parents=True, exist_ok=True)
            for picture in sorted((Path(work) / "out").rglob("*.png")):
                (folder / picture.name).write_bytes(picture.read_bytes())
        (folder / "run.json").write_text(json.dumps({"text": text, "code": code}), encoding="utf-8")
    kept = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return Result(kept["text"], kept["code"], sorted(folder.glob("*.png")))


def run_page(page: Path) -> dict[str, Result]:
    """What the commands of a page print that are run in its own order, after its Python and with its files."""
    text = page.read_text(encoding="utf-8") + str(files_of(page))
    folder = KEPT / hashlib.sha256(f"{_sources()}\0{text}".encode()).hexdigest()[:24]
    if not (folder / "page.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as work:
            command = [sys.executable, "-m", "docs._ext.fences", str(page), work, str(folder / "page.json")]
            subprocess.run(
                command, cwd=CLONE, check=True, env={**os.environ, "PYTHONPATH": str(CLONE), "MPLBACKEND": "Agg"}
            )
            for picture in sorted(Path(work).rglob("*.png")):
                (folder / picture.name).write_bytes(picture.read_bytes())
    pictures = sorted(folder.glob("*.png"))
    rows = json.loads((folder / "page.json").read_text(encoding="utf-8"))
    return {row["command"]: Result(row["text"], row["code"], pictures) for row in rows}


def run_in(work: Path, arguments: list[str]) -> tuple[int, str]:
    """Exit code of `gtmodel` with these arguments in a folder, and what it printed; its errors too where it failed."""
    own = {"PYTHONPATH": str(CLONE), "MPLBACKEND": "Agg", "TERM": "xterm", "NO_COLOR": "1", "COLUMNS": WIDTH}
    command = [sys.executable, "-m", "gtmodel", *arguments]
    with tempfile.TemporaryFile() as errors:
        reader, terminal = pty.openpty()  # tables as a terminal of this width shows them
        with subprocess.Popen(command, cwd=work, env={**os.environ, **own}, stdout=terminal, stderr=errors) as process:
            os.close(terminal)
            text = _all_of(reader)
        errors.seek(0)
        text += errors.read().decode() if process.returncode else ""
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)  # bold and dim
    lines = [line.rstrip() for line in text.replace(str(work.resolve()), ".").replace(str(work), ".").splitlines()]
    lines = [line for line in lines if not PROGRESS.match(line)]
    return process.returncode, "\n".join(lines).strip("\n")


def _all_of(terminal: int) -> str:
    """What is written to a terminal until its other end is closed."""
    parts = []
    with contextlib.suppress(OSError):  # Linux: the other end is closed
        while part := os.read(terminal, 65536):
            parts.append(part)
    os.close(terminal)
    return b"".join(parts).decode()
