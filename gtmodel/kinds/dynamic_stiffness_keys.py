"""The keys of kind "dynamic_stiffness"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Problem, Section

Range = Annotated[list[float], Field(min_length=2, max_length=2)]
Coordinate = Literal["x", "y", "z", "A"]


class Fit(Section):
    """How modes are fitted to a frequency response."""

    search_Hz: Range = Field(default=[3.0, 200.0], description="where the most compliant mode is looked for")
    band_Hz: Range | None = Field(default=None, description="lines fitted; 0.7 to 1.3 times the peak if left out")
    modes: PositiveInt | None = Field(default=None, description="how many; as many as the data ask for if left out")
    most: int = Field(default=3, ge=1, le=5, description="modes that are tried at most")
    relative_noise: PositiveFloat | None = Field(
        default=None, description="of a receptance; without it hits tell their own, or the residuals do"
    )
    estimator: Literal["H1", "H2"] = Field(default="H1", description="H1 for noise on the response, H2 on the force")
    force_window_s: PositiveFloat | None = Field(
        default=None, description="the force is set to zero so long after a hit"
    )
    decay_1_s: NonNegativeFloat = Field(default=0.0, description="exponential window on records that do not die away")


class Process(Section):
    """The Gaussian processes of log m, log c and log k over the pose."""

    covariance: Literal["squared_exponential", "matern_5_2"] = Field(
        default="squared_exponential", description="smooth, or with two derivatives"
    )
    scale_m: list[PositiveFloat] = Field(
        default=[0.5] * 3, min_length=3, max_length=3, description="typical lengths of x, y, z"
    )
    scale_deg: PositiveFloat = Field(default=60.0, description="typical change of A")
    periodic: bool = Field(default=True, description="whether A has a period of 360 degrees")
    shared: bool = Field(default=True, description="whether m, c and k of a direction share their lengths")
    starts: PositiveInt = Field(default=4, description="of the search for hyperparameters")
    seed: int = Field(default=0, description="of these starts and of what is held out")


class Map(Section):
    """The picture of the lowest frequency over two coordinates of the pose."""

    over: list[Coordinate] = Field(default=["y", "A"], min_length=2, max_length=2, description="abscissa and ordinate")
    at_m: list[float] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="the other coordinates; the middle of the poses if left out",
    )
    at_deg: float | None = Field(default=None, description="A, likewise")
    points: int = Field(default=41, ge=5, le=201, description="along each side")


class Measured(Section):
    """Measured records, listed in a CSV file."""

    index: str = Field(
        description="CSV file with the columns x [m], y [m], z [m], A [deg], direction and file; rows of the same "
        "pose and direction are hits of one experiment, unless a column experiment tells them apart"
    )


class Synthetic(Section):
    """Made-up experiments on a smooth field near printed oscillators."""

    near: Literal["table_16"] = Field(description="whose values the field passes near: Cvitanic 2021, Table 16")
    lengths: list[PositiveFloat] = Field(
        default=[2.0, 0.8, 2.0, 0.8], min_length=4, max_length=4,
        description="over which it changes in x, y, z and A, in units of the process's scales; ours",
    )  # fmt: skip
    poses: int = Field(default=60, ge=8, le=1000, description="Latin hypercube in the box")
    box_m: list[Range] = Field(
        default=[[-0.3, 0.9], [-3.1, -2.1], [0.2, 0.4]], min_length=3, max_length=3, description="of x, y, z"
    )
    box_deg: Range = Field(default=[0.0, 120.0], description="of A")
    records: Literal["hits", "receptance"] = Field(default="hits", description="what is measured")
    hits: int = Field(default=5, ge=2, description="of each experiment")
    noise_m_s2: PositiveFloat = Field(default=0.05, description="of the acceleration in records of hits")
    relative_noise: PositiveFloat = Field(default=0.05, description="of receptances")
    sample_rate_Hz: PositiveFloat = Field(default=1024.0, description="of records of hits")
    duration_s: PositiveFloat = Field(default=4.0, description="of each record; of receptances its inverse is the step")
    seed: int = Field(description="of field, poses and noise")


class Schema(Problem):
    """Oscillators of an arm over its poses, from frequency responses. One of [measured] and [synthetic] gives them."""

    repeatability: NonNegativeFloat = Field(
        default=0.15, description="mean change of m, c and k between experiments at one pose; Cvitanic 2021 states 15 %"
    )
    fit: Fit = Fit()
    process: Process = Process()
    map: Map = Map()
    measured: Measured | None = Field(default=None, description="measured records")
    synthetic: Synthetic | None = Field(default=None, description="made-up records")
