"""The physical form of a black-box model: positions and velocities as states (Dressler 2012, eq. (6.14))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._lazy import hint
from ..results import ArgumentError
from .continuous import continuous

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

UNIDENTIFIED = "M is not identifiable without a known force or mass; M^-1 K and M^-1 D are"
CONDITION = 1e10  # of T with scaled rows: beyond, the outputs and their rates are no coordinates


@dataclass(frozen=True, eq=False)
class PhysicalForm:
    """x'' + `M_inv_D` x' + `M_inv_K` x = `M_inv_F` u for the measured positions x.

    M_inv_K (p, p) [1/s2], M_inv_D (p, p) [1/s], M_inv_F (p, m) [output's unit per s2 and input's unit]. `jump`: what
    the input adds to the velocity beside the acceleration, relative, in units of the fastest mode; a structure has
    none, so that it measures what noise or a wrong order left. `notes`: what is not identifiable, what is near Nyquist.
    """

    M_inv_K: np.ndarray
    M_inv_D: np.ndarray
    M_inv_F: np.ndarray
    jump: float
    notes: tuple[str, ...]


def physical_form(system: StateSpace) -> PhysicalForm:
    """M^-1 K and M^-1 D of a discrete model of order 2 p whose p outputs are positions.

    A_c = logm(A) / T_s, T = [C; C A_c]; T A_c T^-1 = [[0, I], [-M^-1 K, -M^-1 D]]. The printed eq. (6.14) of Dressler
    2012 lacks an inverse; what is meant is X = (M s^2 + D s + K)^-1 B U. Raises ArgumentError for another order, a
    model in continuous time, no real logarithm, and outputs that are not independent positions.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> record = gt.vibration.structure_record(
    ...     M, D, K, force=50.0, hold=8, samples=2000, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> form = gt.vibration.physical_form(gt.vibration.identify_subspace(record, order=4).system)
    >>> (form.M_inv_K / 100).round()  # 1/s2
    array([[ 50., -30.],
           [-75., 75.]])
    """
    A, B, C = (np.asarray(X) for X in (system.A, system.B, system.C))
    n, p = len(A), len(C)
    if not system.dt or system.dt is True:
        raise ArgumentError(f"the model has the sample time {system.dt}; expected a discrete one in seconds")
    if n != 2 * p:
        raise ArgumentError(
            f"the model has the order {n} and {p} outputs; positions and velocities of {p} coordinates need the order "
            f"{2 * p}, so ask for it, or measure {n // 2} positions"
        )
    c = continuous(A, B, float(system.dt))
    T = np.vstack([C, C @ c.A])
    if np.linalg.cond(T / np.linalg.norm(T, axis=1, keepdims=True)) > CONDITION:
        raise ArgumentError(
            "the outputs and their rates are not independent: two outputs move alike or one does not move; leave one "
            "out"
        )
    A_p, B_p = T @ c.A @ np.linalg.inv(T), T @ c.B
    fastest = float(np.abs(np.linalg.eigvals(c.A)).max())
    jump = fastest * float(np.linalg.norm(B_p[:p])) / max(float(np.linalg.norm(B_p[p:])), 1e-300)
    notes = (UNIDENTIFIED, *([c.message] if c.message else []))
    return PhysicalForm(-A_p[p:, :p], -A_p[p:, p:], B_p[p:], jump, notes)
