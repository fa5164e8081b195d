"""A causality of a robot on many points.

The study: causality_study, a CausalityStudy; points may be a PointGrid, Orientation adds angles of the plate.
Conditions: which rows of known values keep them. point_table: points as a CSV file.
"""

from . import point_table
from .conditions import UNIT_LENGTH, Conditions
from .evaluated import causality_of, causality_study
from .options import Orientation, PointGrid
from .result import CausalityStudy

__all__ = [
    "UNIT_LENGTH",
    "CausalityStudy",
    "Conditions",
    "Orientation",
    "PointGrid",
    "causality_of",
    "causality_study",
    "point_table",
]
