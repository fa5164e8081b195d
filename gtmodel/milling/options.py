"""What a milling study is asked for besides cutter and cut, tool, search and dynamics, and what it returns."""

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
    """Where the tool is mounted on the flange, and how it is held over the work.

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
    """Dynamics made from joint stiffness: k along x, y, z from the compliance of each pose, with these declared masses.

    >>> gt.milling.Modal(mass=[350.0, 350.0], damping_ratio=[0.03, 0.03, 0.03])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: mass: expected 3 numbers; found 2
    """

    mass: Annotated[list[float], Unit("kg"), Long(3), "masses along x, y, z, the same in every pose"]
    damping_ratio: Annotated[list[float], Long(3), "damping ratios along x, y, z, the same in every pose"]


@dataclass(frozen=True)
class MillingSearch(Options):
    """What may be chosen besides the angle. Speeds are turns per second.

    >>> search = gt.milling.MillingSearch(step=np.radians(2.0), speeds=[25.0, 30.0])  # 1500 and 1800 rpm
    >>> search.refine
    3
    """

    step: Annotated[
        float, Unit("rad", written="deg"), Within(above=0.0), "step of the grid of angles over 360 degrees"
    ] = math.radians(1.0)  # fmt: skip
    speeds: Annotated[list[float], "spindle speeds [1/s] to compare with the given one"] = field(default_factory=list)
    feed_directions: Annotated[list[list[float]], Long(3), "feed directions to compare with the given one"] = field(
        default_factory=list
    )
    places: Annotated[
        list[list[float]], Unit("m"), Long(3), "places of the tool centre point to compare with the given one"
    ] = field(default_factory=list)
    static_choice: Annotated[
        float | None, Unit("rad", written="deg"),
        "angle that a static model chose elsewhere, in print for one, to compare with",
    ] = None  # fmt: skip
    refine: Annotated[int, Within(least=0), "how many of the best angles are refined by an NLP"] = 3
    speed_range: Annotated[
        list[float] | None, Within(above=0.0), Long(2),
        "least and greatest speed [1/s] of an NLP over angle and speed together; none if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class PathOffset(Options):
    """A path offset against the deflection in the chosen pose, while the force rises over the time `entry`.

    >>> gt.milling.PathOffset(bandwidth=0.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: bandwidth: must be more than 0; found 0
    """

    bandwidth: Annotated[float, Unit("Hz"), Within(above=0.0), "bandwidth of offsets that the robot can follow"] = 5.0
    seconds: Annotated[float, Within(above=0.0), "duration of the simulated cut [s]"] = 2.0
    entry: Annotated[float, Unit("s"), Within(above=0.0), "time from the first chip to the full cut"] = 0.5
    cycle: Annotated[float, Unit("s"), Within(above=0.0), "time between the rows of compensation.csv"] = 0.004


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MillingStudy(Study):
    """Where to mill: the best angles about the spindle, and their deflections.

    What needs dynamics is None without them, and in a study that was stopped before its search was complete; one that
    was stopped before the static index has no values at all. `table` holds the rows for people.
    """

    reachable: Annotated[
        Array | None,
        Quantity(
            "rad", "runs of the angle that some branch reaches within the joint limits: first and last of each",
            written="deg",
        ),
    ] = None  # fmt: skip
    static_angle: Annotated[
        float | None, Quantity("rad", "of the least static index among all reachable angles", written="deg")
    ] = None
    static_index: Annotated[
        float | None, Quantity("m", "there, under the peak force; for ranking, not for millimetres", written="mm")
    ] = None
    static_choice: Annotated[
        float | None,
        Quantity(
            "rad", "of the least static index among angles with dynamics, or as given; null without dynamics",
            written="deg",
        ),
    ] = None  # fmt: skip
    dynamic_angle: Annotated[
        float | None, Quantity("rad", "of the least dynamic index, refined; null without dynamics", written="deg")
    ] = None
    dynamic_index: Annotated[
        float | None, Quantity("m", "there: largest deflection over two seconds from rest", written="mm")
    ] = None
    dynamic_mean: Annotated[
        float | None, Quantity("m", "there: mean deflection without transients", written="mm")
    ] = None  # fmt: skip
    static_choice_index: Annotated[
        float | None, Quantity("m", "dynamic index of the static choice", written="mm")
    ] = None  # fmt: skip
    ratio: Annotated[float | None, Quantity("", "the latter over the least dynamic index on the grid")] = None
    refined: Annotated[
        Sequence[Any] | None,
        Quantity(
            "", "after the NLP: angle [deg], dynamic index [mm], whether it converged; best grid angle first"
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
        Quantity("%", "of the dynamic index where all modes are 1 Hz lower, and higher", key="change_1_Hz_percent"),
    ] = None
    mode_coupling: Annotated[str | None, Quantity("", "verdict in words")] = None
    spectral_radius: Annotated[
        float | None,
        Quantity(
            "",
            "of the linear model with regeneration at the dynamic angle; below 1 stable; null: too slow",
        ),
    ] = None
    guideline: Annotated[Sequence[str] | None, Quantity("", "the answer in sentences")] = None
    compensation_rms: Annotated[
        Sequence[float] | None,
        Quantity(
            "m", "error of the tool by offset: none, static, dynamic, and dynamic within the bandwidth", written="mm"
        ),
    ] = None
    printed_mean: Annotated[
        Mapping[str, Any] | None,
        Quantity("mm", "predicted means of the twelve printed tests, by feed direction"),
    ] = None
    dynamics: Annotated[str | None, Quantity("", "where the dynamics come from")] = None
    table: Sequence[Row] = ()

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        return list(self.table)
