"""Keys of a path to follow, and the shape of it that they say."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from gtmodel.motion.options import Arc, Line, Polyline, Shape, Spline, Taught
from gtmodel.results import ArgumentError

from .base import Context, FileSection, InputError, Source

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
OWN = {
    "polyline": {"via_m", "blend_m"},
    "arc": {"through_m"},
    "spline": {"file", "source"},
    "taught": {"file", "source", "tolerance_m"},
}
PATH_ARGUMENTS = {"path.points": "path.file"}  # where what a library says of a path stands in the file


class PathSection(FileSection):
    """The path to follow, from start to goal."""

    shape: Literal["line", "polyline", "arc", "spline", "taught"] = Field(
        "line",
        description="straight; straight pieces with blended corners; arc of a circle; smooth curve through the points "
        "of a file; a recorded path, smoothed",
    )
    via_m: list[Point] = Field([], description="polyline: its corners between start and goal")
    blend_m: PositiveFloat = Field(0.05, description="polyline: distance from a corner at which its blend begins")
    through_m: Point | None = Field(None, description="arc: a third point between start and goal")
    file: str = Field("", description="spline, taught: CSV file with the columns x_m, y_m, z_m")
    source: Source = ""
    tolerance_m: PositiveFloat = Field(5e-4, description="taught: root mean square distance left by the smoothing")
    intervals: PositiveInt = Field(
        400, description="intervals of the motion by squared speeds, the exported one of kind trajectory"
    )

    def options(self, context: Context) -> Shape:
        """The shape, with the points of its file. Raises InputError."""
        for key in self.model_fields_set & set().union(*OWN.values()) - OWN.get(self.shape, set()):
            raise InputError(
                f"does not belong to shape '{self.shape}'; remove it or choose another shape", f"path.{key}"
            )
        match self.shape:
            case "line":
                return Line(intervals=self.intervals)
            case "polyline":
                return Polyline(self.via_m, self.blend_m, intervals=self.intervals)
            case "arc":
                if self.through_m is None:
                    raise InputError("is missing; an arc needs a third point", "path.through_m")
                return Arc(self.through_m, intervals=self.intervals)
            case "spline":
                return Spline(self._points(context), intervals=self.intervals)
        return Taught(self._points(context), self.tolerance_m, intervals=self.intervals)

    def _points(self, context: Context) -> np.ndarray:
        if not self.file:
            raise InputError("is missing", "path.file")
        file = context.file(self.file, "path.file", "path", source=self.source)
        try:
            from gtmodel.motion.paths import read_points  # here: the keys alone need no splines

            return read_points(file)
        except ArgumentError as error:
            raise InputError(error.message, "path.file") from error
