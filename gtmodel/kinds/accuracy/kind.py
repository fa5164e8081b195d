"""Kind "accuracy": the greatest positioning error over a section, from errors of carts and links."""

from __future__ import annotations

from gtmodel.kinematics.accuracy import LinkErrors, accuracy_study
from gtmodel.kinematics.accuracy.judged_case import describe, errors_of, with_method
from gtmodel.kinematics.accuracy.section_study import region_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.results import listed

from .keys import Schema

NAME = "accuracy"


def call(problem: Schema, context: Context) -> Call:
    """Every case over all that is reached, tested in other ways."""
    if context.start is not None:
        raise InputError("--start: an accuracy map is computed from the beginning; leave it out")
    return Call(
        accuracy_study, problem.model(context), _cases(problem), section=problem.section.options(),
        method=problem.method, monte_carlo=problem.monte_carlo.options(), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """The section, the rectangle, and each case with its method."""
    cases, section, draws = _cases(problem), problem.section.options(), problem.monte_carlo.options()
    region = region_of(problem.model(context), cases, section)
    lines = [
        f"{problem.title or 'accuracy'}: section orthogonal to ({listed(region.plane.normal)}), through "
        f"({listed(region.plane.origin)}) m",
        f"  rectangle from (u, v) = ({listed(region.low)}) to ({listed(region.high)}) m, step {section.step:g} m",
    ]
    for k, case in enumerate(with_method(cases, problem.method)):
        errors_of(case, k, region.robot)
        lines.append(f"  {case.name}: {describe(case)}")
    lines.append(f"  beside them {draws.samples} synthetic draws, seed {draws.seed}")
    return "\n".join(lines)


def _cases(problem: Schema) -> list[LinkErrors]:
    return [case.options() for case in problem.cases]
