"""The synthetic scene of lead-through on the robot's side: servo, plate, hand, and what both sensors read."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...control.lead_through import MountedSensor, ServoChain
from ...control.lead_through.servo import ServoRun
from ...geometry.rotations import right_handed
from ..plant import Plant
from ..wrenches import Wrench
from .options import Guiding

AT_FAULT = 1  # what the sensor says of itself


class ServoPlant:
    """Carts under servos that follow the change of the commanded positions, by delay, lag and mode; exact for commands
    that are held. A protocol need not send speeds."""

    def __init__(self, start_m: Sequence[float], servo: ServoChain, cycle_s: float = 0.004) -> None:
        self._last, self.cycle_s = np.array(start_m, dtype=float), cycle_s
        self._run = ServoRun(servo, cycle_s, self._last)

    @property
    def position_m(self) -> np.ndarray:
        """Of the carts."""
        return self._run.position

    @property
    def arm_m(self) -> np.ndarray:
        """Where the carts are: these servos are rigid behind their mode."""
        return self._run.position

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        position = np.array(position_m, dtype=float)
        self._run.advance((position - self._last) / self.cycle_s)
        self._last = position


class PlateScene:
    """What the force sensors of a robot say in each cycle while a synthetic hand leads its tool over a plate.

    forward: carts (n,) -> tool centre point (3,). plant: of the carts. fault_from: cycle in which the tool's sensor
    fails, None for never. `force`, `tip`: of the cycles so far, (3,) each, without noise.
    """

    def __init__(
        self, guiding: Guiding, forward: Callable[[np.ndarray], np.ndarray], plant: Plant,
        fault_from: int | None = None,
    ) -> None:  # fmt: skip
        self.guiding, self.forward, self.plant, self.fault_from = guiding, forward, plant, fault_from
        self.law, self.rng = guiding.law(), np.random.default_rng(guiding.scene.seed)
        self.along = right_handed(np.array(guiding.normal))[1:]
        self.origin = forward(plant.arm_m) - guiding.scene.gap * guiding.scene.plate.normal
        self.force: list[np.ndarray] = []
        self.tip: list[np.ndarray] = []
        self.good: Wrench | None = None

    def wrenches(self) -> tuple[Wrench, Wrench] | None:
        """Of handle and tool in this cycle; None where they are not sent."""
        scene, cycle_s = self.guiding.scene, self.guiding.gains.cycle
        now = len(self.tip)
        tip = self.forward(self.plant.arm_m)
        speed = (tip - self.tip[-1]) / cycle_s if self.tip else np.zeros(3)
        force = scene.plate.force(tip - self.origin, speed, now * cycle_s)
        self.tip.append(tip)
        self.force.append(force)
        handle = self._read(self.law.handle, self.hand(now * cycle_s))
        tool = self._read(self.law.tool, force)
        if self.fault_from is None or now < self.fault_from:
            self.good = tool
            return handle, tool
        if scene.fault == "missing":
            return None
        if scene.fault == "reported":
            tool.status = AT_FAULT
        elif scene.fault == "saturated":
            tool.force_N[2] = self.guiding.gains.force_range
        elif self.good is not None:  # the last one, older and older
            tool = Wrench(self.good.force_N, self.good.moment_N_m, now - self.fault_from + 1)
        return handle, tool

    def hand(self, time: float) -> np.ndarray:
        """(3,) [N] of the hand."""
        hand = self.guiding.scene.hand
        if time < hand.rest:
            return np.zeros(3)
        angle = 2 * math.pi * (time - hand.rest) / hand.period
        dragged = math.cos(angle) * self.along[0] + math.sin(angle) * self.along[1]
        return hand.drag * dragged - hand.push * np.array(self.guiding.normal)

    def _read(self, sensor: MountedSensor, force: np.ndarray) -> Wrench:
        """What a sensor reads under a force at the tool centre point, with bias, load and noise."""
        axes = np.array(sensor.turn).T  # rows: the sensor's axes
        down, own = axes @ np.array(self.law.gravity), axes @ force
        scene = self.guiding.scene
        read = np.array(sensor.force_bias) + sensor.mass * down + own + scene.noise * self.rng.standard_normal(3)
        moment = np.array(sensor.moment_bias) + np.cross(sensor.first_moment, down) + np.cross(sensor.point, own)
        moment += scene.noise_moment * self.rng.standard_normal(3)
        return Wrench(read.tolist(), moment.tolist())
