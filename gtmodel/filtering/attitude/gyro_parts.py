"""What a calibrated gyro's matrix is made of: turn to the body, scale, misalignment."""

from __future__ import annotations

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

_VECTORS = tuple(f"{what}[{k}]" for what in ("mount", "scale", "misalignment", "bias") for k in range(3))
NAMES = (*_VECTORS, "offset")
UNITS = ("rad",) * 3 + ("1",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("s",)


def parts(numbers: np.ndarray) -> np.ndarray:
    """Mount (3,), scale (3,), misalignment (3,), bias (3,) and offset from the thirteen numbers of a correction.

    matrix = turn * stretch, the polar decomposition: `mount` is the rotation vector of the turn from the sensor to the
    body; the stretch is symmetric, scales on its diagonal, misalignments yz, zx, xy of the sensor's axes beside it.
    """
    turn, stretch = scipy.linalg.polar(np.reshape(numbers[:9], (3, 3)))
    beside = stretch[[1, 2, 0], [2, 0, 1]]
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), np.diag(stretch), beside, numbers[9:]])
