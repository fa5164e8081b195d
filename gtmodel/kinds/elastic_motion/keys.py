"""The keys of kind "elastic_motion"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat

from gtmodel.motion.elastic import options
from gtmodel.problem_files.base import FileSection
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.motion.ElasticStudy"


class PlaceSection(FileSection):
    """Where the motion begins or ends, at rest."""

    tcp_m: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="tool centre point, three coordinates in the robot's frame"
    )


class LimitsSection(FileSection):
    """What the motors can."""

    force_N: PositiveFloat = Field(description="largest force of each motor")


class Schema(RobotProblem):
    """Residual vibration of an elastic tool of a three-link robot."""

    start: PlaceSection
    goal: PlaceSection
    limits: LimitsSection
    tool: Made[options.ElasticTool]
    cost: Made[options.ElasticCost] = Made[options.ElasticCost].left_out()
    mesh: Made[options.ElasticMesh] = Made[options.ElasticMesh].left_out()
    solver: Made[options.ElasticSolver] = Made[options.ElasticSolver].left_out()
