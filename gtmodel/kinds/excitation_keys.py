"""The keys of an excitation problem: what is identified, the family of motions, limits, search, and comparison."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeInt, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Section
from gtmodel.problem_files.path_keys import Point
from gtmodel.problem_files.robot_keys import RobotProblem

from .trajectory.keys import Limits


class MotionKeys(Section):
    """The family of motions of the tool centre point, each from rest to rest at one place."""

    family: Literal["fourier", "spline"] = Field(default="fourier", description="finite Fourier series or spline")
    period_s: PositiveFloat = Field(description="of the motion; it may be repeated")
    harmonics: int = Field(default=5, ge=2, le=30, description="fourier: number of harmonics")
    intervals: int = Field(default=12, ge=2, le=60, description="spline: number of polynomial pieces")
    place_low_m: Point = Field(description="lower corner of the box in which random motions stand")
    place_high_m: Point = Field(description="upper corner of that box")


class Search(Section):
    """The optimisation."""

    criterion: Literal["condition", "determinant", "variance"] = Field(
        default="condition",
        description="least condition number (a smooth bound of it); largest determinant of the information; least sum "
        "of the relative variances",
    )
    starts: PositiveInt = Field(default=1, description="how many of the best random motions it starts from")
    max_iterations: PositiveInt = Field(default=400, description="limit of iterations for each start")


class RandomKeys(Section):
    """Random feasible motions to compare with, and to start from."""

    draws: PositiveInt = Field(default=100, description="number of motions")
    seed: NonNegativeInt = Field(default=1, description="of their drawing")


class MonteCarloKeys(Section):
    """Synthetic identifications along the optimised and the best random motion."""

    runs: NonNegativeInt = Field(default=0, le=5000, description="number of runs; none if 0")
    seed: NonNegativeInt = Field(default=0, description="of the noise")


class ExcitationProblem(RobotProblem):
    """The motion from which masses and friction are identified best."""

    identified: list[str] = Field(
        default=["m_p", "m_c", "coulomb", "viscous"], min_length=1, description="parameters to find; arrays by name"
    )
    motion: MotionKeys
    limits: Limits
    search: Search = Search()
    random: RandomKeys = RandomKeys()
    monte_carlo: MonteCarloKeys = MonteCarloKeys()
    noise_N: PositiveFloat = Field(default=30.0, description="white noise of the measured forces, standard deviation")
    periods: PositiveInt = Field(default=1, description="how often the motion is repeated in an experiment")
    sample_s: PositiveFloat = Field(default=0.004, description="sample time of the log and of trajectory.csv")
    sign_smoothing_m_s: PositiveFloat = Field(
        default=0.02, description="velocity over which the optimisation smooths the sign of Coulomb friction"
    )
