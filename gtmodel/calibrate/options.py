"""Options of a calibration study: free parameters, priors, cost, accepted alarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from ..inference import Prior
from ..results.options import Options, Unit, Within
from ..results.suspicion import EveryAlarm


@dataclass(frozen=True)
class Choice:
    """Which parameters of the closure equations are free, fixed or tied.

    Names are of scalars ("L[0]"), of rows ("v[1]") or of whole parameters ("A"). `free`: parameters to estimate; None
    for all; an empty list for only those of the measurement. `fixed`: parameters to keep; overrides `free`, also for
    orientations of frames. `tied`: name -> name of equal shape, whose value it takes. `unit`: quaternions (4), scalar
    first, that keep the length 1; three unknowns each, "u1_2 turned about x" [rad], in the quaternion's own frame.
    `priors`: by scalar name of an unknown. `sizes`: expected errors of parameters, the scale for rank and
    observability; default 1e-3, for compliances 1e-6 m/N.

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
    "out_of_reach", "moved_too_far", "device_drift", "device_temperature", EveryAlarm,
]  # fmt: skip
Cost = Literal["squared", "length", "inverse", "forward", "orthogonal"]
COSTS = get_args(Cost)
COST_WORDS: dict[str, Cost] = {"closure": "squared", "linear": "length", "inverse": "inverse", "forward": "forward",
         "orthogonal": "orthogonal"}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Known(Options):
    """Prior knowledge of one parameter.

    >>> gt.calibrate.Known(std=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: std: must be more than 0; found 0
    """

    value: Annotated[float | None, "expected value in SI; the robot's own if left out"] = None
    std: Annotated[float, Within(above=0), "standard deviation in SI"]


@dataclass(frozen=True)
class Fit(Options):
    """Free parameters, priors, and the cost to minimise.

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
        "f1_raw: quaternions of length one, or free; serial: those Denavit-Hartenberg parameters of an arm that "
        "positions determine. Default: all parameters in the equations, quaternions without unit length",
    ] = None
    free: Annotated[
        list[str] | None,
        "parameters to estimate: scalars, rows or whole ones; default all; []: only frames, scales and offsets of the "
        "measurement, so that the robot is judged as it is",
    ] = None  # fmt: skip
    fixed: Annotated[list[str], "parameters to keep; overrides free"] = field(default_factory=list)
    tied: Annotated[dict[str, str], "parameter -> parameter whose value it takes"] = field(default_factory=dict)
    unit_quaternions: Annotated[list[str], "quaternions that keep the length one"] = field(default_factory=list)
    priors: Annotated[
        dict[str, Known], "prior by unknown, or by row or parameter for all its unknowns at their start values"
    ] = field(default_factory=dict)  # fmt: skip
    sizes: Annotated[
        dict[str, float],
        Within(above=0),
        "expected error of a parameter in SI; default 0.001, or from the data for units other than m and rad",
    ] = field(default_factory=dict)
    cost: Annotated[
        Literal["closure", "linear", "inverse", "forward", "orthogonal"],
        "what to minimise: squared closures (5.1), length errors, errors of the drives, errors of the pose, or "
        "drives and pose together in units of their noise",
    ] = "linear"
    loss: Annotated[Literal["linear", "huber", "soft_l1", "cauchy"], "all but linear are robust"] = "linear"
    loss_width: Annotated[
        float | None, Within(above=0),
        "residual beyond which the loss flattens; default 1.345 robust standard deviations",
    ] = None  # fmt: skip
    accuracy: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0),
        "required mean held-out positioning error; a check",
    ] = None  # fmt: skip
    accept: Annotated[
        list[Alarm],
        "alarms that become notes because the readings are right: unit, scale, exchanged_signals, stuck_columns, "
        "exchanged_columns, swapped_axes, scalar_last, out_of_reach, moved_too_far, device_drift, "
        "device_temperature, copied_rows",
    ] = field(default_factory=list)  # fmt: skip
    sensitivity_step: Annotated[
        float, Within(least=0), "change of each parameter for the sensitivity (5.8), in SI; 0 to leave it out"
    ] = 5e-5  # fmt: skip
