"""The keys of kind "loop_simulation"."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, PositiveFloat

from gtmodel.control import loop_options
from gtmodel.problem_files.base import FileSection
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.control.LoopSimulationStudy"


class LawSection(FileSection):
    """The control law, on the robot as the problem names it."""

    name: Literal["computed_torque", "feedforward", "feedback"] = Field(
        default="computed_torque",
        description="inverse dynamics at the measured state, inverse dynamics of the reference beside a feedback, or "
        "the feedback alone",
    )
    stiffness: float | list[float] = Field(
        description="gain of the position error, one or one for each actuator: 1/s2 with computed_torque, else N/m"
    )
    damping: float | list[float] = Field(description="gain of the velocity error: 1/s with computed_torque, else N.s/m")


class ReferenceSection(FileSection):
    """A motion from a file in place of [move]."""

    file: str = Field(
        description='CSV file as gtmodel writes it, with the tool centre point "T" or the positions "q" at equal '
        "steps; the path starts at the problem's folder"
    )


class PlantFrictionSection(FileSection):
    """Friction of the robot that is controlled, which may stick."""

    smoothing: Literal["tanh", "piecewise_linear", "stiction"] | None = Field(
        default=None,
        description="how the sign of the velocity is smoothed; stiction: not at all, it sticks, with events; left out: "
        "as [friction] has it",
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None, description="velocity over which the sign changes; left out: as [friction] has it"
    )


class PlantSection(FileSection):
    """How the robot that is controlled differs from the one that the law knows."""

    parameters: dict[str, Any] = Field(default={}, description="modifiers beside those of the problem, in SI")
    inertia: str | None = Field(default=None, description="other masses and friction of a catalogue robot")
    payload_kg: float | None = Field(default=None, ge=0, description="another mass on the plate")
    friction: PlantFrictionSection = PlantFrictionSection.left_out()


class Schema(RobotProblem):
    """A robot in continuous time under a control law that computes at samples. One of [move] and [reference]."""

    law: LawSection
    sampling: Made[loop_options.LoopSampling] = Made[loop_options.LoopSampling].left_out()
    move: Made[loop_options.Move] | None = Field(default=None, description="a straight motion of the tool")
    reference: ReferenceSection | None = Field(default=None, description="a motion from a file")
    plant: PlantSection = PlantSection.left_out()
    limits: Made[loop_options.TrackingLimits] = Made[loop_options.TrackingLimits].left_out()
    tolerance: float = Field(default=1e-9, ge=1e-14, le=0.1, description="of the integrator")
