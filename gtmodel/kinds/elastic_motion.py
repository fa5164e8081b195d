"""Kind "elastic_motion": vibration of an elastic tool after motions planned rigid, shaped, and planned elastic."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat

from gtmodel.motion import elastic
from gtmodel.motion.elastic import options
from gtmodel.motion.elastic.options import ASSUMED
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RobotProblem

RESULT = "gtmodel.motion.ElasticStudy"


class PlaceSection(FileSection):
    """Start or end of the motion, at rest."""

    tcp_m: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="tool centre point, three coordinates in the robot's frame"
    )


class LimitsSection(FileSection):
    """Limits of the motors."""

    force_N: PositiveFloat = Field(description="largest force of each motor")


class Schema(RobotProblem):
    """Residual vibration of an elastic tool of a three-link robot."""

    start: PlaceSection
    goal: PlaceSection
    limits: LimitsSection
    tool: Made[options.ElasticTool]
    cost: Made[options.ElasticCost] = Made[options.ElasticCost].left_out()
    mesh: Made[options.ElasticMesh] = Made[options.ElasticMesh].left_out()
    solver: Made[options.ElasticSolver] = Made[options.ElasticSolver].left_out()


ARGUMENTS = {"start": "start.tcp_m", "goal": "goal.tcp_m", "force": "limits.force"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the plans and their vibration."""
    if context.start is not None:
        raise InputError("--start: the elastic plan starts from the rigid one; leave it out")
    return Call(
        elastic.elastic_study, problem.model(context), problem.start.tcp_m, problem.goal.tcp_m,
        force=problem.limits.force_N, **options_of(problem), title=problem.title or f"vibration of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the motions that are compared."""
    elastic.plans.three_link(problem.model(context))
    t = problem.tool.options()
    return "\n".join(
        [
            f"{problem.heading}: {t.mass:g} kg on a spring, {t.frequency:g} Hz, damping {t.damping:g}",
            "  rigid: time and energy with the tool as rigid payload; ZV, ZVD: this motion with an input shaper",
            "  elastic: with the spring in the equations and the tool at rest at the end as a constraint",
            *(f"  {sentence}" for sentence in ASSUMED),
        ]
    )
