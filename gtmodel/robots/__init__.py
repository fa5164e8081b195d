"""Robots written in the language, and the catalogue of printed parameter sets."""

from .catalogue import entries, gantry_tau, inertia_names, make, names
from .configuration import configuration
from .f1 import F1, f1_five_dof, f1_gantry_tau, f1_rotation
from .f1_five_dof import F1FiveDof, F1Rotation
from .six_link import SixLink, six_link_gantry_tau
from .three_link import GantryTau

__all__ = [
    "F1",
    "F1FiveDof",
    "F1Rotation",
    "GantryTau",
    "SixLink",
    "configuration",
    "entries",
    "f1_five_dof",
    "f1_gantry_tau",
    "f1_rotation",
    "gantry_tau",
    "inertia_names",
    "make",
    "names",
    "six_link_gantry_tau",
]
