"""Kind "identification": masses and friction of a robot from its measured motion and forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import tomli_w

from gtmodel.identify import (
    Identification,
    Regressor,
    Repeated,
    Validation,
    identify,
    repeat_identification,
    rows_of,
    with_offsets,
)
from gtmodel.lang import ModelError
from gtmodel.problem_files.base import Context, InputError, Outcome, Row
from gtmodel.results import SolveStatus, Trajectory, TrajectoryError

from . import identification_comparison
from .identification_checks import checks_of, suspicions
from .identification_data import Recordings, model_of, processing_of, recordings, regressor_of, scalars_of
from .identification_keys import Schema

NAME = "identification"

VALUES = {
    "parameters": "estimates by name, in SI units",
    "units": "their units",
    "intervals": "95 % intervals by name; none for what is held at its bound",
    "at_bound": "names held at zero, which would otherwise be negative",
    "corrections": "estimated delays, scales and offsets of the signals by name, in SI units",
    "confidence": "what the intervals assume of the residuals: white, newey_west",
    "noise": "standard deviation of what is left, by target, in SI units",
    "residual_share": "rms of what is left over rms of the measured effort, by target",
    "held_out_rms": "rms error on the motion held out, by target, in SI units; null without one",
    "held_out_share": "the same over the rms of its effort",
    "rows": "rows that were fitted",
    "dropped_share": "share of the samples left out as too slow",
    "cutoff_Hz": "of the zero-phase low pass",
    "condition": "condition number of the weighted regressor, columns in nominal values (0: least of its unit)",
    "left_out": "p-value by watched group of fixed parameters: small where the residuals show their traces",
    "delay_ms": "by how much efforts look later than positions, and its standard deviation; null where not told",
    "truth": "of a synthetic plant; null for measured logs",
    "coverage": "hits of the intervals by name over the repeated runs, pooled, and the band; null without runs",
    "sentences": "what limits the numbers, in words",
    "synthetic": "seed and noise of a made-up log; null for a measured one",
    **identification_comparison.VALUES,
}


def solve(problem: Schema, context: Context) -> Outcome:
    """Read or make the logs, filter, fit, validate."""
    model, free = model_of(problem, context)
    regressor = regressor_of(problem, model, free)
    identification_comparison.check(problem, model)
    context.progress("reading", 0.1)
    data = recordings(problem, context, regressor, free)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    context.progress("fitting", 0.3)
    found, validation = _fitted(problem, regressor, data, free)
    repeated = _repeated(problem, context, regressor, data, free)
    return identification_comparison.beside(
        problem, _outcome(problem, data, found, validation, repeated), data, context
    )


def explain(problem: Schema, context: Context) -> str:
    """What is free and fixed, and how the regressor is computed."""
    model, free = model_of(problem, context)
    regressor = regressor_of(problem, model, free)
    lines = [f"{problem.title or 'identification'}: {', '.join(regressor.columns)} linear in"]
    for name, value, unit in zip(regressor.names, regressor.nominal, regressor.units, strict=True):
        role = "free" if name in scalars_of(regressor, free) else "watched"
        lines.append(f"  {name} [{unit}], {role}, nominal {value:g}")
    lines.append(f"from {', '.join(s.name for s in regressor.inputs)}; every other parameter keeps its number")
    return "\n".join(lines)


def _fitted(
    problem: Schema, regressor: Regressor, data: Recordings, free: list[str]
) -> tuple[Identification, Validation | None]:
    place = "log" if problem.log is not None else "synthetic"
    how = processing_of(problem)
    try:
        rows = rows_of(data.fitted, regressor, how, problem.known, problem.targets)
        if data.offsets is not None:
            rows = with_offsets(rows, problem.targets, per_session=data.offsets == "session")
        found = identify(
            rows, [*free, *rows.signed], nonnegative=_nonnegative(problem, regressor), confidence=problem.confidence
        )
        if not data.held_out:
            return found, None
        fixed = how.__class__(rows.cutoff_Hz, how.order, rows.every, how.position_step, how.mask_steps)
        others = rows_of(data.held_out, regressor, fixed, problem.known, problem.targets)
        if data.offsets is not None:
            others = with_offsets(others, problem.targets, per_session=False)
        return found, found.validate(others)
    except (ModelError, TrajectoryError) as error:
        raise InputError(str(error), place) from error


def _nonnegative(problem: Schema, regressor: Regressor) -> bool | list[str]:
    if not isinstance(problem.nonnegative, bool):
        try:
            scalars_of(regressor, problem.nonnegative)
        except ModelError as error:
            raise InputError(str(error), "nonnegative") from error
    return problem.nonnegative


def _repeated(
    problem: Schema, context: Context, regressor: Regressor, data: Recordings, free: list[str]
) -> Repeated | None:
    s = problem.synthetic
    if s is None or s.runs == 0 or data.simulator is None:
        return None

    def progress(done: int, runs: int) -> None:
        context.progress("repeating", done / runs, {"runs": float(done)})

    truth = {n: data.truth[n] for n in scalars_of(regressor, free)}
    try:
        return repeat_identification(
            data.simulator,
            regressor,
            truth,
            data.sensors,
            s.runs,
            s.seed,
            free=free,
            processing=processing_of(problem),
            confidence=problem.confidence,
            processes=s.processes,
            progress=progress,
            interrupted=context.interrupted,
        )
    except (RuntimeError, ValueError) as error:
        raise InputError(str(error), "synthetic.runs") from error


def _outcome(
    problem: Schema, data: Recordings, found: Identification, validation: Validation | None, repeated: Repeated | None
) -> Outcome:
    checks = checks_of(data, found, validation, repeated)
    failed = [name for name, check in checks.items() if not check.passed]
    stopped = repeated is not None and repeated.runs.interrupted
    message = f"{len(found.estimate.names)} parameters from {len(found.rows)} rows"
    if failed:
        message += f", but {' and '.join(failed)} failed"
    values = _values(problem, data, found, validation, repeated)
    title = problem.title or f"identification of {problem.robot}"
    if found.rows.synthetic:
        title += " (synthetic)"
    figures = _figures(found, validation, title)
    return Outcome(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message=message,
        objective=float(np.sum((found.residuals / found.noise) ** 2)),
        checks=checks,
        values=values,
        trajectory=_trajectory(found, title),
        rows=_rows(values, found),
        figures=figures,
        files={"parameters.toml": _file(found, title)},
        machine_files=("parameters.toml",),
    )


def _values(
    problem: Schema, data: Recordings, found: Identification, validation: Validation | None, repeated: Repeated | None
) -> dict[str, Any]:
    e, rows = found.estimate, found.rows
    names = [*e.names, *e.held]
    power = np.sqrt(np.mean(rows.effort**2, axis=0))
    coverage = None
    if repeated is not None:
        c = repeated.coverage
        hits = {n: int(h) for n, h in zip(c.names, c.hits, strict=True)}
        coverage = {"runs": c.runs, "hits": hits, "pooled": c.pooled, "band": list(c.band)}
    return {
        "parameters": {n: e.value(n) for n in rows.names if n in names and n not in rows.signed},
        "units": {n: u for n, u in zip(rows.names, rows.units, strict=True) if n in names},
        "intervals": {n: list(e.interval(n)) for n in e.names},
        "at_bound": list(e.held),
        "corrections": data.corrections | {n: e.value(n) for n in rows.signed},
        "confidence": found.confidence,
        "noise": found.noise,
        "residual_share": np.sqrt(np.mean(found.residuals**2, axis=0)) / power,
        "held_out_rms": None if validation is None else validation.rms,
        "held_out_share": None if validation is None else validation.relative,
        "rows": len(rows),
        "dropped_share": rows.dropped,
        "cutoff_Hz": rows.cutoff_Hz,
        "condition": found.identifiability.condition,
        "left_out": {", ".join(t.names): t.p for t in found.left_out},
        "delay_ms": None if found.delay is None else [1e3 * found.delay.seconds, 1e3 * found.delay.std],
        "truth": data.truth or None,
        "coverage": coverage,
        "sentences": [
            rows.filter_sentence,
            *suspicions(data, found, validation, problem.targets),
            *found.sentences,
            *_taken_as_known(data),
        ],
        "synthetic": rows.synthetic,
    }


def _taken_as_known(data: Recordings) -> list[str]:
    names = ", ".join(data.corrections)
    return [f"intervals take the estimated {names} as known"] if names else []


def _rows(values: dict[str, Any], found: Identification) -> list[Row]:
    rows = []
    for name, value in values["parameters"].items():
        unit, truth = values["units"][name], (values["truth"] or {}).get(name)
        rows.append(Row(name, value, unit))
        low, high = values["intervals"].get(name, (None, None))
        beside = "" if truth is None else f" (synthetic truth {truth:g})"
        rows.append(Row("  95 %", "at its bound" if low is None else f"{low:.5g} to {high:.5g}{beside}"))
    rows += [Row(name, value) for name, value in values["corrections"].items()]
    unit = found.rows.effort_unit
    for k, target in enumerate(found.rows.targets):
        rows.append(Row(f"noise of {target}", float(found.noise[k]), unit))
        if values["held_out_rms"] is not None:
            rows.append(Row(f"held-out error of {target}", float(values["held_out_rms"][k]), unit))
    rows.append(Row("intervals", f"for {'coloured' if found.confidence == 'newey_west' else 'white'} residuals"))
    if values["coverage"]:
        c = values["coverage"]
        hits, band = c["hits"].values(), c["band"]
        rows.append(Row("pooled coverage", 100 * c["pooled"], "%"))
        rows.append(
            Row("hits of the intervals", f"{min(hits)} to {max(hits)} of {c['runs']}, band {band[0]} to {band[1]}")
        )
    rows += [
        Row("zero-phase low pass at", values["cutoff_Hz"], "Hz"),
        Row("rows", values["rows"]),
        Row("left out as too slow", 100 * values["dropped_share"], "% of samples"),
    ]
    rows += [Row("note", sentence) for sentence in values["sentences"][1:]]
    if values["synthetic"]:
        rows.append(Row("synthetic", values["synthetic"]))
    return rows


def _trajectory(found: Identification, title: str) -> Trajectory:
    """Measured and modelled efforts of the first recording."""
    rows = found.rows
    end = rows.starts[1] if len(rows.starts) > 1 else len(rows)
    part = slice(0, end)
    name, unit = rows.targets[0].partition("[")[0], rows.effort_unit
    signals = {f"{name}.measured": rows.effort[part], f"{name}.modelled": found.modelled()[part]}
    return Trajectory(rows.time[part], signals, dict.fromkeys(signals, unit), title=title, synthetic=rows.synthetic)


def _file(found: Identification, title: str) -> str:
    """parameters.toml: estimates by name with unit and interval."""
    e = found.estimate
    table: dict[str, Any] = {"title": title}
    if found.rows.synthetic:
        table["synthetic"] = found.rows.synthetic
    for n in found.rows.names:
        if n in e.names or n in e.held:
            unit = found.rows.units[found.rows.names.index(n)]
            entry: dict[str, Any] = {"value": e.value(n), "unit": unit}
            entry |= {"at_bound": True} if n in e.held else {"interval_95": list(e.interval(n))}
            table[n] = entry
    return tomli_w.dumps(table)


def _figures(found: Identification, validation: Validation | None, title: str) -> dict[str, Any]:
    rows = found.rows
    fit = found.modelled()

    def efforts() -> Any:
        from gtmodel.plot.identification import efforts_figure

        return efforts_figure(rows.time, rows.effort, fit, rows.targets, rows.effort_unit, title)

    def held_out() -> Any:
        from gtmodel.plot.identification import efforts_figure

        assert validation is not None
        modelled = validation.effort - validation.errors
        return efforts_figure(
            validation.time, validation.effort, modelled, rows.targets, rows.effort_unit, f"{title}, held out"
        )

    def friction() -> Any:
        from gtmodel.plot.identification import friction_figure

        law = rows.Y[:, :, at] @ found.parameters[at]
        rate = "m/s" if rows.effort_unit == "N" else "rad/s"
        return friction_figure(
            rows.velocity, rows.effort - fit + law, law, rows.targets, (rate, rows.effort_unit), title
        )

    figures: dict[str, Any] = {"efforts": efforts}
    if validation is not None:
        figures["held_out"] = held_out
    at = [k for k, n in enumerate(rows.names) if any(word in n for word in ("coulomb", "viscous"))]
    if at and rows.velocity.shape[1] == len(rows.targets):
        figures["friction"] = friction
    return figures
