"""What a calibration of cameras is asked for, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within
from ...results.quantity import Quantity, Row
from ...results.study import Study, to_inherit


@dataclass(frozen=True)
class BoardPictures(Options):
    """The board and the pictures of it.

    >>> gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6).square is None
    True
    """

    width_pixel: Annotated[int, Within(least=2), "of the pictures"]
    height_pixel: Annotated[int, Within(least=2), "of the pictures"]
    columns: Annotated[int, Within(least=2), "inner corners of the board in a row"]
    rows: Annotated[int, Within(least=2), "rows of inner corners"]
    square: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0.0), "side of a square; without it lengths are in squares"
    ] = None
    lengths: Annotated[
        Literal["as_known", "metres", "squares"],
        "of the result; as_known: metres where the square is known; metres are refused without it",
    ] = "as_known"
    identified: Annotated[bool, "corners carry an identity of their own, as on a ChArUco board"] = False


@dataclass(frozen=True)
class StereoStart(Options):
    """Where the fit begins; what is left out comes from the pictures.

    >>> gt.vision.StereoStart(focal_pixel=640.0).translation is None
    True
    """

    focal_pixel: Annotated[
        float | None, Within(above=0.0), "focal length of all cameras; by Zhang's homographies if left out"
    ] = None
    translation: Annotated[
        tuple[float, ...] | None, Long(3),
        "of the second camera, as its p = R p_first + t, in metres where the square is known, else in squares; from "
        "the boards if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class CameraFit(Options):
    """What is fitted, and what becomes of gross errors.

    >>> gt.vision.CameraFit(distortion=["k1", "k2"]).gross_errors
    'named'
    """

    distortion: Annotated[
        tuple[Literal["k1", "k2", "p1", "p2", "k3"], ...], "coefficients that are fitted; the others stay zero"
    ] = ("k1", "k2", "p1", "p2", "k3")
    principal_point: Annotated[bool, "fitted; else it stays in the middle of the picture"] = True
    gross_errors: Annotated[
        Literal["named", "removed"],
        "named: the fit is least squares of all corners, and a check fails on wrong ones; removed: by a robust loss, "
        "then without them",
    ] = "named"
    width: Annotated[float, Within(above=0.0), "of Huber's loss, in standard deviations of the noise"] = 2.0
    gross: Annotated[
        float, Within(above=3.0), "standard deviations, from which on the error of a corner is a gross one"
    ] = 5.0
    limit: Annotated[int, Within(least=1), "of iterations"] = 100


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
