"""A case of errors: what the file says of lengths or cart joints, as the robot's errors and in words."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from gtmodel.kinematics.accuracy import Ellipsoids, ErrorCase
from gtmodel.kinematics.mechanism import Mechanism
from gtmodel.problem_files.base import InputError, Section
from gtmodel.problem_files.sentences import listed

Three = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]


class Case(Section):
    """Errors of the three links: of their lengths, or of the cart joints, in ellipsoids about them; some may be 0."""

    name: str = Field(description="of the case")
    length_um: Three | None = Field(default=None, description="greatest error of each link length")
    along_um: Three | None = Field(
        default=None, description="half-axis of each cart joint's ellipsoid along its guideway"
    )
    across_um: Three | None = Field(default=None, description="half-axes across it")
    method: Literal["support", "projection"] | None = Field(default=None, description="for this case another one")


def errors_of(case: Case, k: int, robot: Mechanism) -> ErrorCase:
    key = f"cases[{k}]"
    given = [name for name in ("length_um", "along_um", "across_um") if getattr(case, name) is not None]
    if given and not any(np.any(getattr(case, name)) for name in given):
        raise InputError("all errors are zero; give at least one that is greater", f"{key}.{given[0]}")
    if case.length_um is not None:
        if case.along_um is not None or case.across_um is not None:
            raise InputError("give either length_um, or along_um with across_um", key)
        return ErrorCase(robot.lengths, radius=1e-6 * np.array(case.length_um))
    if case.along_um is None or case.across_um is None:
        raise InputError("give either length_um, or along_um with across_um", key)
    along, across = 1e-6 * np.array(case.along_um), 1e-6 * np.array(case.across_um)
    ellipsoids = Ellipsoids.about_guideways(robot.directions, along, across)
    return ErrorCase(robot.lengths, ellipsoids=ellipsoids, method=case.method or "support")


def describe(case: Case) -> str:
    if case.length_um is not None:
        return f"link lengths within {listed(np.array(case.length_um))} um"
    return (
        f"cart joints within ellipsoids of {listed(np.array(case.along_um))} um along and "
        f"{listed(np.array(case.across_um))} um across the guideways, corners by {method_of(case)}"
    )


def method_of(case: Case) -> str:
    if case.length_um is not None:
        return "eight corners of U^-1"
    return "iterative projection" if case.method == "projection" else "the support function"
