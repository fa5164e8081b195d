"""What a study of a robot with its cameras gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ...results import Quantity, Row, Study
from ...results.study import to_inherit

Table = Sequence[Mapping[str, Any]] | None
Numbers = Mapping[str, float] | None


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotCamerasStudy(Study):
    """Robot and cameras calibrated together, errors on poses that no fit saw, and whether the pictures fit; or the
    places of cameras that were compared."""

    unknowns: Annotated[Table, Quantity("",
        "for each free parameter of the robot: name, unit, start, value, std and interval_95, in SI units",
    )] = None  # fmt: skip
    cameras: Annotated[Table, Quantity("",
        "for each camera: name, then by parameter its value and std; pixels, metres, quaternion scalar first, from "
        "camera to base; rms_pixel of its residuals and noise_ratio, these over the stated sigma",
    )] = None  # fmt: skip
    poses: Annotated[Numbers, Quantity("", "number of poses fitted and held out, and of corners used and given")] = None
    removed_pictures: Annotated[Sequence[str] | None, "pictures that were wrong as a whole"] = None
    removed_poses: Annotated[
        Sequence[str] | None, "poses none of whose pictures belongs to their row of the actuators"
    ] = None
    removed_corners: Annotated[Sequence[str] | None, "single corners far off"] = None
    held_out_pixel: Annotated[float | None, Quantity("",
        "1.48 times the median of |residual| of held-out corners, at the poses that the calibrated robot predicts",
    )] = None  # fmt: skip
    held_out: Annotated[Numbers, Quantity("m",
        "mean, rms and max error of held-out positions against the truth of synthetic pictures, once the frame of the "
        "true positions is laid through them", written="mm",
    )] = None  # fmt: skip
    two_step: Annotated[Numbers, Quantity("m",
        "in two steps: mean error of the intersected target (centres) and of held-out positions (held_out), and "
        "both once their scale is fitted to the true positions too (centres_scaled, held_out_scaled)", written="mm",
    )] = None  # fmt: skip
    delay: Annotated[Numbers, Quantity("s",
        "how late pictures are behind the actuators' readings, value and std; null where it was not estimated",
        written="ms",
    )] = None  # fmt: skip
    predicted: Annotated[float | None, Quantity("m",
        "rms error over the held-out positions that noise leaves, predicted from the covariance", written="mm",
    )] = None  # fmt: skip
    picture_radius: Annotated[Numbers, "by camera: probability by chance of residuals along the radius"] = None
    picture_quadratic: Annotated[Numbers, "by camera: likewise of a quadratic map in u and v"] = None
    places: Annotated[Table, Quantity("",
        "of a plan: baseline_m, distance_m, rms_mm and max_mm predicted, focal_std_pixel, and why where there is none; "
        "the best first",
    )] = None  # fmt: skip
    synthetic: Annotated[str | None, "seed and noise of synthetic pictures; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows: list[Row] = []
        if self.poses is not None:
            p = self.poses
            rows.append(Row("poses fitted, held out", f"{p['fitted']:g}, {p['held_out']:g}"))
            rows.append(Row("corners used", f"{p['corners']:g} of {p['corners_given']:g}"))
        for c in self.cameras or ():
            f = c["fx"]
            said = f"{f['value']:.2f} +- {f['std']:.2g}" if f["std"] else f"{f['value']:.2f} (held)"
            rows.append(Row(f"focal length of {c['name']}", said, "pixel"))
            rows.append(Row(f"residuals of {c['name']}", f"{c['rms_pixel']:.4f}", "pixel rms"))
        if self.held_out_pixel is not None:
            rows.append(Row("held-out corners", f"{self.held_out_pixel:.4f}", "pixel"))
        if self.held_out is not None:
            rows.append(Row("held-out positions", f"{1e3 * self.held_out['mean']:.4g}", "mm mean"))
        if self.delay is not None:
            rows.append(
                Row("delay of the pictures", f"{1e3 * self.delay['value']:.4g} +- {1e3 * self.delay['std']:.2g}", "ms")
            )
        if self.predicted is not None:
            rows.append(Row("predicted from the covariance", f"{1e3 * self.predicted:.4g}", "mm rms"))
        if self.two_step is not None:
            rows.append(Row("in two steps", f"{1e3 * self.two_step['held_out']:.4g}", "mm mean"))
        for r in self.places or ():
            said = r["why"] or f"{r['rms_mm']:.4g} rms, {r['max_mm']:.4g} at worst"
            rows.append(
                Row(f"baseline {r['baseline_m']:g} m, distance {r['distance_m']:g} m", said, "" if r["why"] else "mm")
            )
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
