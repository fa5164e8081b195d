"""Optimal control: direct collocation of any Optimization. Knows no robot."""

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
from .transcription import Continuation, Transcription, transcribe

__all__ = [
    "Blocks", "Check", "CompilerMissing", "Continuation", "Estimate", "Mesh", "MultiStart", "NotSolved", "Optimum",
    "Phases", "PhasesSolution", "Refinement", "Resimulation", "Solution", "SolverOptions", "Transcription", "estimate",
    "multi_start", "refine", "resimulate", "solve", "solve_phases", "transcribe",
]  # fmt: skip
