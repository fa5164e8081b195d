"""Fields of options that all studies of motions have."""

from __future__ import annotations

from typing import Annotated, Literal

from ..results import Within

Barrier = Annotated[
    Literal["auto", "adaptive", "monotone"],
    "how IPOPT lowers its barrier; auto: adaptive, and monotone where that fails",
]
MostElements = Annotated[
    int, Within(above=0, most=10000), "where a check fails the mesh is refined, to at most so many elements"
]
