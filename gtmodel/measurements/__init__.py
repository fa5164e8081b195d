"""Measured signals: logs read with declared columns and units, corrections, filters. Knows no robot.

Logs
    Column            where a quantity stands in a log, and its unit there
    Session           one stretch of evenly sampled rows
    session_of        a trajectory in memory as one
    read_log          a file of any kind as sessions
    read_recording    files recorded at once as trajectories by clock, rows uneven
    open_log          the tables of a file, and what their columns are called
    LogForm           how a file is written, where it does not say so itself
    read_signals      the same for a set of signals and several files
    LogError          what is wrong with a log, with the file and its line
    sampling_of       rate, jitter, gaps and late rows of a time
    SamplingReport, Gap   what it returns
    inspect           what a log holds, before it is used
    InspectionStudy   what it returns

Signals
    Signal            a column with delay, scale and offset, each fixed or to be estimated
    ESTIMATE          the value that frees one of them
    Corrections       the free ones of a set of signals, session by session
    offset_columns    the regressor of offsets that are free

Clocks
    resample          uneven rows on an even grid, with the error of the method
    Resampled         what it returns
    resampling_study  signals of several clocks on one even grid
    ResamplingStudy   its result
    smooth            angles unwrapped, quaternions with a sign that does not jump
    EvenGrid          the grid: sample time, method, gaps, interval of time
    AlignBy           signals by which clocks are brought together
    align             offset and drift between two clocks, by a signal that both show
    Alignment         what it returns
    delay_study       how late one signal comes behind another
    DelayStudy        its result
    Search            where the delay lies
    SyntheticDelay    two synthetic recordings of one motion
    made_pair         these as trajectories

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

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from ..results.interpolation import smooth as smooth
    from .alignment.align import Alignment as Alignment, align as align
    from .alignment.delay_study import DelayStudy as DelayStudy, delay_study as delay_study
    from .alignment.options import Search as Search, SyntheticDelay as SyntheticDelay, made_pair as made_pair
    from .common_grid.options import AlignBy as AlignBy, EvenGrid as EvenGrid, ResamplingStudy as ResamplingStudy
    from .common_grid.resampling_study import resampling_study as resampling_study
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
