"""Measured signals: read logs with declared columns and units, correct and filter them. Independent of any robot.

Logs
    Column            name and unit of the column that holds a quantity
    Conversion        scales, gear ratios, motor constants, coupling and offsets from columns to the quantity
    Session           one evenly sampled recording
    session_of        a session from a trajectory in memory
    read_log          read a log file of any format as sessions
    read_recording    read files with several clocks: one unevenly sampled trajectory per clock
    open_log          list the tables of a file and their columns
    LogForm           format of a file that does not state it
    read_signals      read a set of signals from several files
    LogError          an error in a log, with its file and line
    sampling_of       sampling rate, jitter, gaps and late rows
    SamplingReport, Gap   the result of sampling_of
    inspect           examine a log before it is used
    InspectionStudy   the result of inspect

Signals
    Signal            a column with delay, scale and offset, each fixed or to be estimated
    ESTIMATE          marks a delay, scale or offset to be estimated
    Corrections       the unknown corrections of a set of signals, session by session
    offset_columns    regressor columns of unknown offsets

Clocks
    resample          resample uneven rows on an even grid and estimate the interpolation error
    Resampled         the result of resample
    resampling_study  resample signals of several clocks on one even grid
    ResamplingStudy   the result of resampling_study
    smooth            unwrap angles and remove sign jumps of quaternions
    EvenGrid          the grid: sample time, method, gaps, time interval
    AlignBy           a pair of signals that aligns two clocks
    joined            join two recordings: in time, at rest, by row number, or by order
    RowJoin, Match    how rows are joined, and the ways
    ClockColumn       the time column of a file
    align             estimate offset and drift between two clocks from a signal that both record
    Alignment         the result of align
    delay_study       estimate the delay between two signals
    DelayStudy        the result of delay_study
    Search            search range of the delay
    SyntheticDelay    options of two synthetic recordings of one motion
    made_pair         the two synthetic recordings as trajectories

Copies
    copies            rows equal to an earlier row
    copied_stretch    consecutive samples that repeat earlier ones

Filters
    ZeroPhase         zero-phase Butterworth low pass
    cutoff_for        cut-off frequency chosen from the excitation band
    excitation_band   frequency below which nearly all power of the motion lies
    derivative        central differences of second order
    second_derivative central second differences
    motion            position, velocity and acceleration from measured positions
    smooth_motion     position, velocity and acceleration from a spline through exact samples
    decimate          keep every n-th row
    position_noise    standard deviation of the white noise on a smooth motion
    moving            rows whose velocity is far from zero, and the share of the others
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from ..results.interpolation import smooth as smooth
    from .alignment.align import Alignment as Alignment, align as align
    from .alignment.delay_study import DelayStudy as DelayStudy, delay_study as delay_study
    from .alignment.options import Search as Search, SyntheticDelay as SyntheticDelay, made_pair as made_pair
    from .common_grid.options import AlignBy as AlignBy, EvenGrid as EvenGrid, ResamplingStudy as ResamplingStudy
    from .common_grid.resampling_study import resampling_study as resampling_study
    from .conversion import Conversion as Conversion
    from .filters import (
        Moving as Moving,
        ZeroPhase as ZeroPhase,
        cutoff_for as cutoff_for,
        decimate as decimate,
        derivative as derivative,
        excitation_band as excitation_band,
        motion as motion,
        moving as moving,
        position_noise as position_noise,
        second_derivative as second_derivative,
        smooth_motion as smooth_motion,
    )
    from .inspection.data_tests import Stretch as Stretch, copied_stretch as copied_stretch, copies as copies
    from .inspection.inspection_study import InspectionStudy as InspectionStudy, inspect as inspect
    from .joining import ClockColumn as ClockColumn, Match as Match, RowJoin as RowJoin, joined as joined
    from .log import (
        Column as Column,
        LogError as LogError,
        Session as Session,
        read_log as read_log,
        session_of as session_of,
    )
    from .recording import read_recording as read_recording
    from .resampling import Resampled as Resampled, resample as resample
    from .sampling import Gap as Gap, SamplingReport as SamplingReport, sampling_of as sampling_of
    from .signals import (
        ESTIMATE as ESTIMATE,
        Corrections as Corrections,
        Signal as Signal,
        offset_columns as offset_columns,
        read_signals as read_signals,
    )
    from .streams.form import LogForm as LogForm
    from .streams.opening import open_log as open_log

public(__name__)
