"""The smooth curve through the samples of a motion."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

Array = np.ndarray

SMOOTH = 5  # degree of the spline through the samples: four continuous derivatives, accelerations without corners


def smooth_motion(time: Array, position: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration at `time` of the smooth curve through the samples (n, axes): what a
    simulated motion is taken to be between them."""
    spline = make_interp_spline(time, position, k=SMOOTH)
    return position, spline.derivative(1)(time), spline.derivative(2)(time)
