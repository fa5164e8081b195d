"""The result of kind "dynamic_stiffness": its table, checks, files and how often intervals hold what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from gtmodel.inference import binomial_band
from gtmodel.problem_files.base import Check, Outcome, Row, at_least
from gtmodel.results import SolveStatus
from gtmodel.vibration import ModalFit, OscillatorField, oscillator_text

from .dynamic_stiffness_data import Experiment
from .dynamic_stiffness_keys import Schema
from .dynamic_stiffness_printed import NOTE
from .dynamic_stiffness_synthetic import Made, drawn
from .dynamic_stiffness_table import NAMES, pose_table

LEVEL = 0.95
CHANGE = 2 / np.sqrt(np.pi)  # mean size of the difference of two values of unit standard deviation
NEW_POSES = 200  # of synthetic fields, where their truth is compared


def outcome(
    problem: Schema,
    experiments: Sequence[Experiment],
    fits: Sequence[ModalFit | None],
    warnings: Sequence[str],
    field: OscillatorField,
    errors: dict[Any, Any],
    rows: dict[str, np.ndarray],
    made: Made | None,
) -> Outcome:
    processes = list(field.processes.values())
    quantile = float(stats.norm.ppf((1 + LEVEL) / 2))
    # a direction may lack poses: rows of unequal length, put behind each other
    z = [np.abs(e / s) for e, s in errors.values()]
    widened = np.concatenate([row / g.inflation for row, g in zip(z, processes, strict=True)])
    left = [g.leave_one_out() for g in processes]
    loo = [float(np.sqrt(np.mean(e**2))) for e, _ in left]
    loo_z = np.concatenate([np.abs(e / s) * g.inflation for (e, s), g in zip(left, processes, strict=True)])
    held = [float(np.mean(np.concatenate(z) < quantile)), float(np.mean(widened < quantile))]
    truth = None if made is None else _coverage_of_truth(problem, field, made)
    found = [[np.nan] * 5 if f is None else [getattr(f, n)[0] for n in NAMES] for f in fits]
    columns = np.array(found).T
    fn = field.value("fn", np.array([e.pose for e in experiments]))
    softest = fn.min(axis=1)
    repeated = _repeatability(experiments, rows)
    note = field.synthetic
    values: dict[str, Any] = {
        "poses": np.array([e.pose for e in experiments]),
        "direction": ["xyz"[e.direction] for e in experiments],
        **dict(
            zip(("mass_kg", "damping_N_s_m", "stiffness_N_m", "frequency_Hz", "damping_ratio"), columns, strict=True)
        ),
        "relative_std": [None if f is None else [f.log_std(n) for n in NAMES] for f in fits],
        "modes": [0 if f is None else len(f.m) for f in fits],
        "next_mode_Hz": [None if f is None else f.next_mode for f in fits],
        "warnings": list(warnings),
        "scatter": problem.repeatability / CHANGE,
        "repeatability_found": repeated,
        "noise_of_process": [g.noise for g in processes],
        "lengths": [g.lengths for g in processes],
        "inflation": [g.inflation for g in processes],
        "leave_one_out_rms": loo,
        "coverage_leave_one_out": float(np.mean(loo_z < quantile)),
        "coverage_held_out": held,
        "coverage_of_truth": truth,
        "lowest_Hz": [float(softest.min()), float(softest.max())],
        "printed": NOTE if made is not None else None,
        "synthetic": note,
    }
    table = [
        *_experiment_rows(experiments, fits),
        Row("lowest frequency over the poses", f"{softest.min():.3g} to {softest.max():.3g}", "Hz"),
        Row("scatter between experiments: stated", f"{values['scatter']:.3g} of each logarithm"),
        Row("scatter: found by the processes", _list(values["noise_of_process"])),
        Row("leave-one-out error, m, c, k of x, y, z", _list(loo)),
        Row("95 % intervals, values left out: inside", f"{values['coverage_leave_one_out']:.1%}"),
        Row("95 % intervals, values held out: inside", f"{held[0]:.1%}, after widening {held[1]:.1%}"),
        Row("intervals widened by", _list(values["inflation"])),
    ]
    if repeated is not None:
        table.append(Row("repeatability found", f"{repeated:.1%}"))
    if truth is not None:
        table.append(
            Row(f"true field at {NEW_POSES} new poses: inside", f"{truth[0]:.1%}, after widening {truth[1]:.1%}")
        )
    table += [Row("warning", text) for text in warnings[:5]]
    if len(warnings) > 5:
        table.append(Row("warnings", f"{len(warnings) - 5} more in result.json"))
    if note is not None:
        table += [Row("printed oscillators", NOTE), Row("SYNTHETIC", note)]
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{sum(f is not None for f in fits)} of {len(fits)} experiments, nine processes",
        checks=_checks(fits, widened, quantile, made, experiments),
        values=values,
        rows=table,
        figures=_figures(problem, experiments, fits, field, errors),
        files={
            "oscillators.toml": oscillator_text(field),
            "oscillators.c": _c_text(field),
            "poses.csv": pose_table(experiments, fits, note),
        },
        machine_files=("oscillators.toml", "oscillators.c"),
    )


def _checks(
    fits: Sequence[ModalFit | None],
    widened: np.ndarray,
    quantile: float,
    made: Made | None,
    experiments: Sequence[Experiment],
) -> dict[str, Check]:
    """Held-out values inside as often as intervals say; of synthetic data, the fits of single experiments too."""
    # the nine values of a pose are held out together: as if there were one process
    count = len(widened) // 9
    low, _ = binomial_band(count, LEVEL)
    share, least = float(np.mean(widened < quantile)), low / count
    checks = {"coverage_held_out": at_least(share, least, "the poses are too few for this field: measure more")}
    if made is not None:
        inside = [
            fit.interval("k")[0] < made.then[2, n // 3, e.direction] < fit.interval("k")[1]
            for n, (e, fit) in enumerate(zip(experiments, fits, strict=True))
            if fit is not None
        ]
        low, _ = binomial_band(len(inside), LEVEL)
        checks["coverage_of_stiffness"] = at_least(float(np.mean(inside)), low / len(inside))
    return checks


def _coverage_of_truth(problem: Schema, field: OscillatorField, made: Made) -> list[float]:
    """Share of the true logarithms within the 95 % intervals of the field, without and with widening."""
    assert problem.synthetic is not None
    poses = drawn(problem.synthetic, NEW_POSES, problem.synthetic.seed + 1)
    true = dict(zip("mck", np.log(made.field.at(poses)), strict=True))
    q = float(stats.norm.ppf((1 + LEVEL) / 2))
    inside = []
    for (d, name), g in field.processes.items():
        mean, std = g.predict(poses)
        z = np.abs(true[name][:, "xyz".index(d)] - mean) / std
        inside.append([np.mean(z * g.inflation < q), np.mean(z < q)])
    return [float(x) for x in np.mean(inside, axis=0)]


def _repeatability(experiments: Sequence[Experiment], rows: dict[str, np.ndarray]) -> float | None:
    """Mean relative change of m, c, k between successive experiments at one pose and direction; None without any."""
    last: dict[tuple[float, ...], int] = {}
    changes = []
    for n, e in enumerate(experiments):
        key = (*e.pose.tolist(), float(e.direction))
        if key in last:
            changes += [float(np.log(v[n, e.direction] / v[last[key], e.direction])) for v in rows.values()]
        last[key] = n
    told = np.abs([c for c in changes if np.isfinite(c)])
    return float(np.mean(told)) if len(told) else None


def _experiment_rows(experiments: Sequence[Experiment], fits: Sequence[ModalFit | None]) -> list[Row]:
    """Of few experiments each, of many the range by direction."""
    if len(experiments) <= 12:
        return [
            Row(f"{e.source} ({'xyz'[e.direction]})", f"fn {f.fn[0]:.4g} Hz, zeta {f.zeta[0]:.3g}, m {f.m[0]:.4g} kg, "
                f"c {f.c[0]:.4g} N.s/m, k {f.k[0]:.4g} N/m")
            for e, f in zip(experiments, fits, strict=True) if f is not None
        ]  # fmt: skip
    rows = []
    for d, name in enumerate("xyz"):
        own = [f for e, f in zip(experiments, fits, strict=True) if f is not None and e.direction == d]
        spans = [
            f"{q} {min(getattr(f, q)[0] for f in own):.3g}..{max(getattr(f, q)[0] for f in own):.3g}" for q in NAMES
        ]
        rows.append(Row(f"{len(own)} experiments in {name}", ", ".join(spans)))
        error = max(f.log_std("k") for f in own)
        rows.append(Row(f"  largest error of k by noise alone, {name}", f"{error:.2%}"))
    rows.append(Row("every experiment with its intervals", "poses.csv"))
    return rows


def _c_text(field: OscillatorField) -> str:
    head = f"/* SYNTHETIC: {field.synthetic} */\n" if field.synthetic else ""
    return f"{head}/* pose x, y, z [m], A [rad] -> m [kg], c [N.s/m], k [N/m] of x, y, z */\n{field.c_code()}"


def _figures(
    problem: Schema,
    experiments: Sequence[Experiment],
    fits: Sequence[ModalFit | None],
    field: OscillatorField,
    errors: dict[Any, Any],
) -> dict[str, Any]:
    from . import dynamic_stiffness_pictures as pictures

    title = problem.title or "dynamic stiffness"
    return {
        "frequency_response": lambda: pictures.responses(experiments, fits, title, field.synthetic),
        "lowest_frequency": lambda: pictures.lowest(problem, experiments, field, title),
        "held_out": lambda: pictures.held_out(field, errors, title),
    }


def _list(numbers: Sequence[float]) -> str:
    return ", ".join(f"{x:.3g}" for x in numbers)
