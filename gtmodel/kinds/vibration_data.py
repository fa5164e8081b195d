"""The recordings of a problem of kind "vibration", measured or made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmodel.measurements import Corrections
from gtmodel.problem_files.base import Context, InputError
from gtmodel.results import TrajectoryError
from gtmodel.vibration import Record, VibrationError, hammer_record, step_record, structure_record

from .vibration_keys import Measurements, Schema, Synthetic

_SECTION = {"subspace": "structure", "step_response": "steps", "impulse": "hit"}


def records(problem: Schema, context: Context) -> list[Record]:
    """The recordings for the model asked for; one but for step responses. Raises InputError."""
    given = [name for name in ("measurements", "synthetic", "matrices") if getattr(problem, name) is not None]
    if len(given) != 1 or given[0] == "matrices":
        raise InputError(
            f"expected one of [measurements] and [synthetic] for the model '{problem.model}'",
            given[-1] if given else "",
        )
    if problem.synthetic is not None:
        return _made(problem, problem.synthetic)
    assert problem.measurements is not None
    found = _read(problem, problem.measurements, context)
    if problem.model != "step_response" and len(found) > 1:
        raise InputError(
            f"hold {len(found)} recordings; the model '{problem.model}' takes one, so name one file",
            "measurements.files",
        )
    return found


def _made(problem: Schema, s: Synthetic) -> list[Record]:
    name = _SECTION[problem.model]
    wrong = next((k for k in _SECTION.values() if k != name and getattr(s, k) is not None), None)
    if getattr(s, name) is None or wrong:
        raise InputError(
            f"the model '{problem.model}' needs [synthetic.{name}] and no other", f"synthetic.{wrong or name}"
        )
    common = {"samples": s.samples, "sample_time": s.sample_time_s, "noise": s.noise_m}
    try:
        if s.structure is not None:
            c = s.structure
            if c.coordinate > len(c.M_kg):
                raise InputError(
                    f"is {c.coordinate}; the structure has {len(c.M_kg)} coordinates", "synthetic.structure.coordinate"
                )
            return [
                structure_record(
                    c.M_kg, c.D_kg_s, c.K_N_m, force=c.force_N, coordinate=c.coordinate - 1, hold=c.hold_samples,
                    seed=s.seed, **common,
                )
            ]  # fmt: skip
        if s.hit is not None:
            h = s.hit
            return [hammer_record(h.frequency_Hz, h.damping, h.amplitude_m, seed=s.seed, **common)]
        t = s.steps
        assert t is not None
        made = [
            step_record(t.a, t.b, t.delay_samples, size, before=t.rest_samples, seed=s.seed + n, **common)
            for n, size in enumerate(t.amplitudes_m)
        ]
        # one note for all of them
        seeds = f"seed {s.seed}" if len(made) == 1 else f"seeds {s.seed} to {s.seed + len(made) - 1}"
        return [replace(r, synthetic=f"{seeds}, noise {s.noise_m:g} m") for r in made]
    except InputError:
        raise
    except ValueError as error:
        raise InputError(str(error), f"synthetic.{name}") from error


def _read(problem: Schema, m: Measurements, context: Context) -> list[Record]:
    keys = {"position_m": m.position_m, "force_N": m.force_N, "reference_m": m.reference_m}
    given = {name: signal for name, signal in keys.items() if signal is not None}
    inputs = [name for name in given if name != "position_m"]
    if len(inputs) != (0 if problem.model == "impulse" else 1):
        wanted = "no input: a decay has none" if problem.model == "impulse" else "one of force_N and reference_m"
        raise InputError(f"expected {wanted}, besides position_m", "measurements")
    for name, signal in given.items():
        for what in ("scale", "offset", "delay_s"):
            if getattr(signal, what) == "estimate":
                raise InputError("a black box does not tell it; give a number", f"measurements.{name}.{what}")
    signals = {name: signal.signal(f"measurements.{name}") for name, signal in given.items()}
    raw = m.read(m.files, signals, context, "measurements.files")
    found = []
    try:
        for session in Corrections(signals, raw).apply():
            first = int(np.ceil(m.after_s / session.sample_time - 1e-9))
            t = session.trajectory
            y = t["position_m"][first:]
            if len(y) < 2:
                raise InputError(
                    f"{m.after_s:g} s leave {len(y)} samples of {session.name}; lower it", "measurements.after_s"
                )
            u = t[inputs[0]][first:] if inputs else np.zeros(len(y))
            found.append(Record(u, y, session.sample_time, t.synthetic))
    except (TrajectoryError, VibrationError) as error:
        raise InputError(str(error), "measurements") from error
    return found
