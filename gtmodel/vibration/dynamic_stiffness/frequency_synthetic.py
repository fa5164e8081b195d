"""Synthetic hits and receptances of known modes, to see what fits give back."""

from __future__ import annotations

import numpy as np

from .frequency_modes import receptance
from .frequency_response import ORDER, FrequencyResponse, Response

FINER = 8  # steps of the simulation per sample


def synthetic_receptance(
    frequency: np.ndarray, m: np.ndarray, c: np.ndarray, k: np.ndarray, *, noise: float, seed: int | np.random.Generator
) -> FrequencyResponse:
    """H at `frequency` (n,) [Hz] times (1 + noise z), z complex normal of unit variance; modes in parallel.

    m [kg], c [N.s/m], k [N/m]: one number each, or (modes,).

    >>> m, c, k = np.array([200.0]), np.array([4000.0]), np.array([3e6])  # kg, N.s/m, N/m
    >>> measured = gt.vibration.synthetic_receptance(np.arange(5.0, 40.0, 0.25), m, c, k, noise=0.01, seed=1)
    >>> measured.synthetic, (gt.vibration.fit_modes(measured, modes=1).k / 1e6).round(2)  # N/um
    ('seed 1, relative noise 0.01', array([3.]))
    """
    rng = np.random.default_rng(seed)
    H = receptance(2j * np.pi * frequency, *(np.atleast_1d(np.asarray(a, float)) for a in (m, c, k)))
    z = (rng.standard_normal(len(H)) + 1j * rng.standard_normal(len(H))) / np.sqrt(2)
    return FrequencyResponse(frequency, H * (1 + noise * z), synthetic=_said(seed, f"relative noise {noise:g}"))


def synthetic_hits(
    m: np.ndarray, c: np.ndarray, k: np.ndarray, *, sample_rate: float, duration: float, hits: int, noise: float,
    peak: float = 1000.0, width: float = 0.012, measures: Response = "acceleration", seed: int | np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Force [N] and response (hits, T) of modes in parallel, white noise of standard deviation `noise` on the response.

    m [kg], c [N.s/m], k [N/m]: (modes,). sample_rate [Hz], duration [s]. A hit is a raised cosine of `width` s, its
    peak [N] differs by a fifth from hit to hit. Simulated in time with steps of an eighth of a sample, the force
    straight between them.

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
        step = [np.asarray(a) for a in tuple(signal.cont2discrete((A, B, C, D), t[1], method="foh"))[:4]]  # pyright: ignore[reportArgumentType]
        numerator, denominator = signal.ss2tf(*step)  # pyright: ignore[reportArgumentType]
        x += signal.lfilter(numerator[0], denominator, F, axis=1)
    F, x = F[:, ::FINER], x[:, ::FINER]
    return F, x + noise * rng.standard_normal(x.shape)


def _said(seed: int | np.random.Generator, noise: str) -> str:
    return f"seed {seed}, {noise}" if isinstance(seed, int) else noise


__all__ = ["synthetic_hits", "synthetic_receptance"]
