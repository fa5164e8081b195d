"""How a recording of a gyro and references of orientation is judged, and a synthetic one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...results.options import Options, Unit, Within


@dataclass(frozen=True)
class AttitudeJudging(Options):
    """Where a gyro is calibrated, and over which gaps between references it is judged on the rest.

    >>> gt.filtering.AttitudeJudging(gaps=(0.2,)).longest_offset
    0.5
    """

    calibrate_until: Annotated[
        float | None, Unit("s"), "by the reference's clock; half of the references if left out"
    ] = None  # fmt: skip
    gaps: Annotated[tuple[float, ...], Unit("s"), Within(above=0), "lengths of time without a reference"] = (0.5, 1.0)
    sample_period: Annotated[
        float | None, Unit("s"), Within(above=0),
        "of the gyro by its own clock, where its rows are stamped when they arrive; compared with the stamps",
    ] = None  # fmt: skip
    longest_offset: Annotated[
        float, Unit("s"), Within(above=0), "of the two clocks either way, where it is sought"
    ] = 0.5  # fmt: skip


@dataclass(frozen=True)
class SyntheticAttitude(Options):
    """A synthetic recording like that of an arm that turns a cheap inertial unit: rests and turns about many axes.

    The gyro is sampled evenly and stamped when its rows arrive, late and by turns; a buffer is read empty at first. The
    references are quaternions world to body, stamped in steps of `resolution`.

    >>> gt.filtering.SyntheticAttitude(seed=2).reference_period
    0.0725
    """

    duration: Annotated[float, Unit("s"), Within(least=6.0), "of the recording"] = 17.8
    sample_period: Annotated[float, Unit("s"), Within(above=0), "of the gyro"] = 0.009963
    reference_period: Annotated[float, Unit("s"), Within(above=0), "of the references, without pauses"] = 0.0725
    resolution: Annotated[float, Unit("s"), Within(above=0), "of the stamps of the references"] = 0.01
    offset: Annotated[float, Unit("s"), "of the reference's clock"] = 0.002
    relative: Annotated[float, Within(least=0), "deviation of the gyro's error, a part of the rate; lasts 2 s"] = 0.006
    noise: Annotated[float, Unit("rad/s"), Within(least=0), "of one reading of the gyro"] = 7e-4
    lost: Annotated[int, Within(least=0), "rows that are missing"] = 5
    seed: Annotated[int, Within(least=0), "of the motion and of all noise"] = 0
