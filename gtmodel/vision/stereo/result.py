"""What a calibration of cameras answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from ...results.quantity import Quantity, Row
from ...results.study import Study, to_inherit

ByCamera = Mapping[str, float]
Vectors = Mapping[str, Sequence[float]]


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StereoStudy(Study):
    """Lenses of cameras and where these stand, from pictures of a board. Poses are those of the first camera's frame.

    `interval("left.fx")` and the like ask the estimate: NAME.fx, fy, cx, cy [pixel], k1, k2, p1, p2, k3, and of further
    cameras "NAME, place.turn_x" [rad] and "NAME, place.x".
    """

    cameras: Annotated[Sequence[str], "names"] = ()
    pictures: Annotated[int, Quantity("", "moments at which the board was seen", "pictures")] = 0
    corners: Annotated[int, Quantity("", "corners in all pictures of all cameras that were fitted", "corners")] = 0
    rms: Annotated[
        float | None, Quantity("", "of the distance between a corner and its prediction", "", key="rms_pixel")
    ] = None
    rms_by_camera: Annotated[ByCamera, Quantity("", "the same of each camera", "", key="rms_by_camera_pixel")] = field(
        default_factory=dict
    )
    rms_by_picture: Annotated[ByCamera, Quantity("", "the same of each picture", "", key="rms_by_picture_pixel")] = (
        field(default_factory=dict)
    )
    noise: Annotated[
        float | None, Quantity("", "standard deviation of a coordinate of a corner", "", key="noise_pixel")
    ] = None
    lens: Annotated[Mapping[str, ByCamera], "fx, fy, cx, cy [pixel], k1, k2, p1, p2, k3 of each camera"] = field(
        default_factory=dict
    )
    lens_std: Annotated[Mapping[str, ByCamera], "their standard deviations"] = field(default_factory=dict)
    rotation: Annotated[Vectors, Quantity("rad", "rotation vector R of each further camera, p = R p_first + t")] = (
        field(default_factory=dict)
    )
    translation: Annotated[Vectors, Quantity("m", "t of each further camera; empty where no length is known")] = field(
        default_factory=dict
    )
    translation_squares: Annotated[Vectors, "t in squares of the board, where no length is known"] = field(
        default_factory=dict
    )
    baseline: Annotated[ByCamera, Quantity("m", "distance of each further camera; empty where no length is known")] = (
        field(default_factory=dict)
    )
    baseline_squares: Annotated[ByCamera, "distance in squares of the board, where no length is known"] = field(
        default_factory=dict
    )
    baseline_interval: Annotated[Vectors, Quantity("m", "95 %")] = field(default_factory=dict)
    baseline_interval_squares: Annotated[Vectors, "95 %"] = field(default_factory=dict)
    point_std: Annotated[
        Sequence[float], Quantity("m", "of a board's corner by intersection, cameras' own errors included: x, y, z")
    ] = ()
    point_std_squares: Annotated[Sequence[float], "the same in squares"] = ()
    tilt: Annotated[
        float | None, Quantity("rad", "largest of a board against a picture plane", "largest tilt", "deg", "", "deg")
    ] = None
    quadratic_p: Annotated[ByCamera, "chance of residuals like a quadratic map of u and v, by camera"] = field(
        default_factory=dict
    )
    radius_p: Annotated[ByCamera, "chance of residuals like these along the radius, by camera"] = field(
        default_factory=dict
    )
    map_rms: Annotated[ByCamera, Quantity("", "size of the quadratic map of the residuals", "", key="map_pixel")] = (
        field(default_factory=dict)
    )
    gross_corners: Annotated[Sequence[str], "corners with gross errors"] = ()
    wrong_pictures: Annotated[Sequence[str], "pictures that are wrong as a whole"] = ()
    removed: Annotated[bool | None, "whether these were left out of the fit"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [r for r in super().rows if r.label != "largest tilt"]
        if self.rms is None:
            return rows
        rows.append(Row("rms error", f"{self.rms:.4f}", "pixel"))
        for name in self.cameras:
            lens, std = self.lens[name], self.lens_std[name]
            rows.append(Row(f"focal length of {name}", f"{lens['fx']:.3f} +- {std['fx']:.3f}", "pixel"))
            middle = f"{lens['cx']:.2f} +- {std['cx']:.2f}, {lens['cy']:.2f} +- {std['cy']:.2f}"
            rows.append(Row(f"principal point of {name}", middle, "pixel"))
        metres = bool(self.baseline)
        for name, b in (self.baseline or self.baseline_squares).items():
            low, high = (self.baseline_interval if metres else self.baseline_interval_squares)[name]
            factor, unit = (1e3, "mm") if metres else (1.0, "squares")
            text = f"{factor * b:.6g}  ({factor * low:.6g} .. {factor * high:.6g}, 95 %)"
            rows.append(Row(f"distance of {name}", text, unit))
        rows += [r for r in super().rows if r.label == "largest tilt"]
        return rows
