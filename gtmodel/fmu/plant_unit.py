"""Declaration of an FMU as the plant of the 4 ms loop: the archive, and the roles of its variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

from .._lazy import hint
from ..results.options import Options, Unit, Within
from ..results.refusal import ArgumentError, naming
from .caller import LONGEST_S, TIMEOUT_S

if TYPE_CHECKING:
    from ..loop.plant import Servo
    from .plant import FmuPlant
else:
    Servo, FmuPlant = hint("gtmodel.loop", "Servo"), hint("gtmodel.fmu", "FmuPlant")

Names = tuple[str, ...] | list[str]


@dataclass(frozen=True)
class PlantUnit(Options):
    """An FMU as the plant of the 4 ms loop, started anew for every run.

    file: path of the archive, FMI 2.0 or 3.0 with co-simulation, or the result of `gt.fmu.export`.

    Raises ArgumentError if the names cannot make a plant. Calling it with a cycle [s] raises errors as `FmuPlant` does.

    >>> carts, motors = [f"q[{k}]" for k in (1, 2, 3)], [f"tau[{k}]" for k in (1, 2, 3)]
    >>> unit = gt.fmu.PlantUnit("robot.fmu", carts, force=motors, speed=[f"der({q})" for q in carts])
    >>> unit.servo
    Servo(kp_N_m=40000.0, kd_N_s_m=1500.0, substeps=8)
    """

    file: Any
    position: Annotated[Names, "outputs with the measured positions, one for each cart"]
    command: Annotated[Names, "inputs for commanded positions"] = ()
    command_speed: Annotated[Names, "inputs for commanded speeds, in addition to command; zero with RSI"] = ()
    force: Annotated[Names, "instead of command, inputs for the motor forces of a position servo"] = ()
    speed: Annotated[Names, "outputs with the speeds, needed with force"] = ()
    arm: Annotated[Names, "outputs with the positions on the arm's side of the carts; default: position"] = ()
    units: Annotated[
        dict[str, str],
        "unit, such as mm, of variables without one in the description, by position, command, command_speed, force, "
        "speed or arm",
    ] = field(default_factory=dict[str, str])
    start: Annotated[dict[str, float], "start value by name of a variable, in the FMU's own units"] = field(
        default_factory=dict[str, float]
    )
    stiffness: Annotated[
        float | None,
        Unit("N/m"),
        Within(above=0.0),
        "stiffness of the servo: 40,000 by default with force; with command that of the servo inside the FMU, "
        "for the law dynamics",
    ] = None
    damping: Annotated[
        float | None, Unit("kg/s"), Within(least=0.0), "damping of the servo, equal to N.s/m: 1,500 by default"
    ] = None
    steps: Annotated[
        int | None,
        Within(least=1, most=1000),
        "communication steps of the FMU in a cycle of 4 ms; 1 by default, 8 with force",
    ] = None
    timeout: Annotated[
        float,
        Unit("s"),
        Within(above=0.0, most=LONGEST_S),
        "timeout of a call of the FMU; its separate process is ended if a call takes longer",
    ] = TIMEOUT_S

    def __post_init__(self) -> None:
        from .plant import QUANTITIES, named

        super().__post_init__()
        named({name: getattr(self, name) for name in QUANTITIES})
        if not self.force and (self.stiffness is None) != (self.damping is None):
            missing = "stiffness" if self.stiffness is None else "damping"
            raise ArgumentError("the servo inside an FMU needs stiffness and damping; add both or neither", missing)

    @property
    def servo(self) -> Servo | None:
        """Servo that computes the forces, or the declared servo inside the FMU; None: unknown."""
        from ..loop.plant import Servo

        if not self.force and self.stiffness is None:
            return None
        options: Mapping[str, Any] = {
            "kp_N_m": self.stiffness, "kd_N_s_m": self.damping, "substeps": self.steps,
        }  # fmt: skip
        return Servo(**{name: value for name, value in options.items() if value is not None})

    def __call__(self, cycle_s: float) -> FmuPlant:
        """Return the FMU at its start."""
        from .plant import FmuPlant

        with naming({"path": "file"}):
            return FmuPlant(
                self.file, self.position, command=self.command, command_speed=self.command_speed, force=self.force,
                speed=self.speed, arm=self.arm, servo=self.servo, start=self.start, cycle_s=cycle_s, units=self.units,
                steps=self.steps, timeout=self.timeout,
            )  # fmt: skip
