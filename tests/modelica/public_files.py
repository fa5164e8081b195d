"""Solve every optimization class of the `.mop` files in a folder, and write the outcome of each as a table.

    python tests/modelica/public_files.py FOLDER [--library FOLDER] [--rows rows.jsonl] [--table rows.md]

Every class is solved as `gtmodel solve FILE:CLASS` does, on 50 elements with 3 points; where that mesh does not resolve
the model, finer ones are tried, and the reason says which does. Nothing is fetched: FOLDER is a copy of the public
files, such as a checkout of JModelica/JModelica, and the library the Modelica Standard Library's folder. Libraries
that stand beside a file, and that it names, are read with it. Rows that the .jsonl file holds already are not solved
again, so that a run that was stopped goes on. docs/coming_from/public_optimica_files.md is written of such a run.

The tier says what a class needs, its components and what it extends included. A: classes, packages, components,
arrays, units, signal connectors. B: functions, records, connectors of its own, or imports besides. C: components of
the Modelica Standard Library, or stream connectors.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

SHARED = ("SIunits", "Units", "Constants", "Icons", "Math")
SIGNALS = ("RealInput", "RealOutput")
# a solver that is told to stop does so at its next iteration: what takes longer than this besides has not begun
PREPARATION_S = 60.0
MESH_CHECKS = ("discretisation_error", "integral_error")
LONGEST = 200  # letters of a reason in the table
FINER = (100, 200, 400)
# published, or by the same statement written anew (docs/notes of the tests): file, class -> optimum
KNOWN: dict[tuple[str, str], float] = {
    ("VDP.mop", "VDP_Opt"): 23.4690886,
    ("VDP.mop", "VDP_Opt2"): 23.4690886,
    ("VDP.mop", "VDP_Opt_Bounds_Lagrange"): 3.176195803,
    ("VDP.mop", "VDP_Opt_Bounds_Mayer"): 3.176195803,
    ("VDP.mop", "VDP_Opt_Constraints_Lagrange"): 5.273481331,
    ("VDP.mop", "VDP_Opt_Constraints_Mayer"): 5.273481331,
    ("VDP.mop", "VDP_Opt_Scaled_Min_Time"): 2.281158695,
    ("CSTR.mop", "CSTR_Opt_Bounds_Lagrange"): 1857.6873858,
    ("CSTR.mop", "CSTR_Opt_Bounds_Mayer"): 1857.6873858,
    ("CSTR.mop", "CSTR_Opt_Extends"): 1857.6873858,
    ("CSTR.mop", "CSTR_Opt_Dependent_Parameter"): 1857.6873858,
    ("CSTR.mop", "CSTR_Opt_Scaled_Min_Time"): 116.370201,
    ("CSTR.mop", "CSTR_Opt_Unscaled_Min_Time"): 116.370201,
    ("DI_opt.mop", "DI_opt"): 1.3606309,
    ("FreeInitialConditions.mop", "FreeInitialConditions"): 19.1797673,
    ("ContState.mop", "ContState_opt"): 0.1698207,
    ("SymbolicElimination.mop", "IllustExampleLagrange"): 1.06183273,
    ("SymbolicElimination.mop", "LinearLoopLagrangeConstraint"): 2.5843277,
    ("MinTimeProblems.mop", "MinTimeProblem1"): 2.0,
    ("MinTimeInit.mop", "MinTimeInit"): 2.0,
    ("MarinePopulation.mop", "MarinePopulation_opt"): 20361731.0,
}
# what is said of an optimum that is another than the known one
LOCAL = {"MarinePopulation_opt": "the file's guesses lead to a local optimum (negative rates); a better one is known"}
# what the text leaves to the Python scripts beside it, or to a tool: start values, that are fixed or not zero
REMEDIES: dict[str, dict[str, bool | float]] = {
    "Binary_Dist_Opt1": {"cost.fixed": True},
    "Distillation1_opt": {"cost.fixed": True},
    "Distillation1_opt2": {"cost.fixed": True},
    "Pendulum_Opt": {"cost.fixed": True},
    "Crane_MPC": {"l.start": 1.0},
}
SAME = 1e-6  # relative, as the optima are published on the same mesh


@dataclass(frozen=True)
class Asked:
    """One class of a file, and the libraries that it is read with."""

    file: Path
    name: str
    libraries: tuple[str, ...]
    tier: str
    at: str = ""


def beside(file: Path, library: str | None) -> tuple[str, ...]:
    """Libraries of a file: those in its folder that it names, and the Modelica Standard Library where these use it."""
    text = file.read_text(errors="replace")
    own = [p for p in sorted(file.parent.glob("*.mo")) if _names(text, p.stem)]
    text += "".join(p.read_text(errors="replace") for p in own)
    used = set(re.findall(r"\bModelica\.(\w+)(?:\.(?:Interfaces\.)?(\w+))?", text))
    more = any(package not in SHARED and name not in SIGNALS for package, name in used)
    return (*map(str, own), *([library] if library is not None and more else []))


def _names(text: str, package: str) -> bool:
    return re.search(rf"(?<![\w.]){package}\.|(?:extends|within)\s+{package}\b", text) is not None


def tier_of(space: Any) -> str:
    """A, B or C of a class, with all that it uses."""
    from gtmodel.modelica.syntax import Component, Extends, ModelicaError

    seen: dict[int, Any] = {}
    tier = "A"
    waiting = [space]
    while waiting:
        item = waiting.pop()
        text = item.text
        if id(text) in seen:
            continue
        seen[id(text)] = item
        words = item.name.split(".")
        if words[0] == "Modelica" and words[1:2] and words[1] not in SHARED and words[-1] not in SIGNALS:
            return "C"
        if words[0] == "Modelica":
            continue
        around = item
        while around is not None:  # functions and constants of the packages around it are used by their names alone
            inside = [c.restriction for c in around.text.classes.values()]
            if text.restriction in ("record", "connector") or "function" in inside or around.text.imports:
                tier = "B"
            around = around.outer
        for element in text.elements:
            if isinstance(element, Component) and "stream" in element.prefixes:
                return "C"
            reference = element.base if isinstance(element, Extends) else element.type_name
            try:
                waiting.append(item.find(reference))
            except ModelicaError:
                continue  # Real and its like, and what is not there
    return tier


def asked(folder: Path, library: str | None, only: str) -> Iterator[Asked]:
    """The optimization classes of all files; a file that is refused is one item without a name."""
    from gtmodel.modelica.syntax import ModelicaError
    from gtmodel.modelica.translate import chosen, opened, solvable

    for file in sorted(folder.rglob("*.mop")):
        libraries = beside(file, library)
        try:
            text = opened(file, libraries)
        except ModelicaError:
            yield Asked(file, "", libraries, "A")
            continue
        for name, item in solvable(text).items():
            if item.restriction == "optimization" and re.search(only, f"{file.name}:{name}"):
                yield Asked(file, name, libraries, tier_of(chosen(text, name)[1]), str(item.at.where))


def solved(item: Asked, seconds: float) -> dict[str, Any]:
    """What `gtmodel solve FILE:CLASS` makes of it."""
    import gtmodel as gt
    from gtmodel.optimize import optimization_study

    began = time.monotonic()
    try:
        problem: Any = gt.modelica.load(f"{item.file}:{item.name}", library=item.libraries)()
        guess = gt.modelica.first_guess(problem)
        options = gt.SolverOptions(max_seconds=seconds)
        again = partial(gt.modelica.simulated_guess, problem) if guess is None else None
        study = optimization_study(problem, guess=guess, second_guess=again, solver=options)
    except gt.ModelError as error:
        row = {"status": "refused", "message": str(error), "where": str(error.where or "")}
        return {**row, "finer": _remedied(item, seconds)}
    solution = study.solution
    row = {
        "status": study.status.value, "objective": solution.objective, "iterations": solution.iterations,
        "message": solution.message, "where": study.where or "", "reservation": solution.reservation,
        "notes": list(study.notes), "finer": "",
    }  # fmt: skip
    unresolved = [name for name in MESH_CHECKS if not solution.checks[name].passed]
    if study.status is gt.SolveStatus.CHECK_FAILED and unresolved:
        for elements in FINER:
            if time.monotonic() - began > seconds:
                break
            more = gt.solve(problem, gt.Mesh(elements, points=3), guess=guess, solver=options, throw=False)
            if more.status.ok:
                row["finer"] = f"solved with mesh.elements={elements}: {more.objective:.8g}"
                break
    return row


def _remedied(item: Asked, seconds: float) -> str:
    """What becomes of a class that is refused with the values that its scripts set."""
    import gtmodel as gt

    given = REMEDIES.get(item.name.rpartition(".")[2])
    if given is None:
        return ""
    said = ", ".join(f"{name}={str(value).lower()}" for name, value in given.items())
    problem: Any = gt.modelica.load(f"{item.file}:{item.name}", library=item.libraries, parameters=given)()
    options = gt.SolverOptions(max_seconds=seconds)
    for elements in (50, *FINER):
        solution = gt.solve(problem, gt.Mesh(elements, points=3), solver=options, throw=False)
        if solution.status.ok:
            mesh = f" and mesh.elements={elements}" if elements != 50 else ""
            return f"solved with parameters.{said}{mesh}: {solution.objective:.8g}"
        if solution.status is not gt.SolveStatus.CHECK_FAILED:
            break
    return f"with parameters.{said} {solution.status.value}"


def _in_child(item: Asked, seconds: float, to: Any) -> None:
    warnings.simplefilter("ignore")
    try:
        row = solved(item, seconds)
    except BaseException as error:  # whatever it is, it is a row
        row = {"status": "crash", "message": repr(error)[:400], "where": ""}
    to.send(row)
    to.close()


def row_of(item: Asked, folder: Path, seconds: float) -> dict[str, Any]:
    """One row, from a process of its own that is ended where it takes too long."""
    context = multiprocessing.get_context("fork")
    mine, its = context.Pipe(duplex=False)
    began = time.monotonic()
    child = context.Process(target=_in_child, args=(item, seconds, its))
    child.start()
    its.close()
    said: dict[str, Any] = {"status": "crash", "message": "the process ended without an answer", "where": ""}
    try:
        if mine.poll(2 * seconds + PREPARATION_S):
            said = mine.recv()
        else:
            child.kill()
            text = f"stopped after {2 * seconds + PREPARATION_S:g} s, before the solver began ({item.at})"
            said = {"status": "interrupted", "message": text, "where": item.at}
    except EOFError:
        pass
    child.join()
    facts = {"file": str(item.file.relative_to(folder)), "class": item.name, "tier": item.tier}
    return {**facts, **said, "wall_s": round(time.monotonic() - began, 1)}


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as Markdown: a count, then one line each."""
    lines = [count(rows), "", "| file | class | tier | status | optimum | known | reason, with file and line |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for r in sorted(rows, key=lambda r: (shelf(r["file"]), r["class"])):
        known = KNOWN.get((Path(r["file"]).name, r["class"].rpartition(".")[2]))
        value = r.get("objective")
        optimum = "" if value is None or r["status"] not in ("solved", "check_failed") else f"{value:.8g}"
        reason = r["message"] if r["status"] != "solved" else r.get("reservation", "")
        local = [LOCAL[n] for n in [r["class"].rpartition(".")[2]] if n in LOCAL and r["status"] == "solved"]
        more = "; ".join([*local, *([r["finer"]] if r.get("finer") else []), *r.get("notes", [])])
        name = f"`{r['class'].rpartition('.')[2]}`" if r["class"] else "the file"
        cells = [shelf(r["file"]), name, r["tier"], r["status"], optimum, "" if known is None else f"{known:.9g}",
                 "; ".join(x for x in (shortened(reason, r["where"]), more) if x)]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def shelf(file: str) -> str:
    """The name of a file with the shelf that it stands on."""
    where = "examples" if "examples" in file else "tests" if "tests_jmodelica" in file else "casadi"
    return f"{where}/{Path(file).name}"


def shortened(reason: str, where: str) -> str:
    """A reason for one line of the table, with its place kept."""
    text = reason.replace("|", "/").replace("\n", " ").replace("<", "&lt;")
    text = text.removeprefix("solved, but ").removeprefix("solved: ")
    place = f" ({where})"
    text = text.removesuffix(place) if where else text
    text = re.sub(
        r"(?: with the \w+ barrier strategy, after the \w+ one failed)? \((?:IPOPT|no progress)[^()]*\)", "", text
    )
    text = re.sub(r"returned iterate \d+, which has the smallest violation; ", "", text)
    if len(text) > LONGEST:
        text = f"{text[:LONGEST].rpartition(' ')[0]} ..."
    return text + (place if where and reason else "")


def count(rows: list[dict[str, Any]]) -> str:
    """How many of which tier ended how."""
    parts = []
    for label, tiers in (("A and B", "AB"), ("C", "C")):
        own = Counter(r["status"] for r in rows if r["tier"] in tiers and r["class"])
        listed = ", ".join(f"{n} {status}" for status, n in own.most_common())
        more = sum(1 for r in rows if r["tier"] in tiers and str(r.get("finer", "")).startswith("solved"))
        also = f"; {more} more solved with more elements or the start values of their scripts" if more else ""
        parts.append(f"Tier {label}: {own.total()} classes, {listed}{also}.")
    return " ".join(parts)


def wrong(rows: list[dict[str, Any]]) -> list[str]:
    """Rows that break what must hold: an end without file and line, or another optimum than the known one."""
    bad = []
    for r in rows:
        name = f"{shelf(r['file'])}:{r['class']}"
        if r["status"] == "crash" or (r["status"] != "solved" and not r["where"]):
            bad.append(f"{name} ends with {r['status']} and no file and line: {r['message'][:200]}")
        known = KNOWN.get((Path(r["file"]).name, r["class"].rpartition(".")[2]))
        if r["status"] == "solved" and known is not None and abs(r["objective"] - known) > SAME * abs(known):
            bad.append(f"{name} is {r['objective']:.9g}, known is {known:.9g}")
    return bad


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--library", help="folder of the Modelica Standard Library")
    parser.add_argument("--rows", type=Path, default=Path("public_files.jsonl"))
    parser.add_argument("--table", type=Path, help="Markdown file to write")
    parser.add_argument("--only", default="", help="regular expression on FILE:CLASS")
    parser.add_argument("--seconds", type=float, default=60.0, help="limit of the solver for each class")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import gtmodel as gt  # before the children, which inherit it

    print(f"gtmodel {gt.__version__}: {gt.modelica.load.__name__}, {gt.solve.__name__}")
    rows = [json.loads(line) for line in given.rows.read_text().splitlines()] if given.rows.exists() else []
    there = {(r["file"], r["class"]) for r in rows}
    items = [x for x in asked(given.folder, given.library, given.only)
             if (str(x.file.relative_to(given.folder)), x.name) not in there]  # fmt: skip
    with ThreadPoolExecutor(given.processes) as pool, given.rows.open("a") as out:
        for row in pool.map(lambda item: row_of(item, given.folder, given.seconds), items):
            rows.append(row)
            print(json.dumps(row), file=out, flush=True)
            print(f"{row['status']:13} {row['wall_s']:6.1f} s  {shelf(row['file'])}:{row['class']}", flush=True)
    if given.table is not None:
        given.table.write_text(table(rows))
    print(count(rows))
    for sentence in wrong(rows):
        print(sentence)


if __name__ == "__main__":
    main()
