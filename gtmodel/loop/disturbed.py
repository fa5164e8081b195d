"""What a simulated robot adds to its plant: delay, noise of encoders, a force that drifts, motors that saturate."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from .._lazy import hint
from ..results.options import Options, Unit, Within
from ..results.refusal import ArgumentError

if TYPE_CHECKING:
    from .plant import Plant, Servo
else:
    Plant, Servo = hint("gtmodel.loop.plant", "Plant"), hint("gtmodel.loop.plant", "Servo")


@dataclass(frozen=True)
class Disturbances(Options):
    """What a simulated robot adds to its plant: delay, noise, a force that drifts, motors that saturate; all synthetic.

    >>> gt.loop.Disturbances(delay=2, noise=1e-5).seed
    1
    """

    delay: Annotated[int, Within(least=0, most=100), "cycles until a command acts; brakes hold until the first"] = 0
    noise: Annotated[
        float, Unit("m"), Within(least=0.0), "standard deviation of a reading of an axis; of joints in rad"
    ] = 0.0
    seed: Annotated[int, Within(least=0), "of the noise"] = 1
    drift: Annotated[float, Unit("N/s"), Within(), "rate of an unknown force at each servo; of joints in N m/s"] = 0.0
    force_limit: Annotated[
        float | None,
        Unit("N"),
        Within(above=0.0),
        "largest force of the motors of the servo, of joints in N m; unlimited if left out",
    ] = None
    force_margin: Annotated[
        float | None,
        Unit("N"),
        Within(least=0.0),
        "how much more the servo may ask for with law predictive, of joints in N m: a check",
    ] = None

    def around(self, plant: Plant, servo: Servo, cycle_s: float) -> DisturbedPlant:
        """Return the plant behind them."""
        shift = self.drift / float(np.max(servo.kp_N_m))
        limits = [] if self.force_limit is None else [(0.0, self.force_limit)]
        return DisturbedPlant(
            plant, delay=self.delay, noise=self.noise, seed=self.seed, drift=shift, limits=limits, cycle_s=cycle_s
        )


class DisturbedPlant:
    """A plant behind a slow interface, with noisy encoders and a force that drifts: all synthetic.

    Args:
        plant: moves under positions and speeds.
        delay: cycles until a command acts; until the first one has arrived the brakes hold.
        noise: standard deviation of one reading [m].
        seed: of the noise.
        drift: rate at which the commanded positions shift [m/s]; times the stiffness of a servo, that of a force.
        limits: (time [s], largest force of the motors [N]) of the instants from which another limit holds.

    `forces_N`: what the servo asked for in each cycle, (substeps, n), if the plant has a servo.

    Raises ArgumentError about `force_limit` for limits of a plant without a servo.

    >>> plant = gt.loop.DrivePlant([0.0, 0.1, 0.2], a=[0.0] * 3, b=[1.0] * 3, delay=1)
    >>> late = gt.loop.DisturbedPlant(plant, delay=1)
    >>> for _ in range(2):
    ...     late.step([0.1, 0.1, 0.2], [0.0] * 3)
    ...     print(late.position_m)
    [0.  0.1 0.2]
    [0.1 0.1 0.2]
    """

    def __init__(
        self, plant: Plant, *, delay: int = 0, noise: float = 0.0, seed: int = 0, drift: float = 0.0,
        limits: Sequence[tuple[float, float]] = (), cycle_s: float = 0.004,
    ) -> None:  # fmt: skip
        if limits and getattr(plant, "limit_N", None) is None:
            raise ArgumentError("this plant has no servo whose forces could be limited; leave it out", "force_limit")
        self.plant, self.delay, self.noise, self.drift, self.cycle_s = plant, delay, noise, drift, cycle_s
        self.limits, self._random = sorted(limits), np.random.default_rng(seed)
        self._pipe: deque[tuple[np.ndarray, Sequence[float]]] = deque()
        self._cycles = 0
        self.forces_N: list[np.ndarray] = []
        self.position_m = self._read()

    @property
    def arm_m(self) -> np.ndarray:
        """Position on the arm's side, without noise [m]."""
        return self.plant.arm_m

    @property
    def title(self) -> str:
        """Name of the plant."""
        return str(getattr(self.plant, "title", type(self.plant).__name__))

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        now = self._cycles * self.cycle_s
        self._cycles += 1
        for _, limit in [entry for entry in self.limits if entry[0] <= now]:
            self.plant.limit_N = limit  # pyrefly: ignore[missing-attribute]
        self._pipe.append((np.array(position_m) + self.drift * now, speed_m_s))
        if len(self._pipe) > self.delay:
            self.plant.step(*self._pipe.popleft())  # pyrefly: ignore[bad-argument-type]
            self.forces_N.append(np.array(getattr(self.plant, "force_N", np.zeros((0, len(position_m))))))
        self.position_m = self._read()

    def _read(self) -> np.ndarray:
        return self.plant.position_m + self.noise * self._random.standard_normal(len(self.plant.position_m))
