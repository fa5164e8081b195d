"""The keys of kind "codegen"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.cgen import Verification
from gtmodel.problem_files.base import FileSection
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.cgen.CodeStudy"


class Function(FileSection):
    """One function: these targets, computed from these known variables."""

    name: str = Field(min_length=1, description="C name of the function")
    known: list[str] = Field(default=[], description="names of variables that are prescribed with their derivatives")
    targets: list[str] = Field(min_length=1, description='names such as "T", "der(q)", "der(T,2)"')
    prefer: list[str] = Field(default=[], description="names to keep as states")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by name of a declared branch")
    trajectory: bool = Field(default=False, description="offer it along a sampled reference too, as NAME_at")


class Schema(RobotProblem):
    """C code of functions of one robot."""

    real: Literal["double", "float"] = Field(default="double", description="the numbers that C computes with")
    name: str = Field(default="", description="prefix of the C names; the name of the problem file when empty")
    functions: list[Function] = Field(min_length=1, description="what to generate")
    box: dict[str, list[list[float]]] = Field(
        default={}, description='intervals by input, such as "der(T)" = [[-1.5, 1.5]]: inside every function answers'
    )
    check: Made[Verification] = Made[Verification].left_out()
