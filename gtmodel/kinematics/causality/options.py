"""Options and result of the causality study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ...results import Quantity, Row, Status, Study
from ...results.options import Long, Options, Within

Three = Annotated[list[float], Long(3)]


@dataclass(frozen=True, kw_only=True)
class PointGrid(Options):
    """A box of points for a single known vector of three, in SI units.

    >>> gt.kinematics.causality.PointGrid(center=[0.0, 0.0, 0.0], half_width=[0.1] * 3, counts=[3, 3, 0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: counts: must be at least 1; found 0
    """

    center: Annotated[list[float] | None, Long(3), "middle of the box"] = None
    center_where: Annotated[
        dict[str, list[float]] | None,
        "quantities whose values determine the middle, such as {q = [0.0, 0.0, 0.0]}",
    ] = None  # fmt: skip
    half_width: Annotated[
        list[float], Long(3), Within(least=0.0), "distance from the middle to the last point along each direction"
    ]  # fmt: skip
    counts: Annotated[
        list[int], Long(3), Within(least=1), "points along each direction; the first one counts layers"
    ]  # fmt: skip
    directions: Annotated[list[Three], Long(3), "one row each, normalised; the first one leads from layer to layer"] = (
        field(default_factory=lambda: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    )


@dataclass(frozen=True)
class Orientation(Options):
    """Adds the orientation to the table: ZYZ angles in degrees and, optionally, the rotation from the middle point.

    Keep the joints among the targets: an arm that does not affect the orientation still limits the reach.

    >>> gt.kinematics.causality.Orientation(of="plate.R").rotation_vector
    False
    """

    of: Annotated[str, "quaternion of the model, scalar first, or rotation matrix"] = "e"
    rotation_vector: Annotated[
        bool, "add the rotation vector from the middle point, in degrees; it is never singular"
    ] = False  # fmt: skip


Array = np.ndarray
NOT_COMPUTED = "not_computed"
INCONSISTENT = "inconsistent_known_values"
OWN = {-1: NOT_COMPUTED, -2: INCONSISTENT}  # codes in addition to those of Status


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CausalityStudy(Study):
    """Values of a causality at n points.

    known, targets: by name, (n, *shape) in SI units; NaN in rows without a solution. codes: (n,) of `Status`; -1 for
    rows that were not computed, -2 for contradictory known values. orientation: an `OrientationMap`, or None.
    normalised: number of rows with a quaternion that was normalised. units: by name.
    """

    known: Mapping[str, Array]
    targets: Mapping[str, Array]
    codes: Array
    orientation: Any = None
    normalised: int = 0
    units: Mapping[str, str] = field(default_factory=dict)
    count: Annotated[int, Quantity("", "number of points", key="rows")]
    statuses: Annotated[
        Mapping[str, int],
        "number of rows per status: ok, out_of_range, not_converged (Newton's method found no solution, as beyond the "
        "reach of a six-link robot), wrong_branch (Newton's solution is not on the declared branch), singular, "
        "not_finite, inconsistent_known_values (such as a quaternion that is not of length 1), not_computed",
    ]
    ranges: Annotated[
        Mapping[str, Mapping[str, Any]],
        "smallest and largest value of each target over the rows that are ok, in SI units",
    ]
    zyz_range: Annotated[
        Array | None,
        Quantity(
            "rad",
            "largest minus smallest ZYZ angle over the rows that are ok; null without [orientation]",
            written="deg",
        ),
    ] = None
    zyz_layer_range: Annotated[
        Array | None, Quantity("rad", "zyz_range_deg of each layer of a grid; null without a grid", written="deg")
    ] = None
    layer_difference: Annotated[
        Array | None,
        "largest difference between the layers, as a fraction of zyz_range_deg; null without a grid",
    ] = None  # fmt: skip
    zyz_singular_rows: Annotated[
        int | None, "number of rows with singular ZYZ angles, beta = 0 or pi; null without [orientation]"
    ] = None

    @property
    def ok(self) -> Array:
        """Whether each row has a solution (n,)."""
        return self.codes == Status.OK

    @property
    def words(self) -> list[str]:
        """The status of each row as a word."""
        return words_of(self.codes)

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("points", self.count)]
        rows += [Row(word.replace("_", " "), n) for word, n in self.statuses.items()]
        if self.normalised:
            rows.append(Row("quaternions brought to length 1", self.normalised))
        for name, ends in self.ranges.items():
            if ends["min"] is not None and np.ndim(ends["min"]) < 2:
                unit = self.units[name]
                rows += [Row(f"least {name}", ends["min"], unit), Row(f"greatest {name}", ends["max"], unit)]
        # NaN if no point is ok, or no place is ok in all layers
        if self.zyz_range is not None and np.all(np.isfinite(self.zyz_range)):
            rows.append(Row("range of ZYZ angles", self.values["zyz_range_deg"], "deg"))
        if self.layer_difference is not None and np.all(np.isfinite(self.layer_difference)):
            rows.append(Row("layers differ by", 100 * self.layer_difference, "%"))
        if self.zyz_singular_rows:
            rows.append(Row("rows where ZYZ is singular", self.zyz_singular_rows))
        return rows


def words_of(codes: Array) -> list[str]:
    """Return the status of each row as a word."""
    return [OWN[c] if c in OWN else Status(c).name.lower() for c in codes.tolist()]
