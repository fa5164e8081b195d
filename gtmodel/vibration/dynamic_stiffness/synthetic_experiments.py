"""Synthetic experiments: poses, hits with noise, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...results import ArgumentError
from .experiments import Experiment
from .frequency_response import FrequencyResponse, frequency_response
from .frequency_synthetic import synthetic_hits, synthetic_receptance
from .gaussian_process_kernel import KernelInputs
from .options import NEW_POSES, ModalFitting, Process, SyntheticArm
from .oscillator_field_synthetic import SyntheticField, synthetic_field

LOWEST_HZ = 1.0  # of synthetic receptances
CHANGE = 2 / np.sqrt(np.pi)  # mean size of the difference of two values of unit standard deviation


class PrintedOscillators(Protocol):
    """Known oscillators near which a synthetic field lies: poses (n, 4), m, c, k (n, 3), and words on them."""

    @property
    def poses(self) -> np.ndarray: ...
    @property
    def m(self) -> np.ndarray: ...
    @property
    def c(self) -> np.ndarray: ...
    @property
    def k(self) -> np.ndarray: ...
    @property
    def note(self) -> str: ...
    @property
    def name(self) -> str: ...


def inputs_of(p: Process) -> KernelInputs:
    """Scales and periods of the pose."""
    return KernelInputs((*p.scale, p.angle_scale), (False, False, False, p.periodic))


@dataclass(frozen=True, eq=False)
class SyntheticExperiments:
    """Experiments, the field they were made from, and m, c, k (n, 3) of each at its own time: the field changed by the
    scatter of repeated experiments.

    new: poses where the fitted field is compared with the true one. printed: what is to be said of the oscillators
    behind it. relative_noise: of receptances, None for hits.
    """

    experiments: list[Experiment]
    field: SyntheticField
    poses: np.ndarray
    then: np.ndarray
    new: np.ndarray
    note: str
    printed: str
    relative_noise: float | None


def synthetic_experiments(
    near: PrintedOscillators,
    synthetic: SyntheticArm,
    *,
    fit: ModalFitting | None = None,
    process: Process | None = None,
    repeatability: float = 0.15,
) -> SyntheticExperiments:
    """Every pose is hit in x, y and z, on a field through the poses of `near`. Raises ArgumentError.

    fit: estimator and windows of the hits; process: scales of the pose; repeatability: mean change of m, c and k
    between experiments at one pose.
    """
    s, fit, scatter = synthetic, fit or ModalFitting(), repeatability / CHANGE
    inputs = inputs_of(process or Process())
    field = synthetic_field(near.poses, near.m, near.c, near.k, inputs, np.array(s.lengths), seed=s.seed)
    poses = _drawn(s, s.poses, s.seed)
    rng = np.random.default_rng(s.seed)
    then = np.stack(field.at(poses)) * np.exp(scatter * rng.standard_normal((3, len(poses), 3)))
    experiments = []
    for n, pose in enumerate(poses):
        for d in range(3):
            m, c, k = then[:, n, d]
            name = f"pose {n} in {'xyz'[d]}"
            experiments.append(Experiment(pose, d, _measured(s, fit, m, c, k, rng, name), name))
    noise = f"{s.noise:g} m/s2" if s.records == "hits" else f"{s.relative_noise:g} of each receptance"
    note = f"seed {s.seed}, noise {noise}, scatter {scatter:.3g} of each logarithm, field near {near.name}"
    relative = s.relative_noise if s.records == "receptance" else None
    new = _drawn(s, NEW_POSES, s.seed + 1)
    return SyntheticExperiments(experiments, field, poses, then, new, note, near.note, relative)


def _drawn(s: SyntheticArm, count: int, seed: int) -> np.ndarray:
    """Poses (count, 4) spread over the box."""
    from scipy.stats import qmc

    if len(s.box) != 3 or any(len(ends) != 2 or ends[0] >= ends[1] for ends in (*s.box, s.box_angle)):
        raise ArgumentError("expected a lower and a higher limit of x, y and z", "synthetic.box")
    limits = np.array([*s.box, s.box_angle], float)
    unit = qmc.LatinHypercube(4, rng=np.random.default_rng(seed)).random(count)
    return limits[:, 0] + unit * (limits[:, 1] - limits[:, 0])


def _measured(
    s: SyntheticArm, fit: ModalFitting, m: float, c: float, k: float, rng: np.random.Generator, name: str
) -> FrequencyResponse:
    if s.records == "receptance":
        lines = np.arange(LOWEST_HZ, s.sample_rate / 2.56, 1 / s.duration)
        return synthetic_receptance(lines, *map(np.atleast_1d, (m, c, k)), noise=s.relative_noise, seed=rng)
    F, x = synthetic_hits(
        *map(np.atleast_1d, (m, c, k)), sample_rate=s.sample_rate, duration=s.duration, hits=s.hits, noise=s.noise,
        seed=rng,
    )  # fmt: skip
    try:
        return frequency_response(
            F, x, s.sample_rate, estimator=fit.estimator, force_window=fit.force_window, decay=fit.decay
        )
    except ValueError as error:
        raise ArgumentError(f"{name}: {error}", "synthetic") from error
