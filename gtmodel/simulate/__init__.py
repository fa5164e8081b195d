"""Simulation of any model: consistent start, CVODES or IDAS on the reduced system, monitored states."""

from .linearize import linearize, modes
from .run import NotSimulated, Simulation, Switch, simulate

__all__ = ["NotSimulated", "Simulation", "Switch", "linearize", "modes", "simulate"]
