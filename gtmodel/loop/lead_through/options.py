"""Settings of lead-through in the loop: the law, both sensors, and the synthetic test scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from ..._lazy import hint
from ...control.lead_through import OscillationWatch, ServoChain, SurfaceGains, SyntheticSurface
from ...control.lead_through.gains import ZEROS, Three
from ...results import ArgumentError
from ...results.options import Options, Unit, Within
from ..exchange import CYCLE_MS

if TYPE_CHECKING:
    from ...control.lead_through import LeadThroughLaw, MountedSensor
else:
    LeadThroughLaw = hint("gtmodel.control.lead_through", "LeadThroughLaw")
    MountedSensor = hint("gtmodel.control.lead_through", "MountedSensor")

UNIT_LENGTH = 1e-9  # tolerance of the law


@dataclass(frozen=True)
class SensorNumbers(Options):
    """Bias, load and pose of a force sensor; `calibrate_wrench` and `lever_arm` of `gtmodel.control.lead_through`
    identify them.

    >>> gt.loop.SensorNumbers(mass=0.8, centre=(0.0, 0.0, 0.05)).mounted().first_moment  # [kg m]
    (0.0, 0.0, 0.04000000000000001)
    """

    mass: Annotated[float, Unit("kg"), Within(above=0.0), "of the load it carries; its weight serves the sign test"]
    centre: Annotated[Three, Unit("m", written="mm"), Within(), "of that mass, from its origin, along its axes"] = ZEROS
    force_bias: Annotated[Three, Unit("N"), Within(), "reading without a force"] = ZEROS
    moment_bias: Annotated[Three, Unit("N.m"), Within(), "reading without a moment"] = ZEROS
    point: Annotated[Three, Unit("m", written="mm"), Within(), "its origin to tool centre point, along its axes"] = (
        ZEROS
    )
    turn: Annotated[Three, Unit("rad", written="deg"), Within(), "rotation vector, tool's frame to sensor's"] = ZEROS

    def mounted(self) -> MountedSensor:
        """Return the sensor as the law needs it."""
        from ...control.lead_through import MountedSensor
        from ...geometry.rotations import rotation_by

        x, y, z = rotation_by(self.turn).tolist()
        a, b, c = self.centre
        return MountedSensor(
            (_vector(x), _vector(y), _vector(z)), _vector(self.point), _vector(self.force_bias),
            _vector(self.moment_bias), self.mass, (self.mass * a, self.mass * b, self.mass * c),
        )  # fmt: skip


@dataclass(frozen=True)
class SyntheticHand(Options):
    """Force of a hand on the handle: after a rest it pushes against the nominal normal and drags along the plate.

    >>> gt.loop.SyntheticHand(drag=0.0).drag
    0.0
    """

    rest: Annotated[float, Unit("s"), Within(above=0.0), "before it takes the handle"] = 0.1
    push: Annotated[float, Unit("N"), Within(least=0.0), "towards the plate"] = 5.0
    drag: Annotated[float, Unit("N"), Within(least=0.0), "along it, in a rotating direction"] = 5.0
    period: Annotated[float, Unit("s"), Within(above=0.0), "of one turn of that direction"] = 2.0


@dataclass(frozen=True)
class SyntheticScene(Options):
    """Synthetic scene of a run: a plate below the tool, a hand, noise, and a fault of the tool's sensor.

    >>> gt.loop.SyntheticScene(gap=0.01).plate.stiffness  # [N/m]
    5000.0
    """

    start: Annotated[Three, Unit("m"), Within(), "of the tool centre point"] = (0.45, -0.9, 0.3)
    gap: Annotated[float, Unit("m"), Within(above=0.0), "to the plate at the start"] = 0.005
    plate: Annotated[SyntheticSurface, "surface below the tool"] = field(default_factory=SyntheticSurface)
    servo: Annotated[ServoChain, "how every cart follows its command"] = field(default_factory=ServoChain)
    hand: Annotated[SyntheticHand, "on the handle"] = field(default_factory=SyntheticHand)
    noise: Annotated[float, Unit("N"), Within(least=0.0), "standard deviation of white noise on the forces"] = 0.0
    noise_moment: Annotated[float, Unit("N.m"), Within(least=0.0), "standard deviation of noise on the moments"] = 0.0
    seed: Annotated[int, Within(least=0), "of the noise"] = 0
    fault: Annotated[
        Literal["stale", "saturated", "missing", "reported"],
        "of the tool's sensor from the middle of the second run on: readings grow old, saturate, are not sent, or the "
        "sensor reports a fault",
    ] = "stale"


@dataclass(frozen=True)
class Guiding(Options):
    """Lead-through in the loop: the law in three translations, its sensors, and its test scene.

    gains: the thesis prints only cycle, cone and reference, see `SurfaceGains`. The tool of a robot with carts does not
    turn.

    >>> tool, handle = gt.loop.SensorNumbers(mass=0.8), gt.loop.SensorNumbers(mass=0.5)
    >>> gt.loop.Guiding(tool=tool, handle=handle).law().translation.gains.force_reference  # [N]
    2.0
    """

    handle: Annotated[SensorNumbers, "the sensor at the handle"]
    tool: Annotated[SensorNumbers, "the sensor at the tool"]
    gains: Annotated[SurfaceGains, "of the law"] = field(default_factory=SurfaceGains)
    watch: Annotated[OscillationWatch, "reduces the gain while the contact oscillates"] = field(
        default_factory=OscillationWatch
    )
    normal: Annotated[Three, Within(), "nominal, from the workpiece to the tool, of length 1"] = (0.0, 0.0, 1.0)
    gravity: Annotated[Three, Unit("m/s2"), Within(), "in the world frame"] = (0.0, 0.0, -9.81)
    drift: Annotated[
        float, Unit("N"), Within(least=0.0), "largest change of a bias, plus noise; a lighter load fails the sign test"
    ] = 1.0
    scene: Annotated[SyntheticScene, "synthetic"] = field(default_factory=SyntheticScene)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gains.cycle != CYCLE_MS / 1000.0:
            raise ArgumentError(f"expected {CYCLE_MS / 1000.0:g} s; found {self.gains.cycle:g} s", "gains.cycle")
        if not abs(float(np.linalg.norm(self.normal)) - 1.0) <= UNIT_LENGTH:
            raise ArgumentError(f"expected a vector of length 1; found {self.normal}", "normal")

    def law(self) -> LeadThroughLaw:
        """Return the law with these settings. Raises ArgumentError."""
        from ...control.lead_through import LeadThroughLaw, SurfaceLaw

        return LeadThroughLaw(
            SurfaceLaw(self.gains, _vector(self.normal), self.watch),
            handle=self.handle.mounted(), tool=self.tool.mounted(), gravity=_vector(self.gravity),
        )  # fmt: skip


def _vector(numbers: Sequence[float]) -> Three:
    """Return a tuple, also from a list."""
    return float(numbers[0]), float(numbers[1]), float(numbers[2])
