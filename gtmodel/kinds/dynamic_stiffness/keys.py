"""The keys of kind "dynamic_stiffness"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat

from gtmodel.problem_files.base import FileSection, Problem, Source
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.vibration.dynamic_stiffness import options

RESULT = "gtmodel.vibration.DynamicStiffnessStudy"


class MeasuredExperimentsSection(FileSection):
    """Measured records, listed in a CSV file."""

    index: str = Field(
        description="CSV file with the columns x [m], y [m], z [m], A [deg], direction and file; rows of the same "
        "pose and direction are hits of one experiment, unless a column experiment tells them apart"
    )
    source: Source = ""


@made_from(options.SyntheticArm)
class SyntheticArmSection(Made):
    """Synthetic experiments on a smooth field near printed oscillators."""

    near: Literal["table_16"] = Field(description="whose values the field passes near: Cvitanic 2021, Table 16")


class Schema(Problem):
    """Oscillators of an arm over its poses, from frequency responses. One of [measured] and [synthetic] gives them."""

    repeatability: NonNegativeFloat = Field(
        default=0.15, description="mean change of m, c and k between experiments at one pose; Cvitanic 2021 states 15 %"
    )
    fit: Made[options.ModalFitting] = Made[options.ModalFitting].left_out()
    process: Made[options.Process] = Made[options.Process].left_out()
    map: Made[options.FrequencyMap] = Made[options.FrequencyMap].left_out()
    measured: MeasuredExperimentsSection | None = Field(default=None, description="measured records")
    synthetic: SyntheticArmSection | None = Field(default=None, description="synthetic records")
