"""Measured signals: logs read with declared columns and units, corrections, filters. Knows no robot.

Logs
    Column            where a quantity stands in a log, and its unit there
    Session           one stretch of evenly sampled rows
    session_of        a trajectory in memory as one
    read_log          a CSV or .mat file as sessions
    read_signals      the same for a set of signals and several files
    LogError          what is wrong with a log, with the file and its line

Signals
    Signal            a column with delay, scale and offset, each fixed or to be estimated
    ESTIMATE          the value that frees one of them
    Corrections       the free ones of a set of signals, session by session
    offset_columns    the regressor of offsets that are free

Copies
    copies            rows that equal an earlier one
    copied_stretch    samples in a row that repeat earlier ones

Filters
    ZeroPhase         Butterworth low pass forth and back
    cutoff_for        its cut-off from the band that the motion excites
    excitation_band   the frequency below which the motion has its power
    derivative        central differences, of order two
    second_derivative the same twice, on three rows
    motion            position, velocity and acceleration from measured positions
    smooth_motion     the same from the smooth curve through exact samples
    decimate          every n-th row
    position_noise    standard deviation of white noise on a smooth motion
    moving            where a velocity is far from zero, and the share dropped
"""

from .copies import Stretch, copied_stretch, copies
from .filters import (
    Moving,
    ZeroPhase,
    cutoff_for,
    decimate,
    derivative,
    excitation_band,
    motion,
    moving,
    position_noise,
    second_derivative,
)
from .log import Column, LogError, Session, read_log, session_of
from .signals import ESTIMATE, Corrections, Signal, offset_columns, read_signals
from .smooth import smooth_motion

__all__ = [
    "ESTIMATE",
    "Column",
    "Corrections",
    "LogError",
    "Moving",
    "Session",
    "Signal",
    "Stretch",
    "ZeroPhase",
    "copied_stretch",
    "copies",
    "cutoff_for",
    "decimate",
    "derivative",
    "excitation_band",
    "motion",
    "moving",
    "offset_columns",
    "position_noise",
    "read_log",
    "read_signals",
    "second_derivative",
    "session_of",
    "smooth_motion",
]
