"""Results of all shipped problems, to be compared between two trees: what a change of structure must leave equal.

python tests/bench/shipped_results.py OUT [PROBLEM ...]     solve into OUT/PROBLEM, what was printed beside it
python tests/bench/shipped_results.py --compare A B         exit 1 where any file but run.toml differs
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

# another number of BLAS threads sums in another order and moves the last digits
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
CLONE = Path(__file__).resolve().parents[2]
PROBLEMS = CLONE / "problems"
sys.path.insert(0, str(CLONE))

from tests.support.recordings import NOT_SHIPPED  # noqa: E402

# a recording that is not shipped, from where the tests have it
SETTINGS = {name: ["--set", f"log.files=['{file}']"] for name, (file, _) in NOT_SHIPPED.items()}


def solve(out: Path, names: list[str]) -> None:
    for name in names or sorted(p.stem for p in PROBLEMS.glob("*.toml")):
        folder = out / name
        command = [sys.executable, "-m", "gtmodel.cli", "solve", str(PROBLEMS / f"{name}.toml"), "--out", str(folder)]
        command += SETTINGS.get(name, [])
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=ONE_THREAD)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "printed.txt").write_text(done.stdout.replace(str(folder), "OUT"))
        print(name, done.returncode, done.stderr.strip().splitlines()[-1] if done.returncode else "", flush=True)


def differences(a: Path, b: Path) -> list[str]:
    """Files, below both folders, that one lacks or that hold other bytes; run.toml holds times and is left out."""
    files = {p.relative_to(root) for root in (a, b) for p in root.rglob("*") if p.is_file() and p.name != "run.toml"}

    def content(path: Path) -> bytes | None:
        return path.read_bytes() if path.is_file() else None

    return sorted(str(n) for n in files if content(a / n) != content(b / n))


def main(words: list[str]) -> int:
    if words[:1] == ["--compare"]:
        found = differences(Path(words[1]), Path(words[2]))
        print("\n".join(found) or "equal")
        return 1 if found else 0
    solve(Path(words[0]), words[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
