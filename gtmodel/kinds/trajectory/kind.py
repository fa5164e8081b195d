"""Kind "trajectory": time- or energy-optimal motion of a robot between two TCP positions, free or along a path."""

from __future__ import annotations

from gtmodel.compiler.causal import compile_causal
from gtmodel.motion import motion, study
from gtmodel.motion.options import MotionProblem
from gtmodel.motion.planning import plan_of
from gtmodel.optimize.formulation.problem import build
from gtmodel.problem_files.base import Call, Context
from gtmodel.problem_files.keys import PATH_ARGUMENTS

from .keys import Schema

NAME = "trajectory"
ARGUMENTS = {**PATH_ARGUMENTS, "earlier": "--start"}


def call(problem: Schema, context: Context) -> Call:
    """The study of the motion that the file describes."""
    asked = dict(vars(problem.motion(context)))
    return Call(study, asked.pop("robot"), **asked, earlier=context.guess())


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: states, controls, bounds, and the certificate of the inverse dynamics."""
    return explained(problem.motion(context), problem)


def explained(asked: MotionProblem, problem: Schema) -> str:
    """What is optimised for this motion, in the words of its file."""
    plan, mesh, force = plan_of(asked), asked.mesh, asked.limits.force
    built = build(motion(asked, plan.guard, plan.path))
    head = [
        f"{asked.title or 'motion'}: {built.formulation} form, {mesh.elements} elements x {mesh.points} Radau points",
        f"  states: {', '.join(built.state_names)}",
        f"  controls: {', '.join(built.control_names)}{';' if plan.restricted else ''} "
        f"{'forces ' if plan.restricted else ''}within {force:g} N",
        f"  free: {', '.join(built.free_names)}",
    ]
    if plan.path is not None and problem.path is not None:
        head.append(f"  along: {problem.path.shape} of {plan.path.length:.4g} m")
    if plan.guard.margins:
        head.append(f"  further limits: {', '.join(dict.fromkeys(m.key for m in plan.guard.margins))}")
    return "\n".join(head) + "\n" + compile_causal(asked.robot, known="T", targets="tau").explain()
