"""Results that engines return and plots show.

Status of a run
    Status            outcome of one evaluation, shared with the generated C
    SolveStatus       outcome of a whole solve or simulation
    ModesStatus       completeness of a set of assembly modes
    c_enum            `Status` as a C99 enumeration
    c_sentences       messages of `Status` as a C99 table

Studies
    Study             result of a study of any library: status, quantities, checks, notes, pictures, files
    read, Stored      a study read from its folder
    Quantity          declaration of an attribute of a study: unit, description, label
    Row               a row of its table
    Options, Unit, Within, Long   options of a study, checked at construction
    Work              progress and termination of a run
    ArgumentError     error of all libraries about a wrong argument
    naming            renames the argument of errors in a block

Checks
    Check, at_most, at_least   a number with its bound, and the verdict

Estimates
    Estimate          estimated quantities with their covariance, from any engine

Time series
    Trajectory        named signals with units, immutable: result, optimum, measurement, guess, scaling reference
    TrajectoryError   invalid data of a trajectory
    UnknownNameError  unknown name of a signal
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
