"""A robot whose servo follows corrected references, as a plant from tool correction to tool deviation."""

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

UNIT = 1e-9  # tolerance of a direction's length
SETTLED = 1e-9  # of the fastest pole: a servo whose poles are nearer to the imaginary axis does not settle
FLAT = 1e-9  # relative singular value below which references do not move the tool


def servo_plant(
    robot: Model, law: Law, start: Mapping[str, Any], direction: ArrayLike, *,
    known: str = "q", targets: str = "tau", tool: str = "T",
) -> CorrectedPlant:  # fmt: skip
    """Return the robot under its own continuous-time law, linearised about a point at rest, as a plant.

    A correction u [m] changes the law's reference so that, in steady state, the tool moves by u along `direction`. The
    deviation [m] is that of the tool along the same direction.

    Args:
        robot: a model with positions `known`, forces `targets` and tool position `tool` (3,).
        law: `Feedback`, `Feedforward`, `ComputedTorque` or your own `Law`; corrections have no rate.
        start: the point by the robot's names, as for `gt.linearize`.
        direction: (3,) of unit length.

    Raises ArgumentError for a wrong direction or an unstable servo, and ModelError as `gt.linearize` or if references
    do not move the tool along the direction.

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
    linear, jacobians = at_rest(robot, law, [known, f"der({known})", tool], start, targets)
    a, b, c, _ = linear.matrices
    n = len(linear.inputs)
    closed = a + b @ (jacobians["position"] @ c[:n] + jacobians["velocity"] @ c[n : 2 * n])
    entry, place = b @ jacobians["reference"], c[2 * n :]
    poles = np.linalg.eigvals(closed)
    if poles.real.max() > -SETTLED * np.abs(poles).max():
        raise ArgumentError("does not hold the robot at rest here: the servo itself is unstable", "law")
    gain = -place @ np.linalg.solve(closed, entry)  # (3, n): from constant references to the tool
    reference, *_ = np.linalg.lstsq(gain, e, rcond=FLAT)
    if np.linalg.norm(gain @ reference - e) > 1e3 * FLAT:
        raise ModelError(f"constant references do not move '{tool}' along {e.tolist()} here")
    return CorrectedPlant(closed, entry @ reference, e @ place)
