"""Simulation of a delayed loop along a path, with measurement noise, from sample to sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...linear.response import states
from ...results import ArgumentError
from .loop import DelayedLoop
from .options import SinePath

WINDOWS = 5  # of a run: the last is compared with the larger of the first two
GROWTH = 2.5  # allowed growth between these; near the limit noise alone grows with the root of time, a factor of 1.7
BLOWN_UP = 1e6  # times noise and steering: a run ends at this deviation


@dataclass(frozen=True, eq=False)
class DelayedRun:
    """time (n,) [s], deviation (n,) and correction (n,) at the samples; bounded: whether the deviation is bounded."""

    time: np.ndarray
    deviation: np.ndarray
    correction: np.ndarray
    bounded: bool


def run_along(
    loop: DelayedLoop, gain: float, path: SinePath | None = None, *, noise: float = 15e-6, seed: int = 0
) -> DelayedRun:
    """Simulate the loop along a path with measurement noise, exactly from sample to sample.

    Args:
        path: by default that of Cvitanic 2021. Its steering acts on the plant like a correction, but without delay.
        noise: standard deviation of the white measurement noise [m]; seed: of the noise. The run is synthetic.

    The run is bounded if the root mean square of its last fifth is at most 2.5 times that of the first two fifths. In
    15 s this detects gains a few per cent above the limit; slow, lightly damped plants need longer runs. Raises
    ArgumentError if the path has fewer than 100 cycles, or if there is neither noise nor steering.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)  # its limit is 0.243
    >>> [gt.control.delayed.run_along(loop, gain).bounded for gain in (0.23, 0.255)]
    [True, False]
    """
    path = path or SinePath()
    steering = path.steering(loop.cycle)
    if len(steering) < 100:
        raise ArgumentError(f"the path must take 100 cycles or more; found {len(steering)}", "path.duration")
    if not (np.isfinite(noise) and noise >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {noise!r}", "noise")
    if noise == 0 and path.amplitude == 0:
        raise ArgumentError("without noise and steering nothing moves; set noise or the amplitude of the path", "noise")
    measured = noise * np.random.default_rng(seed).standard_normal(len(steering))
    matrix, entry, from_noise = loop.matrix(gain), loop.steering_entry, loop.noise_entry(gain)
    largest = BLOWN_UP * (noise + np.abs(steering).max())
    with np.errstate(all="ignore"):  # an unstable run overflows after its end
        x = states(matrix, np.outer(measured, from_noise) + np.outer(steering, entry), np.zeros(len(matrix)))
        deviation = x[:, : len(loop.plant)] @ loop.plant.C
        correction = loop.correction(gain, x, measured)
    time = loop.cycle * np.arange(len(steering))
    beyond = np.flatnonzero(np.abs(deviation) > largest)
    if beyond.size:
        end = int(beyond[0]) + 1
        return DelayedRun(time[:end], deviation[:end], correction[:end], False)
    sizes = [float(np.sqrt(np.mean(p**2))) for p in np.array_split(deviation, WINDOWS)]
    return DelayedRun(time, deviation, correction, sizes[-1] <= GROWTH * max(sizes[:2]))
