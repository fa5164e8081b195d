"""Printed values of Cvitanic 2021, chapter 4, to stand beside ours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..paths import TrackedPath
from .options import FusionSensors

# Table 8, means (deviations): tracker or unit alone, then fusion; 3 axes, 5 axes; None where it is not applicable
TABLE_8 = {
    "position": ((8.9e-6, 8.9e-6), (8.9e-6, 8.9e-6), "m"),
    "orientation": ((None, 0.012), (None, 0.11), "deg"),
    "acceleration": ((0.00018, 0.00061), (0.00012, 0.00040), "m/s2"),
    "angular_velocity": ((None, 0.070), (None, 0.062), "deg/s"),
}
# Table 9: key of the sensors, printed value, fusion's mean errors in 3 and 5 axes, of which quantity. The gyro's is
# printed as 0.16 deg/s/rtHz, ten times what Table 7 offers and what its error belongs to
TABLE_9 = {
    "position_noise": (0.64e-3, (0.41e-3, 0.41e-3), "position"),
    "acceleration_noise": (0.0039, (0.00048, 0.00049), "acceleration"),
    "rate_noise": (0.016, (None, 0.35), "angular_velocity"),
}
# Table 10: limits in 3 and 5 axes below which fusion is better than the tracker alone, in the unit of our keys
TABLE_10 = {
    "acceleration_noise": ((0.1, 0.1), "m/s2"),
    "acceleration_bias": ((0.001, 0.001), "m/s2"),
    "rate_noise": ((None, 0.1), "deg/s"),
    "rate_bias": ((None, 1.0), "deg/s"),
    "misalignment": ((10.0, 0.1), "deg"),
    "arm_error": ((None, 0.1), "m"),
    "sample_time": ((0.01, 0.01), "s"),
}
TABLE_11 = "no data exist"  # of the measurements on the robot; the ratios of its rows, 36 and 35 %, check


def printed_errors(
    path: TrackedPath, sensors: FusionSensors
) -> tuple[str, dict[str, tuple[float | None, float | None]]]:
    """Printed mean errors of one sensor and of fusion by quantity, SI, and their table; none for numbers other than
    those of Tables 7 and 9."""
    if path != replace(TrackedPath(), axes=path.axes):
        return "", {}
    k, plain = (0 if path.axes == 3 else 1), FusionSensors()
    if sensors == plain:
        rows = {name: (alone[k], fused[k], unit) for name, (alone, fused, unit) in TABLE_8.items()}
        return "Table 8", {
            name: (_si(alone, unit), _si(fused, unit))
            for name, (alone, fused, unit) in rows.items()
            if fused is not None
        }
    for key, (value, fused, name) in TABLE_9.items():
        given = _si(value, "deg/s" if key == "rate_noise" else "m")
        if given is not None and fused[k] is not None and sensors == replace(plain, **{key: given}):
            return "Table 9", {name: (None, _si(fused[k], "deg/s" if key == "rate_noise" else "m"))}
    return "", {}


def _si(value: float | None, unit: str) -> float | None:
    return None if value is None else value * (np.pi / 180 if unit.startswith("deg") else 1.0)
