"""A synthetic robot that repeats its motion: linear axes, a tool that differs from the model, runs that differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from .axis import AxisPlant
from .modelled import ModelledRobot
from .options import LearningNoise, LearningRobot
from .references import SquarePath

SLOW = 25  # samples over which the unrepeatable motion is averaged: below 10 Hz at 4 ms


class RepeatedMotion(Protocol):
    """A robot that repeats a motion with another input. names: of its axes; sample_time: [s]; reference: (N, axes) [m];
    corrected: the samples that count; synthetic: what made its runs."""

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def sample_time(self) -> float: ...
    @property
    def reference(self) -> np.ndarray: ...
    @property
    def corrected(self) -> slice: ...
    @property
    def synthetic(self) -> str: ...

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) of the next run, with an input (N, axes) added to the reference."""
        ...


class SyntheticExperiment:
    """Linear axes along a square, with white noise of the sensors and slow motion that differs from run to run.

    robot: as the law knows it; the true tool differs from it as noise says. Each run draws from one generator.

    >>> learning = gt.control.learning
    >>> experiment = learning.SyntheticExperiment(learning.LearningRobot(), learning.SquarePath())
    >>> run = experiment.run(np.zeros((825, 2)))
    >>> run["tool"].shape
    (825, 2)
    """

    def __init__(
        self, robot: LearningRobot | ModelledRobot, path: SquarePath, noise: LearningNoise | None = None
    ) -> None:
        self.noise = noise or LearningNoise()
        self.names, self.sample_time = robot.axes, robot.sample_time
        both = path.samples(robot.sample_time)
        self.reference = both[:, list(robot.along)]
        self.corrected = slice(path.ramp, path.ramp + path.corrected)
        self.generator = np.random.default_rng(self.noise.seed)
        off = self.generator.uniform(-1, 1, (len(self.names), 2))
        self.plants: list[AxisPlant] = [
            robot.plant(k, 1 + self.noise.frequency_error * f, 1 + self.noise.damping_error * z)
            for k, (f, z) in enumerate(off)
        ]
        self.maps = [plant.maps(path.size) for plant in self.plants]
        n = self.noise
        self.deviations = {"motor": n.motor, "tool": n.gauge, "acceleration": n.acceleration}
        self.synthetic = (
            f"linear axes, seed {n.seed}; noise {1e6 * n.motor:g} um of the motors, {n.acceleration:g} m/s2 of the "
            f"accelerometer, {1e6 * n.gauge:g} um of the gauges, {1e6 * n.unrepeatable:g} um unrepeatable"
        )

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) with an input (N, axes) added to the reference; "true tool" without noise."""
        draw, size = self.generator, len(self.reference)
        made: dict[str, list[np.ndarray]] = {}
        for k, maps in enumerate(self.maps):
            slow = np.convolve(draw.normal(size=size + SLOW - 1), np.ones(SLOW) / np.sqrt(SLOW), "valid")
            at = self.reference[:, k] + inputs[:, k] + self.noise.unrepeatable * slow
            for name, T in maps.items():
                clean = T(at)
                made.setdefault(name, []).append(clean + self.deviations[name] * draw.normal(size=size))
                if name == "tool":
                    made.setdefault("true tool", []).append(clean)
        return {name: np.column_stack(columns) for name, columns in made.items()}
