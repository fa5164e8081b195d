"""Results of all shipped problems, for comparison between two trees: a refactoring must not change them.

python tests/bench/shipped_results.py OUT [PROBLEM ...]     solve into OUT/PROBLEM, what was printed beside it
python tests/bench/shipped_results.py --compare A B         exit 1 where any file but run.toml differs

Problems of kind codegen generate code, which is compared byte for byte; of other texts the words are compared, and the
numbers to a relative EQUAL.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

# another number of BLAS threads sums in another order and moves the last digits
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
CLONE = Path(__file__).resolve().parents[2]
PROBLEMS = CLONE / "problems"
EQUAL = 1e-9
TEXTS = {".json", ".csv", ".txt", ".mod"}
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
sys.path.insert(0, str(CLONE))

from tests.support.recordings import EMPS_PULSES, NOT_SHIPPED  # noqa: E402

# a recording that is not shipped, from where the tests have it
SETTINGS = {name: ["--set", f"log.files=['{file}']"] for name, (file, _) in NOT_SHIPPED.items()}
SETTINGS["emps_pulses"] += ["--set", f"log.held_out=['{EMPS_PULSES}']"]


def solve(out: Path, names: list[str]) -> None:
    for name in names or sorted(p.stem for p in PROBLEMS.glob("*.toml")):
        folder = out / name
        problem = PROBLEMS / f"{name}.toml"
        code = tomllib.loads(problem.read_text())["kind"] == "codegen"
        command = [sys.executable, "-m", "gtmodel.cli", "codegen" if code else "solve", str(problem)]
        command += ["-o" if code else "--out", str(folder), *SETTINGS.get(name, [])]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=ONE_THREAD)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "printed.txt").write_text(done.stdout.replace(str(folder), "OUT"))
        print(name, done.returncode, done.stderr.strip().splitlines()[-1] if done.returncode else "", flush=True)


def differences(a: Path, b: Path) -> list[str]:
    """Files, below both folders, that one lacks or that differ; run.toml holds times and is left out."""
    files = {p.relative_to(root) for root in (a, b) for p in root.rglob("*") if p.is_file() and p.name != "run.toml"}
    return [f"{n}: {how}" for n in sorted(files) if (how := difference(a / n, b / n))]


def difference(a: Path, b: Path) -> str:
    """How two files differ; empty where they do not."""
    if not (a.is_file() and b.is_file()):
        return "in one only"
    one, other = a.read_bytes(), b.read_bytes()
    if one == other or a.suffix not in TEXTS:
        return "" if one == other else "other bytes"
    texts = (one.decode(), other.decode())
    words, numbers = [NUMBER.split(t) for t in texts], [[float(n) for n in NUMBER.findall(t)] for t in texts]
    if words[0] != words[1]:
        return "other words: " + next(
            (f"{u!r} / {v!r}" for u, v in zip(*words, strict=False) if u != v), "more of them"
        )
    worst = max((abs(u - v) / max(abs(u), abs(v)), u, v) for u, v in zip(*numbers, strict=True) if u != v)
    return f"{worst[1]!r} / {worst[2]!r}, the worst number" if worst[0] > EQUAL else ""


def main(words: list[str]) -> int:
    if words[:1] == ["--compare"]:
        found = differences(Path(words[1]), Path(words[2]))
        print("\n".join(found) or "equal")
        return 1 if found else 0
    solve(Path(words[0]), words[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
