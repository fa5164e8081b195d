"""gtmodel itself, from the compiled model to the solution read back by name."""

from __future__ import annotations

from importlib import import_module
from unittest.mock import patch

import gtmodel as gt
from gtmodel.motion import Cost, End, Limits, MotionProblem
from gtmodel.motion.task import motion as declare
from gtmodel.optimize import Mesh, SolverOptions
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.guess import initial_guess
from gtmodel.optimize.nlp import make_nlp
from gtmodel.optimize.point_kernels import POINT_FUNCTIONS

from .l1_by_hand import FORCE, FORCE_UNIT, GOAL, START, Motion
from .plain_casadi import POINTS
from .timing import TOLERANCE, Clock, Result

SOLVE = import_module("gtmodel.optimize.solve")  # `gtmodel.optimize` has the function of that name


def declared(motion: Motion) -> gt.Optimization:
    """The problem of problems/l1_min_time.toml with the weight of the motion."""
    cost = Cost(energy=motion.weight, force_unit=FORCE_UNIT)
    ends = {"start": End(START.tolist()), "goal": End(GOAL.tolist())}
    return declare(MotionProblem(robot=motion.robot, **ends, limits=Limits(FORCE), cost=cost))


def compile_seconds(motion: Motion) -> float:
    """Processor time from the class to states, controls and expressions; kept with the model."""
    clock = Clock()
    build(declared(motion))
    return clock.lap()


def solve_blocks(motion: Motion, model: gt.Optimization, elements: int, control: str, machine_code: bool) -> Result:
    """Transcription, guess, IPOPT, and the solution by name. Compiling C, and the check of the mesh, are told apart."""
    problem, options = build(model), SolverOptions(tolerance=TOLERANCE, compile=machine_code)
    for key in [key for key in problem.cache if key.startswith(POINT_FUNCTIONS)]:
        del problem.cache[key]  # to differentiate is a part of every set-up here
    clock, checks, judged = Clock(), list[float](), SOLVE.judged

    def timed(*arguments):
        own = Clock()
        checked = judged(*arguments)
        checks.append(own.lap())
        return checked

    nlp = make_nlp(problem, Mesh(elements, POINTS, control=control), machine_code)
    x0 = initial_guess(nlp, motion.guess)
    setup = clock.lap()
    with patch.object(SOLVE, "judged", timed):
        solution = SOLVE.solve_nlp(nlp, x0, options, throw=False)
    total, solver, check = clock.lap(), solution.seconds["setup"], sum(checks)
    return Result(
        solution.objective, solution.iterations, setup + solver, total - solver - check, solution.status.converged,
        nlp.compile_seconds or 0.0, check,
    )  # fmt: skip
