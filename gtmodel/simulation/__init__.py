"""Simulation of any model: consistent start, CVODES or IDAS on the reduced system, monitored states.

simulate gives a Simulation; simulation_study adds checks, table and pictures: a SimulationStudy.
"""

from .arguments import MOST_ROWS, MOST_STEPS
from .certificate import explain_simulation
from .linearize import Mode, linearize, modes
from .result import NotSimulated, Simulation, Switch
from .run import simulate
from .study import SimulationStudy, simulation_study

__all__ = [
    "MOST_ROWS",
    "MOST_STEPS",
    "Mode",
    "NotSimulated",
    "Simulation",
    "SimulationStudy",
    "Switch",
    "explain_simulation",
    "linearize",
    "modes",
    "simulate",
    "simulation_study",
]
