"""Kinematics that the equations alone do not give: guideways as measured, the plate's orientation over a grid."""

from .guideways import GuidewayFit, MeasurementError, fit_guideway
from .orientation import OrientationMap, grid, orientation_map
from .rotations import rotation_vector, zyz
from .transmission import Backlash, CyclicTerm, backlash, cyclic_term

__all__ = [
    "Backlash",
    "CyclicTerm",
    "GuidewayFit",
    "MeasurementError",
    "OrientationMap",
    "backlash",
    "cyclic_term",
    "fit_guideway",
    "grid",
    "orientation_map",
    "rotation_vector",
    "zyz",
]
