"""A write of gtmodel that the system kills at its n-th touch of the disk, or whose files may not grow beyond a size.

Run as a program: `python -m tests.support.killed FOLDER JOB [EVERY]`; with EVERY = 3, at each third n only. The process
forks for every case, so that what takes long, importing and computing, is done once. FOLDER holds the files of
tests.support.own_models.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

_TOUCHES = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"}
_SIZES = (0, 1, 40, 300, 1000, 3000, 10**6)  # bytes
_LARGEST = 200  # no write of these tests touches the disk that often


def solve(elements: int) -> Callable[[Path], None]:
    """A job of `gtmodel solve --out`: another result for another number of elements."""
    from gtmodel.problem_files.load import load
    from gtmodel.problem_files.run import answer, context_of, solve as run

    loaded = load("swing.toml", [f"mesh.elements={elements}"])
    outcome = answer(loaded, context_of(loaded))
    kind = type("Solved", (), {"call": staticmethod(lambda problem, context: lambda **_: outcome)})
    solved = type(loaded)(loaded.path, loaded.content, loaded.settings, kind(), loaded.problem, loaded.shipped)  # type: ignore[arg-type]

    def job(out: Path) -> None:
        context = context_of(loaded)
        context.notice = said
        finished = run(solved, context, out=out)
        if finished.unwritten:
            raise OSError(finished.unwritten)

    return job


def codegen(elements: int) -> Callable[[Path], None]:
    """A job of `gtmodel codegen` without its algebra: files of other names and other contents for another number."""
    from gtmodel.cgen.folder import write
    from gtmodel.problem_files.load import load
    from gtmodel.problem_files.run import context_of, generate

    loaded = load("pendulum_code.toml", [f"name=p{elements}"])
    generate(loaded, context_of(loaded), Path(f"made{elements}"), verify=False)
    texts = contents(Path(f"made{elements}"))
    manifest = json.loads(texts.pop("manifest.json"))
    return lambda out: write(out, texts, manifest, False)


def said(sentence: str) -> None:
    """What a command would print."""
    print(sentence, file=sys.stderr)


def kill_at(touch: int, folder: Path) -> None:
    """SIGKILL for this process at its `touch`-th touch of something in `folder`, before it happens."""
    count = 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        if event in _TOUCHES and str(folder) in str(arguments[0]):
            # reading changes nothing
            if event == "open" and isinstance(arguments[2], int) and not arguments[2] & (os.O_WRONLY | os.O_RDWR):
                return
            count += 1
            if count == touch:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def full_at(size: int, folder: Path) -> None:
    """As on a full disk: files of this process end at `size` bytes, with an error and without a signal."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def in_a_child(work: Callable[[], None]) -> str:
    """How a forked process ended: "done", "killed", or the sentence of its error."""
    get, put = os.pipe()
    child = os.fork()
    if child == 0:
        said = "done"
        try:
            with contextlib.redirect_stderr(io.StringIO()) as notes:
                work()
            said += notes.getvalue()
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        os.write(put, said.encode())
        os._exit(0)
    os.close(put)
    with os.fdopen(get, "rb") as pipe:
        said = pipe.read().decode()
    _, status = os.waitpid(child, 0)
    return "killed" if os.WIFSIGNALED(status) else said


def contents(folder: Path) -> dict[str, str]:
    """Files of a folder as text, by name; nothing where there is no folder."""
    found = sorted(folder.iterdir()) if folder.is_dir() else []
    return {p.name: p.read_text(encoding="utf-8", errors="replace") for p in found if p.is_file()}


def main(place: Path, job: str, every: int = 1) -> None:
    """Print one JSON object per case: what was there before, after the broken write, and after the next one."""
    os.chdir(place)
    make = {"solve": solve, "codegen": codegen}[job]
    jobs = {"first": make(3), "second": make(4), "wanted": make(5)}
    for name, write in jobs.items():
        write(place / name)
    print(json.dumps({name: contents(place / name) for name in jobs}))
    for scenario in ("kill", "kill new", "kill edited", "full", "full new"):
        # in a folder that is not new, every second touch, and the two scenarios take turns
        first, step = {"kill": (1, 2), "kill edited": (2, 2)}.get(scenario, (1, 1))
        for case in range(first, _LARGEST, step * every) if "kill" in scenario else _SIZES:
            ended = one(place / "out", jobs, scenario, case)
            print(json.dumps({"scenario": scenario, "case": case, **ended}))
            if ended["ended"].startswith("done"):
                break


def one(out: Path, jobs: dict[str, Callable[[Path], None]], scenario: str, case: int) -> dict[str, Any]:
    """One broken write into `out`, a person's edit if the scenario has one, and the next write."""
    shutil.rmtree(out, ignore_errors=True)
    if "new" not in scenario:
        jobs["first"](out)
        (out / "notes.txt").write_text("mine")

    def broken() -> None:
        (kill_at if "kill" in scenario else full_at)(case, out)
        jobs["second"](out)

    found: dict[str, Any] = {"ended": in_a_child(broken), "after": contents(out), "edited": ""}
    if "edited" in scenario:
        found["edited"] = next((name for name in ("result.json", "README.md") if name in found["after"]), "")
        (out / found["edited"]).write_text("mine too")
    found |= {"again": in_a_child(lambda: jobs["wanted"](out)), "then": contents(out)}
    return found | {"folders": sorted(p.name for p in out.iterdir() if p.is_dir())}


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2], *map(int, sys.argv[3:]))
