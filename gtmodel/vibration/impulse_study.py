"""Resonances of a decay: table, checks against a synthetic hit, picture and file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import tomli_w

from ..results import Check, Row, SolveStatus, at_least, at_most
from .impulse import ImpulseModel, identify_impulse
from .options import Hit, Impulse
from .record import Record
from .vibration_result import VibrationStudy, by_chance, commented, entitled, interval, numbers

WITHIN = 0.01  # of synthetic hits: largest relative error of a frequency, or what their noise explains


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ImpulseStudy(VibrationStudy):
    """Resonances of a decay; `model` is what was fitted."""

    model: ImpulseModel | None = None

    def _model_rows(self) -> list[Row]:
        m = self.model
        if m is None:
            return []
        rows = []
        for n, r in enumerate(m.resonances):
            rows += [
                Row(f"resonance {n + 1}", f"{r.frequency_Hz:.5g}{interval(m.interval(f'f[{n}]'))}", "Hz"),
                Row("damping", f"{r.damping:.4g}{interval(m.interval(f'zeta[{n}]'), '.4g')}"),
                Row("amplitude by output", numbers(1e6 * np.array(r.amplitude), ".4g"), "um"),
            ]
        if len(m.resonances) > 1:
            rows.append(Row("distance of neighbours", numbers(m.distance, ".3g"), "half-power widths"))
        return [*rows, Row("residual, rms", numbers(1e6 * m.residual, ".4g"), "um")]


def impulse_study(
    record: Record, given: Impulse, truth: Hit | None, title: str, interrupted: Callable[[], bool]
) -> ImpulseStudy:
    """Fit the decay. Raises ArgumentError, FitStopped."""
    m = identify_impulse(record, modes=given.modes, largest=given.largest, interrupted=interrupted)
    frequency, damping = [r.frequency_Hz for r in m.resonances], [r.damping for r in m.resonances]
    text = tomli_w.dumps({"frequency_Hz": frequency, "damping": damping})
    return ImpulseStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(m.resonances)} resonances in {len(record)} samples",
        title=title,
        checks={} if truth is None else _checks(m, truth),
        figures={"impulse": partial(_figure, record, m, entitled(title or "decay", m.synthetic))},
        files={"parameters.toml": commented(text, m.synthetic)},
        machine_files=("parameters.toml",),
        model=m,
        notes=m.notes,
        estimate=m.estimate,
        frequency=frequency,
        frequency_interval=[list(m.interval(f"f[{n}]")) for n in range(len(frequency))],
        damping=damping,
        damping_interval=[list(m.interval(f"zeta[{n}]")) for n in range(len(damping))],
        distance=m.distance,
        residual=m.residual,
        order=2 * len(m.resonances),
        stable=True,
        synthetic=m.synthetic,
    )


def _checks(m: ImpulseModel, hit: Hit) -> dict[str, Check]:
    true = np.sort(hit.frequency)
    fitted = np.array([r.frequency_Hz for r in m.resonances])
    if len(fitted) != len(true):
        bound = at_least if len(fitted) < len(true) else at_most
        return {"modes_found": bound(len(fitted), len(true))}
    errors = np.abs(fitted / true - 1)
    bounds = np.maximum(WITHIN, by_chance(m.estimate, [f"f[{n}]" for n in range(len(true))]) / true)
    worst = int(np.argmax(errors / bounds))
    return {"frequency_error": at_most(float(errors[worst]), float(bounds[worst]))}


def _figure(record: Record, m: ImpulseModel, title: str) -> Any:
    from ..plot.vibration import decay_figure

    return decay_figure(record.time, record.y, m.fitted, m.rest, [r.damped_Hz for r in m.resonances], title=title)
