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
    naming            what is refused inside, refused as an argument of one's own

What was tested
    Check, at_most, at_least   a number with its bound, and the verdict

What data say
    Estimate          estimated quantities with their covariance, from whichever engine

Time series
    Trajectory        named, unit-carrying, immutable: result, optimum, measurement, guess, scaling reference
    TrajectoryError   data that make no trajectory
    UnknownNameError  a signal name that is not there
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from gtmodel.results.check import Check as Check, at_least as at_least, at_most as at_most
    from gtmodel.results.estimate import Estimate as Estimate
    from gtmodel.results.options import Long as Long, Options as Options, Unit as Unit, Within as Within
    from gtmodel.results.quantity import Quantity as Quantity, Row as Row, listed as listed
    from gtmodel.results.reading import Stored as Stored, read as read
    from gtmodel.results.refusal import ArgumentError as ArgumentError, naming as naming
    from gtmodel.results.status import (
        ModesStatus as ModesStatus,
        SolveStatus as SolveStatus,
        Status as Status,
        c_enum as c_enum,
        c_sentences as c_sentences,
    )
    from gtmodel.results.study import Study as Study
    from gtmodel.results.trajectory import (
        Trajectory as Trajectory,
        TrajectoryError as TrajectoryError,
        UnknownNameError as UnknownNameError,
    )
    from gtmodel.results.work import Work as Work

public(__name__)
