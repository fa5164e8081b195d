"""The twelve milling tests of Cvitanic 2021 (Tables 4, 5, 6, 16), predicted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..results import Check, Row, at_least, at_most
from .cutter import Cut, Cutter, CuttingCoefficients
from .deflection import deflections
from .mode_coupling import critical_depth
from .oscillators import missing_z
from .stability import spectral_radius

FEEDS = {"+x": (1.0, 0.0, 0.0), "+y": (0.0, 1.0, 0.0)}
BEATS = 1.5  # ratio of mean deflections where the dynamic choice is called better
TIE_MM = 0.06
MISSED = 0.6  # of the measured mean: predictions below are called misses
NOTE = (
    "c_z is missing in Table 16: its damping ratio is taken as the mean of x and y; the feed direction is not printed, "
    "so both are shown; which fits better hangs on test 5 (+x without it, +y with it), seen after looking"
)


class PrintedTests(NamedTuple):
    """Tests 1 to 12: tooth frequency [Hz], predicted mean deflection by feed, measured one [mm] (NaN: not printed),
    spectral radius of the linear model and critical depth by feed, and what the poses were chosen by."""

    tooth_hz: np.ndarray
    mean_mm: dict[str, np.ndarray]
    measured_mean_mm: np.ndarray
    radius: dict[str, np.ndarray]
    depth_mm: dict[str, np.ndarray]
    chosen_by: list[str]


def printed_tests(tables: Mapping[str, Any]) -> PrintedTests:
    """Predicted from the printed oscillators and cutting coefficients; tables: `gtmodel.robots.kr500_tables()`."""
    c, t = tables["cutting"], tables["milling_tests"]
    names = ("K_te_N_m", "K_tc_Pa", "K_re_N_m", "K_rc_Pa", "K_ae_N_m", "K_ac_Pa")
    cutter = Cutter(
        c["diameter_m"], c["teeth"], CuttingCoefficients(*(c[k] for k in names)), np.deg2rad(c["helix_deg"])
    )
    cut = Cut(c["mode"], c["radial_depth_m"], c["axial_depth_m"], c["feed_per_tooth_m"])
    hz = np.array(t["tooth_frequency_Hz"])
    o = missing_z(t["m_kg"], t["c_N_s_m"], 1e6 * np.array(t["k_MN_m"]))
    mean, radius, depth = {}, {}, {}
    for name, feed in FEEDS.items():
        runs = [deflections(o[i], cutter, cut, f / cutter.teeth, feed) for i, f in enumerate(hz)]
        mean[name] = 1e3 * np.array([d.mean[0] for d in runs])
        radius[name] = np.array([spectral_radius(o[i], cutter, cut, f / cutter.teeth, feed) for i, f in enumerate(hz)])
        depth[name] = 1e3 * np.array([critical_depth(o[i], cutter, cut, feed) for i in range(len(hz))])
    measured = np.pad(t["deflection_mean_mm"], (0, 2), constant_values=np.nan)
    return PrintedTests(hz, mean, measured, radius, depth, t["optimised_with"])


def rows(p: PrintedTests) -> list[Row]:
    """The table beside the measurement, and in words what it says."""
    rows_of_tests = []
    for i, hz in enumerate(p.tooth_hz):
        measured = "not printed" if np.isnan(p.measured_mean_mm[i]) else f"{p.measured_mean_mm[i]:.2f}"
        predicted = ", ".join(f"{name} {mean[i]:.2f}" for name, mean in p.mean_mm.items())
        label = f"test {i + 1}, {hz:g} Hz, {p.chosen_by[i]}: mean"
        rows_of_tests.append(Row(label, f"{predicted}; measured {measured}", "mm"))
    return [*rows_of_tests, *(Row("printed tests", sentence) for sentence in [*verdicts(p), NOTE])]


def verdicts(p: PrintedTests) -> list[str]:
    """What the predictions explain and what they miss."""
    said = []
    for name, mean in p.mean_mm.items():
        pairs = [f"{p.tooth_hz[i]:g} Hz: {mean[i]:.2f} against {mean[i + 1]:.2f} mm" for i in range(0, 8, 2)]
        said.append(f"feed {name}, static against dynamic choice, {'; '.join(pairs)}")
    best = np.max(list(p.mean_mm.values()), axis=0)
    missed = [i for i in range(10) if best[i] < MISSED * p.measured_mean_mm[i]]
    for i in missed:
        radius = ", ".join(f"{r[i]:.2f} ({name})" for name, r in p.radius.items())
        depth = p.depth_mm["+x"][i]
        said.append(
            f"test {i + 1} is missed: {best[i]:.2f} mm at most, measured {p.measured_mean_mm[i]:.2f}; with feed +x the "
            f"linear model of these poses turns unstable by mode coupling from {depth:.2g} mm of depth on, spectral "
            f"radius with regeneration {radius}: chatter is one explanation; the thesis says that it ruled it out"
        )
    return said


def checks(p: PrintedTests) -> dict[str, Check]:
    """The two statements that the printed oscillators support: far from a mode a tie, near one the dynamic choice."""
    ratios = [mean[i] / mean[i + 1] for mean in p.mean_mm.values() for i in (0, 4)]
    ties = [abs(mean[i] - mean[i + 1]) for mean in p.mean_mm.values() for i in (2, 6)]
    return {
        "static_over_dynamic_near_a_mode": at_least(float(min(ratios)), BEATS),
        "difference_far_from_a_mode_mm": at_most(float(max(ties)), TIE_MM),
    }
