"""Keys of the solver and its mesh that several kinds have."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveInt

Barrier = Annotated[
    Literal["auto", "adaptive", "monotone"],
    Field(description="how IPOPT lowers its barrier; auto: adaptive, and monotone where that fails"),
]
MostElements = Annotated[
    PositiveInt,
    Field(le=10000, description="where a check fails the mesh is refined, to at most so many elements"),
]
