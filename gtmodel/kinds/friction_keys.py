"""The keys of friction identification from constant-velocity runs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from gtmodel.identify.steady import CUTOFF_HZ, SHORTEST, STEADY
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.log_keys import LogSampling, MeasuredSignal
from gtmodel.problem_files.robot_keys import RobotProblem


class Pose(Section):
    """Where the tool centre point was held in the cross-section while the carts ran."""

    name: str = Field(default="", description="one word for pictures")
    tcp_m: list[float] | None = Field(
        default=None, description="somewhere on the way; with guideways along x the place along them does not matter"
    )
    holding_N: list[float] | None = Field(
        default=None, description="printed gravity force of each cart in place of tcp_m; for holding_mass_kg"
    )
    holding_mass_kg: PositiveFloat | None = Field(default=None, description="mass that holding_N holds")
    files: list[str] = Field(default=[], description="logs of this pose, with [log]")


class Log(LogSampling):
    """Measured logs; each pose names its own files."""

    position_m: MeasuredSignal = Field(description="positions of the carts")
    force_N: MeasuredSignal = Field(description="forces of the motors")
    cutoff_Hz: PositiveFloat = Field(
        default=CUTOFF_HZ, description="of the low pass that tells steady from unsteady rows; means are of raw ones"
    )
    slowest_m_s: NonNegativeFloat = Field(default=0.0, description="slower runs are left out")
    steady_acceleration_m_s2: PositiveFloat = Field(
        default=STEADY, description="rows count as constant velocity while all accelerations are smaller"
    )
    shortest_run_s: PositiveFloat = Field(default=SHORTEST, description="shorter runs are left out")


class Coefficients(Section):
    """Friction by cart."""

    coulomb_plus_N: list[float] = Field(description="Coulomb friction forwards")
    coulomb_minus_N: list[float] = Field(description="Coulomb friction backwards, positive")
    viscous_plus_kg_s: list[float] = Field(description="viscous friction forwards")
    viscous_minus_kg_s: list[float] = Field(description="viscous friction backwards")
    mass_kg: PositiveFloat = Field(description="plate and half the links")


class Synthetic(Coefficients):
    """Logs made up from known friction, to see what identification gives back."""

    velocities_m_s: list[PositiveFloat] = Field(min_length=2, description="each is run forth and back")
    moved_mass_kg: NonNegativeFloat = Field(default=30.0, description="felt by each motor in the ramps between runs")
    noise_N: NonNegativeFloat = Field(default=5.0, description="white, standard deviation")
    quantisation_m: NonNegativeFloat = Field(default=1e-6, description="step of the positions")
    seed: int = Field(default=0, ge=0, description="of the noise")


class Schema(RobotProblem):
    """Friction from constant-velocity runs. One of [log], [synthetic] and [printed] gives the forces."""

    directions: Literal["separate", "symmetric"] = Field(
        default="separate", description="separate: coefficients by direction of motion"
    )
    gravity: Literal["most_symmetric", "poses"] = Field(
        default="most_symmetric",
        description="how the mass is found beside friction by direction: least asymmetry, or the change between poses",
    )
    pose: list[Pose] = Field(min_length=1, description="one table for each; the first is the picture's")
    log: Log | None = Field(default=None, description="measured logs")
    synthetic: Synthetic | None = Field(default=None, description="made-up logs")
    printed: Coefficients | None = Field(
        default=None, description="published lines; their mass is the one that was chosen, and is found anew"
    )
