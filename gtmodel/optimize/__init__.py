"""Optimal control: direct collocation of any Optimization. Knows no robot."""

from .control import Blocks
from .mesh import Mesh
from .refine import Refinement, refine
from .resimulate import Resimulation, resimulate
from .solution import Check, Solution
from .solve import NotSolved, SolverOptions, solve

__all__ = [
    "Blocks", "Check", "Mesh", "NotSolved", "Refinement", "Resimulation", "Solution", "SolverOptions", "refine",
    "resimulate", "solve",
]  # fmt: skip
