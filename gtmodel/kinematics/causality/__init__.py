"""A causality of a robot at many points.

The study: causality_study, a CausalityStudy; points may be a PointGrid, Orientation adds angles of the plate.
Conditions: conditions on known values. point_table: points as a CSV file.
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from . import point_table as point_table
    from .evaluation import causality_of as causality_of, causality_study as causality_study
    from .options import CausalityStudy as CausalityStudy, Orientation as Orientation, PointGrid as PointGrid
    from .point_table import UNIT_LENGTH as UNIT_LENGTH, Conditions as Conditions

public(__name__)
