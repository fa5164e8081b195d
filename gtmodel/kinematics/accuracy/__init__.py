"""Positioning accuracy of three links (Dressler 2012, section 4.3 and appendix A).

Corners: first_order_corners, exact_corners, projected_corners, SIGNS, largest. Errors: Ellipsoids, ErrorCase. Shape:
Parallelepiped, parallelepiped. Maps: ErrorMap, map_errors. Draws: length_cloud, base_point_cloud. Forward kinematics:
ForwardWithLengths, common_point.

The study: accuracy_study over a section, an AccuracyStudy; asked for by LinkErrors, ErrorSection, MonteCarlo.
"""

from .corners import SIGNS, exact_corners, first_order_corners, largest
from .ellipsoids import Ellipsoids, projected_corners
from .error_map import ErrorCase, ErrorMap, map_errors
from .lengths import ForwardWithLengths
from .monte_carlo import base_point_cloud, length_cloud
from .options import ErrorSection, LinkErrors, MonteCarlo
from .parallelepiped import Parallelepiped, parallelepiped
from .section_study import AccuracyStudy, accuracy_study
from .spheres import common_point

__all__ = [
    "SIGNS",
    "AccuracyStudy",
    "Ellipsoids",
    "ErrorCase",
    "ErrorMap",
    "ErrorSection",
    "ForwardWithLengths",
    "LinkErrors",
    "MonteCarlo",
    "Parallelepiped",
    "accuracy_study",
    "base_point_cloud",
    "common_point",
    "exact_corners",
    "first_order_corners",
    "largest",
    "length_cloud",
    "map_errors",
    "parallelepiped",
    "projected_corners",
]
