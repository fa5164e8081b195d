"""What a run of the loop needs: the robot, the reference and the program, from a generated folder."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Self

import numpy as np

from ..compiler.causal import CausalFunction
from ..lang import Model
from ..results import Trajectory, Work
from .exchange import CYCLE_MS
from .plant import PlantSource, Servo
from .table import ReferenceTable

Peer = Literal["egm", "rsi"]
Reference = Trajectory | Callable[[], Trajectory]
# what the first and the second run of a law are
LAWS = {
    "trajectory": ("the reference alone", "with feedforward"),
    "dynamics": ("the reference alone", "with inverse-dynamics feedforward"),
    "replay": ("the reference alone", "with a learned table"),
    "path": ("the programme alone", "with path correction"),
}
LONGEST_S = 3600.0
# of an arm on springs; no values of the prototype are published
ELASTIC_HZ, ELASTIC_DAMPING = (0.5, 1000.0), 0.05
# path correction integrates, which is slow beside a time-optimal motion
SLOWER = {"path": 10.0}
# as long as the C program holds by itself
HOLD_CYCLES = 5
# of a cart from its last command: a slow drive under its inverse is further behind than the robot itself would allow
FOLLOWING_M = 0.25


@dataclass(frozen=True)
class Stop:
    """What a cart does when the robot is lost at the reference's greatest speed: it holds, then brakes."""

    speed_m_s: float
    deceleration_m_s2: float

    @classmethod
    def of(cls, reference: np.ndarray, deceleration: float | None) -> Self:
        """From rows of a reference: its greatest speed, and its greatest deceleration where none is given."""
        speeds, accelerations = np.abs(reference[:, 3:6]), np.abs(reference[:, 6:9])
        # where the carts rest any deceleration will do
        return cls(float(np.max(speeds)), deceleration or float(np.max(accelerations)) or 1.0)

    @property
    def distance_m(self) -> float:
        """Held cycles at full speed, then a ramp in whole cycles."""
        step = 1e-3 * CYCLE_MS
        ramp = math.ceil(self.speed_m_s / (self.deceleration_m_s2 * step))
        return self.speed_m_s * step * (HOLD_CYCLES + max(0, ramp - 1) / 2)


@dataclass(frozen=True)
class Bench:
    """What both runs share; the reference has a row per cycle, see `there_and_back`.

    program: the loop, built in `place`, the folder of the work, this user's alone.
    elastic_Hz: of an arm on springs; None for a rigid one. plant: gives that of a run; None for the one of the law.
    servo: what the law dynamics knows of it. following_m: as far a cart may be from its last command [m].
    """

    peer: Peer
    law: str
    robot: Model
    forward: CausalFunction
    program: Path
    place: Path
    reference: ReferenceTable
    cycles: int
    in_lockstep: bool
    elastic_Hz: float | None
    stop: Stop
    work: Work
    plant: PlantSource | None = None
    servo: Servo = field(default_factory=Servo)
    following_m: float = FOLLOWING_M

    @property
    def carts_m(self) -> np.ndarray:
        """Reference of the carts (cycles, 3) [m]."""
        return self.reference.rows[: self.cycles, :3]

    @property
    def tcp_m(self) -> np.ndarray:
        """Reference of the tool centre point (cycles, 3) [m]."""
        return self.reference.rows[: self.cycles, 9:12]
