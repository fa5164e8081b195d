"""Robots written in the language, and the catalogue of printed parameter sets."""

from .catalogue import gantry_tau, inertia_names, names
from .three_link import GantryTau

__all__ = ["GantryTau", "gantry_tau", "inertia_names", "names"]
