"""Kind "excitation": the motion that identifies a robot's masses and friction best, within all limits."""

from __future__ import annotations

import numpy as np

from gtmodel.identify import excitation
from gtmodel.identify.excitation import options
from gtmodel.motion import Limits
from gtmodel.problem_files.base import Call, Context
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import RobotProblem

RESULT = "gtmodel.identify.ExcitationStudy"


@made_from(options.IdentificationExperiment)
class Schema(RobotProblem, Made):
    """The motion that identifies masses and friction best."""

    motion: Made[options.Family]
    limits: Made[Limits]
    search: Made[options.ExcitationSearch] = Made[options.ExcitationSearch].left_out()
    random: Made[options.RandomMotions] = Made[options.RandomMotions].left_out()
    monte_carlo: Made[options.MonteCarloFits] = Made[options.MonteCarloFits].left_out()


ARGUMENTS = {"experiment": "", "start": "--start"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, which may start from an earlier result."""
    start = None
    if context.start is not None:
        start = np.array((context.start.get("values") or {}).get("unknowns", []), dtype=float)
    return Call(
        excitation.excitation_study, problem.model(context), problem.motion.options(), problem.limits.options(),
        experiment=problem.options(), search=problem.search.options(), random=problem.random.options(),
        monte_carlo=problem.monte_carlo.options(), start=start,
        title=problem.title or f"{problem.kind} of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the parameters, the unknowns and the bounds."""
    motion, criterion = problem.motion.options(), problem.search.options().criterion
    plan = excitation.task.plan_of(
        problem.model(context), motion, problem.limits.options(), problem.options(), criterion
    )
    task = plan.task
    rows = {key: plan.keys.count(key) for key in dict.fromkeys(plan.keys)}
    return "\n".join([
        f"{problem.heading}: {len(plan.regressor.names)} parameters "
        f"({', '.join(plan.regressor.names)})",
        f"  motion of T: {motion.family}, {task.basis.size} unknowns for each of {task.dimension} coordinates, "
        f"{task.basis.period:g} s, at rest at both ends",
        f"  criterion: {criterion}, over {task.points} samples of a period",
        f"  bounded at each sample: {', '.join(f'{key} ({n})' for key, n in rows.items())}; "
        f"checked at {excitation.FINER} times as many samples",
    ])  # fmt: skip
