"""The keys of kind "sensor_fusion"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.filtering import paths
from gtmodel.filtering.attitude import options as attitude
from gtmodel.filtering.fusion import options
from gtmodel.problem_files.base import FileSection, Problem
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.log_keys import RecordedSignalSection, RecordingFiles

RESULT = ("gtmodel.filtering.FusionStudy", "gtmodel.filtering.AttitudeStudy")


class OrientationSection(FileSection):
    """Orientations from another device, by its own clock."""

    quaternion: RecordedSignalSection = Field(description="four columns, whose order and direction are found")
    row: RecordedSignalSection | None = Field(
        default=None,
        description="where the quaternions are written in each row of the gyro: from which row each is taken",
    )
    first_row: int = Field(default=0, ge=0, description="how the log counts its first row, for `row`")


class AttitudeLogSection(RecordingFiles):
    """A recorded gyro and references of orientation, in place of a path."""

    rate: RecordedSignalSection = Field(description='of the gyro; unit "1": as written, its unit is found')
    acceleration: RecordedSignalSection | None = Field(default=None, description="of the same unit, or none")
    reference: OrientationSection


class Schema(Problem):
    """A laser tracker and an inertial unit on one body, along a known path: what their fusion gives, and whether its
    filter may be believed. With [log] or [synthetic_log] in place of [path]: a recorded gyro, calibrated against
    references of orientation, and the attitude between them."""

    path: Made[paths.TrackedPath] = Made[paths.TrackedPath].left_out()
    sensors: Made[options.FusionSensors] = Made[options.FusionSensors].left_out()
    filter: Made[options.FusionFilter] = Made[options.FusionFilter].left_out()
    sweep: Made[options.FusionSweep] | None = Field(default=None, description="one number over several values")
    seed: int = Field(default=1, ge=0, description="of the noise of the synthetic readings along a path")
    log: AttitudeLogSection | None = Field(default=None, description="a recording, in place of [path]")
    synthetic_log: Made[attitude.SyntheticAttitude] | None = Field(
        default=None, description="a synthetic recording of that form"
    )
    judging: Made[attitude.AttitudeJudging] = Made[attitude.AttitudeJudging].left_out()
