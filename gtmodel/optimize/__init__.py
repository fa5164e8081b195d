"""Optimal control: direct collocation of any Optimization. Knows no robot.

solve gives a Solution; optimization_study tries it in an integrator too: an OptimizationStudy.
"""

from .compiled import CompilerMissing
from .control import Blocks
from .estimate import Estimate, estimate
from .judgement.refine import Refinement, refine
from .judgement.resimulate import Resimulation, resimulate
from .mesh import Mesh
from .multistart import MultiStart, Optimum, multi_start
from .phases import Phases, PhasesSolution, solve_phases
from .solution import Check, Solution
from .solve import NotSolved, SolverOptions, solve
from .study import OptimizationStudy, optimization_study
from .transcription import Continuation, Transcription, transcribe

__all__ = [
    "Blocks", "Check", "CompilerMissing", "Continuation", "Estimate", "Mesh", "MultiStart", "NotSolved",
    "OptimizationStudy", "Optimum", "Phases", "PhasesSolution", "Refinement", "Resimulation", "Solution",
    "SolverOptions", "Transcription", "estimate", "multi_start", "optimization_study", "refine", "resimulate",
    "solve", "solve_phases", "transcribe",
]  # fmt: skip
