"""Kinematic calibration of any model on its own closure equations. Knows no robot.

Measurements, Pose, Correction   measured poses, their noise, and what lies between sensor and model
Choice                           which parameters are free, fixed, tied, unit quaternions, with priors
prepare, Problem                 equations, unknowns and slopes; identifiability before anything is measured
calibrate, Calibration           parameters with confidence, residuals per link and pose, errors on other poses
closure_equations                what closes, as symbols
"""

from .calibration import Calibration, calibrate
from .closure import Closure, closure_equations
from .measurements import Correction, Measurements, Pose
from .problem import COSTS, Cost, Problem, prepare
from .unknowns import Choice

__all__ = [
    "COSTS", "Calibration", "Choice", "Closure", "Correction", "Cost", "Measurements", "Pose", "Problem", "calibrate",
    "closure_equations", "prepare",
]  # fmt: skip
