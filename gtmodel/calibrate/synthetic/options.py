"""Options of synthetic calibration measurements: a robot with known errors, a grid, a device."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from ...results.options import Long, Options, Unit, Within

Three = Annotated[list[float], Long(3)]


def _zeros() -> list[float]:
    return [0.0, 0.0, 0.0]


@dataclass(frozen=True, kw_only=True)
class Synthetic(Options):
    """A robot with known errors, measured at poses that its model reaches: data to test a calibration.

    >>> gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[4, 4, 0])
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: counts: must be more than 0; found 0
    """

    seed: Annotated[int, Within(least=0), "seed of all random numbers"] = 0
    low: Annotated[list[float], Unit("m"), Long(3), "lower corner of the grid of tool centre points"]
    high: Annotated[list[float], Unit("m"), Long(3), "upper corner"]
    counts: Annotated[list[int], Within(above=0), Long(3), "grid points along x, y, z; those out of reach are left out"]
    poses: Annotated[int | None, Within(above=0), "number of poses, evenly chosen from the grid; default all"] = None
    turn: Annotated[
        float, Unit("rad", written="deg"), Within(least=0),
        "largest random rotation of the plate from home about each axis, if it can turn",
    ] = 0.0  # fmt: skip
    point_error: Annotated[
        float, Unit("m", written="mm"), Within(least=0), "standard deviation of errors of joint positions and link "
        "lengths"
    ] = 1e-3  # fmt: skip
    misalignment: Annotated[
        float, Unit("rad", written="deg"), Within(least=0),
        "rms angle between two guideways; each is rotated about a random axis",
    ] = math.radians(0.1)  # fmt: skip
    scale_error: Annotated[float, Within(least=0), "standard deviation of transmission scales"] = 1e-3
    along: Annotated[
        list[float], Unit("m", written="um"), Within(least=0), Long(3),
        "mean deviation of each cart along its guideway (Dressler 2012, Table 4.2)",
    ] = field(default_factory=lambda: [11e-6, 58e-6, 19e-6])  # fmt: skip
    across: Annotated[list[float], Unit("m", written="um"), Within(least=0), Long(3), "mean deviation across"] = field(
        default_factory=lambda: [28e-6, 38e-6, 47e-6]
    )
    load: Annotated[
        float | list[float], Unit("m", written="um"), Within(least=0), Long(3),
        "mean shift of each cart as the moving plate shifts its weight between the guideways, one number or three; "
        "up to 100 on L1 (section 4.2)",
    ] = 0.0  # fmt: skip
    cart_tilt: Annotated[
        float, Unit("rad", written="deg"), Within(least=0),
        "mean rotation of a cart along its guideway; at most 0.03 on D1 (section 5.3)",
    ] = 0.0  # fmt: skip
    cart_points: Annotated[
        int | None, Within(least=2),
        "points along each guideway, measured with a reflector on the cart, for carts.csv; 28 on D1",
    ] = None  # fmt: skip
    cart_drift: Annotated[
        list[float], Unit("m", written="um"), Within(least=0), Long(3),
        "mean shift of each cart in that recording relative to the poses, due to other loads",
    ] = field(default_factory=_zeros)  # fmt: skip
    cart_device_t: Annotated[list[float], Unit("m"), Long(3), "position of the device for carts.csv"] = field(
        default_factory=_zeros
    )
    cart_device_zyz: Annotated[
        list[float], Unit("rad", written="deg"), Long(3), "orientation of the device for carts.csv"
    ] = field(default_factory=_zeros)  # fmt: skip
    cyclic: Annotated[
        float | list[float], Unit("m", written="um"), Within(least=0), Long(3),
        "amplitude of the transmission's cyclic error, one number or three",
    ] = 10e-6  # fmt: skip
    cyclic_period: Annotated[
        float, Unit("m", written="mm"), Within(above=0), "period of the cyclic error; our choice, not in the thesis"
    ] = 10e-3  # fmt: skip
    repeatability: Annotated[
        float, Unit("m", written="um"), Within(least=0), "mean distance of repeated tool centre points"
    ] = 13e-6  # fmt: skip
    device: Annotated[str, "name of the device in the header: tracker, camera, ..."] = "tracker"
    position_noise: Annotated[
        float | list[float], Unit("m", written="um"), Within(above=0), Long(3),
        "standard deviation of the device, one number or along x, y, z; about 1000 for a camera",
    ] = 10e-6  # fmt: skip
    orientation_noise: Annotated[
        float, Unit("rad", written="deg"), Within(above=0), "standard deviation of a measured orientation"
    ] = math.radians(0.005)  # fmt: skip
    state_noise: Annotated[
        bool, "whether to state the noise to the fit, as priors and some costs require"
    ] = False  # fmt: skip
    device_t: Annotated[list[float], Unit("m"), Long(3), "position of the device in the robot's frame"] = field(
        default_factory=_zeros
    )
    device_zyz: Annotated[list[float], Unit("rad", written="deg"), Long(3), "orientation of the device"] = field(
        default_factory=_zeros
    )
