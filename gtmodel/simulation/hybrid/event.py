"""What happened at one instant of a simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Event:
    """An instant at which a model changed: something switched, a `gt.when` acted.

    time: [s]. causes: events by name with the lines that declare them, and `gt.If` that switched. discrete: discrete
    variables that changed, by name, with their values before and after. restarted: continuous variables that started
    anew, with their values before and after. impulses: of the forces that brought it about, their integrals over the
    instant [unit of the force times s]. energy: change of the declared stored energies [J].

    >>> class Lamp(gt.Model):
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     on = gt.discrete(0.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == 1.0
    ...         yield gt.when(self.x >= 0.5, self.on == 1.0)
    >>> (event,) = gt.simulate(Lamp(), 1.0).events
    >>> round(event.time, 9), event.discrete["on"]
    (0.5, (0.0, 1.0))
    """

    time: float
    causes: tuple[str, ...]
    discrete: Mapping[str, tuple[float, float]]
    restarted: Mapping[str, tuple[float, float]]
    energy: float = 0.0
    impulses: Mapping[str, float] = field(default_factory=dict)
