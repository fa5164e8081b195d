"""Options and results of the studies of delayed feedback."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Protocol, runtime_checkable

import numpy as np

from ..._lazy import hint
from ...results import ArgumentError, Quantity, Study
from ...results.options import Long, Options, Unit, Within
from .plants import MOST_CYCLES

if TYPE_CHECKING:
    from .plants import CorrectedPlant
else:
    CorrectedPlant = hint("gtmodel.control.delayed", "CorrectedPlant")

ACROSS = 1e-6  # least share of a feed direction's length across the tool axis


@dataclass(frozen=True)
class FeedbackTiming(Options):
    """Cycle and delay of the corrections from an external sensor.

    >>> gt.control.delayed.FeedbackTiming().delay
    0.052
    """

    cycle: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "between two corrections"] = 0.004
    delay: Annotated[
        float, Unit("s", written="ms"), Within(least=0.0),
        "from a measurement until its correction acts; need not be a whole number of cycles",
    ] = 0.052  # fmt: skip
    accumulate: Annotated[
        bool, "corrections accumulate: each moves the arm, which stays there; otherwise it only causes vibration"
    ] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.delay > MOST_CYCLES * self.cycle:
            raise ArgumentError(f"must be at most {MOST_CYCLES} cycles; found {self.delay / self.cycle:.4g}", "delay")


@dataclass(frozen=True)
class FeedbackAxis(Options):
    """One direction of a vibrating arm: natural frequency, damping ratio, and equivalent mass or measured gain limit.

    >>> axis = gt.control.delayed.FeedbackAxis(frequency=17.0, damping_ratio=0.06, limit=0.25)
    >>> timing = gt.control.delayed.FeedbackTiming()
    >>> loop = gt.control.delayed.DelayedLoop(axis.plant(timing), timing.cycle, timing.delay)
    >>> round(gt.control.delayed.gain_limit(loop).gain, 6)
    0.25
    """

    frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "undamped natural frequency"]
    damping_ratio: Annotated[float, Within(above=0.0, below=1.0), "of critical damping"]
    mass: Annotated[float | None, Within(above=0.0), "equivalent mass m of eq. (30), a number without a unit"] = None
    limit: Annotated[float | None, Within(above=0.0), "measured gain at which the loop becomes unstable"] = None
    gain: Annotated[
        float | None,
        Within(above=0.0),
        "at which margins are computed; by default the recommended gain, or half the limit without a box",
    ] = None
    gain_step: Annotated[float, Within(above=0.0), "step of the adjustable gain"] = 0.01

    def equivalent_mass(self, timing: FeedbackTiming) -> float:
        """Return m. Raises ArgumentError unless exactly one of mass and limit is set, and for a limit with
        accumulating corrections."""
        if (self.mass is None) == (self.limit is None):
            count = "both" if self.mass is not None else "neither"
            raise ArgumentError(f"expected either mass or limit; found {count}", "mass")
        if self.mass is not None:
            return self.mass
        assert self.limit is not None
        if timing.accumulate:
            raise ArgumentError("does not determine the mass if corrections accumulate; set mass instead", "limit")
        from .off_axis import plant_of_limit

        plant = plant_of_limit(self.frequency, self.damping_ratio, self.limit, timing.cycle, timing.delay)
        return float(1 / (plant.B[1] * timing.cycle**2))

    def plant(self, timing: FeedbackTiming, *, mass: float | None = None) -> CorrectedPlant:
        """Return the plant, with `mass` instead of the equivalent mass if it is set."""
        from .plants import equivalent_plant

        m, w = self.equivalent_mass(timing) if mass is None else mass, 2 * np.pi * self.frequency
        return equivalent_plant(m, 2 * self.damping_ratio * w * m, w**2 * m, timing.cycle, accumulate=timing.accumulate)


@dataclass(frozen=True)
class SinePath(Options):
    """The path y = amplitude sin(2 pi wave_number x) at constant feed; by default that of Cvitanic 2021, eq. (33).

    >>> gt.control.delayed.SinePath().steering(0.004).max().round(8)  # largest steering in a cycle [m]
    np.float64(5.52e-06)
    """

    amplitude: Annotated[float, Unit("m", written="mm"), Within(least=0.0), "of the sine"] = 50.8e-3
    wave_number: Annotated[float, Unit("1/m", key="wave_number_1_m"), Within(above=0.0), "waves per metre"] = 9.8
    feed: Annotated[float, Unit("m/s", written="mm/s"), Within(above=0.0), "along the path"] = 42.33e-3
    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the run"] = 15.0

    def steering(self, cycle: float) -> np.ndarray:
        """Return the change of the commanded step from cycle to cycle, (n,) [m] along y.

        It is the command minus the feed (Cvitanic 2021, eq. (31), (32)), at constant speed the change of direction.
        """
        count = round(self.duration / cycle)
        w = 2 * np.pi * self.wave_number
        x, step, slope = [0.0], self.feed * cycle, self.amplitude * w
        for _ in range(count + 1):  # equal steps along the path
            middle = x[-1] + step / 2 / math.hypot(1, slope * math.cos(w * x[-1]))
            x.append(x[-1] + step / math.hypot(1, slope * math.cos(w * middle)))
        return np.diff(self.amplitude * np.sin(w * np.array(x)), 2)


@dataclass(frozen=True)
class FeedbackBox(Options):
    """Uncertainty of plant and delay: deviations from the declared values in both directions.

    >>> gt.control.delayed.FeedbackBox(delay=0.001).mass
    0.15
    """

    mass: Annotated[float, Within(least=0.0, below=1.0), "of the equivalent mass, as a share"] = 0.15
    damping: Annotated[float, Within(least=0.0, below=1.0), "of the equivalent damping, as a share"] = 0.15
    stiffness: Annotated[float, Within(least=0.0, below=1.0), "of the equivalent stiffness, as a share"] = 0.15
    delay: Annotated[float, Unit("s", written="ms"), Within(least=0.0), "of the delay"] = 0.002
    draws: Annotated[int, Within(least=20, most=100_000), "random points of the box"] = 1000
    seed: Annotated[int, Within(least=0), "of the random points"] = 0


@dataclass(frozen=True)
class GainMargins(Options):
    """Margins that the recommended gain keeps at every tested point of the box.

    >>> round(gt.control.delayed.GainMargins().phase, 4)
    0.5236
    """

    gain: Annotated[float, Within(least=1.0), "least gain margin: the factor to the limit"] = 2.0
    phase: Annotated[float, Unit("rad", written="deg"), Within(least=0.0, below=np.pi / 2), "least phase margin"] = (
        np.pi / 6
    )


@dataclass(frozen=True)
class OffAxisRun(Options):
    """A direction between the axes x and y, with the stable and unstable gains of an experiment, if there is one.

    >>> gt.control.delayed.OffAxisRun(angle=np.pi / 4, stable=0.03, unstable=0.05).stable
    0.03
    """

    angle: Annotated[float, Unit("rad", written="deg"), "from y towards x"]
    stable: Annotated[float | None, Within(above=0.0), "greatest gain observed stable; needs `unstable` too"] = None
    unstable: Annotated[float | None, Within(above=0.0), "least gain observed unstable; needs `stable` too"] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.stable is None) != (self.unstable is None):
            raise ArgumentError("set both stable and unstable, or neither", "stable")
        if self.stable is not None and self.unstable is not None and self.stable >= self.unstable:
            raise ArgumentError(f"must be below unstable, {self.unstable:g}; found {self.stable:g}", "stable")


@dataclass(frozen=True)
class FeedbackCut(Options):
    """A tool that cuts while the loop corrects it along one axis; x, y and z are world axes.

    >>> gt.control.delayed.FeedbackCut("y", 25.0, [350.0, 350.0, 250.0], 17.0, 0.03).steps
    20
    """

    axis: Annotated[str, "name of the corrected axis"]
    speed: Annotated[float, Unit("1/s"), Within(above=0.0), "of the spindle"]
    mass: Annotated[list[float], Unit("kg"), Long(3), Within(above=0.0), "of the tool along x, y, z"]
    z_frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "of the tool along z"]
    z_damping_ratio: Annotated[float, Within(above=0.0, below=1.0), "of the tool along z"]
    feed_direction: Annotated[tuple[float, float, float], "in the plane of the cut"] = (1.0, 0.0, 0.0)
    shares: Annotated[list[float], Within(least=0.0), "gains, as shares of the limit without cutting"] = (  # type: ignore[assignment]
        0.0, 0.25, 0.5, 0.75, 0.9,
    )  # fmt: skip
    deepest: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "greatest depth to search for chatter"] = 5e-3
    steps: Annotated[int, Within(least=4, most=200), "time steps per cycle in the semi-discretised map"] = 20

    def __post_init__(self) -> None:
        super().__post_init__()
        feed = np.asarray(self.feed_direction, float)
        if feed.shape != (3,) or not np.hypot(feed[0], feed[1]) > ACROSS * np.linalg.norm(feed):
            raise ArgumentError(
                f"expected three numbers with x or y not 0, across the tool axis z; found {feed.tolist()}",
                "feed_direction",
            )
        if not len(self.shares):
            raise ArgumentError("is empty; expected one or more gains, as shares of the limit", "shares")


@runtime_checkable
class CutWhileCorrecting(Protocol):
    """A cut during the correction, such as `gt.milling.CorrectedCut`: its tool for given plants and timing, and the
    depths without chatter for gains up to the limit."""

    of: FeedbackCut

    def tool(self, plants: Mapping[str, Any], timing: FeedbackTiming) -> Any: ...

    def depths(self, tool: Any, limit: float) -> dict[str, Any]: ...


@dataclass(frozen=True)
class SyntheticCommands(Options):
    """Synthetic vibrations after one command in each pose, for an arm whose oscillators vary smoothly with its reach.

    The reach is r = cos(joint 2) + cos(joint 2 + joint 3), with the robot's joint angles; by default frequencies fall
    and equivalent masses grow with it. The numbers are our own: the thesis prints no m, c, k.

    >>> gt.control.delayed.SyntheticCommands(seed=3).size
    0.001
    """

    size: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of the command"] = 1e-3
    duration: Annotated[float, Unit("s"), Within(least=0.1), "recorded after the command"] = 0.6
    noise: Annotated[float, Unit("m", written="um"), Within(above=0.0), "of the measurement, standard deviation"] = (
        15e-6
    )
    repeatability: Annotated[
        float, Within(least=0.0, below=1.0), "of m, c and k between experiments in one pose, as a share"
    ] = 0.05
    frequency: Annotated[tuple[float, ...], Unit("Hz"), Within(above=0.0), "of each direction at a reach of 0"] = (
        17.0,
        12.0,
    )
    damping_ratio: Annotated[tuple[float, ...], Within(above=0.0, below=1.0), "of each direction"] = (0.06, 0.06)
    mass: Annotated[tuple[float, ...], Within(above=0.0), "equivalent, of each direction at a reach of 0"] = (3.0, 1.0)
    frequency_slope: Annotated[float, Within(least=-0.5, most=0.5), "change of log frequency with the reach"] = -0.15
    mass_slope: Annotated[float, Within(least=-1.0, most=1.0), "change of log mass with the reach"] = 0.2
    seed: Annotated[int, Within(least=0), "of noise and variation between experiments"] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.frequency) == len(self.damping_ratio) == len(self.mass):
            raise ArgumentError("must have as many numbers as damping_ratio and mass, one per direction", "frequency")


@dataclass(frozen=True)
class GainMap(Options):
    """Grid of the map over the angles of joints 2 and 3, draws and quantile.

    >>> gt.control.delayed.GainMap(points=7).points
    7
    """

    points: Annotated[int, Within(least=3, most=60), "of the map along each joint"] = 13
    draws: Annotated[int, Within(least=50, most=5000), "of m, c and k in each pose"] = 400
    quantile: Annotated[float, Within(above=0.0, below=0.5), "of the limits, as shown in map and table"] = 0.05


ByName = Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DelayedFeedbackStudy(Study):
    """Gain limits, margins and recommended gains of delayed corrections, by axis.

    runs: the simulated deviations [m] just below and above each limit, by axis.
    """

    runs: Mapping[str, Sequence[object]] = field(default_factory=dict)
    limit: Annotated[ByName, Quantity("", "gain at which the loop becomes unstable, by axis", "gain limit")] = field(
        default_factory=dict
    )
    frequency: Annotated[ByName, Quantity("Hz", "of the oscillation there, by axis", "frequency at the limit")] = field(
        default_factory=dict
    )
    returns: Annotated[
        Mapping[str, Sequence[Sequence[float]]],
        "ranges of greater gains, from and to, at which the loop is stable again, by axis",
    ] = field(default_factory=dict)
    simulated_limit: Annotated[
        ByName | None,
        Quantity("", "gain at which synthetic runs along the path begin to grow, by axis", "limit of runs in time"),
    ] = None
    worst_limit: Annotated[
        ByName | None, Quantity("", "least limit over the box, by axis", "worst limit in the box")
    ] = None
    worst_point: Annotated[
        Mapping[str, ByName], "point of the box, by axis; ratios to the declared values, delay in s"
    ] = field(default_factory=dict)
    quantile_limit: Annotated[
        ByName | None, Quantity("", "5 % quantile of the limits at random points of the box, by axis")
    ] = None
    margin_limit: Annotated[
        ByName | None,
        Quantity(
            "", "greatest gain that keeps the margins at the worst point of the box, by axis", "limit with margins"
        ),
    ] = None
    margin_point: Annotated[
        Mapping[str, ByName], "point of the box, by axis; ratios to the declared values, delay in s"
    ] = field(default_factory=dict)
    recommended: Annotated[
        ByName | None, Quantity("", "greatest multiple of the gain step below that, by axis", "recommended gain")
    ] = None
    gain: Annotated[ByName, Quantity("", "at which margins are computed, by axis", "margins at the gain")] = field(
        default_factory=dict
    )
    gain_margin: Annotated[ByName, Quantity("", "factor to the limit", "gain margin")] = field(default_factory=dict)
    phase_margin: Annotated[ByName, Quantity("rad", "to the limit", "phase margin", "deg", "", "deg")] = field(
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
        "limit of each axis for the possible readings of the thesis: cycle, and whether corrections accumulate",
    ] = field(default_factory=dict)
    off_axis_limit: Annotated[
        ByName | None, Quantity("", "by angle in degrees from y towards x", "limit at an angle")
    ] = None
    meeting_limits: Annotated[
        Sequence[Sequence[float]] | None,
        "ranges of limits along y, from and to, for which all directions agree with the experiments",
    ] = None
    meeting_predictions: Annotated[
        Mapping[str, Sequence[float]], "predicted limits, from and to, in directions without an experiment, by angle"
    ] = field(default_factory=dict)
    chatter_depth: Annotated[
        ByName | None, Quantity("m", "from which the cut chatters, by gain", "depth of chatter", "mm", "", "mm")
    ] = None
    tooth_in_cycles: Annotated[str | None, "rational approximation of tooth period over cycle"] = None
    spindle_speed_error: Annotated[float | None, "relative error of the spindle speed by this approximation"] = None
    chatter_depth_finer: Annotated[
        ByName | None, Quantity("m", "depth of chatter with twice the steps, by gain", "", "", "", "mm")
    ] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FeedbackMapStudy(Study):
    """Gain limits over two joints of an arm, from plants measured in some poses."""

    poses: Annotated[int, Quantity("", "with measured plants", "measured poses")] = 0
    asked: Annotated[Sequence[Sequence[float]], Quantity("rad", "joints of the table", "", "", "", "deg")] = ()
    median: Annotated[
        Mapping[str, Sequence[float]],
        Quantity("", "of the limit in the poses of the table, by direction", "median limit"),
    ] = field(default_factory=dict)
    quantile: Annotated[
        Mapping[str, Sequence[float]], Quantity("", "of the limit in these poses, by direction", "5 % quantile")
    ] = field(default_factory=dict)
    recommended: Annotated[
        Mapping[str, Sequence[float]],
        Quantity(
            "", "greatest multiple of the step that keeps the margins in every draw, by direction", "recommended gain"
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
        Quantity("", "share of 95 % intervals of synthetic m, c, k that contain the truth", "in intervals"),
    ] = field(default_factory=dict)
