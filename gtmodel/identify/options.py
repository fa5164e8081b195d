"""Options of an identification: measured and free quantities, synthetic logs, closed-loop validation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from .._lazy import hint
from ..results.options import Long, Options, Unit, Within
from ..results.suspicion import EveryAlarm

if TYPE_CHECKING:
    from ..lang import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

# alarms about how a log was read; each can be accepted
LogAlarm = Literal[
    "unexplained_share",
    "work_of_friction",
    "exchanged_columns",
    "parameters_far_off",
    "saturated_share",
    "delay_moves_a_parameter",
    "cutoff_moves_a_parameter",
    "deviations_beyond_bound",
    EveryAlarm,
]
MASK_STEPS = 3.0  # quantisation steps per sample: below, the sign of a velocity is unknown


@dataclass(frozen=True)
class Processing(Options):
    """How logs become rows: zero-phase low pass on position, efforts and regressor, and selection of rows.

    >>> gt.identify.Processing(cutoff=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: cutoff: must be more than 0; found 0
    """

    cutoff: Annotated[
        float | None, Unit("Hz"), Within(above=0.0), "default: 2.5 times the band in which the motion exceeds the noise"
    ] = None  # fmt: skip
    order: Annotated[int, Within(least=1), "of the Butterworth filter"] = 4
    every: Annotated[
        int | None, Within(least=1), "use every n-th row; by default the rows are far enough apart to be independent"
    ] = None
    position_step: Annotated[
        float | None, Within(least=0.0),
        "quantisation of the position, in SI; default: the smallest step in the log",
    ] = None  # fmt: skip
    mask_steps: Annotated[
        float, Within(least=0.0), "rows slower than this many position steps per sample are dropped"
    ] = MASK_STEPS  # fmt: skip


@dataclass(frozen=True)
class Fitting(Options):
    """Measured variables, free and watched parameters, and how intervals are computed.

    >>> gt.identify.Fitting(confidence="robust")
    Traceback (most recent call last):
    gtmodel.results.agreement.WrongKind: confidence: expected one of auto, white, newey_west; found 'robust'
    """

    known: Annotated[str, "measured position, by the model's name"] = "q"
    targets: Annotated[str, "measured efforts"] = "tau"
    inputs: Annotated[
        list[str], "further measured variables that the efforts depend on: a second force, a payload, a temperature"
    ] = field(default_factory=list)
    watch: Annotated[list[str], "fixed parameters to test for in the residuals"] = field(default_factory=list)
    nonnegative: Annotated[bool | list[str], "free parameters that must not be negative: all, none, these"] = True
    inertias: Annotated[
        Literal["base", "consistent"] | None,
        "inertias of a serial arm to estimate in addition: base parameters, or also physically consistent "
        "bodies that have them",
    ] = None  # fmt: skip
    payloads: Annotated[
        list[float] | None, Unit("kg"), Within(least=0.0),
        "known point masses at the tool of a serial arm, one for each recording, then for each held-out one; with "
        "them a scale of the efforts can be estimated",
    ] = None  # fmt: skip
    payload_centre: Annotated[
        list[float], Unit("m"), Long(3), "centre of mass of the payloads, tool frame"
    ] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # fmt: skip
    confidence: Annotated[
        Literal["auto", "white", "newey_west"],
        "assumption of the intervals about the residuals; auto takes newey_west if they are coloured, and allows for "
        "noise that grows with the speed",
    ] = "auto"
    drift: Annotated[
        bool, 'whether the estimated offsets of the efforts (offset = "estimate") drift linearly over each recording'
    ] = False  # fmt: skip
    folds: Annotated[
        int | None, Within(least=2),
        "number of blocks for cross-validation, each predicted by a fit without it; as many as rows leaves one out",
    ] = None  # fmt: skip
    accept: Annotated[
        list[LogAlarm],
        "alarms about how the log was read that become notes, not failures: unexplained_share, work_of_friction, "
        "exchanged_columns, parameters_far_off, saturated_share, delay_moves_a_parameter, "
        "cutoff_moves_a_parameter, deviations_beyond_bound, copied_rows",
    ] = field(default_factory=list)  # fmt: skip


@dataclass(frozen=True)
class SyntheticLog(Options):
    """A synthetic log of a plant, to check an identification: sines, tracking, sensors, noise.

    >>> options = gt.identify.SyntheticLog(duration=20.0, effort_noise=[30.0, 30.0, 50.0])
    >>> round(options.duration / options.sample_time)  # samples of each motion
    5000
    >>> gt.identify.SyntheticLog(effort_colour=1.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: effort_colour: must be at least 0 and less than 1; found 1
    """

    seed: Annotated[int, Within(least=0), "of the noise"] = 0
    motion_seed: Annotated[
        int, Within(least=0), "seed of the phases of the motion; the held-out motion uses the next seed"
    ] = 1  # fmt: skip
    duration: Annotated[float, Unit("s"), Within(above=0.0), "of each sum of sines"] = 60.0
    sample_time: Annotated[float, Unit("s"), Within(above=0.0), "of the log"] = 0.004
    reference: Annotated[str, "variable that follows the sines or the prescribed motion"] = "T"
    repeats: Annotated[int, Within(least=1), "number of repetitions of the prescribed motion"] = 1
    centre: Annotated[list[float] | None, "centre of the motion; default: the home pose of the robot"] = None
    half_range: Annotated[float | list[float], "largest distance from the centre, by axis"] = 0.4
    frequencies: Annotated[
        list[float], Unit("Hz"), Within(above=0.0), "slow ones for friction, fast ones for masses"
    ] = field(default_factory=lambda: [0.2, 0.5, 1.1, 2.2])
    ramp: Annotated[float, Unit("s"), Within(above=0.0), "over which the motion grows and fades"] = 1.0
    tracking: Annotated[Literal["dressler_2012", "exact"], "how three carts follow: eq. (6.11) at 4 ms, or exactly"] = (
        "dressler_2012"
    )
    position_step: Annotated[float, Within(least=0.0), "quantisation of the position, in SI"] = 1e-6
    effort_step: Annotated[float, Within(least=0.0), "quantisation of the efforts, in SI"] = 0.0
    effort_noise: Annotated[
        float | list[float], Within(least=0.0), "standard deviation in SI, one for all targets or one each"
    ] = 30.0
    effort_colour: Annotated[
        float, Within(least=0.0, below=1.0), "correlation of neighbouring noise samples"
    ] = 0.0  # fmt: skip
    runs: Annotated[
        int, Within(least=0, most=10000), "further logs with other seeds, to check the coverage of the intervals"
    ] = 0  # fmt: skip
    processes: Annotated[
        int | None, Within(least=0), "number of processes for the runs; 0 for this process, default: one per core"
    ] = None  # fmt: skip


@dataclass(frozen=True)
class ClosedLoop(Options):
    """Simulation of the controlled model from the measured reference, with the identified parameters.

    >>> gt.identify.ClosedLoop("models/emps.py", inputs=["qg"])
    Traceback (most recent call last):
    gtmodel.results.agreement.WrongKind: model: expected gtmodel.Model or a function; found 'models/emps.py'
    """

    model: Annotated[
        Model | Callable[..., Model],
        "the controlled model, which takes the estimates, or a function that makes it from them",
    ]
    inputs: Annotated[list[str], "its inputs, such as the reference; signals of the log"]
    every: Annotated[int, Within(least=1), "use every n-th sample of the inputs, cubic in between"] = 1
    tolerance: Annotated[
        float, Within(least=1e-14, most=1e-3), "relative and absolute tolerance of the integrator"
    ] = 1e-7  # fmt: skip
    bound: Annotated[float | None, Within(above=0.0), "largest allowed rms error, SI; default: no check"] = None
