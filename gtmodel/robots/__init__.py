"""Robots written in the language, and the catalogue of printed parameter sets."""

from .catalogue import gantry_tau, inertia_names, names
from .six_link import SixLink, on_guideways, six_link_gantry_tau
from .three_link import GantryTau

__all__ = ["GantryTau", "SixLink", "gantry_tau", "inertia_names", "names", "on_guideways", "six_link_gantry_tau"]
