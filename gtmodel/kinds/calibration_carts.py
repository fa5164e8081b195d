"""Guideways through measured points of the carts: models 2, 4 and 5 of D1."""

from __future__ import annotations

import numpy as np

from gtmodel.lang import Model, ModelError
from gtmodel.robots.measured_guideways import on_measured_points

from . import calibration_table
from .base import Context, InputError
from .calibration_keys import CartPoints, Schema
from .robots import file_of

KEY = "cart_points"
UNIT_LENGTH = 1e-3  # of the quaternion: printed digits leave less


def on_cart_points(problem: Schema, context: Context) -> tuple[Model, list[str]]:
    """The problem's robot, and the names of its guideways on measured points. Raises InputError."""
    model = problem.model(context)
    keys = problem.cart_points
    if keys is None:
        return model, []
    u = np.array(keys.quaternion, float)
    length = float(np.linalg.norm(u))
    if abs(length - 1) > UNIT_LENGTH:
        raise InputError(f"has the length {length:.4g}; a rotation needs length 1", f"{KEY}.quaternion")
    if np.shape(getattr(model, "A", ())) not in ((3, 3), (6, 3)) or hasattr(model, "A0"):
        raise InputError("is for Gantry-Tau robots with three or six links", KEY)
    at, points = _read(keys, context)
    try:
        found = on_measured_points(model, at, {arm - 1: points[arm] for arm in sorted(set(keys.arms))}, u / length)
    except ModelError as error:
        raise InputError(str(error), f"{KEY}.file") from error
    return found.robot, found.guideways


def _read(keys: CartPoints, context: Context) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Coordinates (n,) [m], increasing, and points by arm (n, 3) [m]."""
    path = file_of(keys.file, context)
    if path is None:
        raise InputError(f"there is no file '{keys.file}' in {context.folder} or here", f"{KEY}.file")
    context.take(f"{KEY}.file", path)
    wanted = {"q": ("q", keys.unit)} | {f"P{arm}": (f"P{arm}", keys.unit) for arm in sorted(set(keys.arms))}
    try:
        table = calibration_table.read(path, wanted)
    except InputError as error:
        raise InputError(error.sentence, f"{KEY}.file") from error
    order = np.argsort(table.values["q"][:, 0], kind="stable")
    at = table.values["q"][order, 0]
    same = np.flatnonzero(np.diff(at) <= 0)
    if len(at) < 2 or same.size:
        where = f"line {table.lines[order[same[0] + 1]]} repeats a coordinate" if same.size else f"it has {len(at)}"
        raise InputError(f"straight pieces need two points or more at different coordinates; {where}", f"{KEY}.file")
    return at, {arm: table.values[f"P{arm}"][order] for arm in keys.arms}
