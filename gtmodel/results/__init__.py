"""What every engine returns and every plot takes.

Status of a run
    Status            outcome of one evaluation on data, shared with the generated C
    SolveStatus       outcome of a whole solve or simulation
    ModesStatus       whether a set of assembly modes is whole
    c_enum            `Status` as a C99 enumeration
    c_sentences       its sentences as a C99 table

Studies
    Study             what a study of any library returns: status, quantities, checks, notes, pictures, files
    read, Stored      a written study given back
    Quantity          an attribute of a study, declared once: unit, description, label
    Row               a row of its table
    Options, Unit, Within, Long   options of a study, checked when made
    Work              progress and end of one run
    ArgumentError     what a caller gave cannot be used: the one refusal of all libraries
    naming            what is refused inside, as an argument of one's own

What was tested
    Check, at_most, at_least   a number with its bound, and the verdict

What data say
    Estimate          estimated quantities with their covariance, from whichever engine

Time series
    Trajectory        named, unit-carrying, immutable: result, optimum, measurement, guess, scaling reference
    TrajectoryError   data that make no trajectory
    UnknownNameError  a signal name that is not there
"""

from gtmodel.results.check import Check, at_least, at_most
from gtmodel.results.estimate import Estimate
from gtmodel.results.options import Long, Options, Unit, Within
from gtmodel.results.quantity import Quantity, Row, listed
from gtmodel.results.reading import Stored, read
from gtmodel.results.refusal import ArgumentError, naming
from gtmodel.results.status import ModesStatus, SolveStatus, Status, c_enum, c_sentences
from gtmodel.results.study import Study
from gtmodel.results.trajectory import Trajectory, TrajectoryError, UnknownNameError
from gtmodel.results.work import Work

__all__ = [
    "ArgumentError", "Check", "Estimate", "Long", "ModesStatus", "Options", "Quantity", "Row", "SolveStatus", "Status",
    "Stored", "Study", "Trajectory", "TrajectoryError", "Unit", "UnknownNameError", "Within", "Work",
    "at_least", "at_most", "c_enum", "c_sentences", "listed", "naming", "read",
]  # fmt: skip
