"""Commands of the pages, run as a person runs them, in a folder of their own with the shipped problems in it."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CLONE = Path(__file__).parents[2]
KEPT = CLONE / "build" / "site" / "runs"
WIDTH = "110"  # columns of the printed tables
PROGRESS = re.compile(r"\d+:\d\d:\d\d ")  # a line every ten seconds, where a machine is slow enough for one


@dataclass(frozen=True)
class Result:
    """What a command printed, its exit code, and the pictures that it drew."""

    text: str
    code: int
    pictures: list[Path]


@cache
def _sources() -> str:
    """A digest of gtmodel and of the shipped problems: what a command prints depends on nothing else."""
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


def run_in(work: Path, arguments: list[str]) -> tuple[int, str]:
    """Exit code of `gtmodel` with these arguments in a folder, and what it printed; its errors too where it failed."""
    env = {**os.environ, "PYTHONPATH": str(CLONE), "COLUMNS": WIDTH, "MPLBACKEND": "Agg", "TERM": "dumb"}
    command = [sys.executable, "-m", "gtmodel", *arguments]
    done = subprocess.run(command, cwd=work, env=env, capture_output=True, text=True, check=False)
    text = done.stdout + (done.stderr if done.returncode else "")
    lines = [line.rstrip() for line in text.replace(str(work.resolve()), ".").replace(str(work), ".").splitlines()]
    lines = [line for line in lines if not PROGRESS.match(line)]
    return done.returncode, "\n".join(lines).strip("\n")
