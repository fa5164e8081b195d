"""A robot whose own servo follows corrected references: from a correction of the tool to the deviation of the tool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...lang import Model, ModelError
from ...results import ArgumentError
from ..feedforward import Law
from ..sampled_poles import at_rest
from .plants import CorrectedPlant

UNIT = 1e-9  # of a direction's length
SETTLED = 1e-9  # of the fastest pole: a real part nearer to zero does not bring the robot back
FLAT = 1e-9  # relative singular value: the references do not move the tool along a direction


def servo_plant(
    robot: Model, law: Law, start: Mapping[str, Any], direction: ArrayLike, *,
    known: str = "q", targets: str = "tau", tool: str = "T",
) -> CorrectedPlant:  # fmt: skip
    """The robot under its own law, in continuous time, about a point at rest: how a correction moves the tool.

    A correction u [m] is added to the law's reference such that, held, it moves the tool by u along `direction`; the
    deviation is the tool's along the same direction [m].

    Args:
        robot: what moves, with positions `known`, forces `targets` and the place `tool` (3,).
        law: `Feedback`, `Feedforward`, `ComputedTorque` or a `Law` of your own; corrections have no rate.
        start: the point, by the robot's own names, as for `gt.linearize`.
        direction: (3,) of unit length.

    Raises ArgumentError for the direction, ModelError as `gt.linearize`.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=900.0, damping=60.0)
    >>> at = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}
    >>> plant = gt.control.delayed.servo_plant(robot, law, at, [0.0, 1.0, 0.0])
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> limit = gt.control.delayed.gain_limit(loop)
    >>> round(limit.gain, 3), round(limit.frequency, 2)  # [Hz]; of 900 / (s^2 + 60 s + 900), wherever the tool is
    (1.964, 4.69)
    """
    e = np.asarray(direction, float)
    if e.shape != (3,) or not abs(np.linalg.norm(e) - 1) < UNIT:
        raise ArgumentError(f"expected three numbers of unit length; found {e.tolist()}", "direction")
    linear, by = at_rest(robot, law, [known, f"der({known})", tool], start, targets)
    a, b, c = (np.asarray(m, float) for m in (linear.A, linear.B, linear.C))
    n = linear.ninputs
    closed = a + b @ (by["position"] @ c[:n] + by["velocity"] @ c[n : 2 * n])
    entry, place = b @ by["reference"], c[2 * n :]
    poles = np.linalg.eigvals(closed)
    if poles.real.max() > -SETTLED * np.abs(poles).max():
        raise ArgumentError("does not hold the robot at rest here: the servo itself is unstable", "law")
    held = -place @ np.linalg.solve(closed, entry)  # (3, n): what a held reference moves
    reference, *_ = np.linalg.lstsq(held, e, rcond=FLAT)
    if np.linalg.norm(held @ reference - e) > 1e3 * FLAT:
        raise ModelError(f"held references do not move '{tool}' along {e.tolist()} here")
    return CorrectedPlant(closed, entry @ reference, e @ place)
