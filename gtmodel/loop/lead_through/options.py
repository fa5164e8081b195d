"""What a run of lead-through in the loop declares: the law, both sensors, and the synthetic scene it is tried in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...control.lead_through import (
    LeadThroughLaw,
    MountedSensor,
    OscillationWatch,
    ServoChain,
    SurfaceGains,
    SurfaceLaw,
    SyntheticSurface,
)
from ...control.lead_through.vectors import Vector
from ...results import ArgumentError
from ...results.options import Long, Options, Unit, Within
from ..reference import CYCLE_MS


def _zero() -> list[float]:
    return [0.0, 0.0, 0.0]


def _upright() -> list[list[float]]:
    return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


@dataclass(frozen=True)
class SensorNumbers(Options):
    """Bias, load and place of a force sensor, as `gtmodel.control.lead_through.calibrate_wrench` and `lever_arm` find
    them.

    >>> gt.loop.SensorNumbers(mass=0.8).mounted("tool").mass
    0.8
    """

    mass: Annotated[float, Unit("kg"), Within(above=0.0), "of what it carries: by its weight the sign is tested"]
    first_moment: Annotated[list[float], Unit("kg m"), Within(), Long(3), "mass times centre of mass"] = field(
        default_factory=_zero
    )
    force_bias: Annotated[list[float], Unit("N"), Within(), Long(3), "read without load"] = field(default_factory=_zero)
    moment_bias: Annotated[list[float], Unit("N m"), Within(), Long(3), "read without load"] = field(
        default_factory=_zero
    )
    point: Annotated[list[float], Unit("m"), Within(), Long(3), "sensor's origin to the tool centre point"] = field(
        default_factory=_zero
    )
    turn: Annotated[list[list[float]], Within(), "rows of the matrix whose columns are the sensor's axes"] = field(
        default_factory=_upright
    )

    def mounted(self, name: str) -> MountedSensor:
        """The sensor of the law. Raises ArgumentError, with `name` before the field."""
        if [len(row) for row in self.turn] != [3, 3, 3]:
            raise ArgumentError(f"expected three rows of three numbers; found {self.turn}", f"{name}.turn")
        x, y, z = (_vector(row) for row in self.turn)
        try:
            return MountedSensor(
                (x, y, z), _vector(self.point), _vector(self.force_bias), _vector(self.moment_bias), self.mass,
                _vector(self.first_moment),
            )  # fmt: skip
        except ArgumentError as error:
            raise ArgumentError(error.message, f"{name}.{error.argument}") from error


@dataclass(frozen=True)
class SyntheticHand(Options):
    """Force of a hand on the handle: it rests, then pushes against the nominal normal and drags round along the plate.

    >>> gt.loop.SyntheticHand(drag=0.0).drag
    0.0
    """

    rest: Annotated[float, Unit("s"), Within(above=0.0), "before it takes the handle"] = 0.1
    push: Annotated[float, Unit("N"), Within(least=0.0), "towards the plate"] = 5.0
    drag: Annotated[float, Unit("N"), Within(least=0.0), "along it, its direction goes round"] = 5.0
    period: Annotated[float, Unit("s"), Within(above=0.0), "of a turn of that direction"] = 2.0


@dataclass(frozen=True)
class SyntheticScene(Options):
    """The synthetic scene of a run: a plate below the tool, a hand, noise, and a fault of the tool's sensor.

    >>> gt.loop.SyntheticScene(gap=0.01).plate.stiffness  # [N/m]
    5000.0
    """

    start: Annotated[list[float], Unit("m"), Within(), Long(3), "of the tool centre point"] = field(
        default_factory=lambda: [0.45, -0.9, 0.3]
    )
    gap: Annotated[float, Unit("m"), Within(above=0.0), "to the plate at the start"] = 0.005
    plate: Annotated[SyntheticSurface, "what the tool meets"] = field(default_factory=SyntheticSurface)
    servo: Annotated[ServoChain, "how every cart follows its command"] = field(default_factory=ServoChain)
    hand: Annotated[SyntheticHand, "on the handle"] = field(default_factory=SyntheticHand)
    noise: Annotated[float, Unit("N"), Within(least=0.0), "standard deviation of the forces read, white"] = 0.0
    noise_moment: Annotated[float, Unit("N m"), Within(least=0.0), "of the moments read"] = 0.0
    seed: Annotated[int, Within(least=0), "of the noise"] = 0
    fault: Annotated[
        Literal["stale", "saturated", "missing", "reported"],
        "of the tool's sensor in the second run, from its half on: readings grow old, reach their range, are not sent, "
        "or the sensor says so itself",
    ] = "stale"


@dataclass(frozen=True)
class Guiding(Options):
    """Lead-through in the loop: the law in three translations, its sensors, and the scene in which it is tried.

    gains: the thesis prints only cycle, cone and reference, see `SurfaceGains`. The tool of a robot with carts does not
    turn.

    >>> tool, handle = gt.loop.SensorNumbers(mass=0.8), gt.loop.SensorNumbers(mass=0.5)
    >>> gt.loop.Guiding(tool=tool, handle=handle).law().translation.gains.force_reference  # [N]
    2.0
    """

    handle: Annotated[SensorNumbers, "the sensor at the handle"]
    tool: Annotated[SensorNumbers, "the sensor at the tool"]
    gains: Annotated[SurfaceGains, "of the law"] = field(default_factory=SurfaceGains)
    watch: Annotated[OscillationWatch, "that reduces the gain while a contact oscillates"] = field(
        default_factory=OscillationWatch
    )
    normal: Annotated[list[float], Within(), Long(3), "nominal, from the workpiece to the tool"] = field(
        default_factory=lambda: [0.0, 0.0, 1.0]
    )
    gravity: Annotated[list[float], Unit("m/s2"), Within(), Long(3), "in the world frame"] = field(
        default_factory=lambda: [0.0, 0.0, -9.81]
    )
    drift: Annotated[
        float, Unit("N"), Within(least=0.0), "largest change of a bias, with its noise: it does not decide a sign"
    ] = 1.0
    scene: Annotated[SyntheticScene, "synthetic"] = field(default_factory=SyntheticScene)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gains.cycle != CYCLE_MS / 1000.0:
            raise ArgumentError(f"the loop's is {CYCLE_MS / 1000.0:g} s; found {self.gains.cycle:g} s", "gains.cycle")
        self.law()

    def law(self) -> LeadThroughLaw:
        """The law of these numbers. Raises ArgumentError."""
        return LeadThroughLaw(
            SurfaceLaw(self.gains, _vector(self.normal), self.watch),
            handle=self.handle.mounted("handle"), tool=self.tool.mounted("tool"), gravity=_vector(self.gravity),
        )  # fmt: skip


def _vector(numbers: list[float]) -> Vector:
    return float(numbers[0]), float(numbers[1]), float(numbers[2])
