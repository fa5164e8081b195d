"""Start-up time of commands: processor seconds of new processes against the smallest comparable program.

Prints Markdown; ends with 1 if a ratio is above its limit. Runs are interleaved; the least of each is taken.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from gtmodel.problem_files import names

RUNS = 7
EMPTY = Path(__file__).parent / "rivals" / "empty_typer.py"
IMPORTS = "import casadi, numpy"
MODEL = "import casadi, numpy, typer, pydantic\nclass A(pydantic.BaseModel):\n    x: int\n"
LIMIT = 1.5


def seconds(arguments: list[str], folder: str) -> float:
    """Processor time of a process and its children [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True, env=os.environ)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    command = ["-m", "gtmodel"]
    pairs = {f"gtmodel {words}": ([*command, *words.split()], "empty") for words in ("--help", "--version", "list")}
    pairs |= {f"gtmodel schema {kind}": ([*command, "schema", kind], "model") for kind in names()}
    pairs |= {"import gtmodel": (["-c", "import gtmodel"], "imports")}
    rivals = {"empty": [str(EMPTY), "--help"], "model": ["-c", MODEL], "imports": ["-c", IMPORTS]}
    titles = {
        "empty": "empty typer app, --help",
        "model": "casadi, numpy, typer, one pydantic model",
        "imports": IMPORTS,
    }
    ours: dict[str, list[float]] = {name: [] for name in pairs}
    theirs: dict[str, list[float]] = {name: [] for name in rivals}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(RUNS):
            for name, words in rivals.items():
                theirs[name].append(seconds(words, folder))
            for name, (words, _) in pairs.items():
                ours[name].append(seconds(words, folder))
    print("| command | CPU [s] | reference | CPU [s] | ratio | at most | |\n|---|---:|---|---:|---:|---:|---|")
    good = True
    for name, (_, rival) in pairs.items():
        a, b = min(ours[name]), min(theirs[rival])
        good &= a <= LIMIT * b
        print(f"| `{name}` | {a:.3f} | {titles[rival]} | {b:.3f} | {a / b:.2f} | {LIMIT} | "
              f"{'pass' if a <= LIMIT * b else 'FAIL'} |")  # fmt: skip
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
