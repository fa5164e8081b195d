"""Synthetic recordings of one motion by two clocks."""

from __future__ import annotations

import numpy as np

from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from .options import SyntheticDelay

FREQUENCIES = np.array([0.31, 0.83, 1.71, 2.9])  # Hz
AMPLITUDES = np.array([0.6, 0.3, 0.15, 0.05])  # rad
GAP = 10  # rows


def made_pair(options: SyntheticDelay) -> tuple[Trajectory, Trajectory]:
    """The reference and the late recording, each with the signal q [rad]; they say that they are synthetic.

    >>> first, late = gt.measurements.made_pair(gt.measurements.SyntheticDelay(jitter=0.3, missing=0.02))
    >>> len(first) < 2501, first.synthetic[:9]
    (True, 'synthetic')
    """
    rng = np.random.default_rng(options.seed)
    phase = rng.uniform(0, 2 * np.pi, len(FREQUENCIES))

    def motion(t: Array) -> Array:
        return np.asarray(np.sin(2 * np.pi * np.outer(t, FREQUENCIES) + phase) @ AMPLITUDES)

    note = (
        f"synthetic, seed {options.seed}, noise {options.noise:g} rad, late by {options.delay:g} s"
        + (f", drift {1e6 * options.drift:g} ppm" if options.drift else "")
        + (f", jitter {100 * options.jitter:g} %" if options.jitter else "")
        + (f", {100 * options.missing:g} % missing" if options.missing else "")
    )
    first, second = _times(options, rng), _times(options, rng)
    middle = 0.5 * options.duration
    seen = second - options.delay + options.drift * (second - middle)
    return tuple(  # type: ignore[return-value]
        Trajectory(t, {"q": motion(at) + options.noise * rng.normal(size=len(t))}, {"q": "rad"}, synthetic=note)
        for t, at in ((first, first), (second, seen))
    )


def _times(options: SyntheticDelay, rng: np.random.Generator) -> Array:
    n = round(options.duration / options.sample_time) + 1
    t = options.sample_time * (np.arange(n) + options.jitter * rng.uniform(-1, 1, n))
    keep = np.ones(n, bool)
    for begin in rng.integers(1, max(n - GAP - 1, 2), round(options.missing * n / GAP)):
        keep[begin : begin + GAP] = False
    return t[keep]
