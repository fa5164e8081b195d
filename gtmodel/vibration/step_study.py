"""Step responses: a delayed first-order model with its limits, its table, pictures and files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import tomli_w

from ..results import Check, Row, SolveStatus, at_most
from .options import StepResponse, Steps
from .record import Record
from .step_response import StepModel, identify_step
from .vibration_result import VibrationStudy, by_chance, commented, entitled, interval

WITHIN = 0.01  # of synthetic steps: relative error of the bandwidth's 1 - a and of b, or what their noise explains


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StepStudy(VibrationStudy):
    """Step responses of all recordings together; `model` is what was fitted."""

    model: StepModel | None = None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "a", "b", "gain" or "bandwidth_Hz". Raises ArgumentError."""
        return super().interval(name, level) if self.model is None else self.model.interval(name, level)

    def _model_rows(self) -> list[Row]:
        m = self.model
        if m is None:
            return []
        e = m.estimate
        band = "beyond the Nyquist frequency" if m.bandwidth_Hz is None else f"{m.bandwidth_Hz:.4g}"
        return [
            Row("a", f"{m.a:.6g}{interval(e.interval('a'), '.6g')}"),
            Row("b", f"{m.b:.6g}{interval(e.interval('b'), '.6g')}"),
            Row(
                "delay", f"{m.delay}" + ("" if m.delay_sure else " (not distinguished from its neighbours)"), "samples"
            ),
            Row("delay", 1e3 * m.delay * m.sample_time, "ms"),
            Row("gain b / (1 - a)", f"{m.gain:.5g}{interval(m.interval('gain'))}"),
            Row("bandwidth", f"{band}{interval(_bandwidth_ends(m), '.4g')}", "Hz"),
            Row("residual, rms", 1e6 * e.noise, "um"),
        ]


def step_study(
    records: Sequence[Record], given: StepResponse, truth: Steps | None, title: str, interrupted: Callable[[], bool]
) -> StepStudy:
    """Fit all recordings together. Raises ArgumentError, FitStopped."""
    m = identify_step(
        records, delay=given.delay_samples, longest=given.longest_samples, interrupted=interrupted
    )  # fmt: skip
    e = m.estimate
    parameters = {"a": m.a, "b": m.b, "delay_samples": m.delay, "sample_time_s": m.sample_time}
    return StepStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(records)} recordings, delay {m.delay} samples",
        title=title,
        checks={} if truth is None else _checks(m, truth),
        figures={"step": partial(_figure, records, m, entitled(title or "step response", m.synthetic))},
        files={"parameters.toml": commented(tomli_w.dumps(parameters), m.synthetic)},
        machine_files=("parameters.toml",),
        model=m,
        notes=m.notes,
        estimate=e,
        residual=[e.noise],
        intervals={"a": list(e.interval("a")), "b": list(e.interval("b"))},
        stable=True,
        a=m.a,
        b=m.b,
        delay_samples=m.delay,
        delay_sure=m.delay_sure,
        gain=[m.gain, *m.interval("gain")],
        bandwidth=None if m.bandwidth_Hz is None else [m.bandwidth_Hz, *(_bandwidth_ends(m) or (None, None))],
        synthetic=m.synthetic,
    )


def _bandwidth_ends(m: StepModel) -> tuple[float, float] | None:
    """The interval where it ends below the Nyquist frequency."""
    ends = None if m.bandwidth_Hz is None else m.interval("bandwidth_Hz")
    return ends if ends is not None and np.all(np.isfinite(ends)) else None


def _checks(m: StepModel, true: Steps) -> dict[str, Check]:
    chance = by_chance(m.estimate, ["a", "b"])
    errors = [(abs((1 - m.a) / (1 - true.a) - 1), max(WITHIN, float(chance[0]) / abs(1 - true.a)))]
    if true.b:
        errors.append((abs(m.b / true.b - 1), max(WITHIN, float(chance[1]) / abs(true.b))))
    error, bound = max(errors, key=lambda pair: pair[0] / pair[1])
    late = abs(m.delay - true.delay_samples)
    # a delay whose neighbours explain the steps as well may be one of them
    return {"coefficient_error": at_most(error, bound), "delay_error": at_most(late, 0 if m.delay_sure else 1)}


def _figure(records: Sequence[Record], m: StepModel, title: str) -> Any:
    from ..plot.vibration import step_figure

    runs = [(r.time, r.u[:, 0], r.y[:, 0], f) for r, f in zip(records, m.fitted, strict=True)]
    return step_figure(runs, m.residual_by_delay, m.delay, title=title)
