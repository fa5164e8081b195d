"""What a study of a late loop answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from ...results import Quantity, Study

ByName = Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DelayedFeedbackStudy(Study):
    """How far the gain of a late correction may be turned up, by axis.

    runs: the simulated deviations [m] just below and above each limit, by axis.
    """

    runs: Mapping[str, Sequence[object]] = field(default_factory=dict)
    limit: Annotated[ByName, Quantity("", "gain at which the loop becomes unstable, by axis", "gain limit")] = field(
        default_factory=dict
    )
    frequency: Annotated[ByName, Quantity("Hz", "at which it then swings, by axis", "frequency at the limit")] = field(
        default_factory=dict
    )
    returns: Annotated[
        Mapping[str, Sequence[Sequence[float]]],
        "greater gains, from and to, at which it would be stable again, by axis",
    ] = field(default_factory=dict)
    simulated_limit: Annotated[
        ByName | None,
        Quantity("", "gain at which synthetic runs along the path begin to grow, by axis", "limit of runs in time"),
    ] = None
    worst_limit: Annotated[
        ByName | None, Quantity("", "least limit over the box, by axis", "worst limit in the box")
    ] = None
    worst_point: Annotated[Mapping[str, ByName], "where in the box, by axis; shares of the declared, delay in s"] = (
        field(default_factory=dict)
    )
    quantile_limit: Annotated[
        ByName | None, Quantity("", "5 % of the limits at random points of the box lie below, by axis")
    ] = None
    margin_limit: Annotated[
        ByName | None,
        Quantity(
            "", "greatest gain that keeps the margins at the worst point of the box, by axis", "limit with margins"
        ),
    ] = None
    margin_point: Annotated[Mapping[str, ByName], "where in the box, by axis; shares of the declared, delay in s"] = (
        field(default_factory=dict)
    )
    recommended: Annotated[
        ByName | None, Quantity("", "greatest step of the gain below that, by axis", "recommended gain")
    ] = None
    gain: Annotated[ByName, Quantity("", "at which the margins hold, by axis", "margins at the gain")] = field(
        default_factory=dict
    )
    gain_margin: Annotated[ByName, Quantity("", "factor to the limit", "gain margin")] = field(default_factory=dict)
    phase_margin: Annotated[ByName, Quantity("rad", "least turn", "phase margin", "deg", "", "deg")] = field(
        default_factory=dict
    )
    delay_margin: Annotated[ByName, Quantity("s", "further delay", "delay margin", "ms", "", "ms")] = field(
        default_factory=dict
    )
    disk_margin: Annotated[ByName, Quantity("", "of gain and phase together", "disk margin")] = field(
        default_factory=dict
    )
    readings: Annotated[
        Mapping[str, ByName],
        "limit of each axis as the thesis's text may be read: cycle, and whether corrections add up",
    ] = field(default_factory=dict)
    off_axis_limit: Annotated[
        ByName | None, Quantity("", "by angle in degrees from y towards x", "limit at an angle")
    ] = None
    meeting_limits: Annotated[
        Sequence[Sequence[float]] | None,
        "limits along y, from and to, with which all directions lie where experiments found them",
    ] = None
    meeting_predictions: Annotated[
        Mapping[str, Sequence[float]], "limits, from and to, that they predict where nothing was measured, by angle"
    ] = field(default_factory=dict)
    chatter_depth: Annotated[
        ByName | None, Quantity("m", "at which the cut chatters, by gain", "depth of chatter", "mm", "", "mm")
    ] = None
    tooth_in_cycles: Annotated[str | None, "period of a tooth over the cycle, the rational number that was taken"] = (
        None
    )
    spindle_speed_error: Annotated[float | None, "relative, of the speed that has that period"] = None
    chatter_depth_finer: Annotated[
        ByName | None, Quantity("m", "the same with twice the steps, by gain", "", "", "", "mm")
    ] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FeedbackMapStudy(Study):
    """Gain limits over two joints of an arm, from plants that were measured in some poses."""

    poses: Annotated[int, Quantity("", "in which plants were measured", "measured poses")] = 0
    asked: Annotated[Sequence[Sequence[float]], Quantity("rad", "joints of the table", "", "", "", "deg")] = ()
    median: Annotated[
        Mapping[str, Sequence[float]],
        Quantity("", "of the limit in the poses of the table, by direction", "median limit"),
    ] = field(default_factory=dict)
    quantile: Annotated[
        Mapping[str, Sequence[float]], Quantity("", "5 % of the limits lie below, by direction", "5 % quantile")
    ] = field(default_factory=dict)
    recommended: Annotated[
        Mapping[str, Sequence[float]],
        Quantity(
            "", "greatest step of the gain with which every draw keeps the margins, by direction", "recommended gain"
        ),
    ] = field(default_factory=dict)
    true_limit: Annotated[
        Mapping[str, Sequence[float]] | None, Quantity("", "of synthetic plants, by direction", "true limit")
    ] = None
    least: Annotated[
        ByName, Quantity("", "5 % quantile in the worst pose of the map, by direction", "least limit of the map")
    ] = field(default_factory=dict)
    inside: Annotated[
        ByName | None,
        Quantity("", "share of m, c, k whose 95 % interval holds the truth, of synthetic plants", "in intervals"),
    ] = field(default_factory=dict)
