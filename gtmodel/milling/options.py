"""Options of a milling study (tool, dynamics, search, compensation), and its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ..results import Quantity, Row, Study
from ..results.options import Long, Options, Unit, Within


@dataclass(frozen=True)
class MillingTool(Options):
    """Mounting of the tool on the flange, and its direction over the work.

    >>> tool = gt.milling.MillingTool(tcp=[0.3, 0.0, 0.25], spindle=[1.0, 0.0, 0.0])  # spindle along x of the flange
    >>> tool.axis  # and downwards over the work
    [0.0, 0.0, -1.0]
    """

    tcp: Annotated[list[float], Unit("m"), Long(3), "tool centre point in flange coordinates"] = field(
        default_factory=lambda: [0.0] * 3
    )
    spindle: Annotated[list[float], Long(3), "direction from spindle to tip, flange coordinates"] = field(
        default_factory=lambda: [0.0, 0.0, 1.0]
    )
    axis: Annotated[list[float], Long(3), "direction from spindle to tip, world coordinates"] = field(
        default_factory=lambda: [0.0, 0.0, -1.0]
    )
    zero: Annotated[
        float, Unit("rad", written="deg"),
        "turn about the spindle at A = 0; at turn 0 the flange's z axis points to world x",
    ] = 0.0  # fmt: skip


@dataclass(frozen=True)
class Modal(Options):
    """Dynamics from joint stiffness: k along x, y, z from the compliance of each pose, with these declared masses.

    >>> gt.milling.Modal(mass=[350.0, 350.0], damping_ratio=[0.03, 0.03, 0.03])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: mass: expected 3 numbers; found 2
    """

    mass: Annotated[list[float], Unit("kg"), Long(3), "masses along x, y, z, equal in every pose"]
    damping_ratio: Annotated[list[float], Long(3), "damping ratios along x, y, z, equal in every pose"]


@dataclass(frozen=True)
class MillingSearch(Options):
    """Choices besides the angle. Speeds are in turns per second.

    >>> search = gt.milling.MillingSearch(step=np.radians(2.0), speeds=[25.0, 30.0])  # 1500 and 1800 rpm
    >>> search.refine
    3
    """

    step: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0), "step of the grid of angles over 360 degrees"
    ] = math.radians(1.0)  # fmt: skip
    speeds: Annotated[list[float], "spindle speeds [1/s] to compare with the declared one"] = field(
        default_factory=list
    )
    feed_directions: Annotated[list[list[float]], Long(3), "feed directions to compare with the declared one"] = field(
        default_factory=list
    )
    places: Annotated[
        list[list[float]], Unit("m"), Long(3), "places of the tool centre point to compare with the declared one"
    ] = field(default_factory=list)
    static_choice: Annotated[
        float | None, Unit("rad", written="deg"),
        "angle chosen by another static model, for example in a publication, to compare with",
    ] = None  # fmt: skip
    refine: Annotated[int, Within(least=0), "number of the best angles that an NLP refines"] = 3
    speed_range: Annotated[
        list[float] | None, Within(above=0.0), Long(2),
        "least and greatest speed [1/s] of an NLP over angle and speed; without it there is no such NLP",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class PathOffset(Options):
    """A path offset against the deflection in the chosen pose; the force rises over the time `entry`.

    >>> gt.milling.PathOffset(bandwidth=0.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: bandwidth: must be more than 0; found 0
    """

    bandwidth: Annotated[float, Unit("Hz"), Within(above=0.0), "bandwidth that the robot can follow"] = 5.0
    seconds: Annotated[float, Within(above=0.0), "duration of the simulated cut [s]"] = 2.0
    entry: Annotated[float, Unit("s"), Within(above=0.0), "time from the first chip to the full cut"] = 0.5
    cycle: Annotated[float, Unit("s"), Within(above=0.0), "time between the rows of compensation.csv"] = 0.004


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MillingStudy(Study):
    """Where to mill: the best angles about the spindle, and their deflections.

    Quantities that need dynamics are None without dynamics, and if the study was stopped before its search was
    complete; a study stopped before the static index has no values. `table` holds the rows for people.
    """

    reachable: Annotated[
        Array | None,
        Quantity(
            "rad", "intervals of the angle that some branch reaches within the joint limits: first and last angle",
            written="deg",
        ),
    ] = None  # fmt: skip
    static_angle: Annotated[
        float | None, Quantity("rad", "angle of the least static index among all reachable angles", written="deg")
    ] = None
    static_index: Annotated[
        float | None, Quantity("m", "static index there, under the peak force; only for ranking", written="mm")
    ] = None
    static_choice: Annotated[
        float | None,
        Quantity(
            "rad", "declared angle, or least static index among angles with dynamics; null without dynamics",
            written="deg",
        ),
    ] = None  # fmt: skip
    dynamic_angle: Annotated[
        float | None, Quantity("rad", "angle of the least dynamic index, refined; null without dynamics", written="deg")
    ] = None
    dynamic_index: Annotated[
        float | None, Quantity("m", "dynamic index there: largest deflection over two seconds from rest", written="mm")
    ] = None
    dynamic_mean: Annotated[
        float | None, Quantity("m", "mean deflection there, without transients", written="mm")
    ] = None  # fmt: skip
    static_choice_index: Annotated[
        float | None, Quantity("m", "dynamic index of the static choice", written="mm")
    ] = None  # fmt: skip
    ratio: Annotated[float | None, Quantity("", "static_choice_index over the least dynamic index on the grid")] = None
    refined: Annotated[
        Sequence[Any] | None,
        Quantity(
            "", "per NLP: angle [deg], dynamic index [mm], whether it converged; best grid angle first"
        ),
    ] = None  # fmt: skip
    free_speed: Annotated[
        Sequence[float] | None,
        Quantity(
            "",
            "angle [deg], speed [rpm] and dynamic index [mm] of an NLP over both; null without speed_range_rpm",
        ),
    ] = None
    combinations: Annotated[
        Sequence[Mapping[str, Any]] | None,
        Quantity("", "least dynamic index by place, feed direction and speed, with its angle [deg]"),
    ] = None
    change_1_Hz: Annotated[
        Sequence[float] | None,
        Quantity("%", "change of the dynamic index with all modes 1 Hz lower, and higher", key="change_1_Hz_percent"),
    ] = None
    mode_coupling: Annotated[str | None, Quantity("", "verdict in words")] = None
    spectral_radius: Annotated[
        float | None,
        Quantity(
            "",
            "spectral radius of the linear model with regeneration at the dynamic angle; below 1 stable; null: "
            "spindle too slow",
        ),
    ] = None
    guideline: Annotated[Sequence[str] | None, Quantity("", "recommendations in sentences")] = None
    compensation_rms: Annotated[
        Sequence[float] | None,
        Quantity("m", "tool error with no offset, static, dynamic, and dynamic within the bandwidth", written="mm"),
    ] = None
    printed_mean: Annotated[
        Mapping[str, Any] | None,
        Quantity("mm", "predicted means of the twelve printed tests, by feed direction"),
    ] = None
    dynamics: Annotated[str | None, Quantity("", "source of the dynamics")] = None
    table: Sequence[Row] = ()

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        return list(self.table)
