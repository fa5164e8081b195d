"""The keys of kind "learning_control"."""

from __future__ import annotations

from typing import Any

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


class LearnedPlantSection(RecordingFiles):
    """The robot's axes: from a log (files, signals), from a model in Python, or b q^-delay / (1 - a q^-1)."""

    signals: RunSignals | None = Field(
        default=None, description="of the log, under a reference that excites, such as a random one"
    )
    order: int | None = Field(
        default=None, ge=1, description="states of an axis, the delay not counted; by held-out samples if left out"
    )
    model: str | None = Field(default=None, description="in Python, file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="of the model, in SI")
    reference: list[str] = Field(default=[], description="the model's inputs, one for each axis")
    motor: list[str] = Field(default=[], description="its variables of the motors, one for each axis")
    tool: list[str] = Field(default=[], description="of the tool, for cases 2A, 2B and 3")
    acceleration: list[str] = Field(default=[], description="of the tool's acceleration, for cases 2A and 2B")
    b: list[float] = Field(default=[], description="one for each axis, as in (6.11)")
    a: list[float] = Field(default=[], description="one for each axis, as in (6.11)")
    delay_samples: int | None = Field(
        default=None, ge=0, description="until a reference acts; of a log where its response begins if left out"
    )
    synthetic: str = Field(default="", description="what made the log, where it was simulated")


@made_from(options.ElasticTip)
class SimulatedSection(Made):
    """A Gantry-Tau of the catalogue with a tool on a spring, simulated with its controller."""

    robot: str = Field(default="l1_tape", description="a Gantry-Tau of the catalogue")
    inertia: str = Field(default="model_2", description="its masses and friction")


class Schema(Problem):
    """Iterative learning control: rate and floor before the first iteration, and the runs of a synthetic robot beside
    them. With [log]: from one measured run the input of the next one."""

    robot: Made[options.LearningRobot] = Made[options.LearningRobot].left_out()
    plant: LearnedPlantSection | None = Field(
        default=None, description="the robot's axes from a log, a model or printed numbers, in place of [robot]"
    )
    learning: Made[options.LearningDesign] = Made[options.LearningDesign].left_out()
    reference: Made[references.SquarePath] = Made[references.SquarePath].left_out()
    noise: Made[options.LearningNoise] = Made[options.LearningNoise].left_out()
    simulated: SimulatedSection | None = Field(
        default=None, description="a robot that is simulated, of which [robot] is the model that the law knows"
    )
    log: RunSection | None = Field(default=None, description="a measured run, in place of [reference] and [noise]")
