"""What problems/milling_pose.toml declares, as objects."""

from __future__ import annotations

import numpy as np

from gtmodel.milling import AngleTable, MillingSearch, MillingTool
from tests.milling.thesis import OSCILLATORS

TOOL = MillingTool(tcp=[0.3, 0.0, 0.25], spindle=[1.0, 0.0, 0.0], zero=-np.pi / 2)
ANGLES = np.radians([49.0, 52.0, 110.0])  # of tests 4, 2 and 1 of Cvitanic 2021, Table 16
MEASURED = OSCILLATORS[np.array([3, 1, 0])]
TABLE = AngleTable(ANGLES, MEASURED)
PRINTED_CHOICE = MillingSearch(refine=0, static_choice=np.radians(110.0))
RPM = 1 / 60  # turns per second
GIVEN = {
    "place": [-0.01073, -2.40047, 0.30341],
    "speed": 1935 * RPM,
    "joint_stiffness": 1e6 * np.array([3.93, 3.46, 2.77, 1.57, 0.24, 0.17]),
    "tool": TOOL,
    "dynamics": TABLE,
    "search": PRINTED_CHOICE,
}
