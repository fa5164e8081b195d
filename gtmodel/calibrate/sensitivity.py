"""What a small change of each parameter does to poses and to the cost (Dressler 2012, eq. (5.8), Table 5.10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..lang.source import ModelError
from .problem import Problem, joined_blocks


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


def sensitivity(problem: Problem, x: np.ndarray, step: float = 5e-5) -> Sensitivity:
    """At the unknowns x, on the measured poses; poses to the first order in the step, the cost as it is.

    The thesis changes ZYZ angles, whose sum depends on the frame; here an orientation changes by the angle of its turn.
    Raises ModelError where the pose is not told by the closure equations, and where it is singular.
    """
    read, u = problem.reading, problem.unknowns
    places = {n: s for n, s in read.places.items() if n != problem.actuators}
    pose = [k for s in places.values() for k in range(s.start, s.stop)]
    N, m = len(problem.measurements), len(problem.labels)
    if m != len(pose) or read.latent.numel():
        raise ModelError(f"{m} equations close for a pose of {len(pose)} freedoms: its changes cannot be told")
    J, By = np.zeros((N, m, len(u.names))), np.zeros((N, m, read.noise.numel()))
    y, z = np.zeros((N, read.noise.numel())), np.zeros((N, 0))
    for b in joined_blocks(problem.closure, read, u, problem.actuators, "forward"):
        _, own, slopes, _ = b.evaluate_all(read.data, y, z, x[b.columns])
        J[np.ix_(np.arange(N), b.rows, b.columns)] = own
        By[:, b.rows] = slopes
    try:
        moves = step * np.linalg.solve(By[:, :, pose], J)  # (N, m, n)
    except np.linalg.LinAlgError:
        raise ModelError("a measured pose is singular: what moves it has no bound") from None
    at = {n: [pose.index(k) for k in range(s.start, s.stop)] for n, s in places.items()}
    sums = {n: 2 * np.sum(np.linalg.norm(moves[:, rows], axis=1), axis=0) for n, rows in at.items()}
    return Sensitivity(u.names, step, sums, _cost_changes(problem, x, step))


def _cost_changes(problem: Problem, x: np.ndarray, step: float) -> np.ndarray:
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
