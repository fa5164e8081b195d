"""Optimal control by direct collocation, for any Optimization; independent of robots.

solve returns a Solution; optimization_study also re-simulates it and returns an OptimizationStudy.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from ..compiler.toolchain import CompilerMissing as CompilerMissing
    from .estimate import Estimate as Estimate, estimate as estimate
    from .events.phases_of_events import EventPhases as EventPhases, phases_of_events as phases_of_events
    from .judgement.refine import Refinement as Refinement, refine as refine
    from .judgement.resimulate import Resimulation as Resimulation, resimulate as resimulate
    from .mesh import Blocks as Blocks, LengthCost as LengthCost, Mesh as Mesh
    from .multistart import MultiStart as MultiStart, Optimum as Optimum, multi_start as multi_start
    from .optimization_result import OptimizationStudy as OptimizationStudy
    from .phases import Phases as Phases, PhasesSolution as PhasesSolution, solve_phases as solve_phases
    from .solution import Check as Check, Solution as Solution
    from .solve import NotSolved as NotSolved, SolverOptions as SolverOptions, solve as solve
    from .study import optimization_study as optimization_study
    from .transcription import Continuation as Continuation, Transcription as Transcription, transcribe as transcribe

public(__name__)
