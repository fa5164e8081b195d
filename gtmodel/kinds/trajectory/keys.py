"""Keys of kind "trajectory": start and goal of the motion, limits, path and cost."""

from __future__ import annotations

from pydantic import Field

from gtmodel.motion import options
from gtmodel.motion.options import MotionProblem
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import PathSection, RobotProblem

RESULT = "gtmodel.motion.MotionStudy"


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
