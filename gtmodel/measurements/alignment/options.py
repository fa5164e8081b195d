"""Which signals show one motion, where their offset is sought, and synthetic ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...results.options import Options, Unit, Within


@dataclass(frozen=True)
class Search(Options):
    """Where a delay is sought, and what may differ besides it.

    >>> gt.measurements.Search(longest=0.2).drift
    False
    """

    longest: Annotated[
        float, Unit("s", key="longest_delay_s"), Within(above=0),
        "largest delay either way; clocks that began apart want more",
    ] = 0.05  # fmt: skip
    drift: Annotated[bool, "whether the two clocks may differ in rate"] = False
    scale: Annotated[bool, "whether the late signal may be the other one times a factor"] = True
    shift: Annotated[bool, "whether it may be shifted by a constant"] = True


@dataclass(frozen=True)
class SyntheticDelay(Options):
    """A synthetic recording of one motion by two clocks: sums of sines, white noise, jitter, gaps.

    >>> gt.measurements.SyntheticDelay(delay=0.003, seed=1).noise
    0.001
    """

    delay: Annotated[float, Unit("s"), "how late the second recording is"] = 0.003
    drift: Annotated[float, "by which its clock runs slow, 5e-5 for 50 ppm"] = 0.0
    duration: Annotated[float, Unit("s"), Within(above=0), "of both"] = 10.0
    sample_time: Annotated[float, Unit("s"), Within(above=0), "of both"] = 0.004
    noise: Annotated[float, Unit("rad"), Within(above=0), "standard deviation, of a motion of about 1 rad"] = 1e-3
    jitter: Annotated[float, Within(least=0, below=0.5), "of each row's time, as a share of the sample time, even"] = (
        0.0
    )
    missing: Annotated[float, Within(least=0, below=0.5), "share of the rows that lie in gaps of ten rows"] = 0.0
    seed: Annotated[int, Within(least=0), "of the noise, the times and the phases"] = 0
