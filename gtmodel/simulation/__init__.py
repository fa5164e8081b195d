"""Simulation of any model: consistent start, CVODES or IDAS on the reduced system, monitored states."""

from .arguments import MOST_ROWS, MOST_STEPS
from .certificate import explain_simulation
from .linearize import Mode, linearize, modes
from .result import NotSimulated, Simulation, Switch
from .run import simulate

__all__ = [
    "MOST_ROWS",
    "MOST_STEPS",
    "Mode",
    "NotSimulated",
    "Simulation",
    "Switch",
    "explain_simulation",
    "linearize",
    "modes",
    "simulate",
]
