"""The keys of kind "identification"."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.identify.rows import MASK_STEPS
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.log_keys import LogFiles, MeasuredSignal
from gtmodel.problem_files.robot_keys import RobotProblem

from .closed_loop import ClosedLoop


class SharpFriction(Section):
    """Friction of the model that is fitted."""

    smoothing: Literal["sign", "tanh", "piecewise_linear"] | None = Field(
        default=None, description="of a catalogue robot or robot file: sign, exact away from standstill, if left out"
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None, description="velocity over which a smoothed sign changes; the catalogue's own is 0.1"
    )


class Log(LogFiles):
    """Measured logs."""

    position: MeasuredSignal = Field(description="the known variable; scale and offset in its SI unit")
    effort: MeasuredSignal = Field(description="the measured efforts; scale and offset in their SI unit")
    held_out: list[str] = Field(default=[], description="logs of other motions, for validation only")


class Synthetic(Section):
    """A log made up from a plant, to see what identification gives back: sines, tracking, sensors, noise."""

    seed: int = Field(default=0, ge=0, description="of the noise")
    motion_seed: int = Field(default=1, ge=0, description="of the motion's phases; the held-out one takes the next")
    duration_s: PositiveFloat = Field(default=60.0, description="of each motion of sines")
    sample_time_s: PositiveFloat = Field(default=0.004, description="of the log")
    reference: str = Field(default="T", description="variable that moves along the sines, or as the file has it")
    reference_file: str | None = Field(
        default=None,
        description="CSV file with its columns, such as the trajectory.csv of an excitation, in place of the sines; "
        "the motion held out is of sines still",
    )
    repeats: PositiveInt = Field(default=1, description="how often the motion of the file runs, end on beginning")
    centre: list[float] | None = Field(default=None, description="of the motion; the robot's home if left out")
    half_range: float | list[float] = Field(default=0.4, description="how far it goes from the centre, by axis")
    frequencies_Hz: list[PositiveFloat] = Field(
        default=[0.2, 0.5, 1.1, 2.2], min_length=1, description="slow ones for friction, fast ones for masses"
    )
    ramp_s: PositiveFloat = Field(default=1.0, description="over which the motion grows and fades")
    tracking: Literal["dressler_2012", "exact"] = Field(
        default="dressler_2012", description="how three carts follow: eq. (6.11) at 4 ms, or exactly"
    )
    parameters: dict[str, Any] = Field(default={}, description="of the plant where other than the model's, in SI")
    position_step: NonNegativeFloat = Field(default=1e-6, description="quantisation of the position, in SI")
    effort_step: NonNegativeFloat = Field(default=0.0, description="quantisation of the efforts, in SI")
    effort_noise: NonNegativeFloat | list[NonNegativeFloat] = Field(
        default=30.0, description="standard deviation in SI, one for all or one each"
    )
    effort_colour: float = Field(default=0.0, ge=0, lt=1, description="correlation of neighbouring samples of noise")
    runs: int = Field(default=0, ge=0, le=10000, description="further logs by seed, to see whether intervals hold")
    processes: int | None = Field(
        default=None, ge=0, description="for the runs; 0 in this one, one per core if left out"
    )


class Filter(Section):
    """The zero-phase low pass on position, efforts and regressor, and which rows are used."""

    cutoff_Hz: PositiveFloat | None = Field(default=None, description="2.5 times the excitation band if left out")
    order: PositiveInt = Field(default=4, description="of the Butterworth filter")
    every: PositiveInt | None = Field(
        default=None, description="every how many-th row is used; as many as are independent if left out"
    )
    position_step: NonNegativeFloat | None = Field(
        default=None, description="quantisation of the position, in SI; the smallest step in the log if left out"
    )
    mask_steps: NonNegativeFloat = Field(
        default=MASK_STEPS, description="rows slower than so many position steps a sample are left out"
    )


class Schema(RobotProblem):
    """Masses and friction of a robot, or any parameters in which its efforts are linear, from measured motion."""

    known: str = Field(default="q", description="the measured position, by the model's name")
    targets: str = Field(default="tau", description="the measured efforts")
    free: list[str] | None = Field(default=None, description="parameters to be estimated; those of the variant")
    variant: str | None = Field(
        default=None, description="of a three-link robot: model_1 to model_4 of Table 6.3, or links (thirteen)"
    )
    watch: list[str] = Field(default=[], description="fixed parameters whose traces the residuals are searched for")
    nonnegative: bool | list[str] = Field(default=True, description="free parameters that are so: all, none, these")
    confidence: Literal["auto", "white", "newey_west"] = Field(
        default="auto",
        description="what intervals assume of residuals; auto takes newey_west where they are coloured",
    )
    friction: SharpFriction = SharpFriction()  # pyright: ignore[reportIncompatibleVariableOverride]
    filter: Filter = Filter()
    log: Log | None = Field(default=None, description="measured logs")
    synthetic: Synthetic | None = Field(default=None, description="or a log made up")
    published: dict[str, float] = Field(default={}, description="numbers to compare with, by parameter, in SI")
    closed_loop: ClosedLoop | None = Field(default=None, description="validation by simulating the controlled model")
