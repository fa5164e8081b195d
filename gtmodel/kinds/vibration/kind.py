"""Kind "vibration": step-response, subspace and impulse models of a measured log, M, D, K and modes."""

from __future__ import annotations

from gtmodel.problem_files.base import Context, InputError, Outcome
from gtmodel.results import SolveStatus
from gtmodel.vibration import Stopped, ArgumentError

from .vibration_data import records
from .vibration_impulse import solve_impulse
from .vibration_keys import Schema
from .vibration_matrices import solve_matrices
from .vibration_step import solve_step
from .vibration_subspace import solve_subspace
from .vibration_values import VALUES

NAME = "vibration"

_SOLVE = {"subspace": solve_subspace, "step_response": solve_step, "impulse": solve_impulse}
_LINES = {
    "subspace": "block Hankel matrices, one LQ factor, singular values; A and C from the subspace, B, D and the "
    "initial state from least squares; the order from held-out samples",
    "step_response": "b q^-delay / (1 - a q^-1) by output error (Dressler 2012, eq. (6.11))",
    "impulse": "eigensystem realisation, then least squares on damped sines about a rest position",
    "matrices": "det(M lambda + K) = 0 and the poles of M s^2 + D s + K (Dressler 2012, eq. (6.15))",
}


def solve(problem: Schema, context: Context) -> Outcome:
    """Read or make the recording, fit the model asked for, say what it does not tell."""
    if problem.physical is not None and problem.model != "subspace":
        raise InputError(f"goes with model = 'subspace', not '{problem.model}'", "physical")
    if problem.model == "matrices":
        return solve_matrices(problem)
    context.progress("reading", 0.1)
    found = records(problem, context)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    context.progress("fitting", 0.3)
    try:
        return _SOLVE[problem.model](problem, found, context)
    except Stopped as stopped:
        return Outcome(status=SolveStatus.INTERRUPTED, message=str(stopped))
    except ArgumentError as error:
        raise InputError(str(error), problem.model) from error


def explain(problem: Schema, context: Context) -> str:
    """What is fitted to what."""
    lines = [f"{problem.title or NAME}: model {problem.model}", _LINES[problem.model]]
    if problem.model != "matrices":
        found = records(problem, context)
        r = found[0]
        lines.append(
            f"{len(found)} recording{'s' * (len(found) > 1)}, {len(r)} samples every {1e3 * r.sample_time:g} ms, "
            f"{r.u.shape[1]} inputs, {r.y.shape[1]} outputs" + (f", SYNTHETIC ({r.synthetic})" if r.synthetic else "")
        )
    if problem.physical is not None:
        lines.append("then T = [C; C A_c] with A_c = logm(A) / T_s gives M^-1 K and M^-1 D (eq. (6.14))")
    return "\n".join(lines)


__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]
