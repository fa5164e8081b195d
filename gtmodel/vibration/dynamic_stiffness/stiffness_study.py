"""The study of dynamic stiffness: oscillators of an arm from frequency responses, their field over the pose, and the
prediction of held-out poses; its table of experiments and its plots."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Unpack

import numpy as np

from ...inference import binomial_band
from ...results import ArgumentError, Check, SolveStatus, Work, at_least
from ...results.options import Within
from ...results.work import WorkOptions, study_function
from ..vibration_result import entitled
from .experiments import Experiment
from .modal_fit import ModalFit, fit_modes
from .options import NAMES, QUANTITIES, DynamicStiffnessStudy, FrequencyMap, ModalFitting, Process
from .oscillator_field import OscillatorField, fit_oscillator_field, oscillator_text
from .synthetic import CHANGE, SyntheticExperiments, inputs_of

if TYPE_CHECKING:
    from .options import Fits

_UNITS = {"m": "kg", "c": "N.s/m", "k": "N/m", "fn": "Hz", "zeta": "1"}


def pose_table(experiments: Sequence[Experiment], fits: Sequence[ModalFit | None], note: str | None) -> str:
    """CSV of pose, m, c, k, fn, zeta with the ends of their 95 % intervals (from the noise of the records alone)."""
    out = io.StringIO()
    if note:
        out.write(f"# SYNTHETIC: {note}\n")
    writer = csv.writer(out, lineterminator="\n")
    heads = [f"{n}{end} [{_UNITS[n]}]" for n in NAMES for end in ("", "_low", "_high")]
    writer.writerow(
        ["x [m]", "y [m]", "z [m]", "A [rad]", "direction", "source", "modes", "next_mode [Hz]", *heads, "note"]
    )
    for e, f in zip(experiments, fits, strict=True):
        start = [*map(repr, e.pose.tolist()), "xyz"[e.direction], e.source]
        if f is None:
            writer.writerow([*start, 0, "", *[""] * len(heads), "no mode was found"])
            continue
        numbers = [repr(float(x)) for n in NAMES for x in (getattr(f, n)[0], *f.interval(f"{n}[0]"))]
        distance = "" if f.next_mode is None else repr(f.next_mode)
        writer.writerow([*start, len(f.m), distance, *numbers, "; ".join(f.notes)])
    return out.getvalue()


_ORDER = ("x", "y", "z", "A")


def responses(experiments: Sequence[Experiment], fits: Sequence[ModalFit | None], title: str, note: str | None) -> Any:
    """The first experiment with a mode in each direction."""
    from ...plot.compliance import response_figure

    by_direction = {}
    for e, fit in zip(experiments, fits, strict=True):
        if fit is not None:
            by_direction.setdefault(
                e.direction,
                (
                    f"{e.source}" if "xyz"[e.direction] in e.source else f"{e.source} ({'xyz'[e.direction]})",
                    e.response,
                    fit,
                ),
            )
    return response_figure([by_direction[d] for d in sorted(by_direction)], title=entitled(title, note))


def lowest(map: FrequencyMap, experiments: Sequence[Experiment], field: OscillatorField, title: str) -> Any:
    """Lowest frequency over two coordinates within the poses; the others are constant."""
    from ...plot.compliance import lowest_frequency_figure

    over = [_ORDER.index(c) for c in map.over]
    poses = np.array([e.pose for e in experiments])
    low, high = poses.min(axis=0), poses.max(axis=0)
    low, high = np.where(high > low, low, low - 0.5), np.where(high > low, high, high + 0.5)
    pose = (poses.min(axis=0) + poses.max(axis=0)) / 2
    if map.at is not None:
        pose[:3] = map.at
    if map.at_angle is not None:
        pose[3] = map.at_angle
    u, v = (np.linspace(low[c], high[c], map.points) for c in over)
    grid = np.tile(pose, (len(u) * len(v), 1))
    grid[:, over[0]], grid[:, over[1]] = (a.ravel() for a in np.meshgrid(u, v))
    fn = field.value("fn", grid)
    limits = field.prediction_interval("fn", grid)
    softest = fn.argmin(axis=1)
    rows = np.arange(len(grid))
    wide = np.log(limits[rows, softest, 1] / limits[rows, softest, 0]) / 2
    shape = (len(v), len(u))
    unit = [np.rad2deg(1.0) if c == 3 else 1.0 for c in over]
    names = [f"{_ORDER[c]} [{'deg' if c == 3 else 'm'}]" for c in over]
    constants = ", ".join(
        f"{_ORDER[c]} = {np.rad2deg(pose[c]) if c == 3 else pose[c]:.3g} {'deg' if c == 3 else 'm'}"
        for c in range(4)
        if c not in over
    )
    return lowest_frequency_figure(
        u * unit[0], v * unit[1], fn.min(axis=1).reshape(shape), wide.reshape(shape), poses[:, over] * unit,
        names=(names[0], names[1]), title=entitled(f"{title}\nat {constants}", field.synthetic),
    )  # fmt: skip


def held_out(field: OscillatorField, errors: dict[Any, Any], title: str) -> Any:
    """Held-out values against their predictions."""
    from ...plot.compliance import held_out_figure

    panels = {}
    for key, (error, std) in errors.items():
        g = field.processes[key]
        panels[f"{key[1]} in {key[0]}"] = (np.exp(g.y - error), np.exp(g.y), std * g.inflation)
    return held_out_figure(panels, title=entitled(title, field.synthetic))


Array = np.ndarray
LEVEL = 0.95
QUANTILE = 1.959963984540054  # of the normal distribution, two-sided, at this level


@study_function
def dynamic_stiffness_study(
    experiments: Sequence[Experiment] | SyntheticExperiments,
    *,
    fit: ModalFitting | None = None,
    process: Process | None = None,
    map: FrequencyMap | None = None,
    repeatability: Annotated[float, Within(above=0.0)] = 0.15,
    **work_options: Unpack[WorkOptions],
) -> DynamicStiffnessStudy:
    """Fit mass, damping and stiffness of an arm in x, y and z over its poses to frequency responses.

    Args:
        experiments: from `read_experiments`, or synthetic ones from `synthetic_experiments`, compared with their truth.
        fit: how modes are fitted to each response. process: the Gaussian processes of log m, log c and log k.
        map: the plot of the lowest frequency.
        repeatability: mean relative change of m, c and k between experiments at one pose.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted study has the experiments fitted so far and no field. Raises ArgumentError.

    >>> from gtmodel.robots.kuka import table_16
    >>> from gtmodel.vibration.dynamic_stiffness import Process, SyntheticArm, synthetic_experiments
    >>> made = synthetic_experiments(table_16(), SyntheticArm(seed=1, poses=12, records="receptance"))
    >>> s = gt.vibration.dynamic_stiffness_study(made, process=Process(starts=1))
    >>> s.field.at(made.poses[0])[0].shape
    (3,)
    """
    work = Work(**work_options)
    synthetic = experiments if isinstance(experiments, SyntheticExperiments) else None
    all_experiments = list(synthetic.experiments if synthetic else experiments)  # type: ignore[arg-type]
    fit, process, map = fit or ModalFitting(), process or Process(), map or FrequencyMap()
    if not 0 < fit.search[0] < fit.search[1]:
        raise ArgumentError("expected a lower and a higher frequency", "fit.search")
    if map.over[0] == map.over[1]:
        raise ArgumentError("expected two different coordinates", "map.over")
    fits: list[ModalFit | None] = []
    all_notes: list[str] = []
    for n, experiment in enumerate(all_experiments):
        if work.interrupted():
            return DynamicStiffnessStudy(
                status=SolveStatus.INTERRUPTED,
                message=f"stopped after {n} of {len(all_experiments)} experiments",
                title=work.title,
                **_by_experiment(all_experiments[:n], fits, all_notes, repeatability),
            )
        work.progress("fitting modes", 0.1 + 0.5 * n / len(all_experiments))
        modal, notes = _fitted(experiment, fit, None if synthetic is None else synthetic.relative_noise)
        fits.append(modal)
        all_notes += [f"{experiment.source}: {text}" for text in notes]
    work.progress("fitting processes", 0.7)
    rows = _rows_of(all_experiments, fits)
    field, errors = _field(all_experiments, rows, process, None if synthetic is None else synthetic.note)
    processes = list(field.processes.values())
    # a direction may lack poses, so that rows differ in length: concatenate them
    z = [np.abs(e / s) for e, s in errors.values()]
    widened = np.concatenate([row / g.inflation for row, g in zip(z, processes, strict=True)])
    left_out = [g.leave_one_out() for g in processes]
    left_z = np.concatenate([np.abs(e / s) * g.inflation for (e, s), g in zip(left_out, processes, strict=True)])
    softest = field.value("fn", np.array([e.pose for e in all_experiments])).min(axis=1)
    name = work.title or "dynamic stiffness"
    return DynamicStiffnessStudy(
        status=SolveStatus.SOLVED,
        message=f"{sum(f is not None for f in fits)} of {len(fits)} experiments, nine processes",
        title=work.title,
        checks=_checks(fits, widened, synthetic, all_experiments),
        figures={
            "frequency_response": partial(responses, all_experiments, fits, name, field.synthetic),
            "lowest_frequency": partial(lowest, map, all_experiments, field, name),
            "held_out": partial(held_out, field, errors, name),
        },
        files={
            "oscillators.toml": oscillator_text(field),
            "oscillators.c": _c_text(field),
            "poses.csv": pose_table(all_experiments, fits, field.synthetic),
        },
        machine_files=("oscillators.toml", "oscillators.c"),
        **_by_experiment(all_experiments, fits, all_notes, repeatability),
        measured_repeatability=_repeatability(all_experiments, rows),
        noise_of_process=[g.noise for g in processes],
        lengths=[g.lengths for g in processes],
        inflation=[g.inflation for g in processes],
        leave_one_out_rms=[float(np.sqrt(np.mean(e**2))) for e, _ in left_out],
        coverage_leave_one_out=float(np.mean(left_z < QUANTILE)),
        coverage_held_out=[float(np.mean(np.concatenate(z) < QUANTILE)), float(np.mean(widened < QUANTILE))],
        coverage_of_truth=None if synthetic is None else _coverage_of_truth(field, synthetic),
        lowest=[float(softest.min()), float(softest.max())],
        printed=None if synthetic is None else synthetic.printed,
        synthetic=field.synthetic,
        field=field,
    )


def _by_experiment(experiments: Sequence[Experiment], fits: Fits, notes: Sequence[str], repeatability: float) -> Any:
    """The quantities of single experiments."""
    values = np.array([[np.nan] * 5 if f is None else [getattr(f, n)[0] for n in NAMES] for f in fits])
    return {
        "poses": np.array([e.pose for e in experiments]),
        "direction": ["xyz"[e.direction] for e in experiments],
        **dict(zip(QUANTITIES, values.reshape(-1, 5).T, strict=True)),
        "relative_std": [None if f is None else [f.log_std(n) for n in NAMES] for f in fits],
        "modes": [0 if f is None else len(f.m) for f in fits],
        "next_mode": [None if f is None else f.next_mode for f in fits],
        "notes": list(notes),
        "scatter": repeatability / CHANGE,
        "experiments": experiments,
        "fits": fits,
    }


def _fitted(
    experiment: Experiment, f: ModalFitting, relative_noise: float | None
) -> tuple[ModalFit | None, Sequence[str]]:
    try:
        fit = fit_modes(
            experiment.response, f.modes, band=None if f.band is None else (f.band[0], f.band[1]),
            search=(f.search[0], f.search[1]),
            noise=relative_noise if f.relative_noise is None else f.relative_noise, most=f.most,
        )  # fmt: skip
    except ValueError as error:
        return None, (f"not used: {error}",)
    return fit, fit.notes


def _rows_of(experiments: Sequence[Experiment], fits: Fits) -> dict[str, Array]:
    """m, c, k (n, 3) with one row per experiment; NaN for what it does not determine."""
    rows = {q: np.full((len(experiments), 3), np.nan) for q in "mck"}
    for n, (experiment, fit) in enumerate(zip(experiments, fits, strict=True)):
        if fit is not None:
            for q in "mck":
                rows[q][n, experiment.direction] = getattr(fit, q)[0]
    return rows


def _field(
    experiments: Sequence[Experiment], rows: Mapping[str, Array], p: Process, note: str | None
) -> tuple[OscillatorField, dict[Any, Any]]:
    """The field and the held-out errors."""
    poses = np.array([e.pose for e in experiments])
    for d, name in enumerate("xyz"):
        count = len(np.unique(poses[np.isfinite(rows["m"][:, d])].round(9), axis=0))
        least = len(p.scale) + 4  # one is held out
        if count < least:
            raise ArgumentError(
                f"experiments in {name} gave a mode at {count} different poses; a field needs {least} or more",
                "experiments",
            )
    return fit_oscillator_field(
        poses, rows["m"], rows["c"], rows["k"], scale=inputs_of(p).scale, periodic=p.periodic,
        shape=p.covariance, shared=p.shared, starts=p.starts, seed=p.seed, synthetic=note,
    )  # fmt: skip


def _checks(
    fits: Fits, widened: Array, synthetic: SyntheticExperiments | None, experiments: Sequence[Experiment]
) -> dict[str, Check]:
    """Coverage of held-out values; for synthetic data also of the fits of single experiments."""
    # the nine values of a pose are held out together: count them as one
    count = len(widened) // 9
    low, _ = binomial_band(count, LEVEL)
    share, least = float(np.mean(widened < QUANTILE)), low / count
    checks = {"coverage_held_out": at_least(share, least, "too few poses for this field: measure more")}
    if synthetic is not None:
        inside = [
            fit.interval("k[0]")[0] < synthetic.then[2, n // 3, e.direction] < fit.interval("k[0]")[1]
            for n, (e, fit) in enumerate(zip(experiments, fits, strict=True))
            if fit is not None
        ]
        low, _ = binomial_band(len(inside), LEVEL)
        checks["coverage_of_stiffness"] = at_least(float(np.mean(inside)), low / len(inside))
    return checks


def _coverage_of_truth(field: OscillatorField, synthetic: SyntheticExperiments) -> list[float]:
    """Share of the true logarithms inside the 95 % intervals of the field, before and after inflation."""
    true: dict[str, np.ndarray] = dict(zip("mck", np.log(synthetic.field.at(synthetic.new)), strict=True))
    inside = []
    for (d, name), g in field.processes.items():
        mean, std = g.predict(synthetic.new)
        z = np.abs(true[name][:, "xyz".index(d)] - mean) / std
        inside.append([np.mean(z * g.inflation < QUANTILE), np.mean(z < QUANTILE)])
    return [float(x) for x in np.mean(inside, axis=0)]


def _repeatability(experiments: Sequence[Experiment], rows: Mapping[str, Array]) -> float | None:
    """Mean relative change of m, c, k between successive experiments at one pose and direction; None without any."""
    last: dict[tuple[float, ...], int] = {}
    changes = []
    for n, e in enumerate(experiments):
        key = (*e.pose.tolist(), float(e.direction))
        if key in last:
            changes += [float(np.log(v[n, e.direction] / v[last[key], e.direction])) for v in rows.values()]
        last[key] = n
    sizes = np.abs([c for c in changes if np.isfinite(c)])
    return float(np.mean(sizes)) if len(sizes) else None


def _c_text(field: OscillatorField) -> str:
    head = f"/* SYNTHETIC: {field.synthetic} */\n" if field.synthetic else ""
    return f"{head}/* pose x, y, z [m], A [rad] -> m [kg], c [N.s/m], k [N/m] of x, y, z */\n{field.c_code()}"
