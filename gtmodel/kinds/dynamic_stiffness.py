"""Kind "dynamic_stiffness": oscillators of an arm from frequency responses, as a field over the pose."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat

from gtmodel import robots, vibration
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem, Source
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.vibration import dynamic_stiffness
from gtmodel.vibration.dynamic_stiffness import Experiment, options, read_experiments

RESULT = "gtmodel.vibration.DynamicStiffnessStudy"


class MeasuredExperimentsSection(FileSection):
    """Measured records, listed in a CSV file."""

    index: str = Field(
        description="CSV file with the columns x [m], y [m], z [m], A [deg], direction and file; rows with the same "
        "pose and direction are hits of one experiment, unless a column experiment distinguishes them"
    )
    source: Source = ""


@made_from(options.SyntheticArm)
class SyntheticArmSection(Made):
    """Synthetic experiments on a smooth field near published oscillators."""

    near: Literal["table_16"] = Field(description="published oscillators: Cvitanic 2021, Table 16")


class Schema(Problem):
    """Oscillators of an arm over its poses, from frequency responses in [measured] or [synthetic]."""

    repeatability: NonNegativeFloat = Field(
        default=0.15, description="mean change of m, c and k between experiments at one pose; Cvitanic 2021 states 15 %"
    )
    fit: Made[options.ModalFitting] = Made[options.ModalFitting].left_out()
    process: Made[options.Process] = Made[options.Process].left_out()
    map: Made[options.FrequencyMap] = Made[options.FrequencyMap].left_out()
    measured: MeasuredExperimentsSection | None = Field(default=None, description="measured records")
    synthetic: SyntheticArmSection | None = Field(default=None, description="synthetic records")


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    return {"experiments": "synthetic" if problem.measured is None else "measured.index"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, which fits every experiment, then the processes, and holds out poses."""
    tables = [k for k in ("measured", "synthetic") if getattr(problem, k) is not None]
    if len(tables) != 1:
        raise InputError("expected one of [measured] and [synthetic]", tables[-1] if tables else "measured")
    context.progress("reading experiments", 0.05)
    experiments = _synthetic(problem) if problem.measured is None else _read(problem, problem.measured, context)
    return Call(
        vibration.dynamic_stiffness_study, experiments, fit=problem.fit.options(), process=problem.process.options(),
        map=problem.map.options(), repeatability=problem.repeatability, title=problem.title,
    )  # fmt: skip


def _synthetic(problem: Schema) -> dynamic_stiffness.SyntheticExperiments:
    assert problem.synthetic is not None
    return dynamic_stiffness.synthetic_experiments(
        robots.kuka.table_16(), problem.synthetic.options(), fit=problem.fit.options(),
        process=problem.process.options(), repeatability=problem.repeatability,
    )  # fmt: skip


def _read(problem: Schema, measured: MeasuredExperimentsSection, context: Context) -> list[Experiment]:
    path = context.file(measured.index, "measured.index", source=measured.source)
    experiments = read_experiments(path, problem.fit.options())
    # run.toml stores the hash of every input file
    for name, file in (pair for e in experiments for pair in e.files.items()):
        context.take(name, file)
    return experiments


def explain(problem: Schema, context: Context) -> str:
    """Describe the experiments and the model."""
    s = problem.synthetic
    n = "synthetic" if s is None else f"{3 * s.options().poses} SYNTHETIC, seed {s.options().seed}"
    lines = [
        f"{problem.heading}: experiments: {'measured' if problem.measured else n}",
        "m x'' + c x' + k x = F in x, y and z, several modes in parallel (Cvitanic 2021, eq. (8))",
        "log m, log c, log k over x, y, z and A: nine exact Gaussian processes (eqs. (9)-(11))",
        f"experiments at one pose differ by {problem.repeatability:.0%} on average",
    ]
    return "\n".join([*lines, robots.kuka.NOTE] if s else lines)
