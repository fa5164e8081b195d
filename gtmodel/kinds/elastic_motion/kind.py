"""Kind "elastic_motion": how an elastic tool swings after motions planned rigid, shaped, and planned elastic."""

from __future__ import annotations

from gtmodel.motion.elastic import elastic_study
from gtmodel.motion.elastic.elastic_result import ASSUMED
from gtmodel.motion.elastic.plans import three_link
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of

from .keys import Schema

NAME = "elastic_motion"
ARGUMENTS = {"start": "start.tcp_m", "goal": "goal.tcp_m", "force": "limits.force"}


def call(problem: Schema, context: Context) -> Call:
    """The study of the plans and their swings."""
    if context.start is not None:
        raise InputError("--start: the elastic plan starts from the rigid one; leave it out")
    return Call(
        elastic_study, problem.model(context), problem.start.tcp_m, problem.goal.tcp_m, force=problem.limits.force_N,
        **options_of(problem), title=problem.title or f"vibration of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What is planned and compared."""
    three_link(problem.model(context))
    t = problem.tool.options()
    return "\n".join(
        [
            f"{problem.title or NAME}: {t.mass:g} kg on a spring, {t.frequency:g} Hz, damping {t.damping:g}",
            "  rigid: time and energy with the tool as payload; ZV, ZVD: that motion shaped",
            "  elastic: the spring in the equations, the tool at rest at the end as a constraint",
            *(f"  {sentence}" for sentence in ASSUMED),
        ]
    )
