"""From a fit to the study: values, checks, table, pictures and the file of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import tomli_w

from ..results import SolveStatus, Trajectory
from .asked import Asked
from .between_sessions import BySession
from .bodies import bodies_of
from .checks import judged
from .closed_loop import ClosedLoopRun, within_bound
from .folds import LeftOutInTurn
from .identified import IdentificationStudy
from .inertia import Identification, Validation
from .options import ClosedLoop
from .recordings import Recordings
from .repeated import Repeated
from .rows import Rows


def assembled_study(
    asked: Asked,
    data: Recordings,
    identification: Identification,
    validation: Validation | None,
    *,
    repeated: Repeated | None = None,
    loop: ClosedLoop | None = None,
    runs: Sequence[ClosedLoopRun] = (),
    recordings: BySession | None = None,
    left_out: LeftOutInTurn | None = None,
) -> IdentificationStudy:
    """The study of a fit."""
    e, rows, title, parameters = identification.estimate, identification.rows, asked.title, identification.numbers
    compared = {name: number for name, number in asked.published.items() if name in parameters}
    checks, suspicions = judged(asked, data, identification, validation, repeated)
    bodies = bodies_of(asked, identification)
    shown = (title or "identification") + (" (synthetic)" if rows.synthetic else "")
    stopped = repeated is not None and repeated.runs.interrupted
    coverage = None
    if repeated is not None:
        c = repeated.coverage
        hits = {n: int(h) for n, h in zip(c.names, c.hits, strict=True)}
        coverage = {"runs": c.runs, "hits": hits, "pooled": c.pooled, "band": list(c.band)}
    known = ", ".join(data.corrections)
    return IdentificationStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message=f"{len(e.names)} parameters from {len(rows)} rows",
        title=title,
        objective=float(np.sum((identification.residuals / identification.noise) ** 2)),
        checks=checks | bodies.checks | within_bound(loop, runs),
        parameters=parameters,
        units={n: u for n, u in zip(rows.names, rows.units, strict=True) if n in (*e.names, *e.held)},
        intervals={n: list(e.interval(n)) for n in e.names},
        at_bound=list(e.held),
        corrections=data.corrections | {n: e.value(n) for n in rows.signed},
        estimate=e,
        confidence=identification.confidence,
        noise=identification.noise,
        residual_share=np.sqrt(np.mean(identification.residuals**2, axis=0)) / np.sqrt(np.mean(rows.effort**2, axis=0)),
        held_out_rms=None if validation is None else validation.rms,
        held_out_share=None if validation is None else validation.relative,
        left_out_in_turn=None if left_out is None else left_out.rms,
        row_count=len(rows),
        dropped_share=rows.dropped,
        cutoff=rows.cutoff_Hz,
        condition=identification.identifiability.condition,
        left_out={", ".join(t.names): t.p for t in identification.left_out},
        delay=None if identification.delay is None else [identification.delay.seconds, identification.delay.std],
        by_recording=None if recordings is None else recordings.intervals,
        between_recordings=None if recordings is None or recordings.apart is None else recordings.apart.spread,
        truth=data.truth or None,
        coverage=coverage,
        notes=[
            rows.filter_sentence,
            *suspicions,
            *identification.notes,
            *([recordings.apart.message] if recordings is not None and recordings.apart is not None else []),
            *bodies.notes,
            *([f"intervals take the estimated {known} as known"] if known else []),
        ],
        synthetic=rows.synthetic,
        published={name: parameters[name] / number - 1 for name, number in compared.items() if number}
        if compared
        else None,
        **bodies.values,
        **_of_runs(runs),
        fit=identification,
        numbers=compared,
        closed_loop=runs,
        trajectory=_trajectory(identification, asked.how.targets, shown),
        figures=_figures(identification, validation, shown, runs, title),
        files={"parameters.toml": _file(identification, shown), **bodies.files},
        machine_files=("parameters.toml", *bodies.files),
    )


def _of_runs(runs: Sequence[ClosedLoopRun]) -> dict[str, Any]:
    words = ("rms", "maximum", "relative", "effort")
    return {f"closed_loop_{word}": [getattr(run, word) for run in runs] or None for word in words}


def _trajectory(identification: Identification, name: str, title: str) -> Trajectory:
    """Measured and modelled efforts of the first recording."""
    rows = identification.rows
    end = rows.starts[1] if len(rows.starts) > 1 else len(rows)
    part = slice(0, end)
    signals = {f"{name}.measured": rows.effort[part], f"{name}.modelled": identification.modelled()[part]}
    units = dict.fromkeys(signals, rows.effort_unit)
    return Trajectory(rows.time[part], signals, units, title=title, synthetic=rows.synthetic)


def _file(identification: Identification, title: str) -> str:
    """parameters.toml: estimates by name with unit and interval."""
    e = identification.estimate
    table: dict[str, Any] = {"title": title}
    if identification.rows.synthetic:
        table["synthetic"] = identification.rows.synthetic
    for n, unit in zip(identification.rows.names, identification.rows.units, strict=True):
        if n in e.names or n in e.held:
            entry: dict[str, Any] = {"value": e.value(n), "unit": unit}
            entry |= {"at_bound": True} if n in e.held else {"interval_95": list(e.interval(n))}
            table[n] = entry
    return tomli_w.dumps(table)


def _figures(
    identification: Identification, validation: Validation | None, title: str, runs: Sequence[ClosedLoopRun], plain: str
) -> dict[str, Any]:
    rows, fit = identification.rows, identification.modelled()

    def efforts(of: Rows, modelled: np.ndarray, title: str) -> Any:
        from ..plot.identification import efforts_figure

        return efforts_figure(of.time, of.effort, modelled, rows.targets, rows.common_unit, title)

    def friction() -> Any:
        from ..plot.identification import friction_figure

        law = rows.Y[:, :, at] @ identification.parameters[at]
        rate = {"N": "m/s", "SI": "SI"}.get(rows.common_unit, "rad/s")
        return friction_figure(
            rows.velocity, rows.effort - fit + law, law, rows.targets, (rate, rows.common_unit), title
        )

    def closed_loop() -> Any:
        from ..plot.closed_loop import closed_loop_figure

        said = f"{plain or 'identification'}: closed loop simulated from the reference"
        return closed_loop_figure([(run.name, run.trajectory) for run in runs], title=said)

    figures: dict[str, Any] = {"efforts": partial(efforts, rows, fit, title)}
    if validation is not None:
        other = validation.rows
        figures["held_out"] = partial(efforts, other, other.effort - validation.errors, f"{title}, held out")
    at = [k for k, n in enumerate(rows.names) if any(word in n for word in ("coulomb", "viscous"))]
    if at and rows.velocity.shape[1] == len(rows.targets):
        figures["friction"] = friction
    if runs:
        figures["closed_loop"] = closed_loop
    return figures
