"""Synthetic hits, receptances, oscillator fields and experiments: a known truth to test fits with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy

from ...results import ArgumentError
from .experiments import ORDER, Experiment, FrequencyResponse, Response, frequency_response
from .gaussian_process import KernelInputs, correlation, square_distances
from .modal_fit import receptance
from .options import NEW_POSES, ModalFitting, Process, SyntheticArm

FINER = 8  # steps of the simulation per sample


def synthetic_receptance(
    frequency: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray, *, noise: float, seed: int | np.random.Generator
) -> FrequencyResponse:
    """Return H at `frequency` (n,) [Hz] times (1 + noise z), z complex normal of unit variance; parallel modes.

    m [kg], c [N.s/m], k [N/m]: one number each, or (modes,).

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> measured = gt.vibration.synthetic_receptance(np.arange(5.0, 40.0, 0.25), m, c, k, noise=0.01, seed=1)
    >>> measured.synthetic, (gt.vibration.fit_modes(measured, modes=1).k / 1e6).round(2)  # N/um
    ('seed 1, relative noise 0.01', array([3.]))
    """
    rng = np.random.default_rng(seed)
    H = receptance(2j * np.pi * frequency, *(np.atleast_1d(np.asarray(a, float)) for a in (m, c, k)))
    z = (rng.standard_normal(len(H)) + 1j * rng.standard_normal(len(H))) / np.sqrt(2)
    return FrequencyResponse(frequency, H * (1 + noise * z), synthetic=_note(seed, f"relative noise {noise:g}"))


def synthetic_hits(
    m: np.ndarray, c: np.ndarray, k: np.ndarray, *, sample_rate: float, duration: float, hits: int, noise: float,
    peak: float = 1000.0, width: float = 0.012, measures: Response = "acceleration", seed: int | np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return force [N] and response (hits, T) of parallel modes, with white noise of standard deviation `noise` on the
    response.

    m [kg], c [N.s/m], k [N/m]: (modes,). sample_rate [Hz], duration [s]. A hit is a raised cosine of `width` s; its
    peak [N] varies by a fifth from hit to hit. The simulation has steps of an eighth of a sample and a piecewise linear
    force.

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> force, acceleration = gt.vibration.synthetic_hits(
    ...     m, c, k, sample_rate=1000.0, duration=4.0, hits=4, noise=0.01, seed=1
    ... )
    >>> force.shape, bool(force.max() > 500.0)
    ((4, 4000), True)
    """
    from scipy import signal

    rng = np.random.default_rng(seed)
    t = np.arange(FINER * round(duration * sample_rate)) / (FINER * sample_rate)
    pulse = np.where(t < width, (1 - np.cos(2 * np.pi * t / width)) / 2, 0.0)
    F = pulse * peak * (1 + 0.2 * rng.standard_normal((hits, 1)))
    x = np.zeros_like(F)
    for mass, damping, stiffness in zip(*(np.atleast_1d(a) for a in (m, c, k)), strict=True):
        A = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
        rows = np.array([[1.0, 0.0], [0.0, 1.0], A[1]])
        B, D = np.array([[0.0], [1 / mass]]), np.array([[0.0], [0.0], [1 / mass]])
        order = ORDER[measures]
        C, D = rows[order : order + 1], D[order : order + 1]
        step = [np.asarray(a) for a in tuple(signal.cont2discrete((A, B, C, D), t[1], method="foh"))[:4]]
        numerator, denominator = signal.ss2tf(*step)
        x += signal.lfilter(numerator[0], denominator, F, axis=1)
    F, x = F[:, ::FINER], x[:, ::FINER]
    return F, x + noise * rng.standard_normal(x.shape)


def _note(seed: int | np.random.Generator, noise: str) -> str:
    return f"seed {seed}, {noise}" if isinstance(seed, int) else noise


WAVES = 500  # cosines in a draw: its covariance is accurate to a few per cent
NEAR = 0.01  # relative variance of the correction: exact interpolation of close poses would make the field steep


@dataclass(frozen=True, eq=False)
class SyntheticField:
    """Nine smooth functions over the pose: draws of a squared exponential process that pass near prescribed logarithms.

    Made by synthetic_field(). `at` is like that of OscillatorField, but gives the truth.
    """

    inputs: KernelInputs
    frequencies: np.ndarray  # (WAVES, e)
    phases: np.ndarray  # (WAVES,)
    shares: np.ndarray  # (WAVES, 9)
    given: np.ndarray  # coordinates of the prescribed poses (n, e)
    corrections: np.ndarray  # (n, 9)
    mean: np.ndarray  # (9,)
    lengths: np.ndarray

    def at(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """m [kg], c [N.s/m], k [N/m] of x, y, z: (n, 3) each at poses (n, 4)."""
        c = self.inputs.coordinates(np.asarray(poses, float)) / self.lengths[list(self.inputs.owners)]
        logs = (
            self.mean
            + _waves(c, self.frequencies, self.phases) @ self.shares
            + _between(c, self.given) @ self.corrections
        )
        m, damping, k = np.exp(logs).reshape(-1, 3, 3).transpose(1, 0, 2)
        return m, damping, k


def synthetic_field(
    poses: np.ndarray,
    m: np.ndarray,
    c: np.ndarray,
    k: np.ndarray,
    inputs: KernelInputs,
    lengths: np.ndarray,
    *,
    seed: int,
) -> SyntheticField:
    """Return a synthetic field near m, c, k (n, 3) at poses (n, 4), with `lengths` (4,) relative to the scales of
    `inputs`.

    The spread between the prescribed poses is that of the prescribed values. Matheron's rule: a draw of random cosines,
    corrected towards the prescribed values (Wilson et al. 2020, ICML).

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> inputs = gt.vibration.KernelInputs(scale=(0.5, 0.5, 0.5, 1.0), periodic=(False, False, False, True))
    >>> truth = gt.vibration.synthetic_field(poses, m, c, k, inputs, np.array([2.0, 0.8, 2.0, 0.8]), seed=4)
    >>> bool(np.abs(truth.at(poses)[2] / k - 1).max() < 0.1)  # stiffness at the given poses
    True
    """
    rng = np.random.default_rng(seed)
    logs = np.log(np.hstack([m, c, k]))
    mean, spread = logs.mean(axis=0), logs.std(axis=0)
    lengths = np.asarray(lengths, float)
    given = inputs.coordinates(np.asarray(poses, float)) / lengths[list(inputs.owners)]
    frequencies = rng.standard_normal((WAVES, given.shape[1]))
    phases = rng.uniform(0, 2 * np.pi, WAVES)
    shares = rng.standard_normal((WAVES, logs.shape[1])) * spread
    K = _between(given, given) + NEAR * np.eye(len(given))
    missing = logs - mean - _waves(given, frequencies, phases) @ shares
    return SyntheticField(
        inputs,
        frequencies,
        phases,
        shares,
        given,
        scipy.linalg.cho_solve(scipy.linalg.cho_factor(K), missing),
        mean,
        lengths,
    )


def _waves(c: np.ndarray, frequencies: np.ndarray, phases: np.ndarray) -> np.ndarray:
    return np.sqrt(2 / len(phases)) * np.cos(c @ frequencies.T + phases)


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return correlation(square_distances(a, b, (0,) * a.shape[1])[0], "squared_exponential")


LOWEST_HZ = 1.0  # of synthetic receptances
CHANGE = 2 / np.sqrt(np.pi)  # mean absolute difference of two normal values of unit standard deviation


class PrintedOscillators(Protocol):
    """Known oscillators near a synthetic field: poses (n, 4), m, c, k (n, 3), and a note on them."""

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
    """Experiments, the field behind them, and the true m, c, k (n, 3) of each (`then`): the field with the scatter of
    repeated experiments.

    new: poses where the fitted field is compared with the true one. printed: note on the printed oscillators.
    relative_noise: of receptances, None for hits.
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
    """Draw a field near the oscillators of `near` and hit every pose in x, y and z. Raises ArgumentError.

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
    """Poses (count, 4) that fill the box."""
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


__all__ = ["synthetic_hits", "synthetic_receptance"]
