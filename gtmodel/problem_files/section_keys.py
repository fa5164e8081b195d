"""Keys of a cross-section of the workspace."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat

from .base import Section

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


class SectionKeys(Section):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x."""

    along_m: float | None = Field(
        default=None, description="its position along the guideways; through home if left out"
    )
    step_m: PositiveFloat = Field(default=0.02, description="of the grid")
    low_m: Pair | None = Field(default=None, description="least (u, v); all that the links may reach if left out")
    high_m: Pair | None = Field(default=None, description="greatest (u, v)")
