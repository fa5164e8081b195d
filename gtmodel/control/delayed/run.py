"""A late loop in time: along a path that steers, with noise of the measurement, from sample to sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...results import ArgumentError
from .loop import DelayedLoop
from .options import SinePath

WINDOWS = 5  # of a run: the last is compared with the louder of the first two
GROWTH = 2.5  # between these; near the limit the noise alone builds up by the root of time, a factor of 1.7
BLOWN_UP = 1e6  # times the noise and the steering: a run ends there


@dataclass(frozen=True, eq=False)
class DelayedRun:
    """time (n,) [s], deviation (n,) and correction (n,) at the samples; bounded: whether it stopped growing."""

    time: np.ndarray
    deviation: np.ndarray
    correction: np.ndarray
    bounded: bool


def run_along(
    loop: DelayedLoop, gain: float, path: SinePath | None = None, *, noise: float = 15e-6, seed: int = 0
) -> DelayedRun:
    """Simulate a loop that is steered along a path and measured with noise, exactly from sample to sample.

    Args:
        path: of Cvitanic 2021 if left out. Its steering acts on the plant as a correction does, at once.
        noise: standard deviation of the measurement [m], white; seed: of its draw. The run is synthetic.

    It is bounded where the root mean square of its last fifth is at most 2.5 times that of the first two: in 15 s that
    shows gains a few per cent above the limit; slow, lightly damped plants take longer. Raises
    ArgumentError for a path of fewer than 100 cycles, and without noise and steering, for then nothing moves.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)  # its limit is 0.243
    >>> [gt.control.delayed.run_along(loop, gain).bounded for gain in (0.23, 0.255)]
    [True, False]
    """
    path = path or SinePath()
    steering = path.steering(loop.cycle)
    if len(steering) < 100:
        raise ArgumentError(f"the path takes {len(steering)} cycles; expected 100 or more", "path.duration")
    if not (np.isfinite(noise) and noise >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {noise!r}", "noise")
    if noise == 0 and path.amplitude == 0:
        raise ArgumentError("there is neither noise nor steering: nothing would move", "noise")
    measured = noise * np.random.default_rng(seed).standard_normal(len(steering))
    matrix, entry, from_noise = loop.matrix(gain), loop.steering_entry, loop.noise_entry(gain)
    largest = BLOWN_UP * (noise + np.abs(steering).max())
    x, deviation, correction = np.zeros(len(matrix)), np.zeros(len(steering)), np.zeros(len(steering))
    for k in range(len(steering)):
        deviation[k] = loop.plant.C @ x[: len(loop.plant)]
        correction[k] = loop.correction(gain, x, measured[k])
        if abs(deviation[k]) > largest:
            kept = slice(0, k + 1)
            return DelayedRun(loop.cycle * np.arange(k + 1), deviation[kept], correction[kept], False)
        x = matrix @ x + from_noise * measured[k] + entry * steering[k]
    parts = np.array_split(deviation, WINDOWS)
    sizes = [float(np.sqrt(np.mean(p**2))) for p in parts]
    return DelayedRun(
        loop.cycle * np.arange(len(steering)), deviation, correction, sizes[-1] <= GROWTH * max(sizes[:2])
    )
