"""Simulation of any model: consistent start, CVODES or IDAS on the reduced system, monitored states."""
