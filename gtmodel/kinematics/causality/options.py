"""What a causality on many points is asked for besides the points themselves."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ...results.options import Long, Options, Within

Three = Annotated[list[float], Long(3)]


@dataclass(frozen=True, kw_only=True)
class PointGrid(Options):
    """A box of points for the one known vector of three, in SI units.

    >>> gt.kinematics.causality.PointGrid(center=[0.0, 0.0, 0.0], half_width=[0.1] * 3, counts=[3, 3, 0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: counts: must be at least 1; found 0
    """

    center: Annotated[list[float] | None, Long(3), "middle of the box"] = None
    center_where: Annotated[
        dict[str, list[float]] | None,
        "the middle is where these have their values, such as {q = [0.0, 0.0, 0.0]}",
    ] = None  # fmt: skip
    half_width: Annotated[
        list[float], Long(3), Within(least=0.0), "from the middle to the last point along each direction"
    ]  # fmt: skip
    counts: Annotated[
        list[int], Long(3), Within(least=1), "points along each direction; the first one counts layers"
    ]  # fmt: skip
    directions: Annotated[
        list[Three], Long(3), "one row each, made unit vectors; the first one goes from layer to layer"
    ] = field(default_factory=lambda: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Orientation(Options):
    """Adds the orientation to the table: ZYZ angles in degrees, and on request the turn from the middle point.

    Keep the joints among the targets: an arm that has no say in the orientation still limits what can be reached.

    >>> gt.kinematics.causality.Orientation(of="plate.R").rotation_vector
    False
    """

    of: Annotated[str, "the model's quaternion, scalar first, or rotation matrix"] = "e"
    rotation_vector: Annotated[
        bool, "add the rotation vector from the middle point, in degrees; nowhere singular"
    ] = False  # fmt: skip
