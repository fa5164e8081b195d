"""What a simulation study answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from .result import Simulation

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
