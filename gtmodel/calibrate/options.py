"""What a calibration study is asked for: which parameters move, by which cost, and what is reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from ..inference import Prior
from ..results.options import Options, Unit, Within
from ..results.suspicion import EveryAlarm


@dataclass(frozen=True)
class Choice:
    """What to do with the parameters that the closure equations hold; names are of scalars ("L[0]"), rows or columns
    of numbers that share a beginning ("v[1]") or whole parameters ("A").

    `free`: those to move, None for all, empty for none but those of the measurement; `fixed`: those to leave, stronger
    than free (turns of quaternions too).
    `tied`: name -> name of the same shape, which it follows. `unit`: quaternions (4), scalar first, that are turned and
    keep the length 1 (three unknowns each, "u1_2 turned about x" [rad], in the quaternion's own frame). `priors` by
    scalar name of an unknown. `sizes`: expected error of a parameter, the scale in which rank and observability
    are computed; default 1e-3, of compliances 1e-6 m/N.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> q, _ = robot.causal(known="T", targets="q")(np.array([robot.home]))
    >>> poses = gt.calibrate.Measurements({"q": q, "T": [robot.home]})
    >>> choice = gt.calibrate.Choice(free=["A", "L"], fixed=["A[2]"])
    >>> gt.calibrate.prepare(robot, poses, choice).unknowns.names[-4:]
    ('A[1,2]', 'L[0]', 'L[1]', 'L[2]')
    """

    free: Sequence[str] | None = None
    fixed: Sequence[str] = ()
    tied: Mapping[str, str] = field(default_factory=dict)
    unit: Sequence[str] = ()
    priors: Sequence[Prior] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)


Alarm = Literal[
    "unit", "scale", "exchanged_signals", "stuck_columns", "exchanged_columns", "swapped_axes", "scalar_last",
    "out_of_reach", "moved_too_far", EveryAlarm,
]  # fmt: skip
Cost = Literal["squared", "length", "inverse", "forward", "orthogonal"]
COSTS = get_args(Cost)
COST_WORDS: dict[str, Cost] = {"closure": "squared", "linear": "length", "inverse": "inverse", "forward": "forward",
         "orthogonal": "orthogonal"}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Known(Options):
    """What is known of one parameter before the measurement: its prior.

    >>> gt.calibrate.Known(std=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: std: must be more than 0; found 0
    """

    value: Annotated[float | None, "in SI; the robot's own if left out"] = None
    std: Annotated[float, Within(above=0), "its standard deviation in SI"]


@dataclass(frozen=True)
class Fit(Options):
    """Which parameters move, what is known of them before, and what is minimised.

    >>> fit = gt.calibrate.Fit(free=["L"], priors={"L[0]": gt.calibrate.Known(std=1e-3)})
    >>> fit.cost, fit.variant
    ('linear', None)
    >>> gt.calibrate.Fit(cost="closed")
    Traceback (most recent call last):
    gtmodel...: cost: expected one of closure, linear, inverse, forward, orthogonal; found 'closed'...
    """

    variant: Annotated[
        Literal["ideal", "modified", "six_link", "f1_unit", "f1_raw", "serial"] | None,
        "ideal: one guideway direction (15 parameters); modified: one each (21); six_link (60); f1_unit, "
        "f1_raw: quaternions of length one, or free; serial: of an arm's Denavit-Hartenberg numbers those that "
        "positions determine. Left out: all that the equations hold, quaternions raw",
    ] = None
    free: Annotated[
        list[str] | None,
        "parameters to move, scalars, rows or whole; all if left out; [] for none: the robot is judged as it is, with "
        "frames, scales and offsets of the measurement alone estimated",
    ] = None  # fmt: skip
    fixed: Annotated[list[str], "parameters to leave, stronger than free"] = field(default_factory=list)
    tied: Annotated[dict[str, str], "parameter -> parameter that it follows"] = field(default_factory=dict)
    unit_quaternions: Annotated[list[str], "quaternions that are turned at length one"] = field(default_factory=list)
    priors: Annotated[
        dict[str, Known], "by unknown, or by row or parameter for all its unknowns at their start"
    ] = field(default_factory=dict)  # fmt: skip
    sizes: Annotated[
        dict[str, float],
        Within(above=0),
        "expected error of a parameter in SI; 0.001, or by the data in other units than m and rad",
    ] = field(default_factory=dict)
    cost: Annotated[
        Literal["closure", "linear", "inverse", "forward", "orthogonal"],
        "what is made small: squared closures (5.1), length errors, errors of the drives, of the pose, or "
        "both in units of their noise",
    ] = "linear"
    loss: Annotated[Literal["linear", "huber", "soft_l1", "cauchy"], "robust losses"] = "linear"
    loss_width: Annotated[
        float | None, Within(above=0),
        "residual beyond which the loss flattens; 1.345 robust standard deviations",
    ] = None  # fmt: skip
    accuracy: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0),
        "mean held-out positioning error that is wanted; a check",
    ] = None  # fmt: skip
    accept: Annotated[
        list[Alarm],
        "alarms about the readings that are notes and refuse nothing: unit, scale, exchanged_signals, stuck_columns, "
        "exchanged_columns, swapped_axes, scalar_last, out_of_reach, moved_too_far, copied_rows",
    ] = field(default_factory=list)  # fmt: skip
    sensitivity_step: Annotated[
        float, Within(least=0), "change of each parameter in the sensitivity (5.8), in SI; 0 for none"
    ] = 5e-5  # fmt: skip
