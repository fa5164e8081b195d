"""Optimal control: direct collocation of any Optimization. Knows no robot."""

from .mesh import Mesh
from .solution import Check, Solution
from .solve import NotSolved, SolverOptions, solve

__all__ = ["Check", "Mesh", "NotSolved", "Solution", "SolverOptions", "solve"]
