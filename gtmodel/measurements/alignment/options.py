"""Options of the delay search, and synthetic recordings of one motion with two clocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results.options import Options, Unit, Within
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array


@dataclass(frozen=True)
class Search(Options):
    """Search range of a delay, and the other parameters to be estimated.

    >>> gt.measurements.Search(longest=0.2).drift
    False
    """

    longest: Annotated[
        float, Unit("s", key="longest_delay_s"), Within(above=0),
        "largest delay in either direction; raise it for clocks that were started at different times",
    ] = 0.05  # fmt: skip
    drift: Annotated[bool, "whether the two clocks may differ in rate"] = False
    scale: Annotated[bool, "whether the signals may differ by a factor"] = True
    shift: Annotated[bool, "whether the signals may differ by a constant"] = True


@dataclass(frozen=True)
class SyntheticDelay(Options):
    """Synthetic recordings of one motion with two clocks: sums of sines, white noise, jitter, gaps.

    >>> gt.measurements.SyntheticDelay(delay=0.003, seed=1).noise
    0.001
    """

    delay: Annotated[float, Unit("s"), "delay of the second recording"] = 0.003
    drift: Annotated[float, "relative rate by which the second clock runs slow, 5e-5 for 50 ppm"] = 0.0
    duration: Annotated[float, Unit("s"), Within(above=0), "duration of both recordings"] = 10.0
    sample_time: Annotated[float, Unit("s"), Within(above=0), "sample time of both recordings"] = 0.004
    noise: Annotated[float, Unit("rad"), Within(above=0), "standard deviation; the motion is about 1 rad"] = 1e-3
    jitter: Annotated[
        float, Within(least=0, below=0.5), "largest deviation of a row's time over the sample time, uniform"
    ] = 0.0
    missing: Annotated[float, Within(least=0, below=0.5), "share of missing rows, in gaps of ten rows"] = 0.0
    seed: Annotated[int, Within(least=0), "seed of the noise, the times and the phases"] = 0


FREQUENCIES = np.array([0.31, 0.83, 1.71, 2.9])  # Hz
AMPLITUDES = np.array([0.6, 0.3, 0.15, 0.05])  # rad
GAP = 10  # rows


def made_pair(options: SyntheticDelay) -> tuple[Trajectory, Trajectory]:
    """Return the reference and the late recording, each with the signal q [rad] and a note that it is synthetic.

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
    true_times = second - options.delay + options.drift * (second - middle)
    return tuple(  # type: ignore[return-value]
        Trajectory(t, {"q": motion(at) + options.noise * rng.normal(size=len(t))}, {"q": "rad"}, synthetic=note)
        for t, at in ((first, first), (second, true_times))
    )


def _times(options: SyntheticDelay, rng: np.random.Generator) -> Array:
    n = round(options.duration / options.sample_time) + 1
    t = options.sample_time * (np.arange(n) + options.jitter * rng.uniform(-1, 1, n))
    keep = np.ones(n, bool)
    for begin in rng.integers(1, max(n - GAP - 1, 2), round(options.missing * n / GAP)):
        keep[begin : begin + GAP] = False
    return t[keep]
