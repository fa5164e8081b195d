"""Keys of kind "calibration"."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from gtmodel.calibrate.measured import options as measured
from gtmodel.calibrate.measured.options import Measured
from gtmodel.calibrate.options import Fit
from gtmodel.calibrate.synthetic import options as synthetic_options
from gtmodel.compliance.load_tests import options as load_tests
from gtmodel.compliance.options import Load
from gtmodel.problem_files.base import Context, FileSection, Source
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import FormSection, RobotProblem

RESULT = "gtmodel.calibrate.CalibrationStudy"


@made_from(measured.Measured)
class MeasuredSection(FormSection):
    """Measured poses in a CSV, MATLAB or Parquet file."""

    file: str = Field(description="path from the problem's folder")
    held_out_file: str | None = Field(
        default=None, description="held-out poses in a file with the same columns, for this table"
    )
    source: Source = ""

    def measured(self, key: str, context: Context) -> Measured:
        """Return the options, with the paths of all files. Raises InputError."""
        options = self.options()
        signals = dict(options.signals)
        for name, signal in signals.items():
            if signal.file is not None:
                file = context.file(signal.file, f"{key}.signals.{name}.file", source=self.source)
                signals[name] = replace(signal, file=str(file.resolve()))
        return replace(options, signals=signals)


Measurements = Annotated[
    Annotated[MeasuredSection, Tag("one table")] | Annotated[list[MeasuredSection], Tag("tables")],
    Discriminator(lambda value: "tables" if isinstance(value, list) else "one table"),
]


@made_from(measured.CartPoints, "at", "points")
class CartPointsSection(Made):
    """Points of each cart along its guideway, measured in a separate device set-up (Dressler 2012, eq. (5.7))."""

    file: str = Field(
        description="CSV with the columns q and P1, P2, P3, three numbers each, from the problem's folder"
    )
    source: Source = ""
    unit: str = Field(default="mm", description="unit of all columns")
    arms: list[Annotated[int, Field(ge=1, le=3)]] = Field(
        description="arms whose guideways are straight segments between the points; the others are straight; all arms "
        "for D1 models 2 and 4, arm 2 for model 5",
        min_length=1,
    )


class HeldOutSection(FileSection):
    """Poses that the fit does not use."""

    method: Literal["every", "leave_one_out", "folds"] = Field(
        default="every",
        description="every: some poses are held out; leave_one_out, folds: for few poses, all are fitted, and a fit "
        "without the pose, or without its fold, predicts it",
    )
    every: int = Field(default=2, ge=0, description="hold out every n-th pose; 0 for none")
    folds: int = Field(default=10, ge=2, description="number of folds, for the method folds")
    file: str | None = Field(default=None, description="held-out poses in a file with the same columns")
    source: Source = ""
    refit: list[Literal["offset", "scale", "device", "target"]] = Field(
        default=[],
        description="quantities that differ for the held-out poses and are refitted on a part of them: offset and "
        "scale of the actuators, frame of the device, position of the target",
    )
    refit_every: int = Field(
        default=2, ge=2, description="every n-th held-out pose is used to refit, the others for validation"
    )


@made_from(load_tests.LoadTests)
class LoadTestsSection(Made):
    """Measured tests, one per row: pose of the arm, load, deflection. World coordinates."""

    file: str = Field(description="CSV, path from the problem's folder")
    source: Source = ""


class _SyntheticLoads(Made):
    poses_deg: list[Annotated[list[float], Field(min_length=6, max_length=6)]] | None = Field(
        default=None, description="for synthetic tests: joint angles of each pose; every load acts in every pose"
    )
    load: list[Made[Load]] | None = Field(default=None, description="for synthetic tests: one table for each load")


@made_from(load_tests.Setup)
class _SetUp(_SyntheticLoads):
    """Determination of the joint stiffness."""


class JointStiffness(_SetUp):
    """Joint stiffness of a serial arm from static load tests, in measurements or synthetic."""

    measurements: LoadTestsSection | None = Field(default=None, description="measured tests")
    synthetic: Made[load_tests.SyntheticTests] | None = Field(default=None, description="synthetic tests")


@made_from(Fit)
class _Fitted(RobotProblem, Made):
    """Options of the fit."""


class Schema(_Fitted):
    """Geometric parameters of a robot from measured poses."""

    measurements: Measurements | None = Field(
        default=None, description="measured poses; several tables [[measurements]] share the robot's parameters"
    )
    synthetic: Made[synthetic_options.Synthetic] | None = Field(default=None, description="synthetic poses")
    cart_points: CartPointsSection | None = Field(default=None, description="guideways through measured points")
    held_out: HeldOutSection = HeldOutSection.left_out()
    joint_stiffness: JointStiffness | None = Field(
        default=None, description="joint stiffness of a serial arm from static load tests, instead of geometry"
    )
