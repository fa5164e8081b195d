"""Kind "trajectory": time- or energy-optimal motion of a robot between two TCP positions, free or along a path."""

from __future__ import annotations

from gtmodel.compiler.causal import compile_causal
from gtmodel.motion import motion, study
from gtmodel.motion.options import MotionProblem
from gtmodel.motion.planning import plan_of
from gtmodel.optimize.formulation.problem import build
from gtmodel.problem_files.base import Call, Context

from .keys import PATH_ARGUMENTS, Schema

ARGUMENTS = {**PATH_ARGUMENTS, "earlier": "--start"}


def call(problem: Schema, context: Context) -> Call:
    """Return the library call that solves the motion of the file."""
    arguments = dict(vars(problem.motion(context)))
    return Call(study, arguments.pop("robot"), **arguments, earlier=context.guess())


def explain(problem: Schema, context: Context) -> str:
    """Describe the optimisation: states, controls, bounds, and the certificate of the inverse dynamics."""
    return explained(problem.motion(context), problem, context.full)


def explained(task: MotionProblem, problem: Schema, full: bool) -> str:
    """Return the description of the optimisation for a motion and the problem it comes from."""
    plan, mesh, force = plan_of(task), task.mesh, task.limits.force
    built = build(motion(task, plan.guard, plan.path))
    head = [
        f"{task.title or 'motion'}: {built.formulation} form, {mesh.elements} elements x {mesh.points} Radau points",
        f"  states: {', '.join(built.state_names)}",
        f"  controls: {', '.join(built.control_names)}{';' if plan.restricted else ''} "
        f"{'forces ' if plan.restricted else ''}within {force:g} N",
        f"  free: {', '.join(built.free_names)}",
    ]
    if plan.path is not None and problem.path is not None:
        head.append(f"  along: {problem.path.shape} of {plan.path.length:.4g} m")
    if plan.guard.margins:
        head.append(f"  further limits: {', '.join(dict.fromkeys(m.key for m in plan.guard.margins))}")
    return "\n".join(head) + "\n" + compile_causal(task.robot, known="T", targets="tau").explain(full)
