"""The keys of kind "delayed_feedback"."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, PositiveFloat

from gtmodel.control.delayed import options
from gtmodel.kinds.loop_simulation.keys import LawSection
from gtmodel.kinds.milling.keys import CutterKeys, Three
from gtmodel.milling import Cut
from gtmodel.problem_files.base import FileSection
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = ["gtmodel.control.DelayedFeedbackStudy", "gtmodel.control.delayed.FeedbackMapStudy"]

Pose = Annotated[list[float], Field(min_length=2, max_length=2)]


@made_from(options.SinePath)
class SteeredPathKeys(Made):
    """The path of the synthetic runs that show the limit in time."""

    noise_um: float = Field(default=15.0, ge=0, description="of the measurement, standard deviation")
    seed: int = Field(default=0, ge=0, description="of the noise")


@made_from(options.FeedbackCut, "speed")
class FeedbackCutKeys(Made):
    """A tool that cuts meanwhile, corrected along an axis."""

    speed_rpm: PositiveFloat = Field(description="of the spindle, turns per minute")
    engagement: Made[Cut]
    cutter: CutterKeys

    def options(self) -> Any:
        """The tool."""
        return options.FeedbackCut(**self.given(), speed=self.speed_rpm / 60)


class ServoSection(FileSection):
    """A robot that corrects its own references, by its own law: [law], [robot] and where it stands."""

    tool_m: Three = Field(description="tool centre point, in the robot's frame")
    directions: dict[str, Three] = Field(min_length=1, description="unit vectors along which it is corrected, by name")
    gain_step: PositiveFloat = Field(default=0.1, description="from one gain that can be set to the next")


class PlantRow(FileSection):
    """The equivalent oscillators of one pose, as fitted to the vibration after a command."""

    joints_deg: Pose = Field(description="joints 2 and 3")
    m: dict[str, PositiveFloat] = Field(description="equivalent mass by direction, a number without a unit")
    c: dict[str, PositiveFloat] = Field(description="equivalent damping [1/s] by direction")
    k: dict[str, PositiveFloat] = Field(description="equivalent stiffness [1/s2] by direction")


@made_from(options.GainMap)
class JointMapKeys(Made):
    """Gain limits over joints 2 and 3, from plants in some poses."""

    poses_deg: list[Pose] = Field(default=[], description="joints 2 and 3 of the synthetic experiments")
    table_deg: list[Pose] = Field(default=[], description="joints 2 and 3 of the poses of the table")
    gain_step: dict[str, PositiveFloat] = Field(min_length=1, description="by direction")
    plant: list[PlantRow] = Field(default=[], description="measured plants, one table for each pose")
    synthetic: Made[options.SyntheticCommands] | None = Field(default=None, description="synthetic vibrations instead")


class Schema(RobotProblem):
    """How far late corrections may be turned up. One of [axes], [servo] and [map] says on what they act."""

    robot: str | None = Field(default=None, description="of [servo]: catalogue name, file, or model in Python")  # type: ignore[assignment]
    timing: Made[options.FeedbackTiming] = Made[options.FeedbackTiming].left_out()
    axes: dict[str, Made[options.FeedbackAxis]] = Field(default={}, description="vibrating directions, by name")
    servo: ServoSection | None = Field(default=None, description="a robot of any model under its own law")
    law: LawSection | None = Field(default=None, description="of the robot's servo")
    map: JointMapKeys | None = Field(default=None, description="limits over two joints")
    box: Made[options.FeedbackBox] = Made[options.FeedbackBox].left_out()
    margins: Made[options.GainMargins] = Made[options.GainMargins].left_out()
    off_axis: list[Made[options.OffAxisRun]] = Field(default=[], description="directions between the axes x and y")
    path: SteeredPathKeys | None = Field(default=None, description="synthetic runs along a path")
    cut: FeedbackCutKeys | None = Field(default=None, description="chatter while it corrects")
