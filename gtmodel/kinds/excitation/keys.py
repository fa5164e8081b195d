"""The keys of an excitation problem: what is identified, the family of motions, limits, search, and comparison."""

from __future__ import annotations

from gtmodel import motion
from gtmodel.identify.excitation import options
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(options.Family)
class Motion(Made):
    """The family of motions of the tool centre point, each from rest to rest at one place."""


@made_from(motion.Limits)
class Limits(Made):
    """What the motion must keep; what is left out is unlimited."""


@made_from(options.Search)
class Search(Made):
    """The optimisation."""


@made_from(options.RandomMotions)
class RandomMotions(Made):
    """Random feasible motions to compare with, and to start from."""


@made_from(options.MonteCarloFits)
class MonteCarlo(Made):
    """Synthetic identifications along the optimised and the best random motion."""


@made_from(options.Experiment)
class Schema(RobotProblem, Made):
    """The motion from which masses and friction are identified best."""

    motion: Motion
    limits: Limits
    search: Search = Search()
    random: RandomMotions = RandomMotions()
    monte_carlo: MonteCarlo = MonteCarlo()
