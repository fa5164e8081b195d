"""The keys of kind "calibration"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, field_validator

from gtmodel.calibrate import Cost
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.robot_keys import RobotProblem

from .calibration_stiffness_keys import JointStiffness
from .calibration_synthetic_keys import Synthetic

Free = Literal["estimate"]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]
Noise = PositiveFloat | list[PositiveFloat] | list[list[float]]
COSTS: dict[str, Cost] = {"closure": "squared", "linear": "length", "inverse": "inverse", "forward": "forward",
         "orthogonal": "orthogonal"}  # fmt: skip


class MeasuredSignal(Section):
    """Columns of a measured variable: quantity = scale (column + delay rate) - offset, as of a log's signals."""

    column: str | list[str] = Field(description='names in the file; "q" means "q[0]", "q[1]", ... too')
    unit: str | list[str] = Field(description="unit of the columns, or one each")
    noise: Noise | None = Field(
        default=None,
        description="standard deviation in SI, one, one each, or a covariance; of a quaternion in rad; left out, the "
        "residuals tell it",
    )
    scale: float | Free = Field(default=1.0, description="quantity per column, both in SI")
    offset: float | Free = Field(
        default=0.0, description="what is read when the quantity is zero, in its SI unit; estimated, one per session"
    )
    delay_s: float | Free = Field(default=0.0, description="how late the column is; needs its rate")
    rate: str | list[str] | None = Field(default=None, description="columns of the rate, for a delay")
    rate_unit: str = Field(default="m/s", description="unit of the rate's columns")

    @field_validator("scale")
    @classmethod
    def _keeps_readings(cls, scale: float | Free) -> float | Free:
        if scale == 0:
            raise ValueError('0 makes all readings the same; give the quantity per column in SI, or "estimate"')
        return scale


class FrameStart(Section):
    """Where an unknown frame is thought to be."""

    t_m: Three = Field(default=[0.0, 0.0, 0.0], description="its origin")
    quaternion: Four = Field(default=[1.0, 0.0, 0.0, 0.0], description="its turn, scalar first")


class Sag(Section):
    """How far the tool gives way under a payload: k times its weight, along it."""

    payload_kg: NonNegativeFloat | str = Field(description="mass at the tool, one, or the column of each pose's")
    compliance_m_per_N: NonNegativeFloat | Free = Field(
        default="estimate", description="k; estimated, T.sag, it takes poses with two payloads or more"
    )
    down: Three = Field(default=[0.0, 0.0, -1.0], description="where the weight pulls, in the robot's frame")


class Measured(Section):
    """Measured poses in a CSV file."""

    file: str = Field(description="path from the problem's folder")
    signals: dict[str, MeasuredSignal] = Field(description="by the model's variables: q, T, e", min_length=2)
    session: str | None = Field(default=None, description="column that names the recording of a row")
    actuators: str = Field(default="q", description="the variable that the drives measure")
    position: str = Field(default="T", description="the variable that the device measures")
    orientation: str | None = Field(default=None, description="its quaternion, scalar first, where it is measured")
    frame: Literal["robot", "device"] = Field(
        default="robot", description="coordinates of the file: the robot's, or those of a device that stands unknown"
    )
    target: bool = Field(default=False, description="whether the target sits unknown on the end-effector")
    device_start: FrameStart | None = Field(
        default=None, description="of the device in the robot's frame; left out, by alignment with the robot's model"
    )
    device_per_session: bool = Field(
        default=False,
        description="whether the device stood elsewhere in each session, found by alignment",
    )
    target_per_session: bool = Field(default=False, description="whether the target sat elsewhere in each session")
    sag: Sag | None = Field(default=None, description="of the tool under a payload; none if left out")
    target_start: FrameStart = Field(default=FrameStart(), description="of the robot's tool frame in the target's")


class CartPoints(Section):
    """Points of each cart along its guideway, measured in another set-up of the device (Dressler 2012, eq. (5.7))."""

    file: str = Field(
        description="CSV with the columns q and P1, P2, P3, three numbers each, from the problem's folder"
    )
    unit: str = Field(default="mm", description="of all its columns")
    arms: list[Annotated[int, Field(ge=1, le=3)]] = Field(
        description="arms on straight pieces through their points; all others stay straight: D1 models 2 and 4 all, 5 "
        "the second",
        min_length=1,
    )
    quaternion: Four = Field(
        default=[1.0, 0.0, 0.0, 0.0],
        description="turn of that set-up in the frame of the poses, by common reference points, scalar first",
    )
    turn_std_rad: PositiveFloat | None = Field(
        default=None, description="how well it is known; left out, the poses alone tell it, badly about the guideway"
    )


class HeldOut(Section):
    """Poses that the fit does not see."""

    every: int = Field(default=2, ge=0, description="every how many-th pose is held out; 0 for none")
    file: str | None = Field(default=None, description="another file of the same columns instead")

    @field_validator("every")
    @classmethod
    def _leaves_poses(cls, every: int) -> int:
        if every == 1:
            raise ValueError("1 holds every pose out and leaves none to fit; take 2 or more, or 0 for none")
        return every


class PriorKeys(Section):
    """Knowledge of one parameter before the measurement."""

    value: float | None = Field(default=None, description="in SI; the robot's own if left out")
    std: PositiveFloat = Field(description="its standard deviation in SI")


class Schema(RobotProblem):
    """Geometric parameters of a robot from measured poses."""

    variant: Literal["ideal", "modified", "six_link", "f1_unit", "f1_raw"] | None = Field(
        default=None,
        description="ideal: one guideway direction (15 parameters); modified: one each (21); six_link (60); f1_unit, "
        "f1_raw: quaternions of length one, or free. Left out: all that the equations hold, quaternions raw",
    )
    free: list[str] = Field(default=[], description="parameters to move, scalars, rows or whole; all if left out")
    fixed: list[str] = Field(default=[], description="parameters to leave, stronger than free")
    tied: dict[str, str] = Field(default={}, description="parameter -> parameter that it follows")
    unit_quaternions: list[str] = Field(default=[], description="quaternions that are turned at length one")
    priors: dict[str, PriorKeys] = Field(
        default={}, description="by unknown, or by row or parameter for all its unknowns at their start"
    )
    sizes: dict[str, PositiveFloat] = Field(default={}, description="expected error of a parameter in SI; 0.001")
    cost: Literal["closure", "linear", "inverse", "forward", "orthogonal"] = Field(
        default="linear",
        description="what is made small: squared closures (5.1), length errors, errors of the drives, of the pose, or "
        "both in units of their noise",
    )
    loss: Literal["linear", "huber", "soft_l1", "cauchy"] = Field(default="linear", description="robust losses")
    loss_width: PositiveFloat | None = Field(
        default=None, description="residual beyond which the loss flattens; 1.345 robust standard deviations"
    )
    accuracy_mm: PositiveFloat | None = Field(
        default=None, description="mean held-out positioning error that is wanted; a check"
    )
    sensitivity_step: NonNegativeFloat = Field(
        default=5e-5, description="change of each parameter in the sensitivity (5.8), in SI; 0 for none"
    )
    measurements: Measured | None = Field(default=None, description="measured poses")
    synthetic: Synthetic | None = Field(default=None, description="made-up poses instead")
    cart_points: CartPoints | None = Field(default=None, description="guideways through measured points")
    held_out: HeldOut = HeldOut()
    joint_stiffness: JointStiffness | None = Field(
        default=None, description="joint stiffness of a serial arm from static load tests, in place of geometry"
    )
