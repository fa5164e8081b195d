"""Where the dynamics of a pose come from: measured angles, joint stiffness, or a field over the poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..results import ArgumentError
from ..results.refusal import naming
from ..vibration import OscillatorField
from .angle_table import AngleTable
from .options import Modal
from .oscillators import Oscillators
from .redundant_angle import runs_of

NEIGHBOURS = 3  # of a grid angle on either side through which a local table is laid
ROUNDING = 1e-9  # rad, of an angle of the grid


class Dynamics(NamedTuple):
    """Oscillators by angle at one place. `rows` of the grid where they are known, `smooth` a CasADi function about a
    row, between the angles `low` and `high` [rad]."""

    rows: np.ndarray
    oscillators: Oscillators
    at: Callable[[float], Oscillators]
    smooth: Callable[[int], tuple[Any, float, float]]


Given = AngleTable | Modal | OscillatorField


def dynamics_of(given: Given | None, where: str) -> tuple[Callable[..., Dynamics] | None, str | None]:
    """(angles, reachable (n,), compliance (n, 3, 3), branch (n,), place) -> Dynamics, and in words where they come
    from; None where none are given. where: what a person calls their source, such as a file."""
    if given is None:
        return None, None
    if isinstance(given, AngleTable):
        return _of_table(given), "measured at the given angles, monotone cubics of the logarithms between them"
    if isinstance(given, Modal):
        said = "made from joint stiffness with declared masses: an example, not a measurement"
        return _of_modal(given.mass, given.damping_ratio), said
    said = f"; synthetic: {given.synthetic}" if given.synthetic else ""
    return _of_field(given), f"Gaussian processes over the pose{where and ', '}{where}{said}"


def _of_table(table: AngleTable) -> Callable[..., Dynamics]:
    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        rows = np.flatnonzero(reachable & table.covers(angles))
        if not len(rows):
            low, high = np.rad2deg(table.angles[[0, -1]])
            raise ArgumentError(f"tells nothing of a reachable angle; it holds {low:g} to {high:g} deg", "dynamics")
        smooth = table.casadi_function()
        return Dynamics(rows, table.at(angles[rows]), table.at, lambda row: (smooth, *table.angles[[0, -1]]))

    return dynamics


def _of_modal(mass: list[float], zeta: list[float]) -> Callable[..., Dynamics]:
    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        rows = np.flatnonzero(reachable)
        k = 1 / np.einsum("nii->ni", compliance[rows])
        with naming("dynamics", ValueError):
            oscillators = Oscillators.with_damping_ratio(np.tile(mass, (len(rows), 1)), k, zeta)

        def near(row: int) -> AngleTable:
            here = [row]
            for way in (-1, 1):
                for other in row + way * np.arange(1, NEIGHBOURS + 1):
                    if not 0 <= other < len(angles) or not reachable[other] or branch[other] != branch[row]:
                        break
                    here.append(int(other))
            if len(here) < 2:
                raise ValueError("no neighbour of this angle is reachable on the same branch")
            here.sort()
            return AngleTable(angles[here], oscillators[np.searchsorted(rows, here)])

        def at(angle: float) -> Oscillators:
            nearest = int(np.argmin(np.abs(angles[rows] - angle)))
            if abs(angles[rows[nearest]] - angle) < ROUNDING:  # no neighbour is needed
                return oscillators[np.array([nearest])]
            return near(rows[nearest]).at(angle)

        def smooth(row: int) -> tuple[Any, float, float]:
            table = near(row)
            return table.casadi_function(), *table.angles[[0, -1]]

        return Dynamics(rows, oscillators, at, smooth)

    return dynamics


def _of_field(field: OscillatorField) -> Callable[..., Dynamics]:
    import casadi as ca

    def dynamics(angles, reachable, compliance, branch, place) -> Dynamics:
        def at(angle: Any) -> Oscillators:
            a = np.atleast_1d(angle)
            return Oscillators(*field.at(np.column_stack([np.tile(place, (len(a), 1)), a])))

        poses = np.column_stack([np.tile(place, (len(angles), 1)), angles])
        known = reachable & field.covers(poses)
        rows = np.flatnonzero(known)
        if not len(rows):
            where = ", ".join(f"{x:.4g}" for x in place)
            raise ArgumentError(
                f"tells nothing of a reachable angle at ({where}) m: too far from the poses that were measured, or too "
                "few of them; measure nearer to the work",
                "dynamics",
            )
        A = ca.SX.sym("A")
        along = ca.Function("oscillators", [A], field.casadi_function()(ca.vertcat(*place, A)), ["A"], ["m", "c", "k"])
        return Dynamics(rows, at(angles[rows]), at, lambda row: (along, *_run(angles, known, row)))

    return dynamics


def _run(angles: np.ndarray, reachable: np.ndarray, row: int) -> tuple[float, float]:
    """Ends of the reachable angles around a row without a gap."""
    low, high = next(run for run in runs_of(reachable) if run[0] <= row <= run[1])
    return float(angles[low]), float(angles[high])
