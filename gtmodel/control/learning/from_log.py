"""A robot of learning control from one log of all its axes: channels that are exchanged are named before any fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...results import ArgumentError
from .identified import COLUMNS, EXPLAINED, LEAST, TAPS, identified_axis, pulses
from .modelled import ModelledRobot
from .options import AXES
from .plants import SAMPLE_TIME


def identified_robot(
    reference: Any, signals: Mapping[str, Any], sample_time: float = SAMPLE_TIME, order: int | None = None,
    delay: int | None = None,
) -> ModelledRobot:  # fmt: skip
    """A robot by plants of its axes, each identified from its own columns of one log, see `identified_axis`.

    Args:
        reference: (N, axes) [m], the learned input included. signals: "motor", and where they were measured "tool" [m]
            and "acceleration" [m/s2], each (N, axes). order, delay: of every axis, as of `identified_axis`.

    Raises ArgumentError where a column follows the reference of another axis and not its own, for columns that do not
    match, and as `identified_axis`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=(200, 2)), 10, axis=0)
    >>> maps = [learning.flexible_axis(f, z).maps(2000)["motor"] for f, z in ((7.4, 0.2), (11.5, 0.05))]
    >>> motor = np.column_stack([T(r[:, k]) for k, T in enumerate(maps)])
    >>> learning.identified_robot(r, {"motor": motor}).axes
    ('x', 'y')
    >>> learning.identified_robot(r, {"motor": motor[:, ::-1]})
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: signals: 'motor' of x follows the reference of y, which explains 100 % of ...
    """
    u = np.asarray(reference, float)
    rows = {name: np.asarray(values, float) for name, values in signals.items()}
    if u.ndim != 2 or not 1 <= u.shape[1] <= len(AXES):
        raise ArgumentError(f"expected (N, axes) of one to three axes; found {u.shape}", "reference")
    for name, values in rows.items():
        if values.shape != u.shape:
            raise ArgumentError(f"'{name}' is {values.shape}; expected {u.shape}, as the reference", "signals")
        _own_reference(u, values, name)
    axes = []
    for k in range(u.shape[1]):
        mine = {name: values[:, k] for name, values in rows.items()}
        try:
            axes.append(identified_axis(u[:, k], mine, sample_time, order, delay))
        except ArgumentError as error:
            raise ArgumentError(f"axis {AXES[k]}: {error.message}", error.argument) from error
    return ModelledRobot(axes)


def _own_reference(u: np.ndarray, values: np.ndarray, name: str) -> None:
    """Raises ArgumentError where a column follows the reference of another axis and not its own."""
    if u.shape[1] < 2 or len(u) < LEAST * TAPS or not (np.all(np.isfinite(u)) and np.all(np.isfinite(values))):
        return
    share = np.array([[pulses(r, y)[2] for r in u.T] for y in values.T])
    for k, row in enumerate(share):
        j = int(np.argmax(row))
        if row[k] < EXPLAINED <= row[j]:
            raise ArgumentError(
                f"'{name}' of {AXES[k]} follows the reference of {AXES[j]}, which explains {100 * row[j]:.0f} % of its "
                f"variance; its own explains {100 * row[k]:.0f} %: exchange the columns, or {COLUMNS}",
                "signals",
            )
