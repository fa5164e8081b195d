"""What a calibration of cameras is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within


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
