"""Guideways through measured points of the carts: models 2, 4 and 5 of D1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...lang import Model, ModelError
from ...measurements import signal_table
from ...results import ArgumentError
from ...robots.links import family_of
from ...robots.measured_guideways import on_measured_points
from .options import CartPoints

UNIT_LENGTH = 1e-3  # of the quaternion: printed digits leave less


def on_cart_points(robot: Model, carts: CartPoints | None) -> tuple[Model, list[str]]:
    """The robot, and the names of its guideways on measured points. Raises ArgumentError."""
    if carts is None:
        return robot, []
    u = np.array(carts.quaternion, float)
    length = float(np.linalg.norm(u))
    if abs(length - 1) > UNIT_LENGTH:
        raise ArgumentError(f"has the length {length:.4g}; a rotation needs length 1", "carts.quaternion")
    if family_of(robot) not in ("three_link", "six_link"):
        raise ArgumentError("is for Gantry-Tau robots with three or six links", "carts")
    try:
        placed = on_measured_points(robot, carts.at, {arm - 1: rows for arm, rows in carts.points.items()}, u / length)
    except ModelError as error:
        raise ArgumentError(str(error), "carts.points") from error
    return placed.robot, placed.guideways


def read_cart_points(path: Path, arms: Sequence[int], unit: str = "mm") -> tuple[np.ndarray, dict[int, np.ndarray]]:
    r"""Coordinates (n,) [m], increasing, and points by arm (n, 3) [m] of a CSV file with the columns q and P1, P2, P3.

    Raises ArgumentError with the line of what is wrong.

    >>> from pathlib import Path
    >>> _ = Path("carts.csv").write_text("q,P1[0],P1[1],P1[2]\n0,0.1,0,900\n500,500.1,0.05,900\n")
    >>> at, points = gt.calibrate.read_cart_points(Path("carts.csv"), arms=[1])  # a file in mm
    >>> at, points[1].shape
    (array([0. , 0.5]), (2, 3))
    """
    wanted = {"q": ("q", unit)} | {f"P{arm}": (f"P{arm}", unit) for arm in sorted(set(arms))}
    table = signal_table.read(path, wanted)
    order = np.argsort(table.values["q"][:, 0], kind="stable")
    at = table.values["q"][order, 0]
    same = np.flatnonzero(np.diff(at) <= 0)
    if len(at) < 2 or same.size:
        where = f"line {table.lines[order[same[0] + 1]]} repeats a coordinate" if same.size else f"it has {len(at)}"
        raise ArgumentError(f"straight pieces need two points or more at different coordinates; {where}")
    return at, {arm: table.values[f"P{arm}"][order] for arm in sorted(set(arms))}
