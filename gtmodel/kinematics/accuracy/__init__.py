"""Positioning accuracy of three links (Dressler 2012, section 4.3 and appendix A).

Corners: first_order_corners, exact_corners, projected_corners, SIGNS, largest. Errors: Ellipsoids, ErrorCase. Shape:
Parallelepiped, parallelepiped. Maps: ErrorMap, map_errors. Draws: length_cloud, base_point_cloud. Forward kinematics:
ForwardWithLengths, common_point.

The study: accuracy_study over a section, an AccuracyStudy; asked for by LinkErrors, ErrorSection, MonteCarloDraws.
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .accuracy_result import AccuracyStudy as AccuracyStudy
    from .corners import (
        SIGNS as SIGNS,
        exact_corners as exact_corners,
        first_order_corners as first_order_corners,
        largest as largest,
    )
    from .ellipsoids import Ellipsoids as Ellipsoids, projected_corners as projected_corners
    from .error_map import ErrorCase as ErrorCase, ErrorMap as ErrorMap, map_errors as map_errors
    from .lengths import ForwardWithLengths as ForwardWithLengths
    from .monte_carlo import base_point_cloud as base_point_cloud, length_cloud as length_cloud
    from .options import ErrorSection as ErrorSection, LinkErrors as LinkErrors, MonteCarloDraws as MonteCarloDraws
    from .parallelepiped import Parallelepiped as Parallelepiped, parallelepiped as parallelepiped
    from .section_study import accuracy_study as accuracy_study
    from .spheres import common_point as common_point

public(__name__)
