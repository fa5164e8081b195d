"""The identification study: masses and friction of a robot from its measured motion and forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..measurements import Signal
from ..results import ArgumentError, SolveStatus, TrajectoryError, Work
from ..results.door import study_function
from ..results.work import Progress, never, silent
from .closed_loop import ClosedLoopRun, follow
from .concluded import concluded
from .identified import IdentificationStudy
from .inertia import Identification, Validation, identify
from .options import ClosedLoop, Fitting, SyntheticLog
from .parameter_names import scalar_parameters
from .recordings import Log, Recordings, made_up, measured, scalars_of, sessions_of
from .regressor import Regressor
from .repeated import Repeated, repeat_identification
from .rows import Processing, rows_of, with_offsets

Array = np.ndarray
STOPPED = "stopped before the fit"


@study_function
def study(
    robot: Model,
    log: Log,
    free: Sequence[str],
    *,
    held_out: Log = (),
    signals: Mapping[str, Signal] | None = None,
    fitting: Fitting | None = None,
    processing: Processing | None = None,
    published: Mapping[str, float] | None = None,
    closed_loop: ClosedLoop | None = None,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> IdentificationStudy:
    """Masses and friction, or any parameters in which the efforts are linear, from a measured motion.

    Args:
        robot: the model, with friction by the sign of the velocity or smoothed.
        log: a recording or several, each a Session or a Trajectory, evenly sampled, with the measured position and
            efforts under the model's names, SI.
        free: parameters to be estimated, arrays by name.
        held_out: recordings of other motions, for validation only.
        signals: by name how position and efforts follow from what the log holds, with delays, scales and offsets that
            are known or estimated; the log holds them themselves if left out.
        fitting: names of what is measured, fixed parameters to watch, bounds, intervals.
        processing: the filter and which rows are used.
        published: numbers to compare with, by parameter [SI].
        closed_loop: the controlled model, simulated with what was found.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.identify import SyntheticLog, study, synthetic_study
    >>> robot = gt.robots.inertia_variant("model_2").robot
    >>> made = synthetic_study(robot, SyntheticLog(duration=8.0), ["m_p", "m_c", "coulomb", "viscous"])
    >>> made.truth["m_p"]
    9.13
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    how, processing = fitting or Fitting(), processing or Processing()
    regressor = regressor_of(robot, free, how)
    told = _told(robot, published or {})
    work.progress("reading", 0.1)
    recordings, others = sessions_of(log, "log"), sessions_of(held_out, "held_out")
    data = measured(recordings, others, signals, regressor, processing, free, how.known, how.targets)
    _check_inputs(closed_loop, data)
    if work.interrupted():
        return IdentificationStudy(status=SolveStatus.INTERRUPTED, message=STOPPED, title=title)
    work.progress("fitting", 0.3)
    found, validation = _fitted(how, processing, regressor, data, free, "log")
    runs: list[ClosedLoopRun] = []
    if closed_loop is not None:
        e = found.estimate
        names = [n for n in found.rows.names if n in (*e.names, *e.held) and n not in found.rows.signed]
        numbers = {n: e.value(n) for n in names}
        runs = follow(closed_loop, numbers, data.fitted + data.held_out, how.known, how.targets, work)
    return concluded(how, data, found, validation, None, title, told=told, loop=closed_loop, runs=runs)


@study_function
def synthetic_study(
    robot: Model,
    synthetic: SyntheticLog,
    free: Sequence[str],
    *,
    plant: Model | None = None,
    motion: Array | None = None,
    fitting: Fitting | None = None,
    processing: Processing | None = None,
    published: Mapping[str, float] | None = None,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> IdentificationStudy:
    """What `study` gives back from a log that is made up: values against the truth, and with runs its coverage.

    Args:
        robot: the model that is fitted.
        synthetic: motion, sensors and noise.
        free, fitting, processing, published: as of `study`.
        plant: the model that makes the log, where it is another.
        motion: (n, ...) of the reference variable at the sample times, such as an excitation's, in place of sines; the
            motion held out is of sines still.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Interrupted while it repeats, it keeps the runs that ended. Raises ArgumentError.
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    how, processing = fitting or Fitting(), processing or Processing()
    regressor = regressor_of(robot, free, how)
    told = _told(robot, published or {})
    work.progress("reading", 0.1)
    data = made_up(plant or robot, synthetic, motion, regressor, how.known, how.targets)
    if work.interrupted():
        return IdentificationStudy(status=SolveStatus.INTERRUPTED, message=STOPPED, title=title)
    work.progress("fitting", 0.3)
    found, validation = _fitted(how, processing, regressor, data, free, "synthetic")
    repeated = _repeated(how, processing, synthetic, regressor, data, free, work)
    return concluded(how, data, found, validation, repeated, title, told=told)


def regressor_of(robot: Model, free: Sequence[str], how: Fitting) -> Regressor:
    """The regressor of what is free and what is watched. Raises ArgumentError."""
    flat = flat_of(robot)
    for name in ("known", "targets"):
        try:
            flat.lookup(getattr(how, name))
        except ModelError as error:
            raise ArgumentError(str(error), f"fitting.{name}") from error
    try:
        found = Regressor(robot, [*free, *how.watch], how.known, how.targets)
    except ModelError as error:
        at = "fitting.watch" if any(f"'{n}" in str(error) for n in how.watch) else "free"
        raise ArgumentError(str(error), at) from error
    if not isinstance(how.nonnegative, bool):
        try:
            scalars_of(found, how.nonnegative)
        except ModelError as error:
            raise ArgumentError(str(error), "fitting.nonnegative") from error
    return found


def _told(robot: Model, published: Mapping[str, float]) -> Mapping[str, float]:
    for name in published:
        try:
            scalar_parameters(flat_of(robot), [name])
        except ModelError as error:
            raise ArgumentError(str(error), f"published.{name}") from error
    return published


def _check_inputs(loop: ClosedLoop | None, data: Recordings) -> None:
    for name in [] if loop is None else loop.inputs:
        for session in (*data.fitted, *data.held_out):
            if name not in session.trajectory:
                raise ArgumentError(f"'{session.name}' holds no '{name}'", "closed_loop.inputs")


def _fitted(
    how: Fitting, processing: Processing, regressor: Regressor, data: Recordings, free: Sequence[str], place: str
) -> tuple[Identification, Validation | None]:
    try:
        rows = rows_of(data.fitted, regressor, processing, how.known, how.targets)
        if data.offsets is not None:
            rows = with_offsets(rows, how.targets, per_session=data.offsets == "session")
        found = identify(
            rows, [*free, *rows.signed], nonnegative=how.nonnegative, confidence=how.confidence
        )  # fmt: skip
        if not data.held_out:
            return found, None
        fixed = Processing(
            rows.cutoff_Hz, processing.order, rows.every, processing.position_step, processing.mask_steps
        )
        others = rows_of(data.held_out, regressor, fixed, how.known, how.targets)
        if data.offsets is not None:
            others = with_offsets(others, how.targets, per_session=False)
        return found, found.validate(others)
    except (ModelError, TrajectoryError) as error:
        raise ArgumentError(str(error), place) from error


def _repeated(
    how: Fitting,
    processing: Processing,
    s: SyntheticLog,
    regressor: Regressor,
    data: Recordings,
    free: Sequence[str],
    work: Work,
) -> Repeated | None:
    if s.runs == 0 or data.simulator is None:
        return None

    def progress(done: int, runs: int) -> None:
        work.progress("repeating", done / runs, {"runs": float(done)})

    truth = {n: data.truth[n] for n in scalars_of(regressor, free)}
    try:
        return repeat_identification(
            data.simulator,
            regressor,
            truth,
            data.sensors,
            s.runs,
            s.seed,
            free=free,
            processing=processing,
            confidence=how.confidence,
            processes=s.processes,
            progress=progress,
            interrupted=work.interrupted,
        )
    except (RuntimeError, ValueError) as error:
        raise ArgumentError(str(error), "synthetic.runs") from error
