"""The keys of an excitation problem: what is identified, the family of motions, limits, search, and comparison."""

from __future__ import annotations

from gtmodel.identify.excitation import options
from gtmodel.motion import Limits
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.identify.ExcitationStudy"


@made_from(options.IdentificationExperiment)
class Schema(RobotProblem, Made):
    """The motion from which masses and friction are identified best."""

    motion: Made[options.Family]
    limits: Made[Limits]
    search: Made[options.ExcitationSearch] = Made[options.ExcitationSearch].left_out()
    random: Made[options.RandomMotions] = Made[options.RandomMotions].left_out()
    monte_carlo: Made[options.MonteCarloFits] = Made[options.MonteCarloFits].left_out()
