"""What a simulation gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .._lazy import hint
from ..results.check import Check
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .hybrid.event import Event

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
