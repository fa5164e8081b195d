"""Kind "dynamic_stiffness": oscillators of an arm from frequency responses, and their field over the pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gtmodel.problem_files.base import Context, InputError, Outcome
from gtmodel.results import SolveStatus
from gtmodel.vibration import Inputs, ModalFit, OscillatorField, fit_modes, fit_oscillator_field

from .dynamic_stiffness_data import Experiment, read_experiments
from .dynamic_stiffness_keys import Schema
from .dynamic_stiffness_printed import NOTE
from .dynamic_stiffness_report import CHANGE, outcome
from .dynamic_stiffness_synthetic import Made, make

NAME = "dynamic_stiffness"

VALUES = {
    "poses": "x, y, z in m and A in rad of each experiment, in the order of its table",
    "direction": "x, y or z of each experiment",
    "mass_kg": "of the most compliant mode, by experiment; null where no mode was found",
    "damping_N_s_m": "likewise",
    "stiffness_N_m": "likewise",
    "frequency_Hz": "undamped natural frequency, likewise",
    "damping_ratio": "likewise",
    "relative_std": "of m, c, k, fn and zeta by experiment, from the noise of its own records",
    "modes": "how many modes were fitted, by experiment",
    "next_mode_Hz": "distance to the nearest other mode; null where there is one",
    "warnings": "of fits, in words",
    "scatter": "standard deviation of a logarithm between experiments at one pose, from the repeatability",
    "repeatability_found": "mean change of m, c and k between experiments at one pose; null where none was repeated",
    "noise_of_process": "standard deviation of a logarithm that the processes found, m, c, k of x, y, z in turn",
    "lengths": "of the processes in units of their scales, x, y, z, A of each direction's m, c, k in turn",
    "inflation": "factor on standard deviations, from held-out poses; m, c, k of x, y, z in turn",
    "leave_one_out_rms": "errors of logarithms when one pose is left out; m, c, k of x, y, z in turn",
    "coverage_leave_one_out": "share of left-out values inside the 95 % intervals before they are widened",
    "coverage_held_out": "share of held-out values inside, before and after widening",
    "coverage_of_truth": "share of the true field inside at new poses, before and after; null for measured data",
    "lowest_Hz": "lowest and highest frequency of the softest direction over the poses",
    "printed": "what is said of printed oscillators; null where none are used",
    "synthetic": "seed and noise of made-up records; null for measured ones",
}


def solve(problem: Schema, context: Context) -> Outcome:
    """Fit every experiment, then the processes, then hold out poses."""
    inputs = _inputs(problem)
    scatter = problem.repeatability / CHANGE
    given = [k for k in ("measured", "synthetic") if getattr(problem, k) is not None]
    if len(given) != 1:
        raise InputError("expected one of [measured] and [synthetic]", given[-1] if given else "measured")
    context.progress("reading", 0.05)
    made = None
    if problem.synthetic is not None:
        made = make(problem.synthetic, problem.fit, inputs, scatter)
        experiments = made.experiments
    else:
        assert problem.measured is not None
        experiments = read_experiments(problem.measured.index, problem.fit, context)
    fits: list[ModalFit | None] = []
    warnings: list[str] = []
    for n, experiment in enumerate(experiments):
        if context.interrupted():
            return Outcome(
                status=SolveStatus.INTERRUPTED, message=f"stopped after {n} of {len(experiments)} experiments"
            )
        context.progress("fitting modes", 0.1 + 0.5 * n / len(experiments))
        fit, said = _fitted(problem, experiment)
        fits.append(fit)
        warnings += [f"{experiment.source}: {text}" for text in said]
    context.progress("fitting processes", 0.7)
    field, errors, rows = _field(problem, experiments, fits, made)
    return outcome(problem, experiments, fits, warnings, field, errors, rows, made)


def explain(problem: Schema, context: Context) -> str:
    """What will be fitted."""
    s = problem.synthetic
    n = "synthetic ones" if s is None else f"{3 * s.poses} SYNTHETIC ones, seed {s.seed}"
    lines = [
        f"{problem.title or NAME}: experiments: {'measured ones' if problem.measured else n}",
        "m x'' + c x' + k x = F in x, y and z, several modes in parallel (Cvitanic 2021, eq. (8))",
        "log m, log c, log k over x, y, z and A: nine exact Gaussian processes (eqs. (9)-(11))",
        f"experiments at one pose differ by {problem.repeatability:.0%} on average",
    ]
    return "\n".join([*lines, NOTE] if s else lines)


def _inputs(problem: Schema) -> Inputs:
    p = problem.process
    return Inputs((*p.scale_m, float(np.deg2rad(p.scale_deg))), (False, False, False, p.periodic))


def _fitted(problem: Schema, experiment: Experiment) -> tuple[ModalFit | None, tuple[str, ...]]:
    f = problem.fit
    if not 0 < f.search_Hz[0] < f.search_Hz[1]:
        raise InputError("expected a lower and a higher frequency", "fit.search_Hz")
    noise = f.relative_noise
    if noise is None and problem.synthetic is not None and problem.synthetic.records == "receptance":
        noise = problem.synthetic.relative_noise
    try:
        fit = fit_modes(
            experiment.response, f.modes, band=None if f.band_Hz is None else (f.band_Hz[0], f.band_Hz[1]),
            search=(f.search_Hz[0], f.search_Hz[1]), noise=noise, most=f.most,
        )  # fmt: skip
    except ValueError as error:
        return None, (f"left out: {error}",)
    return fit, fit.notes


def _field(
    problem: Schema, experiments: Sequence[Experiment], fits: Sequence[ModalFit | None], made: Made | None
) -> tuple[OscillatorField, dict[Any, Any], dict[str, np.ndarray]]:
    """The field, held-out errors, and m, c, k (n, 3) with one row per experiment."""
    poses = np.array([e.pose for e in experiments])
    values = {q: np.full((len(poses), 3), np.nan) for q in "mck"}
    for n, (experiment, fit) in enumerate(zip(experiments, fits, strict=True)):
        if fit is not None:
            for q in "mck":
                values[q][n, experiment.direction] = getattr(fit, q)[0]
    p = problem.process
    for d, name in enumerate("xyz"):
        told = len(np.unique(poses[np.isfinite(values["m"][:, d])].round(9), axis=0))
        least = len(p.scale_m) + 4  # one is held out
        if told < least:
            key = "synthetic" if problem.measured is None else "measured.index"
            raise InputError(
                f"experiments in {name} gave a mode at {told} different poses; a field takes {least} or more",
                key,
            )
    note = None if made is None else made.note
    field, errors = fit_oscillator_field(
        poses, values["m"], values["c"], values["k"], scale=_inputs(problem).scale, periodic=p.periodic,
        shape=p.covariance, shared=p.shared, starts=p.starts, seed=p.seed, synthetic=note,
    )  # fmt: skip
    return field, errors, values


__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]
