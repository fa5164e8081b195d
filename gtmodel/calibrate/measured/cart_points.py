"""Guideways through measured points of the carts: models 2, 4 and 5 of D1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from ...lang import Model, ModelError
from ...measurements import signal_table
from ...results import ArgumentError, Long, Options, Unit, Within
from ...robots.links import family_of
from ...robots.measured_guideways import on_measured_points

UNIT_LENGTH = 1e-3  # of the quaternion: printed digits leave less


@dataclass(frozen=True, eq=False)
class CartPoints(Options):
    """Points of each cart along its guideway, measured in another set-up of the device (Dressler 2012, eq. (5.7)).

    at: (n,) coordinates of the carts [m], increasing. points: arm from 1 -> (n, 3) [m]; all other arms stay straight.

    >>> at = np.linspace(0.0, 2.0, 5)
    >>> carts = gt.calibrate.CartPoints(at, {1: np.column_stack([at, 1e-4 * at**2, 0 * at])})  # arm 1 bends
    >>> carts.points[1].shape, carts.quaternion
    ((5, 3), [1.0, 0.0, 0.0, 0.0])
    """

    at: np.ndarray
    points: Mapping[int, np.ndarray]
    quaternion: Annotated[
        list[float], Long(4), "turn of that set-up in the frame of the poses, by common reference points, scalar first"
    ] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])  # fmt: skip
    turn_std: Annotated[
        float | None, Unit("rad"), Within(above=0.0),
        "how well it is known; left out, the poses alone determine it, badly about the guideway",
    ] = field(default=None, kw_only=True)  # fmt: skip


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
