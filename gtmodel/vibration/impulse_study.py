"""Kind "vibration", model "impulse": resonances of a decay."""

from __future__ import annotations

from typing import Any

import numpy as np
import tomli_w

from gtmodel.problem_files.base import Check, Context, Outcome, Row, at_least, at_most
from gtmodel.results import SolveStatus
from gtmodel.vibration import ImpulseModel, Record, identify_impulse

from .vibration_keys import Schema
from .vibration_values import by_chance, interval, listed, said, values

WITHIN = 0.01  # of synthetic hits: largest relative error of a frequency, or what their noise explains


def solve_impulse(problem: Schema, records: list[Record], context: Context) -> Outcome:
    """Fit the decay. Raises ArgumentError, Stopped."""
    m = identify_impulse(
        records[0], modes=problem.impulse.modes, largest=problem.impulse.largest, interrupted=context.interrupted
    )
    found = values(
        words=list(m.words),
        frequency_Hz=[r.frequency_Hz for r in m.resonances],
        frequency_interval_Hz=[list(r.frequency_interval_Hz) for r in m.resonances],
        damping=[r.damping for r in m.resonances],
        damping_interval=[list(r.damping_interval) for r in m.resonances],
        distance=m.distance,
        residual_m=m.residual,
        order=2 * len(m.resonances),
        stable=True,
        synthetic=m.synthetic,
    )
    rows = []
    for n, r in enumerate(m.resonances, 1):
        rows += [
            Row(f"resonance {n}", f"{r.frequency_Hz:.5g}{interval(r.frequency_interval_Hz)}", "Hz"),
            Row("damping", f"{r.damping:.4g}{interval(r.damping_interval, '.4g')}"),
            Row("amplitude by output", listed(1e6 * np.array(r.amplitude), ".4g"), "um"),
        ]
    if len(m.resonances) > 1:
        rows.append(Row("distance of neighbours", listed(m.distance, ".3g"), "half-power widths"))
    rows += [Row("residual, rms", listed(1e6 * m.residual, ".4g"), "um"), *(Row("said", w) for w in m.words)]
    if m.synthetic:
        rows.append(Row("SYNTHETIC", m.synthetic))
    comment = f"# synthetic: {m.synthetic}\n" if m.synthetic else ""
    numbers = {"frequency_Hz": found["frequency_Hz"], "damping": found["damping"]}
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{len(m.resonances)} resonances in {len(records[0])} samples",
        checks=_checks(problem, m),
        values=found,
        rows=rows,
        figures={"impulse": lambda: _figure(problem, records[0], m)},
        files={"parameters.toml": comment + tomli_w.dumps(numbers)},
        machine_files=("parameters.toml",),
    )


def _checks(problem: Schema, m: ImpulseModel) -> dict[str, Check]:
    h = problem.synthetic and problem.synthetic.hit
    if not h:
        return {}
    true = np.sort(h.frequency_Hz)
    found = np.array([r.frequency_Hz for r in m.resonances])
    if len(found) != len(true):
        bound = at_least if len(found) < len(true) else at_most
        return {"modes_found": bound(len(found), len(true))}
    errors = np.abs(found / true - 1)
    bounds = np.maximum(WITHIN, by_chance(m.estimate, [f"f[{n}]" for n in range(len(true))]) / true)
    worst = int(np.argmax(errors / bounds))
    return {"frequency_error": at_most(float(errors[worst]), float(bounds[worst]))}


def _figure(problem: Schema, record: Record, m: ImpulseModel) -> Any:
    from gtmodel.plot.vibration import decay_figure

    marks = [r.damped_Hz for r in m.resonances]
    return decay_figure(
        record.time, record.y, m.fitted, m.rest, marks, title=said(problem.title or "decay", m.synthetic)
    )
