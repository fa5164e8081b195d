"""Kind "vibration": step-response, subspace and impulse models of a measured log, M, D, K and modes."""

from __future__ import annotations

from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.vibration import matrices_study, study

from .keys import KNOWN, Schema

NAME = "vibration"

_LINES = {
    "subspace": "block Hankel matrices, one LQ factor, singular values; A and C from the subspace, B, D and the "
    "initial state from least squares; the order from held-out samples",
    "step_response": "b q^-delay / (1 - a q^-1) by output error (Dressler 2012, eq. (6.11))",
    "impulse": "eigensystem realisation, then least squares on damped sines about a rest position",
    "matrices": "det(M lambda + K) = 0 and the poles of M s^2 + D s + K (Dressler 2012, eq. (6.15))",
}


def arguments(problem: Schema) -> dict[str, str]:
    """Where the study's arguments stand in the file."""
    known = f"synthetic.{KNOWN.get(problem.model, '')}"
    return {"model": problem.model, "known": known, "records": known if problem.synthetic else "measurements"}


def call(problem: Schema, context: Context) -> Call:
    """Read or make the recording, then the study of the model asked for."""
    if problem.physical is not None and problem.model != "subspace":
        raise InputError(f"goes with model = 'subspace', not '{problem.model}'", "physical")
    if problem.model == "matrices":
        given = [name for name in ("measurements", "synthetic", "matrices") if getattr(problem, name) is not None]
        if given != ["matrices"] or problem.matrices is None:
            raise InputError("expected [matrices] alone for the model 'matrices'", given[0] if given else "matrices")
        return Call(matrices_study, problem.matrices.options(), title=problem.title)
    context.progress("reading", 0.1)
    records, known = problem.data(context)
    force = problem.measurements is None or problem.measurements.force_N is not None
    return Call(
        study, records, getattr(problem, problem.model).options(), truth=known, input_unit="N" if force else "m",
        physical=problem.physical and problem.physical.options(), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What is fitted to what."""
    lines = [f"{problem.title or NAME}: model {problem.model}", _LINES[problem.model]]
    if problem.model != "matrices":
        records, _ = problem.data(context)
        r = records[0]
        lines.append(
            f"{len(records)} recording{'s' * (len(records) > 1)}, {len(r)} samples every {1e3 * r.sample_time:g} ms, "
            f"{r.u.shape[1]} inputs, {r.y.shape[1]} outputs" + (f", SYNTHETIC ({r.synthetic})" if r.synthetic else "")
        )
    if problem.physical is not None:
        lines.append("then T = [C; C A_c] with A_c = logm(A) / T_s gives M^-1 K and M^-1 D (eq. (6.14))")
    return "\n".join(lines)
