"""Options and result of the modes study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit

# quantities of a pose: their columns in a file, and the factor to SI units
COLUMNS = {
    "q": {("q1_m", "q2_m", "q3_m"): 1.0},
    "axes": {("q4_rad", "q5_rad", "q6_rad"): 1.0, ("q4_deg", "q5_deg", "q6_deg"): math.pi / 180},
    "tcp": {("x_m", "y_m", "z_m"): 1.0},
    "zyz": {("alpha_deg", "beta_deg", "gamma_deg"): math.pi / 180},
    "quaternion": {("e0", "e1", "e2", "e3"): 1.0},
}


@dataclass(frozen=True)
class CommandedPose(Options):
    """Carts and rotary axes, or a tool pose; default: home.

    >>> gt.kinematics.assembly_modes.CommandedPose(q=[0.1, 0.2])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: q: expected 3 numbers; found 2
    """

    q: Annotated[list[float] | None, Unit("m"), Long(3), "coordinates of the three carts"] = None
    axes: Annotated[
        list[float] | None, Unit("rad"), Long(3), "rotary axes q4, q5, q6 of an F1; default: zero"
    ] = None  # fmt: skip
    tcp: Annotated[list[float] | None, Unit("m"), Long(3), "tool centre point, instead of q"] = None
    zyz: Annotated[
        list[float] | None, Unit("rad", written="deg"), Long(3),
        "ZYZ angles of the plate at tcp, if its orientation is free; default: those at home",
    ] = None  # fmt: skip
    quaternion: Annotated[list[float] | None, Long(4), "unit quaternion instead of zyz, scalar first"] = None

    def given(self) -> tuple[str, ...]:
        """Return the names of the quantities that are set."""
        return tuple(name for name in COLUMNS if getattr(self, name) is not None)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ModesStudy(Study):
    """Assembly modes of one pose or platform, or of many. Angles are in degrees, as in `AssemblyModes`."""

    poses: Annotated[int, "number of poses or platforms"] = 0
    whole: Annotated[int, "number of poses with a complete set: all finite modes are known, and none is multiple"] = 0
    finite: Annotated[int | None, "finite modes over the complex numbers, smallest number over the poses"] = None
    distinct: Annotated[
        int | None, "finite modes outside the radius of uniqueness of every other, smallest number over the poses"
    ] = None
    certified: Annotated[int | None, "modes that pass the Newton-Kantorovich test, smallest number over the poses"] = (
        None
    )
    real: Annotated[int | None, "modes with a real pose, smallest number over the poses"] = None
    real_most: Annotated[int | None, "modes with a real pose, largest number over the poses"] = None
    real_counts: Annotated[Mapping[str, int], "number of poses by their number of real modes"] = field(
        default_factory=dict
    )
    conjugate_pairs: Annotated[int | None, "pairs of complex conjugate modes, smallest number over the poses"] = None
    infinite: Annotated[int | None, "paths that ended at infinity, largest number over the poses"] = None
    multiple: Annotated[int | None, "paths that ended in singular modes, largest number over the poses"] = None
    lost: Annotated[int | None, "paths that failed, largest number over the poses"] = None
    retries: Annotated[int | None, "paths tracked again from another start system, sum over the poses"] = None
    worst_residual: Annotated[float | None, "largest residual of the scaled equations; the terms have size 1"] = None
    worst_leg_error: Annotated[
        float | None,
        "largest error of a leg length at a real mode, for the unscaled legs, over the size of the platform",
    ] = None
    nearest_distance: Annotated[
        float,
        Quantity(
            "m",
            "distance of the centroid of the plate joints between the two closest real modes, over all poses; null for "
            "fewer than two. The measure is (distance / size)^2 + angle^2",
            key="nearest_mm",
            written="mm",
        ),
    ] = math.nan
    nearest_angle_deg: Annotated[float, Quantity("deg", "angle between these two modes", key="nearest_deg")] = math.nan
    commanded: Annotated[
        int | None,
        "number of the commanded mode among the real ones, from 1; null for several poses, and if "
        "no pose was commanded or Newton's method found none",
    ] = None
    commanded_nearest_distance: Annotated[
        float,
        Quantity(
            "m",
            "distance from the commanded mode to the closest other real mode, smallest over the poses",
            key="commanded_nearest_mm",
            written="mm",
        ),
    ] = math.nan
    commanded_nearest_angle_deg: Annotated[
        float, Quantity("deg", "angle between these two modes", key="commanded_nearest_deg")
    ] = math.nan
    modes: Annotated[
        Sequence[Mapping[str, Any]],
        "real modes of a single pose: mode (from 1), tcp_m, quaternion (scalar first), "
        "nearest_mode, nearest_mm, nearest_deg, commanded; empty for several",
    ] = ()
    each: Annotated[
        Sequence[Mapping[str, Any]],
        "for each pose: pose (from 1), status, message, the values above, q_m and q_rad, the "
        "commanded tcp_m and quaternion, and its modes",
    ] = ()

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if not self.each:
            return []
        return _rows_of_one(self, self.each[0]) if len(self.each) == 1 else _rows_of_many(self, self.each)


def _rows_of_one(study: ModesStudy, pose: Mapping[str, Any]) -> list[Row]:
    rows = [
        Row("modes found, distinct, certified", f"{pose['finite']}, {pose['distinct']}, {pose['certified']}", "of 40"),
        Row("real", pose["real"]),
        Row("conjugate pairs", pose["conjugate_pairs"]),
        Row("at infinity, multiple, lost", f"{pose['infinite']}, {pose['multiple']}, {pose['lost']}", "paths"),
        Row("tracked again", pose["retries"], "paths"),
        Row("worst residual", pose["worst_residual"]),
        Row("worst error of a leg, relative", pose["worst_leg_error"]),
        *_near_rows("nearest two real modes", pose["nearest_mm"], pose["nearest_deg"]),
        Row("commanded mode", "none" if pose["commanded"] is None else pose["commanded"]),
        *_near_rows("nearest to the commanded", pose["commanded_nearest_mm"], pose["commanded_nearest_deg"]),
    ]
    for mode in study.modes:
        mark = " (commanded)" if mode["commanded"] else ""
        rows.append(Row(f"mode {mode['mode']}{mark}", ", ".join(f"{x:.4f}" for x in mode["tcp_m"]), "m"))
    return rows


def _near_rows(label: str, mm: float, deg: float) -> list[Row]:
    if not math.isfinite(mm):
        return []
    return [Row(label, mm, "mm"), Row(f"{label}, angle", deg, "deg")]


def _rows_of_many(study: ModesStudy, each: Sequence[Mapping[str, Any]]) -> list[Row]:
    return [
        Row("poses", study.poses),
        Row("with a complete set of modes", study.whole),
        *(Row(f"with {count} real modes", poses) for count, poses in study.real_counts.items()),
        Row("with the commanded pose among them", sum(pose["commanded"] is not None for pose in each)),
        Row("tracked again", study.retries, "paths"),
        Row("worst residual", study.worst_residual),
        Row("worst error of a leg, relative", study.worst_leg_error),
        *_near_rows("nearest two real modes", 1e3 * study.nearest_distance, study.nearest_angle_deg),
        *_near_rows(
            "nearest to a commanded one", 1e3 * study.commanded_nearest_distance, study.commanded_nearest_angle_deg
        ),
    ]
