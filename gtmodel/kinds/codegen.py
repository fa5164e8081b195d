"""Kind "codegen": C code of a robot's functions, written by ``gtmodel codegen``."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, NonNegativeInt, PositiveInt

from gtmodel.cgen import Costs, GenerationError, check, costs, generate, write_costs
from gtmodel.cgen.costs_file import COSTS
from gtmodel.cgen.folder import held
from gtmodel.compiler.causal import CausalFunction, c_name, compile_causal
from gtmodel.results import SolveStatus
from gtmodel.results.folder import Held, others

from .base import Check, Context, InputError, Outcome, Row, Section
from .noted import checked, refuse_distrusted
from .robot_keys import RobotProblem
from .verdict import marked

NAME = "codegen"

VALUES = {
    "folder": "where the code was written",
    "functions": "C name of each function -> its inputs and outputs",
    "files": "files written, sorted",
    "operations": "operations and calls of libm in one evaluation of each body",
    "points": "with --check: number of random inputs compared per function",
    "text_bytes": "with --check: machine code of each function at -O2",
    "newton_bytes": "with --check: of it the Newton blocks and their guards",
    "stack_bytes": "with --check: stack of a call",
    "instructions": "with --check: instructions of a call with its guards, counted by callgrind",
    "symbols": "with --check: what the folder defines for others",
}


class Function(Section):
    """One function: these targets, computed from these known variables."""

    name: str = Field(min_length=1, description="C name of the function")
    known: list[str] = Field(default=[], description="names of variables that are prescribed with their derivatives")
    targets: list[str] = Field(min_length=1, description='names such as "T", "der(q)", "der(T,2)"')
    prefer: list[str] = Field(default=[], description="names to keep as states")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by name of a declared branch")
    trajectory: bool = Field(default=False, description="offer it along a sampled reference too, as NAME_at")


class Verification(Section):
    """What --check does besides compiling: the C code and Python on the same random inputs."""

    points: PositiveInt = Field(default=1000, description="random inputs per function")
    seed: NonNegativeInt = Field(default=0, description="of the random inputs")


class Schema(RobotProblem):
    """C code of functions of one robot."""

    real: Literal["double", "float"] = Field(default="double", description="the numbers that C computes with")
    name: str = Field(default="", description="prefix of the C names; the name of the problem file when empty")
    functions: list[Function] = Field(min_length=1, description="what to generate")
    box: dict[str, list[list[float]]] = Field(
        default={}, description='intervals by input, such as "der(T)" = [[-1.5, 1.5]]: inside every function answers'
    )
    check: Verification = Verification()


def solve(problem: Schema, context: Context) -> Outcome:
    """Not for this kind: it needs a folder. Raises InputError."""
    raise InputError("generates code and solves nothing; use gtmodel codegen PROBLEM.toml -o DIR", "kind")


def write(problem: Schema, context: Context, out: Path, *, verify: bool = False, write_failed: bool = False) -> Outcome:
    """Generate the code into `out`. With `verify` it is first compiled and compared with Python elsewhere, and comes
    into `out` only when all checks passed; with `write_failed` also otherwise, marked in the first lines.

    Raises InputError for a wrong problem and for a folder that holds other people's files.
    """
    try:
        with held(out) as folder:
            if folder.told:
                context.notice(folder.told)
            functions = compiled(problem, context)
            if context.interrupted():
                return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the code was generated")
            if not write_failed:
                refuse_distrusted(context, "the code")
            context.progress("generating")
            if not verify:
                found = checked(Outcome(status=SolveStatus.SOLVED), context)
                mark = None if found.status.ok else partial(_marked, found.message)
                return checked(_generated(problem, context, functions, folder, mark), context)
            with tempfile.TemporaryDirectory(prefix="gtmodel-codegen-") as scratch:
                outcome, cost = _verified(problem, context, functions, Path(scratch) / "code")
            outcome = checked(outcome, context)
            outcome = replace(
                outcome,
                values={**outcome.values, "folder": str(folder.path)},
                rows=[Row("folder", str(folder.path)), *outcome.rows[1:]],
            )
            if not outcome.status.ok and not write_failed:
                kept = "; what an earlier run wrote there stays" if others(folder.path) else ""
                said = f"{outcome.message}; the code is not written; --write-failed writes it, marked{kept}"
                return replace(outcome, message=said)
            mark = None if outcome.status.ok else partial(_marked, outcome.message)
            _generated(problem, context, functions, folder, mark)
            if cost is not None:
                write_costs(folder, cost)
            return outcome
    except GenerationError as error:
        raise InputError(str(error)) from error


def _generated(
    problem: Schema,
    context: Context,
    functions: dict[str, CausalFunction],
    out: Held | Path,
    mark: Callable[[str, str], str] | None = None,
) -> Outcome:
    """The code in a folder, and what it is."""
    provenance = {"problem": context.name, "title": problem.title, "robot": problem.robot}
    provenance["problem_sha256"] = sha256(problem.model_dump_json().encode()).hexdigest()
    generated = generate(
        functions,
        out,
        name=problem.name or c_name(context.name),
        provenance=provenance,
        problem=problem.model_dump(mode="json", exclude_unset=True),
        along=[f.name for f in problem.functions if f.trajectory],
        real=problem.real,
        box=problem.box,
        mark=mark,
    )
    files = sorted(str(f) for f in generated.files)
    signatures = {generated.functions[name]: _signature(f) for name, f in functions.items()}
    values: dict[str, Any] = {
        "folder": str(generated.folder),
        "functions": signatures,
        "files": files,
        "operations": generated.operations,
    }
    rows = [Row("folder", str(generated.folder)), Row("files", len(files)), Row("numbers", problem.real)]
    rows += [Row(name, _in_words(signature)) for name, signature in signatures.items()]
    return Outcome(status=SolveStatus.SOLVED, message=f"generated {len(files)} files", values=values, rows=rows)


def _marked(message: str, file: str, text: str) -> str:
    return marked(file, text.encode(), message).decode() if file.endswith((".c", ".h")) else text


def _verified(
    problem: Schema, context: Context, functions: dict[str, CausalFunction], scratch: Path
) -> tuple[Outcome, Costs | None]:
    """The code compiled in a folder of its own and compared with Python; what it costs where that was counted."""
    made = _generated(problem, context, functions, scratch)
    values, rows = dict(made.values), made.rows
    if context.interrupted():
        return _stopped(made, "generated, but not checked"), None
    context.progress("compiling and comparing")
    try:
        report = check(scratch, functions, points=problem.check.points, seed=problem.check.seed)
    except GenerationError as error:
        return replace(made, status=SolveStatus.FAILED, message=str(error)), None
    if context.interrupted() and report.passed:
        return _stopped(made, "generated and compared with Python, but costs were not counted"), None
    context.progress("counting")
    cost = costs(scratch, functions)
    values["files"] = sorted([*values["files"], COSTS])
    values |= {"points": problem.check.points, "text_bytes": cost.text_bytes, "newton_bytes": cost.newton_bytes}
    values |= {"stack_bytes": cost.stack_bytes, "instructions": cost.instructions, "symbols": list(cost.symbols)}
    rows += [Row(f"{name} costs", _cost(cost, name)) for name in cost.text_bytes]
    rows += [Row("costs", cost.missing)] if cost.missing else []
    outcome = Outcome(
        status=SolveStatus.SOLVED if report.passed or report.checks else SolveStatus.FAILED,
        message=report.message,
        checks={
            c.name: Check(c.value, c.bound, c.passed, "" if c.passed else c.detail, c.least) for c in report.checks
        },
        values=values,
        rows=rows,
    )
    return outcome, cost


def _stopped(made: Outcome, done: str) -> Outcome:
    return replace(made, status=SolveStatus.INTERRUPTED, message=f"stopped: {done}")


def explain(problem: Schema, context: Context) -> str:
    """The certificate of every function."""
    return "\n\n".join(f"{name}\n{f.explain()}" for name, f in compiled(problem, context).items())


def compiled(problem: Schema, context: Context) -> dict[str, CausalFunction]:
    """The functions by name; when a stop is asked for, those done. Raises InputError for a name given twice, ModelError
    for a wrong causality."""
    model = problem.model(context)
    functions: dict[str, CausalFunction] = {}
    for n, f in enumerate(problem.functions):
        if f.name in functions:
            raise InputError(f"'{f.name}' names two functions", f"functions[{n}].name")
        if context.interrupted():
            break
        context.progress(f"deriving {f.name}", n / len(problem.functions))
        functions[f.name] = compile_causal(model, f.known, f.targets, f.prefer, f.branches, f.name)
    return functions


def _signature(function: CausalFunction) -> dict[str, list[str]]:
    return {
        "inputs": [f"{s.name} [{s.unit}]" for s in function.inputs],
        "outputs": [f"{s.name} [{s.unit}]" for s in function.outputs],
    }


def _cost(cost: Costs, name: str) -> str:
    counted = f", {cost.instructions[name]} instructions" if name in cost.instructions else ""
    return f"{cost.text_bytes[name]} bytes of code, {cost.stack_bytes[name]} of stack{counted}"


def _in_words(signature: dict[str, list[str]]) -> str:
    return f"{', '.join(signature['outputs'])} from {', '.join(signature['inputs']) or 'nothing'}"
