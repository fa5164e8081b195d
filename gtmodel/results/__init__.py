"""What every engine returns and every plot takes.

Status of a run
    Status            outcome of one evaluation on data, shared with the generated C
    SolveStatus       outcome of a whole solve or simulation
    ModesStatus       whether a set of assembly modes is whole
    c_enum            `Status` as a C99 enumeration
    c_sentences       its sentences as a C99 table

What was tested
    Check             a number with its bound, and the verdict

What data say
    Estimate          estimated quantities with their covariance, from whichever engine

Time series
    Trajectory        named, unit-carrying, immutable: result, optimum, measurement, guess, scaling reference
    TrajectoryError   data that make no trajectory
    UnknownNameError  a signal name that is not there
"""

from gtmodel.results.check import Check
from gtmodel.results.estimate import Estimate
from gtmodel.results.status import ModesStatus, SolveStatus, Status, c_enum, c_sentences
from gtmodel.results.trajectory import Trajectory, TrajectoryError, UnknownNameError

__all__ = [
    "Check",
    "Estimate",
    "ModesStatus",
    "SolveStatus",
    "Status",
    "Trajectory",
    "TrajectoryError",
    "UnknownNameError",
    "c_enum",
    "c_sentences",
]
