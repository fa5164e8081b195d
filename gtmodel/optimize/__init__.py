"""Optimal control: direct collocation of any Optimization. Knows no robot."""

from .control import Blocks
from .mesh import Mesh
from .multistart import MultiStart, Optimum, multi_start
from .phases import Phases, PhasesSolution, solve_phases
from .refine import Refinement, refine
from .resimulate import Resimulation, resimulate
from .solution import Check, Solution
from .solve import NotSolved, SolverOptions, solve
from .transcription import Continuation, Transcription, transcribe

__all__ = [
    "Blocks", "Check", "Continuation", "Mesh", "MultiStart", "NotSolved", "Optimum", "Phases", "PhasesSolution",
    "Refinement", "Resimulation", "Solution", "SolverOptions", "Transcription", "multi_start", "refine", "resimulate",
    "solve", "solve_phases", "transcribe",
]  # fmt: skip
