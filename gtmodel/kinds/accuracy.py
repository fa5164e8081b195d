"""Kind "accuracy": largest positioning error over a section, from errors of carts and links."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.kinematics import accuracy
from gtmodel.kinematics.accuracy import LinkErrors, options
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import listed

RESULT = "gtmodel.kinematics.AccuracyStudy"


class Schema(RobotProblem):
    """Accuracy of a three-link robot."""

    section: Made[options.ErrorSection] = Made[options.ErrorSection].left_out()
    method: Literal["support", "projection"] = Field(
        default="support",
        description="bound over ellipsoids of errors: exact to first order, or the iteration of Dressler 2012, A.2",
    )
    cases: list[Made[options.LinkErrors]] = Field(min_length=1, description="cases of errors")
    monte_carlo: Made[options.MonteCarloDraws] = Made[options.MonteCarloDraws].left_out()


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study: every case over the reachable part of the section, with tests."""
    if context.start is not None:
        raise InputError("--start: an accuracy map does not use an earlier result; leave it out")
    return Call(
        accuracy.accuracy_study, problem.model(context), _cases(problem), section=problem.section.options(),
        method=problem.method, monte_carlo=problem.monte_carlo.options(), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the section, the rectangle, and each case with its method."""
    cases, section, draws = _cases(problem), problem.section.options(), problem.monte_carlo.options()
    region = accuracy.section_study.region_of(problem.model(context), cases, section)
    lines = [
        f"{problem.title or 'accuracy'}: section orthogonal to ({listed(region.plane.normal)}), through "
        f"({listed(region.plane.origin)}) m",
        f"  rectangle from (u, v) = ({listed(region.low)}) to ({listed(region.high)}) m, step {section.step:g} m",
    ]
    for k, case in enumerate(accuracy.case.with_method(cases, problem.method)):
        accuracy.case.errors_of(case, k, region.robot)
        lines.append(f"  {case.name}: {accuracy.case.describe(case)}")
    lines.append(f"  for comparison: {draws.samples} synthetic draws, seed {draws.seed}")
    return "\n".join(lines)


def _cases(problem: Schema) -> list[LinkErrors]:
    return [case.options() for case in problem.cases]
