"""Made-up experiments of kind "dynamic_stiffness": poses, hits with noise, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmodel.problem_files.base import InputError
from gtmodel.vibration import (
    Inputs,
    SyntheticField,
    frequency_response,
    synthetic_field,
    synthetic_hits,
    synthetic_receptance,
)

from .dynamic_stiffness_data import Experiment
from .dynamic_stiffness_keys import Fit, Synthetic
from .dynamic_stiffness_printed import table_16

LOWEST_HZ = 1.0  # of made-up receptances


@dataclass(frozen=True, eq=False)
class Made:
    """Experiments, the field they were made from, and m, c, k (n, 3) of each at its own time: the field changed by the
    scatter of repeated experiments."""

    experiments: list[Experiment]
    field: SyntheticField
    poses: np.ndarray
    then: np.ndarray
    note: str


def box(s: Synthetic) -> np.ndarray:
    """Limits (4, 2) of the poses, in m and rad. Raises InputError."""
    limits = np.array([*s.box_m, np.deg2rad(s.box_deg)], float)
    if np.any(limits[:, 0] >= limits[:, 1]):
        raise InputError("expected a lower and a higher limit", "synthetic.box_m")
    return limits


def drawn(s: Synthetic, count: int, seed: int) -> np.ndarray:
    """Poses (count, 4) spread over the box."""
    from scipy.stats import qmc

    limits = box(s)
    unit = qmc.LatinHypercube(4, rng=np.random.default_rng(seed)).random(count)
    return limits[:, 0] + unit * (limits[:, 1] - limits[:, 0])


def make(s: Synthetic, fit: Fit, inputs: Inputs, scatter: float) -> Made:
    """Every pose is hit in x, y and z; `scatter`: standard deviation of log m, c, k between experiments."""
    printed = table_16()
    field = synthetic_field(printed.poses, printed.m, printed.c, printed.k, inputs, np.array(s.lengths), seed=s.seed)
    poses = drawn(s, s.poses, s.seed)
    rng = np.random.default_rng(s.seed)
    then = np.stack(field.at(poses)) * np.exp(scatter * rng.standard_normal((3, len(poses), 3)))
    experiments = []
    for n, pose in enumerate(poses):
        for d in range(3):
            m, c, k = then[:, n, d]
            name = f"pose {n} in {'xyz'[d]}"
            experiments.append(Experiment(pose, d, _measured(s, fit, m, c, k, rng, name), name))
    noise = f"{s.noise_m_s2:g} m/s2" if s.records == "hits" else f"{s.relative_noise:g} of each receptance"
    note = f"seed {s.seed}, noise {noise}, scatter {scatter:.3g} of each logarithm, field near {s.near}"
    return Made(experiments, field, poses, then, note)


def _measured(s: Synthetic, fit: Fit, m: float, c: float, k: float, rng: np.random.Generator, name: str):
    if s.records == "receptance":
        lines = np.arange(LOWEST_HZ, s.sample_rate_Hz / 2.56, 1 / s.duration_s)
        return synthetic_receptance(lines, *map(np.atleast_1d, (m, c, k)), noise=s.relative_noise, seed=rng)
    F, x = synthetic_hits(
        *map(np.atleast_1d, (m, c, k)), sample_rate=s.sample_rate_Hz, duration=s.duration_s, hits=s.hits,
        noise=s.noise_m_s2, seed=rng,
    )  # fmt: skip
    try:
        return frequency_response(
            F, x, s.sample_rate_Hz, estimator=fit.estimator, force_window=fit.force_window_s, decay=fit.decay_1_s
        )
    except ValueError as error:
        raise InputError(f"{name}: {error}", "synthetic") from error
