"""What the search for assembly modes is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ...results.options import Long, Options, Unit

# quantities of a pose with their columns in a file, and the number per SI unit
COLUMNS = {
    "q": {("q1_m", "q2_m", "q3_m"): 1.0},
    "axes": {("q4_rad", "q5_rad", "q6_rad"): 1.0, ("q4_deg", "q5_deg", "q6_deg"): math.pi / 180},
    "tcp": {("x_m", "y_m", "z_m"): 1.0},
    "zyz": {("alpha_deg", "beta_deg", "gamma_deg"): math.pi / 180},
    "quaternion": {("e0", "e1", "e2", "e3"): 1.0},
}


@dataclass(frozen=True)
class CommandedPose(Options):
    """Carts and rotary axes, or a tool pose; home where nothing is given.

    >>> gt.kinematics.assembly_modes.CommandedPose(q=[0.1, 0.2])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: q: expected 3 numbers; found 2
    """

    q: Annotated[list[float] | None, Unit("m"), Long(3), "coordinates of the three carts"] = None
    axes: Annotated[
        list[float] | None, Unit("rad"), Long(3), "rotary axes q4, q5, q6 of an F1; zero if left out"
    ] = None  # fmt: skip
    tcp: Annotated[list[float] | None, Unit("m"), Long(3), "tool centre point, in place of q"] = None
    zyz: Annotated[
        list[float] | None, Unit("rad", written="deg"), Long(3),
        "the plate's angles about z, y, z there, where they are free; home's if left out",
    ] = None  # fmt: skip
    quaternion: Annotated[list[float] | None, Long(4), "its unit quaternion instead, scalar first"] = None

    def given(self) -> tuple[str, ...]:
        """The quantities that are there."""
        return tuple(name for name in COLUMNS if getattr(self, name) is not None)
