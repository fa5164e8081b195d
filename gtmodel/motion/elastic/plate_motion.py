"""How an elastic tool swings after a motion of the plate, which follows its motion exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...control.input_shaping import residual_vibration
from ...optimize import Solution
from ...results import ArgumentError, Trajectory
from .options import ElasticTool

Array = np.ndarray
SAMPLES = 4001  # of a motion, at least
PER_PERIOD = 200  # samples of a swing's period, at least
MOST_SAMPLES = 400_001
AFTER = 6  # periods that are shown after the motion


@dataclass(frozen=True, eq=False)
class PlateMotion:
    """A motion of the plate, its name, and the largest force on the way [N]."""

    name: str
    plate: Trajectory
    peak: float

    def residual(self, ratios: Any, tool: ElasticTool) -> Array:
        """Amplitude [m] for modes at these ratios to the planned frequency."""
        v = self.plate["der(T)"]
        by_direction = residual_vibration(self.plate.time, v, np.asarray(ratios) * tool.frequency, tool.damping)
        return np.linalg.norm(by_direction, axis=-1)


def sampled(solution: Solution, tool: ElasticTool) -> Trajectory:
    """The plate along the collocated polynomials; its ends, at rest to the solver's tolerance, are put to rest."""
    n = _samples(solution.trajectory.duration, tool)
    plate = solution.sample(np.linspace(0.0, 1.0, n)).select(["T", "der(T)", "der(T,2)", "tau"])
    v = plate["der(T)"].copy()
    v[[0, -1]] = 0.0
    return plate.with_values({"der(T)": v}, {"der(T)": "m/s"})


def swing(plate: Trajectory, tool: ElasticTool) -> tuple[Array, Array]:
    """Times and offsets (n, 3) [m] of the tool during the motion and AFTER periods after it, integrated exactly for
    velocities linear between samples.

    plate: its velocity "der(T)" (n, 3) [m/s] at least, from rest to rest.

    >>> t = np.linspace(0.0, 0.5, 101)
    >>> velocity = np.outer(np.sin(np.pi * t / 0.5), [0.2, 0.0, 0.0])
    >>> plate = gt.Trajectory(t, {"der(T)": velocity}, {"der(T)": "m/s"})
    >>> tool = gt.motion.elastic.ElasticTool(mass=5.0, frequency=6.0)
    >>> time, offset = gt.motion.elastic.swing(plate, tool)
    >>> (1e3 * np.abs(offset[time > 0.5]).max(axis=0)).round(2)  # [mm], undamped
    array([1.82, 0.  , 0.  ])
    """
    from scipy.signal import StateSpace, lsim

    w = 2 * np.pi * tool.frequency
    n = _samples(plate.duration, tool)
    step = plate.duration / (n - 1)
    after = np.arange(1, int(AFTER / tool.frequency / step)) * step
    t = np.linspace(0.0, plate.duration, n)
    v = np.vstack([plate(t + plate.time[0], "der(T)"), np.zeros((len(after), 3))])
    # z' = -w^2 x - 2 zeta w (z - v), x' = z - v: driven by the velocity, so that steps of the acceleration need no care
    c = 2 * tool.damping * w
    system = StateSpace([[0.0, 1.0], [-(w**2), -c]], [[-1.0], [c]], [[1.0, 0.0]], [[0.0]])
    time = np.concatenate([t, t[-1] + after])
    return time, np.column_stack([lsim(system, v[:, k], time)[1] for k in range(3)])


def _samples(duration: float, tool: ElasticTool) -> int:
    """Instants of a motion that follow its swing. Raises ArgumentError for a frequency that they cannot follow."""
    n = max(SAMPLES, int(np.ceil(PER_PERIOD * duration * tool.frequency)) + 1)
    if n > MOST_SAMPLES:
        most = MOST_SAMPLES / PER_PERIOD / duration
        raise ArgumentError(f"is too fast to be followed; at most {most:.3g} Hz in {duration:.3g} s", "tool.frequency")
    return n
