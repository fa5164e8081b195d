"""What a small change of each parameter does to poses and to the cost (Dressler 2012, eq. (5.8), Table 5.10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .positioning import pose_jacobians
from .problem import CalibrationProblem


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sums over all poses of the changes with `step` added to and taken from each unknown.

    `pose`: signal -> (n,), of positions [m], of quaternions the angle of the turn [rad]; `cost` (n,): of the squared
    closures of (5.1) [m^4].
    """

    names: tuple[str, ...]
    step: float
    pose: dict[str, np.ndarray]
    cost: np.ndarray


def sensitivity(problem: CalibrationProblem, x: np.ndarray, step: float = 5e-5) -> Sensitivity:
    """At the unknowns x, on the measured poses; poses to the first order in the step, the cost as it is.

    The thesis changes ZYZ angles, whose sum depends on the frame; here an orientation changes by the angle of its turn.
    Raises ModelError where the closure equations do not determine the pose, and where it is singular.
    """
    position = next((n for n in problem.reading.places if n != problem.actuators), "T")
    moves = pose_jacobians(problem, position, x)
    sums = {n: 2 * np.sum(np.linalg.norm(step * own, axis=1), axis=0) for n, own in moves.items()}
    return Sensitivity(problem.unknowns.names, step, sums, _cost_changes(problem, x, step))


def _cost_changes(problem: CalibrationProblem, x: np.ndarray, step: float) -> np.ndarray:
    data = problem.reading.data
    changes = np.zeros(len(x))
    for b in problem.squared:
        before = np.sum(b.evaluate(data, x[b.columns])[0] ** 2, axis=1)
        for k in b.columns:
            for sign in (1.0, -1.0):
                moved = x.copy()
                moved[k] += sign * step
                after = np.sum(b.evaluate(data, moved[b.columns])[0] ** 2, axis=1)
                changes[k] += float(np.sum(np.abs(after - before)))
    return changes
