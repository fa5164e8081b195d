"""Options and result of the loop simulation: the controller's sampling, a point-to-point move, limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from ..results import Quantity, Study, Trajectory
from ..results.options import Long, Options, Unit, Within


@dataclass(frozen=True)
class LoopSampling(Options):
    """Sampling, delay and measurements of a digital controller.

    >>> gt.control.LoopSampling(period=0.002).delay
    0.008
    """

    period: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "between two samples"] = 0.004
    delay: Annotated[
        float, Unit("s", written="ms"), Within(least=0.0),
        "from a sample until its forces act; need not be a whole number of periods",
    ] = 0.008  # fmt: skip
    resolution: Annotated[float, Unit("m", written="um"), Within(least=0.0), "of the encoders; 0: exact"] = 0.0
    velocity: Annotated[
        Literal["measured", "difference"],
        "input of the law: the plant's velocity, or the difference of two measured positions over the period",
    ] = "measured"
    compiled: Annotated[bool, "evaluate the law by its generated C; the numbers are identical bit for bit"] = False


@dataclass(frozen=True)
class Move(Options):
    """A straight motion of the tool from rest to rest along a polynomial of fifth degree, then a time at rest.

    >>> gt.control.Move(start=[0.5, -0.9, 0.3], goal=[0.8, -0.9, 0.3], duration=0.6).rest
    0.2
    """

    start: Annotated[list[float], Unit("m"), Long(3), "tool centre point at the start, in the robot's frame"]
    goal: Annotated[list[float], Unit("m"), Long(3), "tool centre point at the end"]
    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the motion"]
    rest: Annotated[float, Unit("s"), Within(least=0.0), "at the goal after the motion, still under control"] = 0.2


@dataclass(frozen=True)
class TrackingLimits(Options):
    """Limits on tracking error and force; a limit of None is not checked.

    >>> gt.control.TrackingLimits(force=700.0).error is None
    True
    """

    error: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0.0), "largest allowed tracking error of an actuator"
    ] = None  # fmt: skip
    force: Annotated[float | None, Unit("N"), Within(above=0.0), "largest allowed force of an actuator"] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoopSimulationStudy(Study):
    """A motion under a sampled law. trajectory: reference, position and forces at the reference's times.

    law_samples: inputs and forces of the law at each sample.
    """

    law_samples: Trajectory | None = None
    period: Annotated[float, Quantity("s", "between two samples", "period", shown="ms", written="ms")]
    delay: Annotated[float, Quantity("s", "from a sample until its forces act", "delay", shown="ms", written="ms")]
    samples: Annotated[int, Quantity("", "evaluations of the law", "samples")] = 0
    end_time: Annotated[float, Quantity("s", "time reached", "end time")] = 0.0
    rms_error: Annotated[
        Sequence[float] | np.ndarray,
        Quantity("m", "of each actuator, reference minus position, root mean square", "rms error", "mm", "", "mm"),
    ] = ()
    largest_error: Annotated[
        Sequence[float] | np.ndarray, Quantity("m", "of each actuator", "largest error", "mm", "", "mm")
    ] = ()
    last_error: Annotated[
        Sequence[float] | np.ndarray, Quantity("m", "of each actuator, at the end", "error at the end", "mm", "", "mm")
    ] = ()
    largest_force: Annotated[Sequence[float] | np.ndarray, Quantity("N", "of each actuator", "largest force")] = ()
