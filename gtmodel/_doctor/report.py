"""The rows of ``gtmodel doctor``, whether gtmodel can solve problems here, and advice if it cannot."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gtmodel._files import codegen_dir, problems_dir
from gtmodel._version import __version__

from . import machine
from .requirements import Requirement, Requirements, requirements
from .trials import IMPORTS, LINEAR_SOLVERS

HEAD = ("what", "version or state", "remark")
# required for a solve or its re-simulation; the others are alternatives
NEEDED = ("ipopt mumps", "fatrop", "cvodes", "idas")
ALTERNATIVES = ("osqp", "qrqp")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
TRIALS_S = 60.0
CRASHED = "the process crashed"
PIP = "python -m pip"
TRIALS = Path(__file__).with_name("trials.py")


@dataclass(frozen=True)
class Finding:
    """One row: subject, version or state, remark; `advice` if gtmodel cannot solve problems without it."""

    what: str
    state: str
    remark: str = ""
    advice: str = ""


@dataclass(frozen=True)
class Trial:
    """Trial of a solver: its fault, "" if it works, and information about it."""

    fault: str = ""
    about: str = ""


@dataclass(frozen=True)
class Report:
    """All rows."""

    rows: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """True if gtmodel can solve problems."""
        return not any(row.advice for row in self.rows)

    @property
    def message(self) -> str:
        """One sentence: that gtmodel can solve problems here, or what to do first."""
        wrong = [row for row in self.rows if row.advice]
        if not wrong:
            return "gtmodel can solve problems here"
        more = f"; also wrong: {', '.join(row.what for row in wrong[1:])}" if wrong[1:] else ""
        return f"gtmodel cannot solve problems here: {wrong[0].what}: {wrong[0].remark}; {wrong[0].advice}{more}"

    def cells(self) -> list[tuple[str, str, str]]:
        """Return the rows of the table."""
        return [(row.what, row.state, row.remark) for row in self.rows]

    def document(self) -> dict[str, Any]:
        """Return the object that --json prints."""
        rows = {row.what: {k: v for k, v in asdict(row).items() if k != "what"} for row in self.rows}
        return {"gtmodel": __version__, "ok": self.ok, "message": self.message, "rows": rows}


def examined() -> Report:
    """Examine everything; solvers and compiler are tried in parallel."""
    with ThreadPoolExecutor(2) as pool:
        trials, compiler = pool.submit(tried), pool.submit(machine.compiler)
        wanted = requirements()
        first = [*_python(wanted), *_packages(wanted)]
        last = [*_programs(), *_extras(wanted), *_folders()]
        rows = [*first, *_solvers(trials.result(), wanted), _compiler(*compiler.result()), *last]
    clean = machine.discreet
    return Report(tuple(Finding(r.what, clean(r.state), clean(r.remark), clean(r.advice)) for r in rows))


def tried() -> dict[str, Trial]:
    """Run trials.py in a separate process; after a crash, start it again with the trials that are left."""
    done: dict[str, Trial] = {}
    program = [sys.executable, "-P", str(TRIALS)]
    while True:
        begun = ""
        try:
            run = subprocess.run([*program, *done], capture_output=True, text=True, errors="replace", timeout=TRIALS_S)
            lines, end = run.stdout, f"{CRASHED} (exit code {run.returncode})"
        except subprocess.TimeoutExpired as error:
            lines, end = (error.stdout or b"").decode(errors="replace"), f"not done after {TRIALS_S:g} s"
        except OSError as error:
            return {**done, "python": Trial(str(error))}
        for line in lines.splitlines():
            event = json.loads(line)
            if "begin" in event:
                begun = event["begin"]
            else:
                done[event["trial"]] = Trial(event["fault"], event["about"])
        if not begun or begun in done:
            return done
        done[begun] = Trial(end)


def _python(wanted: Requirements) -> list[Finding]:
    version = platform.python_version()
    least = tuple(int(n) for n in wanted.python.split(".") if n.isdigit())
    old = bool(least) and sys.version_info[: len(least)] < least
    return [
        Finding("gtmodel", __version__, f"in {Path(__file__).resolve().parents[2]}"),
        Finding(
            "python", f"{platform.python_implementation()} {version}", f"older than {wanted.python}" if old else "",
            f"make an environment with Python {wanted.python} or newer" if old else "",
        ),
        Finding("platform", platform.platform(), f"{_processors()} processors"),
    ]  # fmt: skip


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _packages(wanted: Requirements) -> list[Finding]:
    if not wanted.packages:
        return [Finding("packages", "unknown", "neither pyproject.toml nor an installation lists the requirements")]
    rows = []
    for package in wanted.packages:
        fault, remark, advice = package.missing(), "", ""
        if fault:
            remark = f"{fault}: {package.least} or newer is needed" if package.least else fault
            advice = f"install it: {PIP} install '{package}'"
        rows.append(Finding(package.name, package.installed() or "none", remark, advice))
    return rows


def _solvers(trials: dict[str, Trial], wanted: Requirements) -> list[Finding]:
    rows = []
    for name in IMPORTS:
        fault = trials.get(f"import {name}", Trial("not tried")).fault
        package = next((p for p in wanted.packages if p.name == name.partition(".")[0]), Requirement(name))
        if fault and package.installed():
            advice = f"reinstall it: {PIP} install --force-reinstall '{package}'"
            rows.append(Finding(f"import {name}", "none", fault, advice))
    if rows or any(p.missing() for p in wanted.packages if p.name in ("numpy", "casadi")):
        return [*rows, Finding("solvers", "none", "not tried without casadi and numpy")]
    faults = {name: trial.fault for name, trial in trials.items()}
    loaded = [s for s in LINEAR_SOLVERS if not faults.get(f"ipopt {s}", "not tried")]
    absent = [s for s in LINEAR_SOLVERS if s not in loaded]
    needed = {name: fault for name in NEEDED if (fault := faults.get(name, "not tried"))}
    reinstall = f"reinstall casadi: {PIP} install --force-reinstall casadi"
    blas = trials.get("blas", Trial()).about or "unknown"
    rows.append(Finding("BLAS", blas, ", ".join(f"{n}={os.environ[n]}" for n in THREADS if n in os.environ)))
    rows.append(Finding("ipopt with", ", ".join(loaded) or "none", f"not here: {', '.join(absent)}" if absent else ""))
    for what, names in (("other solvers", ("fatrop", *ALTERNATIVES)), ("integrators", ("cvodes", "idas"))):
        good = [n for n in names if not faults.get(n, "not tried")]
        bad = [f"{n}: {faults[n]}" for n in names if n in ALTERNATIVES and faults.get(n)]
        rows.append(Finding(what, ", ".join(good) or "none", "; ".join(bad)))
    rows += [Finding(name, "fails on a tiny problem", fault, reinstall) for name, fault in needed.items()]
    return rows


def _compiler(state: str, fault: str) -> Finding:
    without = "without one gtmodel solves, more slowly, and checks no generated code"
    return Finding("C compiler", state, f"{fault}; {without}" if fault else "compiles and runs a tiny function")


def _programs() -> list[Finding]:
    rows = []
    for name, command, option, use in (
        ("callgrind", "valgrind", "--version", "counts instructions; package valgrind"),
        ("frama-c", "frama-c", "-version", "proves C code; package frama-c-base"),
    ):
        state = machine.program(command, option)
        rows.append(Finding(name, state, f"optional: {use}" if state == "none" else ""))
    return rows


def _extras(wanted: Requirements) -> list[Finding]:
    rows = []
    for name, packages in wanted.extras.items():
        lacking = [p for p in packages if p.missing()]
        install = f"optional: {PIP} install 'gtmodel[{name}]'"
        state = f"lacks {', '.join(p.name for p in lacking)}" if lacking else "complete"
        rows.append(Finding(f"extra {name}", state, install if lacking else ""))
    return rows


def _folders() -> list[Finding]:
    cache, fault = machine.cache()
    problems, sources = sorted(problems_dir().glob("*.toml")), sorted(codegen_dir().rglob("*.c"))
    lost = not problems or not sources
    return [
        Finding("cache", cache, fault or "writable"),
        Finding(
            "shipped", f"{len(problems)} problems, {len(sources)} C sources",
            "files of gtmodel are missing" if lost else "",
            f"reinstall gtmodel: {PIP} install --force-reinstall gtmodel" if lost else "",
        ),
    ]  # fmt: skip
