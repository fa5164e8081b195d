"""Keys of kind "trajectory": start and goal of the motion, limits, path and cost."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from gtmodel.motion import options
from gtmodel.motion.options import Arc, Line, MotionProblem, Polyline, Shape, Spline, Taught
from gtmodel.problem_files.base import Context, FileSection, InputError, Source
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results.refusal import naming

RESULT = "gtmodel.motion.MotionStudy"


Point = Annotated[list[float], Field(min_length=3, max_length=3)]
OWN = {
    "polyline": {"via_m", "blend_m"},
    "arc": {"through_m"},
    "spline": {"file", "source"},
    "taught": {"file", "source", "tolerance_m"},
}
PATH_ARGUMENTS = {"path.points": "path.file"}  # argument of the library -> key


class PathSection(FileSection):
    """The path to follow, from start to goal."""

    shape: Literal["line", "polyline", "arc", "spline", "taught"] = Field(
        "line",
        description="line: straight; polyline: straight segments with blended corners; arc: arc of a circle; spline: "
        "smooth curve through the points of a file; taught: a recorded path, smoothed",
    )
    via_m: list[Point] = Field([], description="polyline: corners between start and goal")
    blend_m: PositiveFloat = Field(0.05, description="polyline: distance from a corner at which its blend begins")
    through_m: Point | None = Field(None, description="arc: a third point between start and goal")
    file: str = Field("", description="spline, taught: CSV file with the columns x_m, y_m, z_m")
    source: Source = ""
    tolerance_m: PositiveFloat = Field(5e-4, description="taught: rms distance between recorded and smoothed path")
    intervals: PositiveInt = Field(
        400, description="intervals of the squared speed in the exported motion of kind trajectory"
    )

    def options(self, context: Context) -> Shape:
        """Return the shape, with the points of its file. Raises InputError."""
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
                    raise InputError("is missing; give a third point of the arc", "path.through_m")
                return Arc(self.through_m, intervals=self.intervals)
            case "spline":
                return Spline(self._points(context), intervals=self.intervals)
        return Taught(self._points(context), self.tolerance_m, intervals=self.intervals)

    def _points(self, context: Context) -> np.ndarray:
        if not self.file:
            raise InputError("is missing; name a CSV file with the columns x_m, y_m, z_m", "path.file")
        file = context.file(self.file, "path.file", "path", source=self.source)
        with naming("path.file", refusal=InputError):
            from gtmodel.motion.paths import read_points  # here: the keys alone need no splines

            return read_points(file)


class Schema(RobotProblem):
    """Optimal motion between two poses, free or along a path."""

    start: Made[options.End]
    goal: Made[options.End]
    limits: Made[options.Limits]
    path: PathSection | None = Field(default=None, description="the path to follow; free motion if left out")
    cost: Made[options.Cost] = Made[options.Cost].left_out()
    mesh: Made[options.MotionMesh] = Made[options.MotionMesh].left_out()
    starts: Made[options.Starts] = Made[options.Starts].left_out()
    solver: Made[options.Solver] = Made[options.Solver].left_out()
    export: Made[options.Export] = Made[options.Export].left_out()

    def motion(self, context: Context) -> MotionProblem:
        """Return the motion that the file describes. Raises InputError and ArgumentError."""
        return MotionProblem(
            robot=self.model(context), path=None if self.path is None else self.path.options(context),
            **options_of(self), title=self.title,
        )  # fmt: skip
