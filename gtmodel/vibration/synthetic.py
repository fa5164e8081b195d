"""Synthetic records of known structures with seed and noise: pseudo-random force, steps, hammer hits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..linear.response import late_lag, simulate
from ..linear.state_space import held, second_order
from ..results import ArgumentError
from .modes import matrices
from .options import Hit, Sampling, Steps, SyntheticStructure
from .record import Record


def synthetic_records(known: SyntheticStructure | Steps | Hit, sampling: Sampling) -> list[Record]:
    """Return synthetic recordings of a known system: one, or one for each step. Raises ArgumentError.

    >>> from gtmodel.vibration import Sampling, Steps, synthetic_records
    >>> steps = Steps(a=0.9, b=0.1, delay_samples=2, amplitudes=[1e-3, 2e-3])
    >>> [len(r) for r in synthetic_records(steps, Sampling(seed=1, noise=0.0, samples=50))]
    [50, 50]
    """
    s = sampling
    common = {"samples": s.samples, "sample_time": s.sample_time, "noise": s.noise}
    try:
        if isinstance(known, SyntheticStructure):
            if known.coordinate > len(known.M):
                raise ArgumentError(
                    f"is {known.coordinate}; the structure has {len(known.M)} coordinates", "known.coordinate"
                )
            return [
                structure_record(
                    known.M, known.D, known.K, force=known.force, coordinate=known.coordinate - 1,
                    hold=known.hold_samples, seed=s.seed, **common,
                )
            ]  # fmt: skip
        if isinstance(known, Hit):
            return [hammer_record(known.frequency, known.damping, known.amplitude, seed=s.seed, **common)]
        records = [
            step_record(
                known.a, known.b, known.delay_samples, size, before=known.rest_samples, seed=s.seed + n, **common
            )
            for n, size in enumerate(known.amplitudes)
        ]
    except ValueError as error:
        argument = error.argument if isinstance(error, ArgumentError) else ""
        raise ArgumentError(getattr(error, "sentence", str(error)), argument or "known") from error
    # one note for all records
    seeds = f"seed {s.seed}" if len(records) == 1 else f"seeds {s.seed} to {s.seed + len(records) - 1}"
    return [replace(r, synthetic=f"{seeds}, noise {s.noise:g} m") for r in records]


def structure_record(
    M: ArrayLike,
    D: ArrayLike,
    K: ArrayLike,
    *,
    force: float,
    samples: int,
    sample_time: float,
    noise: float,
    seed: int,
    coordinate: int = 0,
    hold: int = 1,
) -> Record:
    """Return positions of M x'' + D x' + K x = e u for u = +-force [N], drawn anew every `hold` samples.

    noise [m]: standard deviation of the white noise on every position. coordinate: where the force acts, from 0. The
    structure starts at rest; the response is exact for the held input. Raises ArgumentError.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> record.y.shape, record.synthetic
    ((2000, 2), 'seed 1, noise 1e-06 m')
    """
    M, D, K = matrices(M, D, K)
    p = len(M)
    if not 0 <= coordinate < p:
        raise ArgumentError(f"the force acts on coordinate {coordinate}; expected 0 to {p - 1}")
    F = np.eye(p)[:, coordinate : coordinate + 1]
    A, B, C = second_order(M, D, K, F)
    if np.linalg.eigvals(A).real.max() >= 0:
        raise ArgumentError("the structure is unstable or undamped: its response would not stay bounded; change D or K")
    Ad, Bd = held(A, B, sample_time)
    random = np.random.default_rng(seed)
    if hold < 1:
        raise ArgumentError(f"the force is held over {hold} samples; expected at least 1")
    drawn = random.choice([-1.0, 1.0], size=-(-samples // hold))
    u = force * np.repeat(drawn, hold)[:samples, None]
    y = simulate(Ad, Bd, C, np.zeros((p, 1)), u) + noise * random.standard_normal((samples, p))
    return Record(u, y, sample_time, f"seed {seed}, noise {noise:g} m")


def hammer_record(
    frequency_Hz: Sequence[float],
    damping: Sequence[float],
    amplitude: ArrayLike,
    *,
    samples: int,
    sample_time: float,
    noise: float,
    seed: int,
) -> Record:
    """Return positions after a hit at time 0: decaying sines at the damped frequencies, starting at zero.

    frequency_Hz: undamped, by mode; damping: ratio, by mode; amplitude (modes, p) [m]. The input is a column of zeros,
    since the force of a hit is not recorded. Raises ArgumentError.

    >>> record = gt.vibration.hammer_record(
    ...     [7.4], [0.03], [[5e-4]], samples=500, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> record.y.shape, bool(np.abs(record.y).max() < 5e-4)
    ((500, 1), True)
    """
    f, zeta, a = np.array(frequency_Hz, float), np.array(damping, float), np.atleast_2d(np.asarray(amplitude, float))
    if not len(f) == len(zeta) == len(a):
        raise ArgumentError(
            f"{len(f)} frequencies, {len(zeta)} dampings and {len(a)} rows of amplitudes; expected equal numbers"
        )
    if np.any(f <= 0) or np.any(zeta < 0) or np.any(zeta >= 1):
        raise ArgumentError("expected frequencies above 0 and damping ratios from 0 to below 1")
    t = sample_time * np.arange(samples)[:, None]
    w = 2 * np.pi * f
    y = (np.exp(-zeta * w * t) * np.sin(w * np.sqrt(1 - zeta**2) * t)) @ a
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return Record(np.zeros(samples), y, sample_time, f"seed {seed}, noise {noise:g} m")


def step_record(
    a: float,
    b: float,
    delay: int,
    amplitude: float,
    *,
    samples: int,
    before: int,
    sample_time: float,
    noise: float,
    seed: int,
) -> Record:
    """Return the response of b q^-delay / (1 - a q^-1) to a step of the reference [m] after `before` samples at rest.

    delay in samples. noise [m]: standard deviation of the white noise on the position.

    >>> record = gt.vibration.step_record(
    ...     0.9, 0.1, 2, 1e-3, samples=100, before=10, sample_time=0.004, noise=0.0, seed=1
    ... )
    >>> np.flatnonzero(record.y)[0], round(1e3 * float(record.y[-1, 0]), 3)  # mm
    (np.int64(12), 1.0)
    """
    u = np.where(np.arange(samples) >= before, amplitude, 0.0)
    y = late_lag(u, a, b, delay) + noise * np.random.default_rng(seed).standard_normal(samples)
    return Record(u, y, sample_time, f"seed {seed}, noise {noise:g} m")
