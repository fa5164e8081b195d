"""The keys of kind "trajectory": where the motion begins and ends, what it keeps, what it costs."""

from __future__ import annotations

from pydantic import Field

from gtmodel.motion import options
from gtmodel.motion.problem import MotionProblem
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.path_keys import PathSection
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(options.End)
class Start(Made):
    """Where the motion begins."""


@made_from(options.End)
class Goal(Made):
    """Where the motion ends."""


@made_from(options.Limits)
class Limits(Made):
    """What the motion must keep; what is left out is unlimited."""


@made_from(options.Cost)
class Cost(Made):
    """What is minimised: time * T + energy * sum int (F / force_unit_N)^2 dt."""


@made_from(options.Starts)
class Starts(Made):
    """Further starts of the search, from bent lines; of all optima the best counts."""


@made_from(options.Mesh)
class Mesh(Made):
    """Where the equations are collocated (Radau)."""


@made_from(options.Solver)
class Solver(Made):
    """When the solver stops."""


@made_from(options.Export)
class Export(Made):
    """The files for a controller."""


class Schema(RobotProblem):
    """Optimal motion between two poses, free or along a path."""

    start: Start
    goal: Goal
    limits: Limits
    path: PathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Cost = Cost()
    mesh: Mesh = Mesh()
    starts: Starts = Starts()
    solver: Solver = Solver()
    export: Export = Export()

    def motion(self, context: Context) -> MotionProblem:
        """The motion that the file describes. Raises InputError, and ArgumentError."""
        return MotionProblem(
            robot=self.model(context), path=None if self.path is None else self.path.options(context),
            **options_of(self), title=self.title,
        )  # fmt: skip
