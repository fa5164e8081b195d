"""What is done with a sensor before the start: calibration from poses at rest, and the test of its sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from .calibration import WrenchCalibration, calibrate_wrench
from .sensor import MountedSensor
from .sign import SignTest, sign_test
from .synthetic_sensor import SyntheticSensor

AT_REST = 50  # readings before the start


def calibrated(
    sensor: SyntheticSensor, poses: int, readings: int, turn: np.ndarray, rng: np.random.Generator
) -> tuple[WrenchCalibration, MountedSensor, SignTest]:
    """Calibrated on random poses while its sign was right, as the law knows it; then its sign is tested.

    In each pose the mean of so many readings counts. turn (3, 3): of the tool before the start.
    """
    fewer = 1 / np.sqrt(readings)
    right = replace(
        sensor, sign=1.0, force_noise=fewer * sensor.force_noise, moment_noise=fewer * sensor.moment_noise
    )  # fmt: skip
    turns = scipy.spatial.transform.Rotation.random(poses, rng=rng).as_matrix()
    noise = max(right.force_noise, 1e-6), max(right.moment_noise, 1e-8)
    known = calibrate_wrench(turns, *right.readings_at_rest(turns, rng), sigma_force=noise[0], sigma_moment=noise[1])
    now = turn @ sensor.matrix
    forces = sensor.readings_at_rest(np.tile(now, (AT_REST, 1, 1)), rng)[0]
    test = sign_test(known, now, forces, sigma=max(sensor.force_noise, 1e-6))
    return known, MountedSensor.calibrated(known, sensor.matrix, sensor.point), test
