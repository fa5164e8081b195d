"""What the fusion study is asked for, sensors, filter and what is swept, which options go together, printed values
of Cvitanic 2021, chapter 4, and what the study returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np

from ...results import ArgumentError, Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ...results.study import to_inherit
from ..paths import TrackedPath

FilterKind = Literal["extended", "iterated", "unscented", "particle"]
Sweepable = Literal[
    "acceleration_noise", "acceleration_bias", "rate_noise", "rate_bias", "misalignment", "arm_error", "sample_time"
]


@dataclass(frozen=True)
class FusionSensors(Options):
    """Tracker and inertial unit: Table 7 of Cvitanic 2021, a Leica AT960 with T-Mac and a Gladiator Landmark 60.

    Noise of the unit is a density, as data sheets print it: times the root of the rate it is the deviation of one
    reading.
    The biases are there and the filter does not know them.

    >>> gt.filtering.FusionSensors().acceleration_noise  # m/s2 per root of Hz
    0.00039
    """

    position_noise: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of the tracker, per axis"] = 6.4e-6
    orientation_noise: Annotated[float, Unit("rad", written="deg"), Within(above=0.0), "of the tracker, per axis"] = (
        np.radians(0.015)
    )
    acceleration_noise: Annotated[
        float, Unit("m/s2", key="acceleration_noise_m_s2_rtHz"), Within(above=0.0), "density of the accelerometer"
    ] = 0.00039
    acceleration_bias: Annotated[float, Unit("m/s2"), "of each axis of the accelerometer"] = 0.00025
    rate_noise: Annotated[
        float, Unit("rad/s", written="deg/s", key="rate_noise_deg_s_rtHz"), Within(above=0.0), "density of the gyro"
    ] = np.radians(0.0016)
    rate_bias: Annotated[float, Unit("rad/s", written="deg/s"), "of each axis of the gyro"] = np.radians(0.0008)
    sample_time: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "of all sensors"] = 0.001
    arm: Annotated[
        tuple[float, ...], Unit("m", written="mm"), Long(3), "from the target to the unit, in the axes of the body"
    ] = (0.18, 0.1, -0.12)
    arm_error: Annotated[float, Unit("m", written="mm"), "of the arm along z, unknown to the filter"] = 0.0
    misalignment: Annotated[float, Unit("rad", written="deg"), "of the unit about z, unknown to the filter"] = 0.0
    gravity: Annotated[bool, "the accelerometer feels gravity; the thesis leaves it out"] = False
    outlier_share: Annotated[
        float, Within(least=0.0, most=0.5), "of the tracker's positions, off by twenty times its noise"
    ] = 0.0

    def with_value(self, name: str, value: float) -> FusionSensors:
        """The same with one other number."""
        return replace(self, **{name: value})


@dataclass(frozen=True)
class FusionFilter(Options):
    """Which filter, and what it takes for its noise.

    `printed` takes the covariance of Appendix B per step, with (21) and (24) as they are printed; in three axes only.
    Otherwise jerk and angular jerk are white. With `fast_jerk_density` and `fast_angular_jerk_density` two filters of
    different densities interact.

    >>> gt.filtering.FusionFilter(printed=True).jerk_density
    (0.1, 1e-06, 0.1)
    """

    kind: Annotated[FilterKind, "extended, iterated, unscented or particle"] = "extended"
    particles: Annotated[int, Within(least=2), "of the particle filter, which keeps a Gaussian of the position"] = 1000
    printed: Annotated[bool, "covariance of Appendix B, equations (21) and (24) as printed"] = False
    exact_step: Annotated[bool, "with `printed`: the factor 1/2 that (21) lacks is put in"] = False
    jerk_density: Annotated[
        tuple[float, ...], Unit("m2/s5"), Long(3), Within(least=0.0), "of white jerk along x, y, z"
    ] = (0.1, 1e-6, 0.1)
    angular_jerk_density: Annotated[float, Unit("rad2/s5"), Within(least=0.0), "of white angular jerk"] = 1e2
    fast_jerk_density: Annotated[
        float | None, Unit("m2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    fast_angular_jerk_density: Annotated[
        float | None, Unit("rad2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    stay: Annotated[float, Within(above=0.0, below=1.0), "chance that a filter stays the right one for a step"] = 0.999
    outliers: Annotated[
        Literal["huber"] | None,
        "the tracker's readings count less the further off, by Huber's weights; none if left out",
    ] = None
    smooth: Annotated[bool, "fixed-interval smoothing besides"] = False
    tracker_jerk_density: Annotated[
        float, Unit("m2/s5"), Within(above=0.0), "of the filter on the tracker alone, the second baseline"
    ] = 10.0


@dataclass(frozen=True)
class FusionSweep(Options):
    """One number of the sensors over several values, all others as they are; where fusion stops being of use.

    >>> gt.filtering.FusionSweep("sample_time", (0.001, 0.002, 0.01)).parameter
    'sample_time'
    """

    parameter: Annotated[Sweepable, "a key of the sensors"]
    values: Annotated[tuple[float, ...], "in SI units: m, rad, s, m/s2, rad/s, and these per root of Hz"]


SETTLED = 0.02  # s; what the filters forget of their start, left out of all errors and of the innovations
MOST_SAMPLES = 2_000_000  # along the path: a minute's work is 300,000 in three axes, a gigabyte as many as these
SAME = 1e-12  # relative: a default that was written in other units
TURNING = ("orientation_noise", "rate_noise", "rate_bias", "arm", "arm_error")  # of what only a body that turns shows


def agree_together(path: TrackedPath, sensors: FusionSensors, design: FusionFilter) -> None:
    """Raises ArgumentError for options that contradict each other, and for those that change nothing."""
    if design.printed and path.axes == 5:
        raise ArgumentError("the printed covariance is that of 3 axes; leave it out in 5", "filter.printed")
    fast = [design.fast_jerk_density is not None, design.fast_angular_jerk_density is not None]
    if any(fast) and design.printed:
        raise ArgumentError("with the printed covariance there is no second filter", "filter.fast_jerk_density")
    if fast[1] and not fast[0]:
        raise ArgumentError("give fast_jerk_density too; the second filter has both", "filter.fast_jerk_density")
    if any(fast) and design.kind != "extended":
        raise ArgumentError(f"two interacting filters are extended ones; found {design.kind!r}", "filter.kind")
    if design.smooth and design.kind == "particle":
        raise ArgumentError("particles cannot be smoothed; leave it out, or take another kind", "filter.smooth")
    if path.duration < 3 * SETTLED:
        raise ArgumentError(f"expected at least {3 * SETTLED:g} s; found {path.duration:g}", "path.duration")
    if path.duration < 10 * sensors.sample_time:
        raise ArgumentError("expected at least 10 samples along the path", "sensors.sample_time")
    if path.duration > MOST_SAMPLES * sensors.sample_time:
        samples = path.duration / sensors.sample_time
        raise ArgumentError(f"expected at most {MOST_SAMPLES:,} samples; found {samples:.3g}", "path.duration")
    still = "in 3 axes the body does not turn and is not asked for its orientation; leave it out, or take 5 axes"
    _without(sensors, "sensors", dict.fromkeys(TURNING, still) if path.axes == 3 else {})
    shape = {"sine": ("radius", "turn"), "line": ("amplitude", "cycles", "radius")}
    unused = dict.fromkeys(shape.get(path.kind, ("amplitude", "cycles")), f"a {path.kind} has none; leave it out")
    _without(path, "path", unused | ({"turn": still} if path.axes == 3 else {}))
    alone = {} if design.printed else {"exact_step": "belongs to printed = true; leave it out"}
    if design.kind != "particle":
        alone["particles"] = "belongs to kind = 'particle'; leave it out"
    if not fast[0]:
        alone["stay"] = "is of two interacting filters; leave it out, or give fast_jerk_density"
    if path.axes == 3:
        alone |= dict.fromkeys(("angular_jerk_density", "fast_angular_jerk_density"), still)
    if design.printed:
        alone["jerk_density"] = "with the printed covariance there is none; leave it out"
    _without(design, "filter", alone)


def agree_on_sweep(path: TrackedPath, sensors: FusionSensors, design: FusionFilter, sweep: FusionSweep) -> None:
    """Raises ArgumentError for a sweep of what is not there, of no values, and of one that does not fit."""
    if not sweep.values:
        raise ArgumentError("expected at least one value; found none", "sweep.values")
    if path.axes == 3 and sweep.parameter in TURNING:
        raise ArgumentError(
            f"'{sweep.parameter}' is of a body that turns, which it does not in 3 axes; take 5", "sweep.parameter"
        )
    for value in sweep.values:
        try:
            agree_together(path, sensors.with_value(sweep.parameter, value), design)
        except ArgumentError as fault:
            sentence = f"{value:g} of '{sweep.parameter}' does not fit: {fault.message}"
            raise ArgumentError(sentence, "sweep.values") from None


def _without(given: Any, section: str, unused: dict[str, str]) -> None:
    """Raises ArgumentError for one of these options that is other than its default."""
    plain = type(given)()
    for name, why in unused.items():
        one, other = getattr(given, name), getattr(plain, name)
        if (one is None) != (other is None) or (one is not None and not np.allclose(one, other, rtol=SAME, atol=0.0)):
            raise ArgumentError(why, f"{section}.{name}")


# Table 8, means (deviations): tracker or unit alone, then fusion; 3 axes, 5 axes; None where it is not applicable
TABLE_8 = {
    "position": ((8.9e-6, 8.9e-6), (8.9e-6, 8.9e-6), "m"),
    "orientation": ((None, 0.012), (None, 0.11), "deg"),
    "acceleration": ((0.00018, 0.00061), (0.00012, 0.00040), "m/s2"),
    "angular_velocity": ((None, 0.070), (None, 0.062), "deg/s"),
}
# Table 9: key of the sensors, printed value, fusion's mean errors in 3 and 5 axes, of which quantity. The gyro's is
# printed as 0.16 deg/s/rtHz, ten times what Table 7 offers and what its error belongs to
TABLE_9 = {
    "position_noise": (0.64e-3, (0.41e-3, 0.41e-3), "position"),
    "acceleration_noise": (0.0039, (0.00048, 0.00049), "acceleration"),
    "rate_noise": (0.016, (None, 0.35), "angular_velocity"),
}
# Table 10: limits in 3 and 5 axes below which fusion is better than the tracker alone, in the unit of our keys
TABLE_10 = {
    "acceleration_noise": ((0.1, 0.1), "m/s2"),
    "acceleration_bias": ((0.001, 0.001), "m/s2"),
    "rate_noise": ((None, 0.1), "deg/s"),
    "rate_bias": ((None, 1.0), "deg/s"),
    "misalignment": ((10.0, 0.1), "deg"),
    "arm_error": ((None, 0.1), "m"),
    "sample_time": ((0.01, 0.01), "s"),
}
TABLE_11 = "no data exist"  # of the measurements on the robot; the ratios of its rows, 36 and 35 %, check


def printed_errors(
    path: TrackedPath, sensors: FusionSensors
) -> tuple[str, dict[str, tuple[float | None, float | None]]]:
    """Printed mean errors of one sensor and of fusion by quantity, SI, and their table; none for numbers other than
    those of Tables 7 and 9."""
    if path != replace(TrackedPath(), axes=path.axes):
        return "", {}
    k, plain = (0 if path.axes == 3 else 1), FusionSensors()
    if sensors == plain:
        rows = {name: (alone[k], fused[k], unit) for name, (alone, fused, unit) in TABLE_8.items()}
        return "Table 8", {
            name: (_si(alone, unit), _si(fused, unit))
            for name, (alone, fused, unit) in rows.items()
            if fused is not None
        }
    for key, (value, fused, name) in TABLE_9.items():
        given = _si(value, "deg/s" if key == "rate_noise" else "m")
        if given is not None and fused[k] is not None and sensors == replace(plain, **{key: given}):
            return "Table 9", {name: (None, _si(fused[k], "deg/s" if key == "rate_noise" else "m"))}
    return "", {}


def _si(value: float | None, unit: str) -> float | None:
    return None if value is None else value * (np.pi / 180 if unit.startswith("deg") else 1.0)


METRIC = "mean over the axes of |error|"


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FusionStudy(Study):
    """Tracker and inertial unit on one body, filtered: errors, and whether the filter may be believed.

    Errors of velocity are means of |error| over x and z, first where the path is nearly straight, then at its bends
    (normal acceleration above a fifth of its largest). `mean_errors` are by quantity: mean over the axes of |error|,
    mean of the length of the error, mean of |sum of its components|, which fits the position row of Table 8.
    """

    axes: Annotated[int | None, "3 or 5"] = None
    velocity_slope: Annotated[
        Sequence[float], Quantity("m/s", "slope of four positions: off the bends, at them", written="mm/s")
    ] = ()
    velocity_tracker: Annotated[
        Sequence[float], Quantity("m/s", "Kalman filter on the tracker alone: off, at", written="mm/s")
    ] = ()
    velocity_fused: Annotated[Sequence[float], Quantity("m/s", "off, at", written="mm/s")] = ()
    velocity_smoothed: Annotated[Sequence[float], Quantity("m/s", "off, at; empty if not asked", written="mm/s")] = ()
    below_slope: Annotated[
        Sequence[float], "how far the fused velocity error lies below the slope's: off, at, all"
    ] = ()
    below_tracker: Annotated[Sequence[float], "below that of the filter on the tracker alone: off, at, all"] = ()
    alone: Annotated[Mapping[str, Sequence[float]], "errors of one sensor by quantity, SI: three metrics"] = field(
        default_factory=dict
    )
    fused: Annotated[Mapping[str, Sequence[float]], "errors of fusion by quantity, SI: three metrics"] = field(
        default_factory=dict
    )
    printed: Annotated[
        Mapping[str, Sequence[float | None]],
        "where the thesis has the same numbers: printed mean errors of one sensor and of fusion, SI, metric not stated",
    ] = field(default_factory=dict)
    printed_in: Annotated[str, "the table they stand in"] = ""
    nis: Annotated[float | None, "mean normalised innovation squared of an instant"] = None
    nis_band: Annotated[Sequence[float], "99.9 % band of it, exact for a right filter"] = ()
    nis_numbers: Annotated[
        float | None, "what nis is where the filter is right: the numbers read at an instant, less what weights cut"
    ] = None
    counted_less: Annotated[
        Mapping[str, float], "share of the readings of each sensor that counted less as outliers; of right ones 0.18"
    ] = field(default_factory=dict)
    verdict: Annotated[str, "what the innovations say of the filter"] = ""
    preferred_jerk_density: Annotated[
        float | None, Quantity("m2/s5", "among decades, by the likelihood; where nis lies outside its band")
    ] = None
    fast_share: Annotated[Sequence[float], "mean probability of the faster filter: off the bends, at them"] = ()
    sweep_parameter: Annotated[str, "what was swept"] = ""
    sweep_values: Annotated[Sequence[float], "SI"] = ()
    sweep_fused: Annotated[Sequence[float], Quantity("m/s", "velocity error of fusion", written="mm/s")] = ()
    sweep_tracker: Annotated[
        Sequence[float], Quantity("m/s", "of the filter on the tracker alone", written="mm/s")
    ] = ()
    sweep_slope: Annotated[Sequence[float], Quantity("m/s", "of the slope of four positions", written="mm/s")] = ()
    sweep_consistent: Annotated[Sequence[bool], "whether the innovations lie in their band"] = ()
    limit_tracker: Annotated[float | None, "swept value at which fusion is no better than the tracker's filter"] = None
    limit_slope: Annotated[float | None, "swept value at which fusion is no better than the slope"] = None
    limit_printed: Annotated[float | None, "that of Table 10, SI"] = None
    synthetic: Annotated[str | None, "seed and noise of the readings"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if not self.velocity_fused:
            return []
        rows = []
        lines = (
            ("velocity error, slope of four", self.velocity_slope),
            ("  filter on the tracker alone", self.velocity_tracker),
            ("  fused", self.velocity_fused), ("  smoothed", self.velocity_smoothed),
        )  # fmt: skip
        for label, (off, at) in ((label, pair) for label, pair in lines if pair):
            rows.append(Row(label, f"{1e3 * off:.3g} off the bends, {1e3 * at:.3g} at them", "mm/s"))
        below = (("  below the slope", self.below_slope), ("  below the tracker's filter", self.below_tracker))
        for label, share in (pair for pair in below if pair[1]):
            rows.append(Row(label, ", ".join(f"{100 * s:.1f}" for s in share) + " (off, at, all)", "%"))
        rows += [row for name in self.fused for row in self._errors(name)]
        if self.nis_band:
            low, high = self.nis_band
            said = f"{self.nis:.4g} of {self.nis_numbers:.3g}, right within {low:.4g} to {high:.4g}"
            rows += [Row("innovations squared (NIS)", said), Row("  verdict", self.verdict)]
        if self.counted_less:
            said = ", ".join(f"{name} {100 * share:.3g}" for name, share in self.counted_less.items())
            rows.append(Row("  counted less as outliers", f"{said}  (of right readings 18)", "%"))
        if self.fast_share:
            off, at = self.fast_share
            rows.append(Row("faster filter's probability", f"{off:.2g} off the bends, {at:.2g} at them"))
        rows += self._swept()
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])

    def _errors(self, name: str) -> list[Row]:
        unit, factor = _SHOWN[name]
        alone, fused = (
            ", ".join(f"{factor * v:.3g}" for v in values[name]) if name in values else "none"
            for values in (self.alone, self.fused)
        )
        rows = [Row(f"{name.replace('_', ' ')}: alone; fused", f"{alone}; {fused}  (per axis, length, |sum|)", unit)]
        if name in self.printed:
            said = "; ".join("none" if v is None else f"{factor * v:.3g}" for v in self.printed[name])
            rows.append(Row(f"  printed, {self.printed_in}", said, unit))
        return rows

    def _swept(self) -> list[Row]:
        if not self.sweep_parameter:
            return []
        rows = []
        columns = zip(
            self.sweep_values,
            self.sweep_fused,
            self.sweep_tracker,
            self.sweep_slope,
            self.sweep_consistent,
            strict=True,
        )
        for value, fused, tracker, slope, right in columns:
            said = f"fused {1e3 * fused:.3g}, tracker {1e3 * tracker:.3g}, slope {1e3 * slope:.3g}"
            rows.append(
                Row(f"{self.sweep_parameter} {value:.4g}", said + ("" if right else "; not consistent"), "mm/s")
            )
        for label, limit in (("tracker's filter", self.limit_tracker), ("slope", self.limit_slope)):
            where = "not reached" if limit is None else f"{limit:.3g}"
            rows.append(Row(f"  no better than the {label} at", where))
        printed = "no limit" if self.limit_printed is None else f"{self.limit_printed:.3g}"
        return [*rows, Row("  printed, Table 10", printed)]


_SHOWN = {
    "position": ("mm", 1e3), "orientation": ("deg", 57.29577951308232), "acceleration": ("m/s2", 1.0),
    "angular_velocity": ("deg/s", 57.29577951308232), "angular_acceleration": ("rad/s2", 1.0),
}  # fmt: skip
