"""The oscillators of the KR 500-3 that are printed: Cvitanic 2021, Table 16, and what is missing there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kr500 import kr500_tables

NOTE = (
    "Table 16 holds nine distinct rows and they are values of a regression, no training data; its c_z repeats m_z, so "
    "that zeta_z is taken as the mean of the other two"
)


@dataclass(frozen=True, eq=False)
class Table16Oscillators:
    """Distinct rows: poses (n, 4) in m and rad, m [kg], c [N.s/m], k [N/m] (n, 3); `tests`: numbers of each row."""

    poses: np.ndarray
    m: np.ndarray
    c: np.ndarray
    k: np.ndarray
    tests: tuple[tuple[int, ...], ...]
    note: str = NOTE  # what a reader of the values must know
    name: str = "table_16"

    @property
    def fn(self) -> np.ndarray:
        """Natural frequencies (n, 3) [Hz]."""
        return np.sqrt(self.k / self.m) / (2 * np.pi)

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios (n, 3)."""
        return self.c / (2 * np.sqrt(self.k * self.m))


def table_16() -> Table16Oscillators:
    """Each pose once, c_z from zeta_z = (zeta_x + zeta_y) / 2."""
    table = kr500_tables()["milling_tests"]
    poses = np.column_stack([np.array(table["tcp_mm"]) / 1e3, np.deg2rad(table["angle_A_deg"])])
    m, c, k = np.array(table["m_kg"]), np.array(table["c_N_s_m"]), 1e6 * np.array(table["k_MN_m"])
    zeta = c / (2 * np.sqrt(k * m))
    c[:, 2] = zeta[:, :2].mean(axis=1) * 2 * np.sqrt(k[:, 2] * m[:, 2])
    rows: dict[tuple[float, ...], list[int]] = {}
    for test, row in enumerate(np.hstack([m, k]).tolist(), 1):
        rows.setdefault(tuple(row), []).append(test)
    first = [tests[0] - 1 for tests in rows.values()]
    return Table16Oscillators(poses[first], m[first], c[first], k[first], tuple(map(tuple, rows.values())))
