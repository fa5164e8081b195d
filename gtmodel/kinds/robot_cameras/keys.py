"""The keys of kind "robot_cameras"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from gtmodel.problem_files.base import FileSection, Source
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.vision.detection import targets
from gtmodel.vision.robot_cameras import options

RESULT = "gtmodel.vision.robot_cameras.RobotCamerasStudy"


@made_from(targets.FiveSquares)
class FiveSquaresSection(Made):
    """Black squares on the tool; their layout is an example unless given."""

    kind: Literal["five_squares"] = Field(description="which target")


@made_from(targets.Chessboard)
class ChessboardSection(Made):
    """A chessboard; its marks are the inner corners."""

    kind: Literal["chessboard"] = Field(description="which target")


@made_from(targets.Charuco)
class CharucoSection(Made):
    """A chessboard with coded marks."""

    kind: Literal["charuco"] = Field(description="which target")


class PicturesSection(FileSection):
    """Corners that were detected, and what the actuators read at the same poses."""

    corners: str = Field(
        description="CSV: camera, pose, mark, u, v and, where known, sigma; path from this file's folder"
    )
    actuators: str = Field(
        description="CSV: pose, each actuator, and rate1 ... of a moving robot; path from this file's folder"
    )
    unit: str = Field(default="mm", description="of the actuators' columns")
    sigma_pixel: PositiveFloat = Field(
        default=0.1, description="standard deviation of a corner where no column says it"
    )
    second_device: str | None = Field(
        default=None,
        description="CSV: pose, x, y, z in `unit`, positions by a second device; path from this file's folder",
    )
    second_device_noise_um: PositiveFloat = Field(default=10.0, description="of each of its coordinates")
    source: Source = ""


class Schema(RobotProblem):
    """A robot and its cameras calibrated together, or with [places] where two cameras will be worth most. One of
    [pictures] and [synthetic] says what is seen."""

    pictures: PicturesSection | None = Field(default=None, description="measured pictures")
    target: Annotated[FiveSquaresSection | ChessboardSection | CharucoSection, Field(discriminator="kind")] | None = (
        Field(default=None, description="whose marks the corners are; with [pictures]")
    )
    camera: list[Made[options.CameraStart]] = Field(
        default=[],
        description="one table [[camera]] for each, as known before; of synthetic ones the size alone if left out",
    )
    synthetic: Made[options.SyntheticRobotCameras] | None = Field(default=None, description="synthetic instead")
    calibration: Made[options.RobotCameras] = Made[options.RobotCameras].left_out()
    places: Made[options.CameraPlaces] | None = Field(
        default=None, description="a plan: places of two cameras to compare, with [synthetic]"
    )
    held_out_every: int = Field(default=2, ge=2, description="every how many-th pose no fit sees")
    two_steps: bool = Field(default=False, description="whether positions are intersected first too, for comparison")
    accuracy_mm: PositiveFloat | None = Field(
        default=None, description="greatest mean error of held-out synthetic positions, or rms of the best place"
    )
