"""Problem files of identification for the synthetic logs of five vendors, filled from the data sheet alone."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import tomli_w

import gtmodel as gt
from gtmodel import der
from tests.support.vendor_logs import VENDORS, Truth

NAMES = [*(f"{letter}_{i}" for letter in "Jvc" for i in (1, 2, 3)), "mgl"]


class ThreeAxes(gt.Model):
    """Three axes without inertial coupling, the second one under gravity; the third turns."""

    J_1, J_2, J_3 = (gt.parameter(8.0, unit="kg.m2"), gt.parameter(6.0, unit="kg.m2"), gt.parameter(0.6, unit="kg.m2"))
    v_1, v_2, v_3 = (gt.parameter(9.0, unit="N.m.s/rad") for _ in range(3))
    c_1, c_2, c_3 = (gt.parameter(8.0, unit="N.m") for _ in range(3))
    mgl = gt.parameter(70.0, unit="N.m", description="gravity of the arm when it is horizontal")
    q = gt.variable(3, unit="rad")
    tau = gt.variable(3, unit="N.m")

    def equations(self):
        for i in range(3):
            rate = der(self.q[i])
            J, v, c = (getattr(self, f"{letter}_{i + 1}") for letter in "Jvc")
            gravity = self.mgl * gt.cos(self.q[1]) if i == 1 else 0.0
            yield self.tau[i] == J * der(rate) + v * rate + c * gt.sign(rate) + gravity


class TwoAxesAndSlide(ThreeAxes):
    """The same machine with a third axis that slides: its units are kg, kg/s and N, which a vector cannot have."""

    J_1, J_2, J_3 = (gt.parameter(value) for value in (8.0, 6.0, 16.0))
    v_1, v_2, v_3 = (gt.parameter(9.0), gt.parameter(8.0), gt.parameter(80.0))
    c_1, c_2, c_3 = (gt.parameter(8.0), gt.parameter(8.0), gt.parameter(25.0))
    mgl = gt.parameter(70.0)
    q = gt.variable(3)
    tau = gt.variable(3)


_HEAD = """kind = "identification"
robot = "tests.identify.vendor_problems:{robot}"
free = {free}
drift = true                             # of the sensors of the efforts, as the data sheet says
[log]
files = {files}
"""
_FORMS = {
    "kuka": """time = { column = "IPOC", unit = "ms" }
empty_rows = "drop"                      # the names stand again in the middle
late_rows = "drop"                       # rows written twice
resample = { sample_time_s = 0.004 }
""",
    "ur": """time = { column = "timestamp", unit = "s" }
empty_rows = "drop"
late_rows = "drop"
resample = { sample_time_s = 0.008 }
""",
    "siemens": """encoding = "cp1252"
decimal = "comma"
header = 5
time = { column = "Zeitstempel", unit = "s" }
late_rows = "drop"
resample = { sample_time_s = 0.004 }
""",
    "abb": """formats."tunemaster*" = { header = 7 }
late_rows = "drop"
resample = { sample_time_s = 0.004032 }
""",
    "beckhoff": """header = 6
time = { column = "Name", unit = "100 ns", per_channel = true }
empty_rows = "drop"                      # lines about the channels, blank cells below slow channels, EOF
late_rows = "drop"
resample = { sample_time_s = 0.004 }
""",
}
_CLOCKS = {  # of a signal: its file, and when its time is zero
    "abb": (
        {"file": "egm*", "time": {"column": ["sec", "usec"], "unit": ["s", "us"], "since": "1970-01-01"}},
        {"file": "tunemaster*", "time": {"column": "Time", "unit": "s", "since": "Log started", "zone": "+01:00"}},
    ),
}
_COLUMNS = {
    "kuka": (["AIPos_A1", "AIPos_A2", "AIPos_A3"], ["MACur_A1", "MACur_A2", "MACur_A3"]),
    "ur": ([f"actual_q_{i}" for i in range(3)], [f"actual_current_{i}" for i in range(3)]),
    "siemens": (["C1 Motorlage", "B2 Istposition", "Z3 Istposition"], [f"{a} Strom Iq" for a in ("C1", "B2", "Z3")]),
    "abb": ([f"joint_{i}" for i in (1, 2, 3)], [f"Axis {i} Torque" for i in (1, 2, 3)]),
    "beckhoff": ([f"ActPosRaw_{i}" for i in (1, 2, 3)], [f"ActTorque_{i}" for i in (1, 2, 3)]),
}  # fmt: skip
_UNITS = {
    "abb": ("deg", "N.m"),
    "beckhoff": ("1", "1"),
    "kuka": ("deg", "1"),
    "ur": ("rad", "A"),
    "siemens": (["rev", "deg", "mm"], "A"),
}


def problem(truth: Truth) -> str:
    """Return the problem file for a log: keys from the guide, figures from the data sheet."""
    kind, numbers = VENDORS[truth.vendor], truth.numbers
    gears, signs = np.array(numbers["gears"]), np.array(numbers["position_signs"])
    zero = signs * np.array(numbers["position_zero"]) / np.array(numbers["position_units_per_SI"])
    per_Nm, counts = np.array(numbers["effort_units_per_Nm"]), kind.units[0] == "counts"
    position: dict[str, Any] = {
        "column": _COLUMNS[truth.vendor][0],
        "unit": _UNITS[truth.vendor][0],
        "scale": (signs / np.array(numbers["position_units_per_SI"]) if counts else signs).tolist(),
    }
    effort: dict[str, Any] = {"column": _COLUMNS[truth.vendor][1], "unit": _UNITS[truth.vendor][1]}
    share = float(np.asarray(numbers["n_32"])) / gears[2]
    if np.any(zero):
        position["offset"] = zero.tolist()
    if any(kind.motor_side):
        position["gear_ratio"] = np.where(kind.motor_side, gears, 1.0).tolist()
        if share:
            position["coupling"] = [[1, 0, 0], [0, 1, 0], [0, -share, 1]]
    if effort["unit"] == "A":
        effort |= {"scale": numbers["effort_signs"], "motor_constant_Nm_A": (1 / per_Nm).tolist()}
    else:
        effort["scale"] = (np.array(numbers["effort_signs"]) / per_Nm).tolist()
    effort["gear_ratio"] = gears.tolist()
    if share:
        effort["coupling"] = [[1, 0, 0], [0, 1, share], [0, 0, 1]]
    effort["offset"] = "estimate"  # of the sensor, one for each recording
    if counts:
        effort["quantity_unit"] = ["N.m", "N.m", "N"]
    clocks: tuple[dict[str, Any], dict[str, Any]] = _CLOCKS.get(truth.vendor, ({}, {}))
    robot = TwoAxesAndSlide if kind.linear else ThreeAxes
    head = _HEAD.format(robot=robot.__name__, free=json.dumps(NAMES), files=json.dumps([f.name for f in truth.files]))
    signals = {"position": position | clocks[0], "effort": effort | clocks[1]}
    return head + _FORMS[truth.vendor] + tomli_w.dumps({"log": signals})
