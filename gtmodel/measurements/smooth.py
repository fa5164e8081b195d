"""The smooth curve through the samples of a motion."""

from __future__ import annotations

import numpy as np
import scipy

Array = np.ndarray

SMOOTH = 5  # degree of the spline through the samples: four continuous derivatives, accelerations without corners


def smooth_motion(time: Array, position: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration at the samples, of the smooth curve through them.

    Args:
        time: (n,) [s], ascending, n >= 6.
        position: (n, axes), exact samples such as those of a reference; noise would be amplified.

    The curve is a spline of degree five: what a simulated motion is taken to be between its samples.

    >>> t = np.linspace(0.0, 1.0, 51)
    >>> q, dq, ddq = gt.measurements.smooth_motion(t, t[:, None] ** 3)
    >>> ddq[[10, 25, 50], 0].round(6).tolist()  # 6 t
    [1.2, 3.0, 6.0]
    """
    spline = scipy.interpolate.make_interp_spline(time, position, k=SMOOTH)
    return position, spline.derivative(1)(time), spline.derivative(2)(time)
