"""A simulated robot with friction and an elastic tool under a sampled law, which repeats a motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel import lang as gt

from ...results import ArgumentError, Status, Trajectory
from ..feedforward import ComputedTorque
from ..sampled_loop import law_function, sampled_loop
from .options import AXES, ElasticTip, LearningNoise
from .references import SAMPLE_TIME, SquarePath

GRAVITY = 9.81  # m/s2
TOLERANCE = 1e-6  # of the integrator


class SimulatedMotion:
    """A simulated robot with a sampled controller that moves its tool along a square in x and y; runs repeat exactly.

    The tool is a mass on a spring at the plate and reacts on the plate. The input is added to the reference of the
    plate, which is converted to the actuators by inverse kinematics.

    Args:
        robot: a model with "T", "q", "tau" and a part `plate` with a `frame`, such as a Gantry-Tau with masses and
            friction; the controller's model is this robot without the tool.
        tip: the tool and the controller. path: the square. noise: only gauge and seed are used.

    Raises ArgumentError if the robot lacks one of these, or if the path leaves the workspace.

    >>> learning = gt.control.learning
    >>> robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
    >>> path = learning.SquarePath(corrected=50, ramp=5)
    >>> run = learning.SimulatedMotion(robot, learning.ElasticTip(), path).run(np.zeros((60, 2)))
    >>> run["tool"].shape
    (60, 2)
    """

    names = AXES[:2]

    def __init__(
        self, robot: gt.Model, tip: ElasticTip, path: SquarePath, noise: LearningNoise | None = None,
        sample_time: float = SAMPLE_TIME,
    ) -> None:  # fmt: skip
        from ...mechanics import PointMass, PointSpringDamper

        scatter = noise or LearningNoise()
        for name in ("T", "q", "tau", "plate"):
            if not hasattr(robot, name):
                raise ArgumentError(f"the robot has no '{name}'; use one with a plate, such as l1_tape", "robot")
        mass, frequency, damping = tip.mass, tip.frequency, tip.damping
        stiffness = mass * (2 * np.pi * frequency) ** 2
        base: Any = type(robot)

        def equations(model: Any) -> Any:
            yield from base.equations(model)
            yield gt.connect(model.spring.a, model.plate.frame)
            yield gt.connect(model.spring.b, model.tool.frame)

        members = {
            "spring": gt.part(
                PointSpringDamper, K=stiffness * np.eye(3), D=2 * damping * np.sqrt(stiffness * mass) * np.eye(3)
            ),
            "tool": gt.part(PointMass, m=mass),
            "equations": equations,
        }
        self.plant = type("WithTool", (base,), members)(**robot._modifiers)
        self.law = ComputedTorque(robot, tip.position_gain, tip.velocity_gain)
        self.delay, self.sample_time = tip.delay, sample_time
        self.positions = robot.causal(known="T", targets="q")
        self.start, self.reference = np.asarray(tip.start, float), path.samples(sample_time)
        self.corrected = slice(path.ramp, path.ramp + path.corrected)
        self.sag = GRAVITY * mass / stiffness
        self._loops: dict[bytes, gt.Model] = {}
        self.noise, self.generator = scatter.gauge, np.random.default_rng(scatter.seed)
        self.synthetic = (
            f"a simulated robot with friction and a tool of {mass:g} kg on a spring at {frequency:g} Hz, "
            f"gauge noise {1e6 * scatter.gauge:g} um, seed {scatter.seed}"
        )

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Return the signals (N, 2) by name of a run with an input (N, 2) added to the reference."""
        from ... import simulation

        offset = np.zeros((len(self.reference), 3))
        offset[:, :2] = self.reference + inputs
        q, status = self.positions(self.start + offset)
        if np.any(status != Status.OK):
            raise ArgumentError("the path leaves the workspace of the robot; move its start", "start")
        count = q.shape[1]
        still = np.zeros(count)
        first = law_function(self.law, count)(q[0], still, still, q[0], still).full().reshape(-1)
        if (start := first.tobytes()) not in self._loops:  # runs that start alike share all preparation
            self._loops[start] = sampled_loop(self.plant, self.law, self.sample_time, self.delay, first=first)
        time = self.sample_time * np.arange(len(q))
        table = Trajectory(time, {"reference": q}, {"reference": "m"})
        motion = simulation.simulate(
            self._loops[start], float(time[-1]), inputs={"reference": (table, "cubic")}, step=self.sample_time,
            tolerance=TOLERANCE,
            start={
                "plant.q": q[0], "der(plant.q)": 0.0, "plant.spring.offset": [0.0, 0.0, -self.sag],
                "der(plant.spring.offset)": 0.0,
            },
            outputs=["plant.T", "plant.spring.offset"],
        ).trajectory  # fmt: skip
        plate = motion["plant.T"][: len(q)] - self.start
        tool = plate + motion["plant.spring.offset"][: len(q)]
        measured = tool[:, :2] + self.noise * self.generator.normal(size=(len(q), 2))
        return {"motor": plate[:, :2], "tool": measured, "true tool": tool[:, :2]}
