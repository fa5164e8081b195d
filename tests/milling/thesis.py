"""The cutter, the cut and the twelve tests of Cvitanic 2021, chapter 3."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.milling import Cut, Cutter, CuttingCoefficients, missing_z
from gtmodel.robots.kuka import kr500_tables

PRINTED: dict[str, Any] = kr500_tables()
C, TESTS = PRINTED["cutting"], PRINTED["milling_tests"]
K = CuttingCoefficients(*(C[k] for k in ("K_te_N_m", "K_tc_Pa", "K_re_N_m", "K_rc_Pa", "K_ae_N_m", "K_ac_Pa")))
CUTTER = Cutter(C["diameter_m"], C["teeth"], K, np.deg2rad(C["helix_deg"]))
CUT = Cut(C["mode"], C["radial_depth_m"], C["axial_depth_m"], C["feed_per_tooth_m"])
TOOTH_HZ = np.array(TESTS["tooth_frequency_Hz"])
MEASURED = 1e-3 * np.array(TESTS["deflection_mean_mm"])
OSCILLATORS = missing_z(TESTS["m_kg"], TESTS["c_N_s_m"], 1e6 * np.array(TESTS["k_MN_m"]))
X, Y = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
