"""The keys of kind "calibration"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from gtmodel.calibrate.measured import options as measured
from gtmodel.calibrate.options import Fit
from gtmodel.calibrate.synthetic import options as synthetic_options
from gtmodel.compliance.load_tests import options as load_tests
from gtmodel.compliance.options import Load
from gtmodel.problem_files.base import FileSection, Source
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import FormSection, RobotProblem

RESULT = "gtmodel.calibrate.CalibrationStudy"


@made_from(measured.Measured)
class MeasuredSection(FormSection):
    """Measured poses in a CSV, MATLAB or Parquet file."""

    file: str = Field(description="path from the problem's folder")
    held_out_file: str | None = Field(
        default=None, description="another file of the same columns, which no fit sees; of each of several tables"
    )
    source: Source = ""


Measurements = Annotated[
    Annotated[MeasuredSection, Tag("one table")] | Annotated[list[MeasuredSection], Tag("tables")],
    Discriminator(lambda value: "tables" if isinstance(value, list) else "one table"),
]


@made_from(measured.CartPoints, "at", "points")
class CartPointsSection(Made):
    """Points of each cart along its guideway, measured in another set-up of the device (Dressler 2012, eq. (5.7))."""

    file: str = Field(
        description="CSV with the columns q and P1, P2, P3, three numbers each, from the problem's folder"
    )
    source: Source = ""
    unit: str = Field(default="mm", description="of all its columns")
    arms: list[Annotated[int, Field(ge=1, le=3)]] = Field(
        description="arms on straight pieces through their points; all others stay straight: D1 models 2 and 4 all, 5 "
        "the second",
        min_length=1,
    )


class HeldOutSection(FileSection):
    """Poses that the fit does not see."""

    method: Literal["every", "leave_one_out", "folds"] = Field(
        default="every",
        description="every: some poses are held out; leave_one_out, folds: all are fitted, and each is predicted by a "
        "fit without it, or without its fold, for few poses",
    )
    every: int = Field(default=2, ge=0, description="every how many-th pose is held out; 0 for none")
    folds: int = Field(default=10, ge=2, description="number of folds, of the method folds")
    file: str | None = Field(default=None, description="another file of the same columns instead")
    source: Source = ""
    refit: list[Literal["offset", "scale", "device", "target"]] = Field(
        default=[],
        description="what the held-out poses have of their own, refitted on a part of them: offset and scale of the "
        "actuators, frame of the device, place of the target",
    )
    refit_every: int = Field(
        default=2, ge=2, description="the first of so many held-out poses refits them, the others judge"
    )


@made_from(load_tests.LoadTests)
class LoadTestsSection(Made):
    """Measured tests, one a row: where the arm stood, what pulled, what moved. World coordinates."""

    file: str = Field(description="CSV, path from the problem's folder")
    source: Source = ""


class _Hung(Made):
    poses_deg: list[Annotated[list[float], Field(min_length=6, max_length=6)]] | None = Field(
        default=None, description="joint angles of each pose, all loads in each; of synthetic tests"
    )
    load: list[Made[Load]] | None = Field(default=None, description="one table for each load; of synthetic tests")


@made_from(load_tests.Setup)
class _SetUp(_Hung):
    """How joint stiffness is determined."""


class JointStiffness(_SetUp):
    """Joint stiffness of a serial arm from static load tests. One of measurements and synthetic says what moved."""

    measurements: LoadTestsSection | None = Field(default=None, description="measured tests")
    synthetic: Made[load_tests.SyntheticTests] | None = Field(default=None, description="synthetic tests")


@made_from(Fit)
class _Fitted(RobotProblem, Made):
    """What a calibration fits."""


class Schema(_Fitted):
    """Geometric parameters of a robot from measured poses."""

    measurements: Measurements | None = Field(
        default=None, description="measured poses; several tables [[measurements]] share the robot's parameters"
    )
    synthetic: Made[synthetic_options.Synthetic] | None = Field(default=None, description="synthetic poses instead")
    cart_points: CartPointsSection | None = Field(default=None, description="guideways through measured points")
    held_out: HeldOutSection = HeldOutSection.left_out()
    joint_stiffness: JointStiffness | None = Field(
        default=None, description="joint stiffness of a serial arm from static load tests, in place of geometry"
    )
