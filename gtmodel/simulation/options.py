"""Argument checks of simulate() and linearize(), and the results of a simulation and of its study."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from .._lazy import hint
from .._pickling import PortableError
from ..lang.slips import floats
from ..lang.source import ModelError
from ..results import Quantity, Row, Study
from ..results.check import Check
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .hybrid.clock import Event

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = hint("matplotlib.figure", "Figure")

# rows of a trajectory: more would fill the memory
MOST_ROWS = 1_000_000
# time [s]: squares of longer times, and so the integrator's norms, overflow
LARGEST_TIME = 1e150
# integrator steps with a given max_step: more would take hours
MOST_STEPS = 10_000_000


def number(what: str, value: Any) -> float:
    """Return a number as float. Raises ModelError that names `what`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ModelError(f"{what} takes a number; found {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ModelError(f"{what} takes a number; found one that exceeds the largest float") from None


def numbers(what: str, value: Any) -> np.ndarray:
    """Return numbers as a one-dimensional array. Raises ModelError that names `what`."""
    try:
        return floats(value).reshape(-1)
    except (TypeError, ValueError):
        raise ModelError(f"{what} takes numbers; found {reprlib.repr(value)}") from None


def names(what: str, value: Sequence[str] | str) -> list[str]:
    """Return one name or several as a list. Raises ModelError for anything but strings."""
    texts: list[Any] = list(value) if isinstance(value, (list, tuple, set, dict)) else [value]
    for name in texts:
        if not isinstance(name, str):
            raise ModelError(f"{what} takes names such as 'T'; found {name!r}")
    return texts


def by_name(what: str, value: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return a dictionary by name. Raises ModelError for anything else."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ModelError(f"{what} takes a dictionary by name, such as {{'T': 0.0}}; found {value!r}")
    names(what, list(value))
    return value


def span(final_time: Any, start_time: Any) -> tuple[float, float]:
    """Return (start, end) [s] of a run."""
    end, start = number("final_time", final_time), number("start_time", start_time)
    if not (np.isfinite(start) and np.isfinite(end) and end > start):
        raise ModelError(f"the simulation must end after its start; found {start:g} s to {end:g} s")
    if max(abs(start), abs(end)) > LARGEST_TIME:
        raise ModelError(f"times of a run must be within {LARGEST_TIME:g} s of zero; found {start:g} s to {end:g} s")
    return start, end


def output_step(step: Any, length: float) -> float | None:
    """Return the interval [s] of the rows of a run of `length` seconds."""
    if step is None:
        return None
    step = number("step", step)
    if not 0 < step <= length:
        raise ModelError(f"the output interval must be positive and within the run; found {step:g} s")
    if length / step > MOST_ROWS:
        raise ModelError(
            f"an output interval of {step:g} s gives {length / step:.3g} rows, more than {MOST_ROWS}; give at least "
            f"{length / MOST_ROWS:.3g} s"
        )
    return step


def longest_step(max_step: Any, length: float) -> float:
    """Return the longest internal step [s] of a run of `length` seconds; infinite by default."""
    if max_step is None:
        return np.inf
    step = number("max_step", max_step)
    if not step > 0:
        raise ModelError(f"max_step must be positive; found {step:g} s")
    if length / step > MOST_STEPS:
        raise ModelError(
            f"a max_step of {step:g} s means {length / step:.3g} steps, more than {MOST_STEPS}; give at least "
            f"{length / MOST_STEPS:.3g} s"
        )
    return step


# called with the time reached [s]; returns True to stop
Progress = Callable[[float], bool]


@dataclass(frozen=True)
class Switch:
    """A change of the states that a simulation integrates, at a time [s]: their names before and after."""

    time: float
    before: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Simulation:
    """The result of `simulate`.

    trajectory: all quantities declared at the top level or one level below, first derivatives of moving top-level
        quantities, and with declared energies `energy.stored`, `energy.supplied`, `energy.dissipated` [J].
    status: CHECK_FAILED if the run reached its end but a check failed; simulate() does not raise for it.
    checks: "energy_balance", for declared energies: energy_error relative to the exchanged energy. "resolution", if all
        states stay very small: the tolerance relative to the largest state, both in nominals. "small_states", if some
        states stay small compared with others: their largest error relative to the largest value of that state.
    energy_error: largest |stored - start - supplied + dissipated| at a row [J]; None without declared energies.
    residual: largest |left - right| of any equation as written, at any row, in SI units.
    states: names of the states at the end. switches: changes of the states during the run.
    chosen: start values that were not prescribed, by state, as chosen by the initialisation.
    events: the events in order. At each the trajectory has two rows; the second one, after the event, is at the next
        larger floating-point time.
    samples: inputs and outputs of each sampled block at its samples, by the block's name.
    accumulation: the time [s] at which events accumulate, if that ended the run.

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
        """Plot the named signals, by default all, over time, with a mark at each change of states and each event; see
        `Trajectory.plot`."""
        return self.trajectory.plot(*names, marks=[change.time for change in (*self.switches, *self.events)])


class NotSimulated(PortableError, RuntimeError):
    """Raised by simulate() if the run ends early; the message gives the reason, `.simulation` the run up to there.

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
SHOWN = 5  # events in the table


def described(event: Mapping[str, Any]) -> str:
    """Return the changes at an event, or its causes if nothing changed."""
    changes = [f"{name} {a:.6g} -> {b:.6g}" for name, (a, b) in event["changes"].items()]
    return "; ".join(changes or event["causes"])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulationStudy(Study):
    """A simulated motion. simulation: the result of `simulate`."""

    simulation: Simulation
    end_time: Annotated[float, Quantity("s", "time reached")]
    end: Annotated[
        Mapping[str, Any], Quantity("", "every recorded quantity at that time, by its name, in SI units")
    ]  # fmt: skip
    states: Annotated[Sequence[str], Quantity("", "names of the states at that time")]
    switches: Annotated[int, Quantity("", "number of changes of the states during the run")]
    chosen: Annotated[
        Mapping[str, float],
        Quantity("", "start values that are not prescribed, by state, as chosen by the initialisation"),
    ] = field(default_factory=dict)
    events: Annotated[
        Sequence[Mapping[str, Any]],
        Quantity("", "events: time_s, causes, changes by name with values before and after, change of energy energy_J"),
    ] = ()
    accumulation: Annotated[float | None, Quantity("s", "time at which events accumulate; null if they do not")] = None
    energy_error: Annotated[
        float | None,
        Quantity("J", "largest error of the energy balance; null for a model that declares no energies"),
    ] = None
    energy_stored: Annotated[
        float | None, Quantity("J", "energy stored at that time minus the energy stored at the start")
    ] = None
    energy_supplied: Annotated[float | None, Quantity("J", "energy supplied until then")] = None
    energy_dissipated: Annotated[float | None, Quantity("J", "energy dissipated until then")] = None

    @property
    def rows(self) -> list[Row]:
        """Rows of the printed table."""
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
