"""Kind "vibration": step-response, subspace and impulse models of a measured log, M, D, K and modes."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat

from gtmodel import vibration
from gtmodel.measurements import Corrections
from gtmodel.problem_files.base import Call, Context, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import LogFiles, MeasuredSignalSection
from gtmodel.results import ArgumentError, TrajectoryError
from gtmodel.vibration import Record, options

RESULT = "gtmodel.vibration.VibrationStudy"

KNOWN = {
    "subspace": "structure",
    "step_response": "steps",
    "impulse": "hit",
}  # table of the synthetic system, by model


class MeasurementsSection(LogFiles):
    """A measured log. Step responses may have several recordings; the other models need one."""

    position_m: MeasuredSignalSection = Field(description="measured positions, one column or several")
    force_N: MeasuredSignalSection | None = Field(default=None, description="forces as inputs; or give reference_m")
    reference_m: MeasuredSignalSection | None = Field(
        default=None, description="position references as inputs; or give force_N"
    )
    after_s: NonNegativeFloat = Field(
        default=0.0, description="time after the log's first row from which rows are used"
    )

    def records(self, model: str, context: Context) -> list[Record]:
        """Return the recordings of the log. Raises InputError."""
        records = self._sessions(model, context)
        if model != "step_response" and len(records) > 1:
            raise InputError(
                f"found {len(records)} recordings; the model '{model}' needs one: name one file", "measurements.files"
            )
        return records

    def _sessions(self, model: str, context: Context) -> list[Record]:
        keys = {"position_m": self.position_m, "force_N": self.force_N, "reference_m": self.reference_m}
        sections = {name: signal for name, signal in keys.items() if signal is not None}
        inputs = [name for name in sections if name != "position_m"]
        if len(inputs) != (0 if model == "impulse" else 1):
            expected = "no input, because a decay has none," if model == "impulse" else "one of force_N and reference_m"
            raise InputError(f"expected {expected} besides position_m", "measurements")
        for name, signal in sections.items():
            for what in ("scale", "offset", "delay_s"):
                if getattr(signal, what) == "estimate":
                    raise InputError(
                        "a black-box model cannot estimate it; give a number", f"measurements.{name}.{what}"
                    )
        signals = {name: signal.signal(f"measurements.{name}") for name, signal in sections.items()}
        raw = self.sessions(signals, context, key="measurements.files")
        records = []
        try:
            for session in Corrections(signals, raw).apply():
                first = int(np.ceil(self.after_s / session.sample_time - 1e-9))
                t = session.trajectory
                y = t["position_m"][first:]
                if len(y) < 2:
                    raise InputError(
                        f"{self.after_s:g} s leave {len(y)} samples of {session.name}; reduce it",
                        "measurements.after_s",
                    )
                u = t[inputs[0]][first:] if inputs else np.zeros(len(y))
                records.append(Record(u, y, session.sample_time, t.synthetic))
        except (TrajectoryError, ArgumentError) as error:
            raise InputError(str(error), "measurements") from error
        return records


@made_from(options.Sampling)
class SyntheticRecordsSection(Made):
    """A synthetic recording of a known system, to test the identification."""

    structure: Made[options.SyntheticStructure] | None = Field(default=None, description='for model = "subspace"')
    steps: Made[options.Steps] | None = Field(default=None, description='for model = "step_response"')
    hit: Made[options.Hit] | None = Field(default=None, description='for model = "impulse"')

    def known(self, model: str) -> Any:
        """Return the options of the synthetic system. Raises InputError."""
        name = KNOWN[model]
        wrong = next((k for k in KNOWN.values() if k != name and getattr(self, k) is not None), None)
        if getattr(self, name) is None or wrong:
            raise InputError(f"the model '{model}' needs [synthetic.{name}] only", f"synthetic.{wrong or name}")
        return getattr(self, name).options()


class Schema(Problem):
    """Vibration models. The data are in one of [measurements], [synthetic] and [matrices]."""

    model: Literal["subspace", "step_response", "impulse", "matrices"] = Field(description="kind of model")
    measurements: MeasurementsSection | None = Field(default=None, description="a measured log")
    synthetic: SyntheticRecordsSection | None = Field(default=None, description="a synthetic recording")
    matrices: Made[options.Matrices] | None = Field(default=None, description='given matrices, for model = "matrices"')
    subspace: Made[options.Subspace] = Made[options.Subspace].left_out()
    physical: Made[options.Physical] | None = Field(default=None, description="M, D, K from the subspace model")
    step_response: Made[options.StepResponse] = Made[options.StepResponse].left_out()
    impulse: Made[options.Impulse] = Made[options.Impulse].left_out()

    def data(self, context: Context) -> tuple[list[Record], Any]:
        """Return the recordings for the model, and the system behind synthetic recordings. Raises InputError."""
        tables = [name for name in ("measurements", "synthetic", "matrices") if getattr(self, name) is not None]
        if self.model == "matrices" or len(tables) != 1 or tables[0] == "matrices":
            raise InputError(
                f"expected one of [measurements] and [synthetic] for the model '{self.model}'",
                tables[-1] if tables else "",
            )
        if self.measurements is not None:
            return self.measurements.records(self.model, context), None

        assert self.synthetic is not None
        known = self.synthetic.known(self.model)
        return vibration.synthetic_records(known, self.synthetic.options()), known


_LINES = {
    "subspace": "block Hankel matrices, one LQ factor, singular values; A and C from the subspace, B, D and the "
    "initial state from least squares; the order from held-out samples",
    "step_response": "b q^-delay / (1 - a q^-1) by output error (Dressler 2012, eq. (6.11))",
    "impulse": "eigensystem realisation, then least squares on damped sines about a rest position",
    "matrices": "det(M lambda + K) = 0 and the poles of M s^2 + D s + K (Dressler 2012, eq. (6.15))",
}


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    known = f"synthetic.{KNOWN.get(problem.model, '')}"
    return {"model": problem.model, "known": known, "records": known if problem.synthetic else "measurements"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the recordings or matrices."""
    if problem.physical is not None and problem.model != "subspace":
        raise InputError(f"needs model = 'subspace'; found '{problem.model}'", "physical")
    if problem.model == "matrices":
        tables = [name for name in ("measurements", "synthetic", "matrices") if getattr(problem, name) is not None]
        if tables != ["matrices"] or problem.matrices is None:
            raise InputError("expected only [matrices] for the model 'matrices'", tables[0] if tables else "matrices")
        return Call(vibration.matrices_study, problem.matrices.options(), title=problem.title)
    context.progress("reading logs", 0.1)
    records, known = problem.data(context)
    force = problem.measurements is None or problem.measurements.force_N is not None
    return Call(
        vibration.study, records, getattr(problem, problem.model).options(), truth=known,
        input_unit="N" if force else "m", physical=problem.physical and problem.physical.options(), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the model and the recordings."""
    lines = [f"{problem.heading}: model {problem.model}", _LINES[problem.model]]
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
