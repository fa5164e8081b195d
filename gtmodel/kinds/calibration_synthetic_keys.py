"""The keys of synthetic calibration measurements."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Section

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
ThreeSizes = Annotated[list[NonNegativeFloat], Field(min_length=3, max_length=3)]
ThreeCounts = Annotated[list[PositiveInt], Field(min_length=3, max_length=3)]


class Synthetic(Section):
    """A robot with known errors, measured at poses that its model reaches: a file to try the calibration on."""

    seed: int = Field(default=0, ge=0, description="of all that is random")
    low_m: Three = Field(description="least corner of the grid of tool centre points")
    high_m: Three = Field(description="greatest corner")
    counts: ThreeCounts = Field(description="grid points along x, y, z; those out of reach are left out")
    poses: PositiveInt | None = Field(default=None, description="so many of them, evenly taken; all if left out")
    turn_deg: NonNegativeFloat = Field(
        default=0.0, description="greatest random turn of the plate from home about each axis, where it can turn"
    )
    point_error_mm: NonNegativeFloat = Field(
        default=1.0, description="standard deviation of errors of joint positions and link lengths"
    )
    misalignment_deg: NonNegativeFloat = Field(
        default=0.1, description="angle between two guideways, rms; each is turned about an axis of its own"
    )
    scale_error: NonNegativeFloat = Field(default=1e-3, description="standard deviation of transmission scales")
    along_um: ThreeSizes = Field(
        default=[11.0, 58.0, 19.0],
        description="mean deviation of each cart along its guideway (Dressler 2012, Table 4.2)",
    )
    across_um: ThreeSizes = Field(default=[28.0, 38.0, 47.0], description="and across it")
    load_um: NonNegativeFloat | ThreeSizes = Field(
        default=0.0,
        description="mean shift of each cart as the plate moves across the guideways and its weight is shared out "
        "anew, one or three; up to 100 on L1 (section 4.2)",
    )
    cart_tilt_deg: NonNegativeFloat = Field(
        default=0.0, description="mean turn of a cart along its guideway; at most 0.03 on D1 (section 5.3)"
    )
    cart_points: PositiveInt | None = Field(
        default=None,
        ge=2,
        description="points along each guideway, measured with a reflector on the cart: carts.csv; 28 on D1",
    )
    cart_drift_um: ThreeSizes = Field(
        default=[0.0, 0.0, 0.0],
        description="how far in the mean each cart is in that recording from where it is at the poses, by other loads",
    )
    cart_device_t_m: Three = Field(default=[0.0, 0.0, 0.0], description="where the device stands for these")
    cart_device_zyz_deg: Three = Field(default=[0.0, 0.0, 0.0], description="and how it is turned")
    cyclic_um: NonNegativeFloat | ThreeSizes = Field(
        default=10.0, description="amplitude of the transmission's cyclic error, one or three"
    )
    cyclic_period_mm: PositiveFloat = Field(default=10.0, description="its period, of ours: the text gives none")
    repeatability_um: NonNegativeFloat = Field(default=13.0, description="mean distance of repeated tool centre points")
    device: str = Field(default="tracker", description="what measures, for the header: tracker, camera, ...")
    position_noise_um: PositiveFloat | list[PositiveFloat] = Field(
        default=10.0, description="standard deviation of the device, one or along x, y, z; a camera has some 1000"
    )
    orientation_noise_deg: PositiveFloat = Field(default=0.005, description="of a device that measures orientation too")
    state_noise: bool = Field(
        default=False, description="whether sizes of noise are told to the fit, as priors and some costs need them"
    )
    device_t_m: Three = Field(default=[0.0, 0.0, 0.0], description="where the device stands in the robot's frame")
    device_zyz_deg: Three = Field(default=[0.0, 0.0, 0.0], description="and how it is turned")
