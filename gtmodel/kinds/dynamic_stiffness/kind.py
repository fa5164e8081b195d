"""Kind "dynamic_stiffness": oscillators of an arm from frequency responses, and their field over the pose."""

from __future__ import annotations

from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.robots.kr500_oscillators import NOTE, table_16
from gtmodel.vibration import dynamic_stiffness_study
from gtmodel.vibration.dynamic_stiffness import (
    Experiment,
    SyntheticExperiments,
    read_experiments,
    synthetic_experiments,
)

from .keys import MeasuredExperimentsSection, Schema

NAME = "dynamic_stiffness"


def arguments(problem: Schema) -> dict[str, str]:
    """Where the study's arguments stand in the file."""
    return {"experiments": "synthetic" if problem.measured is None else "measured.index"}


def call(problem: Schema, context: Context) -> Call:
    """Read or make the experiments; the study fits every one, then the processes, then holds out poses."""
    given = [k for k in ("measured", "synthetic") if getattr(problem, k) is not None]
    if len(given) != 1:
        raise InputError("expected one of [measured] and [synthetic]", given[-1] if given else "measured")
    context.progress("reading", 0.05)
    experiments = _made(problem) if problem.measured is None else _read(problem, problem.measured, context)
    return Call(
        dynamic_stiffness_study, experiments, fit=problem.fit.options(), process=problem.process.options(),
        map=problem.map.options(), repeatability=problem.repeatability, title=problem.title,
    )  # fmt: skip


def _made(problem: Schema) -> SyntheticExperiments:
    assert problem.synthetic is not None
    return synthetic_experiments(
        table_16(), problem.synthetic.options(), fit=problem.fit.options(), process=problem.process.options(),
        repeatability=problem.repeatability,
    )  # fmt: skip


def _read(problem: Schema, measured: MeasuredExperimentsSection, context: Context) -> list[Experiment]:
    path = context.file(measured.index, "measured.index", source=measured.source)
    experiments = read_experiments(path, problem.fit.options())
    # run.toml keeps the hash of every file that was read
    for name, file in (pair for e in experiments for pair in e.files.items()):
        context.take(name, file)
    return experiments


def explain(problem: Schema, context: Context) -> str:
    """What will be fitted."""
    s = problem.synthetic
    n = "synthetic ones" if s is None else f"{3 * s.options().poses} SYNTHETIC ones, seed {s.options().seed}"
    lines = [
        f"{problem.title or NAME}: experiments: {'measured ones' if problem.measured else n}",
        "m x'' + c x' + k x = F in x, y and z, several modes in parallel (Cvitanic 2021, eq. (8))",
        "log m, log c, log k over x, y, z and A: nine exact Gaussian processes (eqs. (9)-(11))",
        f"experiments at one pose differ by {problem.repeatability:.0%} on average",
    ]
    return "\n".join([*lines, NOTE] if s else lines)
