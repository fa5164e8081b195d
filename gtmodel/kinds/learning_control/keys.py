"""The keys of kind "learning_control"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.control.learning import options, references
from gtmodel.problem_files.base import FileSection, Problem
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.log_keys import RecordedSignalSection, RecordingFiles

RESULT = ("gtmodel.control.learning.LearningStudy", "gtmodel.control.learning.NextInputStudy")


class RunSignals(FileSection):
    """Columns of a run, one for each axis."""

    reference: RecordedSignalSection = Field(description="what the robot is to follow, without the input")
    input: RecordedSignalSection | None = Field(default=None, description="what was added to it; zero if left out")
    motor: RecordedSignalSection | None = Field(
        default=None, description="the motors through the forward kinematics; for cases 1, 2A and 2B"
    )
    acceleration: RecordedSignalSection | None = Field(default=None, description="of the tool; for cases 2A and 2B")
    tool: RecordedSignalSection | None = Field(default=None, description="measured; for case 3")


class RunSection(RecordingFiles):
    """One measured run, at the robot's sampling."""

    signals: RunSignals
    repeats: list[str] = Field(default=[], description="files of runs that were identical to each other")
    ramp_samples: int = Field(default=references.RAMP, ge=1, description="of lead-in and of lead-out")
    acceleration_noise_m_s2: float = Field(default=0.07, gt=0, description="of a reading of the accelerometer")
    synthetic: str = Field(default="", description="what made the run, where it was simulated")


@made_from(options.ElasticTip)
class SimulatedSection(Made):
    """A Gantry-Tau of the catalogue with a tool on a spring, simulated with its controller."""

    robot: str = Field(default="l1_tape", description="a Gantry-Tau of the catalogue")
    inertia: str = Field(default="model_2", description="its masses and friction")


class Schema(Problem):
    """Iterative learning control: rate and floor before the first iteration, and the runs of a synthetic robot beside
    them. With [log]: from one measured run the input of the next one."""

    robot: Made[options.LearningRobot] = Made[options.LearningRobot].left_out()
    learning: Made[options.LearningDesign] = Made[options.LearningDesign].left_out()
    reference: Made[references.SquarePath] = Made[references.SquarePath].left_out()
    noise: Made[options.LearningNoise] = Made[options.LearningNoise].left_out()
    simulated: SimulatedSection | None = Field(
        default=None, description="a robot that is simulated, of which [robot] is the model that the law knows"
    )
    log: RunSection | None = Field(default=None, description="a measured run, in place of [reference] and [noise]")
