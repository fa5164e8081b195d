"""Kind "codegen": C code of a robot's functions, written by ``gtmodel codegen``."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from gtmodel.cgen import CodeStudy, study
from gtmodel.cgen.folder import held
from gtmodel.compiler.causal import CausalFunction, c_name, compile_causal
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.noted import doubts, refuse_distrusted

from .keys import Schema

NAME = "codegen"


def call(problem: Schema, context: Context) -> Call:
    """The study of the functions; it lacks the folder, which no file names: call it with `folder=`."""
    return Call(
        study, functions_of(problem, context), name=problem.name or c_name(context.name), real=problem.real,
        box=problem.box, along=[f.name for f in problem.functions if f.trajectory], check=problem.check.options(),
        provenance={
            "problem": context.name, "title": problem.title, "robot": problem.robot,
            "problem_sha256": sha256(problem.model_dump_json().encode()).hexdigest(),
        },
        problem=problem.model_dump(mode="json", exclude_unset=True), title=problem.title,
    )  # fmt: skip


def write(
    problem: Schema, context: Context, out: Path, *, verify: bool = False, write_failed: bool = False
) -> CodeStudy:
    """Generate the code into `out`. With `verify` it is first compiled and compared with Python elsewhere, and comes
    into `out` only when all checks passed; with `write_failed` also otherwise, marked in the first lines.

    Raises InputError for a wrong problem, ArgumentError for a folder that holds other people's files.
    """
    with held(out) as folder:
        if folder.message:
            context.notice(folder.message)
        made = call(problem, context)
        if not write_failed and not context.interrupted():
            refuse_distrusted(context, "the code")
        made.options |= {} if verify else {"check": None}
        return made(
            folder=folder, also=doubts(context), write_failed=write_failed, by="--write-failed", **context.work()
        )


def explain(problem: Schema, context: Context) -> str:
    """The certificate of every function."""
    return "\n\n".join(f"{name}\n{f.explain()}" for name, f in functions_of(problem, context).items())


def functions_of(problem: Schema, context: Context) -> dict[str, CausalFunction]:
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
