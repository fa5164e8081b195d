"""Positioning accuracy of three links (Dressler 2012, section 4.3 and appendix A).

Corners: first_order_corners, exact_corners, projected_corners, SIGNS, largest. Errors: Ellipsoids, ErrorCase. Shape:
Parallelepiped, parallelepiped. Maps: ErrorMap, map_errors. Draws: length_cloud, base_point_cloud. Forward kinematics:
ForwardWithLengths, common_point.

The study: accuracy_study over a section, an AccuracyStudy; options: LinkErrors, ErrorSection, MonteCarloDraws.
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .case import (
        ForwardWithLengths as ForwardWithLengths,
        base_point_cloud as base_point_cloud,
        common_point as common_point,
        length_cloud as length_cloud,
    )
    from .corners import (
        SIGNS as SIGNS,
        Ellipsoids as Ellipsoids,
        ErrorCase as ErrorCase,
        ErrorMap as ErrorMap,
        Parallelepiped as Parallelepiped,
        exact_corners as exact_corners,
        first_order_corners as first_order_corners,
        largest as largest,
        map_errors as map_errors,
        parallelepiped as parallelepiped,
        projected_corners as projected_corners,
    )
    from .options import (
        AccuracyStudy as AccuracyStudy,
        ErrorSection as ErrorSection,
        LinkErrors as LinkErrors,
        MonteCarloDraws as MonteCarloDraws,
    )
    from .section_study import accuracy_study as accuracy_study

public(__name__)
