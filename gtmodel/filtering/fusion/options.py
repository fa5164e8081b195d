"""What the fusion study is asked for: the sensors of Table 7, the filter, and what is swept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from ...results.options import Long, Options, Unit, Within

FilterKind = Literal["extended", "iterated", "unscented", "particle"]
Sweepable = Literal[
    "acceleration_noise", "acceleration_bias", "rate_noise", "rate_bias", "misalignment", "arm_error", "sample_time"
]


@dataclass(frozen=True)
class FusionSensors(Options):
    """Tracker and inertial unit: Table 7 of Cvitanic 2021, a Leica AT960 with T-Mac and a Gladiator Landmark 60.

    Noise of the unit is a density, as data sheets print it: times the root of the rate it is the deviation of one
    reading.
    The biases are there and the filter does not know them.

    >>> gt.filtering.FusionSensors().acceleration_noise  # m/s2 per root of Hz
    0.00039
    """

    position_noise: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of the tracker, per axis"] = 6.4e-6
    orientation_noise: Annotated[float, Unit("rad", written="deg"), Within(above=0.0), "of the tracker, per axis"] = (
        np.radians(0.015)
    )
    acceleration_noise: Annotated[
        float, Unit("m/s2", key="acceleration_noise_m_s2_rtHz"), Within(above=0.0), "density of the accelerometer"
    ] = 0.00039
    acceleration_bias: Annotated[float, Unit("m/s2"), "of each axis of the accelerometer"] = 0.00025
    rate_noise: Annotated[
        float, Unit("rad/s", written="deg/s", key="rate_noise_deg_s_rtHz"), Within(above=0.0), "density of the gyro"
    ] = np.radians(0.0016)
    rate_bias: Annotated[float, Unit("rad/s", written="deg/s"), "of each axis of the gyro"] = np.radians(0.0008)
    sample_time: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "of all sensors"] = 0.001
    arm: Annotated[
        tuple[float, ...], Unit("m", written="mm"), Long(3), "from the target to the unit, in the axes of the body"
    ] = (0.18, 0.1, -0.12)
    arm_error: Annotated[float, Unit("m", written="mm"), "of the arm along z, unknown to the filter"] = 0.0
    misalignment: Annotated[float, Unit("rad", written="deg"), "of the unit about z, unknown to the filter"] = 0.0
    gravity: Annotated[bool, "the accelerometer feels gravity; the thesis leaves it out"] = False
    outlier_share: Annotated[
        float, Within(least=0.0, most=0.5), "of the tracker's positions, off by twenty times its noise"
    ] = 0.0

    def with_value(self, name: str, value: float) -> FusionSensors:
        """The same with one other number."""
        return replace(self, **{name: value})


@dataclass(frozen=True)
class FusionFilter(Options):
    """Which filter, and what it takes for its noise.

    `printed` takes the covariance of Appendix B per step, with (21) and (24) as they are printed; in three axes only.
    Otherwise jerk and angular jerk are white. With `fast_jerk_density` and `fast_angular_jerk_density` two filters of
    different densities interact.

    >>> gt.filtering.FusionFilter(printed=True).jerk_density
    (0.1, 1e-06, 0.1)
    """

    kind: Annotated[FilterKind, "extended, iterated, unscented or particle"] = "extended"
    particles: Annotated[int, Within(least=2), "of the particle filter, which keeps a Gaussian of the position"] = 1000
    printed: Annotated[bool, "covariance of Appendix B, equations (21) and (24) as printed"] = False
    exact_step: Annotated[bool, "with `printed`: the factor 1/2 that (21) lacks is put in"] = False
    jerk_density: Annotated[
        tuple[float, ...], Unit("m2/s5"), Long(3), Within(least=0.0), "of white jerk along x, y, z"
    ] = (0.1, 1e-6, 0.1)
    angular_jerk_density: Annotated[float, Unit("rad2/s5"), Within(least=0.0), "of white angular jerk"] = 1e2
    fast_jerk_density: Annotated[
        float | None, Unit("m2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    fast_angular_jerk_density: Annotated[
        float | None, Unit("rad2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    stay: Annotated[float, Within(above=0.0, below=1.0), "chance that a filter stays the right one for a step"] = 0.999
    outliers: Annotated[
        Literal["huber"] | None,
        "the tracker's readings count less the further off, by Huber's weights; none if left out",
    ] = None
    smooth: Annotated[bool, "fixed-interval smoothing besides"] = False
    tracker_jerk_density: Annotated[
        float, Unit("m2/s5"), Within(above=0.0), "of the filter on the tracker alone, the second baseline"
    ] = 10.0


@dataclass(frozen=True)
class FusionSweep(Options):
    """One number of the sensors over several values, all others as they are; where fusion stops being of use.

    >>> gt.filtering.FusionSweep("sample_time", (0.001, 0.002, 0.01)).parameter
    'sample_time'
    """

    parameter: Annotated[Sweepable, "a key of the sensors"]
    values: Annotated[tuple[float, ...], "in SI units: m, rad, s, m/s2, rad/s, and these per root of Hz"]
