"""The keys of kind "elastic_motion"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat

from gtmodel.motion.elastic import options
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem


class Place(Section):
    """Where the motion begins or ends, at rest."""

    tcp_m: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="tool centre point, three coordinates in the robot's frame"
    )


class Limits(Section):
    """What the motors can."""

    force_N: PositiveFloat = Field(description="largest force of each motor")


@made_from(options.Tool)
class Tool(Made):
    """A mass on a spring at the plate, alike in all directions."""


@made_from(options.Cost)
class Cost(Made):
    """Final time plus weighted energy."""


@made_from(options.Mesh)
class Mesh(Made):
    """Where the equations are collocated."""


@made_from(options.Solver)
class Solver(Made):
    """How the plans are found."""


class Schema(RobotProblem):
    """Residual vibration of an elastic tool of a three-link robot."""

    start: Place
    goal: Place
    limits: Limits
    tool: Tool
    cost: Cost = Cost()
    mesh: Mesh = Mesh()
    solver: Solver = Solver()
