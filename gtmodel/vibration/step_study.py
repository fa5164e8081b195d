"""Kind "vibration", model "step_response": a delayed first-order model with its limits."""

from __future__ import annotations

from typing import Any

import tomli_w

from gtmodel.problem_files.base import Check, Context, Outcome, Row, at_most
from gtmodel.results import SolveStatus
from gtmodel.vibration import Record, StepModel, identify_step

from .vibration_keys import Schema
from .vibration_values import by_chance, interval, said, values

WITHIN = 0.01  # of synthetic steps: relative error of the bandwidth's 1 - a and of b, or what their noise explains


def solve_step(problem: Schema, records: list[Record], context: Context) -> Outcome:
    """Fit all recordings together. Raises ArgumentError, Stopped."""
    k = problem.step_response
    m = identify_step(records, delay=k.delay_samples, longest=k.longest_samples, interrupted=context.interrupted)
    e = m.estimate
    found = values(
        words=list(m.words),
        residual_m=[e.noise],
        intervals={"a": list(e.interval("a")), "b": list(e.interval("b"))},
        stable=True,
        a=m.a,
        b=m.b,
        delay_samples=m.delay,
        delay_sure=m.delay_sure,
        gain=[m.gain, *m.gain_interval],
        bandwidth_Hz=None if m.bandwidth_Hz is None else [m.bandwidth_Hz, *(m.bandwidth_interval_Hz or (None, None))],
        synthetic=m.synthetic,
    )
    band = "beyond the Nyquist frequency" if m.bandwidth_Hz is None else f"{m.bandwidth_Hz:.4g}"
    rows = [
        Row("a", f"{m.a:.6g}{interval(e.interval('a'), '.6g')}"),
        Row("b", f"{m.b:.6g}{interval(e.interval('b'), '.6g')}"),
        Row("delay", f"{m.delay}" + ("" if m.delay_sure else " (not told from its neighbours)"), "samples"),
        Row("delay", 1e3 * m.delay * m.sample_time, "ms"),
        Row("gain b / (1 - a)", f"{m.gain:.5g}{interval(m.gain_interval)}"),
        Row("bandwidth", f"{band}{interval(m.bandwidth_interval_Hz, '.4g')}", "Hz"),
        Row("residual, rms", 1e6 * e.noise, "um"),
        *(Row("said", w) for w in m.words),
        *([Row("SYNTHETIC", m.synthetic)] if m.synthetic else []),
    ]
    comment = f"# synthetic: {m.synthetic}\n" if m.synthetic else ""
    numbers = {"a": m.a, "b": m.b, "delay_samples": m.delay, "sample_time_s": m.sample_time}
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{len(records)} recordings, delay {m.delay} samples",
        checks=_checks(problem, m),
        values=found,
        rows=rows,
        figures={"step": lambda: _figure(problem, records, m)},
        files={"parameters.toml": comment + tomli_w.dumps(numbers)},
        machine_files=("parameters.toml",),
    )


def _checks(problem: Schema, m: StepModel) -> dict[str, Check]:
    t = problem.synthetic and problem.synthetic.steps
    if not t:
        return {}
    chance = by_chance(m.estimate, ["a", "b"])
    errors = [(abs((1 - m.a) / (1 - t.a) - 1), max(WITHIN, float(chance[0]) / abs(1 - t.a)))]
    if t.b:
        errors.append((abs(m.b / t.b - 1), max(WITHIN, float(chance[1]) / abs(t.b))))
    error, bound = max(errors, key=lambda pair: pair[0] / pair[1])
    late = abs(m.delay - t.delay_samples)
    # a delay whose neighbours explain the steps as well may be one of them
    return {"coefficient_error": at_most(error, bound), "delay_error": at_most(late, 0 if m.delay_sure else 1)}


def _figure(problem: Schema, records: list[Record], m: StepModel) -> Any:
    from gtmodel.plot.vibration import step_figure

    title = said(problem.title or "step response", m.synthetic)
    runs = [(r.time, r.u[:, 0], r.y[:, 0], f) for r, f in zip(records, m.fitted, strict=True)]
    return step_figure(runs, m.residual_by_delay, m.delay, title=title)
