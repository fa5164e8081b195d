"""What a simulation gives back, and what its study answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

from .._lazy import hint
from ..results import Quantity, Row, Study
from ..results.check import Check
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .hybrid.clock import Event

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = hint("matplotlib.figure", "Figure")

# called with the time reached [s]; True asks for a stop
Progress = Callable[[float], bool]


@dataclass(frozen=True)
class Switch:
    """A change of the states that a simulation integrates, at a time [s]: their names before and after."""

    time: float
    before: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Simulation:
    """What `simulate` returns.

    trajectory: every quantity declared at the top or one level below, the first derivative of what moves, and
        with declared energies `energy.stored`, `energy.supplied`, `energy.dissipated` [J].
    status: CHECK_FAILED where the run reached its end and a check failed; simulate() does not raise for it.
    checks: "energy_balance" where energies are declared: energy_error in parts of the energy that moved; "resolution"
        where states stay that small: the tolerance in parts of the largest state, both in nominals; "small_states"
        where some stay small beside others: the largest error of one in parts of its largest value.
    energy_error: largest |stored - start - supplied + dissipated| at a row [J]; None without declared energies.
    residual: largest |left - right| of any equation as written, at any row, in SI units.
    states: names of the states at the end. switches: their changes on the way.
    chosen: start values that nobody prescribed, by state; the initialisation chose them.
    events: what happened at instants, in their order. At each the trajectory has two rows, the second one, with what
        came after it, at the next larger time that a float can hold.
    samples: inputs and outputs of each sampled block at its samples, by the block's name.
    accumulation: the time [s] at which events come infinitely close, where that ended the run.

    >>> class Ball(gt.Model):
    ...     height = gt.variable(unit="m", start=2.0, fixed=True)
    ...     speed = gt.variable(unit="m/s")
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.height) == self.speed
    ...         yield gt.der(self.speed) == -self.g
    >>> run = gt.simulate(Ball(), 0.5)
    >>> run.status.ok, run.states, run.chosen
    (True, ('height', 'speed'), {'speed': 0.0})
    """

    status: SolveStatus
    message: str
    trajectory: Trajectory
    energy_error: float | None = None
    residual: float = 0.0
    states: tuple[str, ...] = ()
    switches: list[Switch] = field(default_factory=list)
    chosen: dict[str, float] = field(default_factory=dict)
    checks: dict[str, Check] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    samples: dict[str, Trajectory] = field(default_factory=dict)
    accumulation: float | None = None

    def plot(self, *names: str) -> Figure:
        """The named signals over time, all if none is named, with a mark at each change of states and each event; see
        `Trajectory.plot`."""
        return self.trajectory.plot(*names, marks=[at.time for at in (*self.switches, *self.events)])


class NotSimulated(RuntimeError):
    """Raised by simulate() when the run ended early; the message says why, and `.simulation` holds what was reached.

    >>> class Escape(gt.Model):  # x' = x^2 from 1: infinite at 1 s
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.x**2
    >>> try:
    ...     gt.simulate(Escape(), 2.0)
    ... except gt.NotSimulated as error:
    ...     print(round(error.simulation.trajectory.time[-1], 1))
    1.0
    """

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation.message)
        self.simulation = simulation


ENERGIES = ("stored", "supplied", "dissipated")
# events in the table
SHOWN = 5


def described(event: Mapping[str, Any]) -> str:
    """What changed at an event, or what caused it where nothing did."""
    changes = [f"{name} {a:.6g} -> {b:.6g}" for name, (a, b) in event["changes"].items()]
    return "; ".join(changes or event["causes"])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulationStudy(Study):
    """A simulated motion. simulation: what `simulate` gave."""

    simulation: Simulation
    end_time: Annotated[float, Quantity("s", "time reached")]
    end: Annotated[
        Mapping[str, Any], Quantity("", "every recorded quantity at that time, by its name, in SI units")
    ]  # fmt: skip
    states: Annotated[Sequence[str], Quantity("", "names of the states at that time")]
    switches: Annotated[int, Quantity("", "number of changes of the states on the way")]
    chosen: Annotated[
        Mapping[str, float],
        Quantity("", "start values that the problem leaves open, by state; the initialisation chose them"),
    ] = field(default_factory=dict)
    events: Annotated[
        Sequence[Mapping[str, Any]],
        Quantity(
            "", "what happened at instants: time_s, causes, changes by name from and to, energy_J that it brought"
        ),
    ] = ()
    accumulation: Annotated[
        float | None, Quantity("s", "time at which events come infinitely close; null where they do not")
    ] = None
    energy_error: Annotated[
        float | None,
        Quantity("J", "largest error of the energy balance; null for a model that declares no energies"),
    ] = None
    energy_stored: Annotated[
        float | None, Quantity("J", "energy stored at that time, beyond what was stored at the start")
    ] = None
    energy_supplied: Annotated[float | None, Quantity("J", "energy supplied until then")] = None
    energy_dissipated: Annotated[float | None, Quantity("J", "energy dissipated until then")] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        units = {} if self.trajectory is None else self.trajectory.units
        rows = [Row("end time", self.end_time, "s")]
        rows += [Row(f"{name} at the end", x, units[name]) for name, x in self.end.items() if "." not in name]
        rows += [Row("states", ", ".join(self.states) or "none")]
        rows += [Row(f"chosen start of {name}", x) for name, x in self.chosen.items()]
        if self.switches:
            rows.append(Row("changes of states", self.switches))
        if self.events:
            rows.append(Row("events", len(self.events)))
            rows += [Row(f"at {e['time_s']:.9g} s", described(e)) for e in self.events[:SHOWN]]
        if self.accumulation is not None:
            rows.append(Row("events accumulate at", self.accumulation, "s"))
        if self.energy_error is not None:
            rows += [Row(f"energy {k}", getattr(self, f"energy_{k}"), "J") for k in ENERGIES]
            rows.append(Row("error of the energy balance", self.energy_error, "J"))
        return rows
