"""Options and result of a calibration of cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within
from ...results.quantity import Quantity, Row
from ...results.study import Study, to_inherit


@dataclass(frozen=True)
class BoardPictures(Options):
    """The board and its pictures.

    >>> gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6).square is None
    True
    """

    width_pixel: Annotated[int, Within(least=2), "of the pictures"]
    height_pixel: Annotated[int, Within(least=2), "of the pictures"]
    columns: Annotated[int, Within(least=2), "inner corners of the board in a row"]
    rows: Annotated[int, Within(least=2), "rows of inner corners"]
    square: Annotated[
        float | None,
        Unit("m", written="mm"),
        Within(above=0.0),
        "side of a square; if left out, lengths are in squares",
    ] = None
    lengths: Annotated[
        Literal["as_known", "metres", "squares"],
        "unit of the result; as_known: metres if the side of a square is known; metres without it are an error",
    ] = "as_known"
    identified: Annotated[bool, "corners are identified individually, as on a ChArUco board"] = False


@dataclass(frozen=True)
class StereoStart(Options):
    """Starting values of the fit; those left out are computed from the pictures.

    >>> gt.vision.StereoStart(focal_pixel=640.0).translation is None
    True
    """

    focal_pixel: Annotated[
        float | None, Within(above=0.0), "focal length of all cameras; from homographies (Zhang) if left out"
    ] = None
    translation: Annotated[
        tuple[float, ...] | None, Long(3),
        "t of the second camera in p = R p_first + t, in metres if the side of a square is known, else in squares; "
        "from the boards if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class CameraFit(Options):
    """The fitted parameters, and the treatment of gross errors.

    >>> gt.vision.CameraFit(distortion=["k1", "k2"]).gross_errors
    'named'
    """

    distortion: Annotated[
        tuple[Literal["k1", "k2", "p1", "p2", "k3"], ...], "fitted coefficients; the others are zero"
    ] = ("k1", "k2", "p1", "p2", "k3")
    principal_point: Annotated[bool, "fit it; otherwise it is the middle of the picture"] = True
    gross_errors: Annotated[
        Literal["named", "removed"],
        "named: least squares with all corners, and a check fails if there are wrong ones; removed: a robust fit finds "
        "them, and the final fit leaves them out",
    ] = "named"
    width: Annotated[float, Within(above=0.0), "width of Huber's loss, in standard deviations of the noise"] = 2.0
    gross: Annotated[float, Within(above=3.0), "smallest gross error of a corner, in standard deviations"] = 5.0
    limit: Annotated[int, Within(least=1), "largest number of iterations"] = 100


ByCamera = Mapping[str, float]
Vectors = Mapping[str, Sequence[float]]


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StereoStudy(Study):
    """Lenses and poses of cameras from pictures of a board. Poses are in the frame of the first camera.

    `interval("left.fx")` returns the interval of a parameter of the estimate: NAME.fx, fy, cx, cy [pixel], k1, k2, p1,
    p2, k3, and for further cameras "NAME, place.turn_x" [rad] and "NAME, place.x".
    """

    cameras: Annotated[Sequence[str], "names"] = ()
    pictures: Annotated[int, Quantity("", "number of times at which the board was seen", "pictures")] = 0
    corners: Annotated[int, Quantity("", "fitted corners in all pictures of all cameras", "corners")] = 0
    rms: Annotated[
        float | None, Quantity("", "rms distance between a corner and its prediction", "", key="rms_pixel")
    ] = None
    rms_by_camera: Annotated[ByCamera, Quantity("", "rms of each camera", "", key="rms_by_camera_pixel")] = field(
        default_factory=dict
    )
    rms_by_picture: Annotated[ByCamera, Quantity("", "rms of each picture", "", key="rms_by_picture_pixel")] = field(
        default_factory=dict
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
    translation: Annotated[Vectors, Quantity("m", "t of each further camera; empty if no length is known")] = field(
        default_factory=dict
    )
    translation_squares: Annotated[Vectors, "t in squares of the board, if no length is known"] = field(
        default_factory=dict
    )
    baseline: Annotated[ByCamera, Quantity("m", "distance of each further camera; empty if no length is known")] = (
        field(default_factory=dict)
    )
    baseline_squares: Annotated[ByCamera, "distance in squares of the board, if no length is known"] = field(
        default_factory=dict
    )
    baseline_interval: Annotated[Vectors, Quantity("m", "95 %")] = field(default_factory=dict)
    baseline_interval_squares: Annotated[Vectors, "95 %"] = field(default_factory=dict)
    point_std: Annotated[
        Sequence[float], Quantity("m", "std of an intersected corner, with the errors of the cameras: x, y, z")
    ] = ()
    point_std_squares: Annotated[Sequence[float], "point_std in squares"] = ()
    tilt: Annotated[
        float | None,
        Quantity("rad", "largest tilt of a board against a picture plane", "largest tilt", "deg", "", "deg"),
    ] = None
    quadratic_p: Annotated[ByCamera, "p-value of the test for a quadratic map of u and v, by camera"] = field(
        default_factory=dict
    )
    radius_p: Annotated[ByCamera, "p-value of the test for a radial pattern, by camera"] = field(default_factory=dict)
    map_rms: Annotated[ByCamera, Quantity("", "rms of the quadratic map of the residuals", "", key="map_pixel")] = (
        field(default_factory=dict)
    )
    gross_corners: Annotated[Sequence[str], "corners with gross errors"] = ()
    wrong_pictures: Annotated[Sequence[str], "pictures that are wrong as a whole"] = ()
    removed: Annotated[bool | None, "whether these were left out of the fit"] = None

    @property
    def rows(self) -> list[Row]:
        """The rows of the printed table."""
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
