"""Options of the fusion study (sensors, filter, sweep), their consistency, printed values of Cvitanic 2021, chapter 4,
and its result."""

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

    The noise of the unit is a density, as in data sheets: its product with the square root of the rate is the standard
    deviation of one reading. The readings contain the biases, but the filter does not know them.

    >>> gt.filtering.FusionSensors().acceleration_noise  # m/s2 per root of Hz
    0.00039
    """

    position_noise: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of the tracker, per axis"] = 6.4e-6
    orientation_noise: Annotated[
        float,
        Unit("rad", written="deg"),
        Within(above=0.0),
        "standard deviation of the tracker's orientation, about each axis",
    ] = np.radians(0.015)
    acceleration_noise: Annotated[
        float, Unit("m/s2", key="acceleration_noise_m_s2_rtHz"), Within(above=0.0), "density of the accelerometer"
    ] = 0.00039
    acceleration_bias: Annotated[float, Unit("m/s2"), "bias of each axis of the accelerometer"] = 0.00025
    rate_noise: Annotated[
        float, Unit("rad/s", written="deg/s", key="rate_noise_deg_s_rtHz"), Within(above=0.0), "density of the gyro"
    ] = np.radians(0.0016)
    rate_bias: Annotated[float, Unit("rad/s", written="deg/s"), "bias of each axis of the gyro"] = np.radians(0.0008)
    sample_time: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "sampling period of all sensors"] = 0.001
    arm: Annotated[
        tuple[float, ...],
        Unit("m", written="mm"),
        Long(3),
        "lever arm from the target to the inertial unit, in the axes of the body",
    ] = (0.18, 0.1, -0.12)
    arm_error: Annotated[float, Unit("m", written="mm"), "error of the arm along z, unknown to the filter"] = 0.0
    misalignment: Annotated[
        float, Unit("rad", written="deg"), "misalignment of the inertial unit about z, unknown to the filter"
    ] = 0.0
    gravity: Annotated[bool, "whether the accelerometer measures gravity; the thesis leaves it out"] = False
    outlier_share: Annotated[
        float, Within(least=0.0, most=0.5), "share of the tracker's positions that are off by twenty times its noise"
    ] = 0.0

    def with_value(self, name: str, value: float) -> FusionSensors:
        """Return the same sensors with one number changed."""
        return replace(self, **{name: value})


@dataclass(frozen=True)
class FusionFilter(Options):
    """Kind of filter, and its process noise.

    `printed` uses the covariance of Appendix B per step, with (21) and (24) as printed; in three axes only. Otherwise
    jerk and angular jerk are white. With `fast_jerk_density` and `fast_angular_jerk_density` two filters with different
    densities interact.

    >>> gt.filtering.FusionFilter(printed=True).jerk_density
    (0.1, 1e-06, 0.1)
    """

    kind: Annotated[FilterKind, "extended, iterated, unscented or particle"] = "extended"
    particles: Annotated[int, Within(least=2), "particles of the particle filter, which marginalises the position"] = (
        1000
    )
    printed: Annotated[bool, "use the covariance of Appendix B, equations (21) and (24) as printed"] = False
    exact_step: Annotated[bool, "with `printed`: insert the factor 1/2 that (21) lacks"] = False
    jerk_density: Annotated[
        tuple[float, ...], Unit("m2/s5"), Long(3), Within(least=0.0), "density of white jerk along x, y, z"
    ] = (0.1, 1e-6, 0.1)
    angular_jerk_density: Annotated[float, Unit("rad2/s5"), Within(least=0.0), "of white angular jerk"] = 1e2
    fast_jerk_density: Annotated[
        float | None, Unit("m2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    fast_angular_jerk_density: Annotated[
        float | None, Unit("rad2/s5"), Within(above=0.0), "of a second, faster filter; none if left out"
    ] = None
    stay: Annotated[float, Within(above=0.0, below=1.0), "probability that the true filter stays so for a step"] = 0.999
    outliers: Annotated[
        Literal["huber"] | None,
        "tracker readings far from the prediction count less, with Huber's weights; none if left out",
    ] = None
    smooth: Annotated[bool, "whether to smooth over the whole log too (fixed interval)"] = False
    tracker_jerk_density: Annotated[
        float,
        Unit("m2/s5"),
        Within(above=0.0),
        "jerk noise density of the filter that uses the tracker alone, the second baseline",
    ] = 10.0


@dataclass(frozen=True)
class FusionSweep(Options):
    """Sweep of one sensor parameter over several values, to find where fusion no longer improves the result.

    >>> gt.filtering.FusionSweep("sample_time", (0.001, 0.002, 0.01)).parameter
    'sample_time'
    """

    parameter: Annotated[Sweepable, "a key of the sensors"]
    values: Annotated[tuple[float, ...], "in SI units: m, rad, s, m/s2, rad/s, and these per root of Hz"]


SETTLED = 0.02  # s; initial transient of the filters, left out of all errors and of the innovations
MOST_SAMPLES = 2_000_000  # along the path: 300,000 take a minute in three axes, two million take a gigabyte
SAME = 1e-12  # relative: a default written in other units
TURNING = ("orientation_noise", "rate_noise", "rate_bias", "arm", "arm_error")  # options of a rotating body


def agree_together(path: TrackedPath, sensors: FusionSensors, design: FusionFilter) -> None:
    """Raise ArgumentError for options that contradict each other, and for options without effect."""
    if design.printed and path.axes == 5:
        raise ArgumentError("the printed covariance is for 3 axes; leave it out in 5", "filter.printed")
    fast = [design.fast_jerk_density is not None, design.fast_angular_jerk_density is not None]
    if any(fast) and design.printed:
        raise ArgumentError("the printed covariance allows no second filter", "filter.fast_jerk_density")
    if fast[1] and not fast[0]:
        raise ArgumentError("give fast_jerk_density too; the second filter needs both", "filter.fast_jerk_density")
    if any(fast) and design.kind != "extended":
        raise ArgumentError(f"expected 'extended' for interacting filters; found {design.kind!r}", "filter.kind")
    if design.smooth and design.kind == "particle":
        raise ArgumentError("particles cannot be smoothed; leave smooth out, or use another kind", "filter.smooth")
    if path.duration < 3 * SETTLED:
        raise ArgumentError(f"expected at least {3 * SETTLED:g} s; found {path.duration:g}", "path.duration")
    if path.duration < 10 * sensors.sample_time:
        raise ArgumentError("expected at least 10 samples along the path", "sensors.sample_time")
    if path.duration > MOST_SAMPLES * sensors.sample_time:
        samples = path.duration / sensors.sample_time
        raise ArgumentError(f"expected at most {MOST_SAMPLES:,} samples; found {samples:.3g}", "path.duration")
    still = "in 3 axes the body does not turn and its orientation is not measured; leave it out, or use 5 axes"
    _without(sensors, "sensors", dict.fromkeys(TURNING, still) if path.axes == 3 else {})
    shape = {"sine": ("radius", "turn"), "line": ("amplitude", "cycles", "radius")}
    unused = dict.fromkeys(shape.get(path.kind, ("amplitude", "cycles")), f"a {path.kind} has none; leave it out")
    _without(path, "path", unused | ({"turn": still} if path.axes == 3 else {}))
    unused = {} if design.printed else {"exact_step": "has an effect only with printed = true; leave it out"}
    if design.kind != "particle":
        unused["particles"] = "has an effect only with kind = 'particle'; leave it out"
    if not fast[0]:
        unused["stay"] = "has an effect only for two interacting filters; leave it out, or give fast_jerk_density"
    if path.axes == 3:
        unused |= dict.fromkeys(("angular_jerk_density", "fast_angular_jerk_density"), still)
    if design.printed:
        unused["jerk_density"] = "has no effect with the printed covariance; leave it out"
    _without(design, "filter", unused)


def agree_on_sweep(path: TrackedPath, sensors: FusionSensors, design: FusionFilter, sweep: FusionSweep) -> None:
    """Raise ArgumentError for a sweep without values, of an unused parameter, or with a value that does not fit."""
    if not sweep.values:
        raise ArgumentError("expected at least one value; found none", "sweep.values")
    if path.axes == 3 and sweep.parameter in TURNING:
        raise ArgumentError(
            f"'{sweep.parameter}' has no effect in 3 axes, where the body does not turn; use 5", "sweep.parameter"
        )
    for value in sweep.values:
        try:
            agree_together(path, sensors.with_value(sweep.parameter, value), design)
        except ArgumentError as fault:
            sentence = f"'{sweep.parameter}' cannot be {value:g}: {fault.message}"
            raise ArgumentError(sentence, "sweep.values") from None


def _without(options: Any, section: str, unused: dict[str, str]) -> None:
    """Raise ArgumentError if one of these options differs from its default."""
    plain = type(options)()
    for name, why in unused.items():
        a, b = getattr(options, name), getattr(plain, name)
        if (a is None) != (b is None) or (a is not None and not np.allclose(a, b, rtol=SAME, atol=0.0)):
            raise ArgumentError(why, f"{section}.{name}")


# Table 8, means (deviations): tracker or unit alone, then fusion; 3 axes, 5 axes; None: not applicable
TABLE_8 = {
    "position": ((8.9e-6, 8.9e-6), (8.9e-6, 8.9e-6), "m"),
    "orientation": ((None, 0.012), (None, 0.11), "deg"),
    "acceleration": ((0.00018, 0.00061), (0.00012, 0.00040), "m/s2"),
    "angular_velocity": ((None, 0.070), (None, 0.062), "deg/s"),
}
# Table 9: key of the sensors, printed value, mean errors of fusion in 3 and 5 axes, quantity. The gyro noise is printed
# as 0.16 deg/s/rtHz, but its error belongs to 0.016, ten times the value of Table 7
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
TABLE_11 = "no data exist"  # of the measurements on the robot; the ratios of its rows, 36 and 35 %, are correct


def printed_errors(
    path: TrackedPath, sensors: FusionSensors
) -> tuple[str, dict[str, tuple[float | None, float | None]]]:
    """Printed mean errors of one sensor and of fusion by quantity, SI, and their table; empty for numbers other than
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
        si_value = _si(value, "deg/s" if key == "rate_noise" else "m")
        # pyrefly: ignore[bad-argument-type]
        if si_value is not None and fused[k] is not None and sensors == replace(plain, **{key: si_value}):
            return "Table 9", {name: (None, _si(fused[k], "deg/s" if key == "rate_noise" else "m"))}
    return "", {}


def _si(value: float | None, unit: str) -> float | None:
    return None if value is None else value * (np.pi / 180 if unit.startswith("deg") else 1.0)


METRIC = "mean over the axes of |error|"


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FusionStudy(Study):
    """Fusion of a tracker and an inertial unit on one body: errors, and consistency of the filter.

    Errors of velocity are means of |error| over x and z: first off the bends of the path, then at them (normal
    acceleration above a fifth of its maximum). `alone` and `fused` hold three metrics per quantity: mean over the axes
    of |error|, mean length of the error, mean of |sum of its components|, which fits the position row of Table 8.
    """

    axes: Annotated[int | None, "3 or 5"] = None
    velocity_slope: Annotated[
        Sequence[float], Quantity("m/s", "slope of four positions: off the bends, at them", written="mm/s")
    ] = ()
    velocity_tracker: Annotated[
        Sequence[float], Quantity("m/s", "Kalman filter on the tracker alone: off, at", written="mm/s")
    ] = ()
    velocity_fused: Annotated[Sequence[float], Quantity("m/s", "off, at", written="mm/s")] = ()
    velocity_smoothed: Annotated[
        Sequence[float], Quantity("m/s", "off, at; empty if not smoothed", written="mm/s")
    ] = ()
    below_slope: Annotated[Sequence[float], "reduction of the velocity error against the slope: off, at, all"] = ()
    below_tracker: Annotated[Sequence[float], "against the filter on the tracker alone: off, at, all"] = ()
    alone: Annotated[Mapping[str, Sequence[float]], "errors of one sensor by quantity, SI: three metrics"] = field(
        default_factory=dict
    )
    fused: Annotated[Mapping[str, Sequence[float]], "errors of fusion by quantity, SI: three metrics"] = field(
        default_factory=dict
    )
    printed: Annotated[
        Mapping[str, Sequence[float | None]],
        "if the thesis has the same case: its printed mean errors of one sensor and of fusion, SI, metric not stated",
    ] = field(default_factory=dict)
    printed_in: Annotated[str, "table of these numbers"] = ""
    nis: Annotated[float | None, "mean normalised innovation squared per instant"] = None
    nis_band: Annotated[Sequence[float], "99.9 % band of nis, exact for a consistent filter"] = ()
    nis_numbers: Annotated[
        float | None, "expected nis of a consistent filter: the numbers read per instant, less the effect of weights"
    ] = None
    counted_less: Annotated[
        Mapping[str, float], "share of the readings of each sensor that counted less as outliers; 0.18 without outliers"
    ] = field(default_factory=dict)
    verdict: Annotated[str, "whether the innovations agree with the filter"] = ""
    preferred_jerk_density: Annotated[
        float | None, Quantity("m2/s5", "most likely decade, if nis is outside its band")
    ] = None
    fast_share: Annotated[Sequence[float], "mean probability of the faster filter: off the bends, at them"] = ()
    sweep_parameter: Annotated[str, "swept parameter"] = ""
    sweep_values: Annotated[Sequence[float], "SI"] = ()
    sweep_fused: Annotated[Sequence[float], Quantity("m/s", "velocity error of fusion", written="mm/s")] = ()
    sweep_tracker: Annotated[
        Sequence[float], Quantity("m/s", "velocity error of the filter that uses the tracker alone", written="mm/s")
    ] = ()
    sweep_slope: Annotated[
        Sequence[float], Quantity("m/s", "velocity error of the slope of four positions", written="mm/s")
    ] = ()
    sweep_consistent: Annotated[Sequence[bool], "whether the innovations are in their band"] = ()
    limit_tracker: Annotated[float | None, "swept value at which fusion is no better than the tracker's filter"] = None
    limit_slope: Annotated[float | None, "swept value at which fusion is no better than the slope"] = None
    limit_printed: Annotated[float | None, "limit in Table 10, SI"] = None
    synthetic: Annotated[str | None, "seed and noise of the readings"] = None

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
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
            text = f"{self.nis:.4g}, expected {self.nis_numbers:.3g}, band {low:.4g} to {high:.4g}"
            rows += [Row("innovations squared (NIS)", text), Row("  verdict", self.verdict)]
        if self.counted_less:
            text = ", ".join(f"{name} {100 * share:.3g}" for name, share in self.counted_less.items())
            rows.append(Row("  counted less as outliers", f"{text}  (18 without outliers)", "%"))
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
            text = "; ".join("none" if v is None else f"{factor * v:.3g}" for v in self.printed[name])
            rows.append(Row(f"  printed, {self.printed_in}", text, unit))
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
            text = f"fused {1e3 * fused:.3g}, tracker {1e3 * tracker:.3g}, slope {1e3 * slope:.3g}"
            rows.append(
                Row(f"{self.sweep_parameter} {value:.4g}", text + ("" if right else "; not consistent"), "mm/s")
            )
        for label, limit in (("tracker's filter", self.limit_tracker), ("slope", self.limit_slope)):
            text = "not reached" if limit is None else f"{limit:.3g}"
            rows.append(Row(f"  no better than the {label} at", text))
        printed = "no limit" if self.limit_printed is None else f"{self.limit_printed:.3g}"
        return [*rows, Row("  printed, Table 10", printed)]


_SHOWN = {
    "position": ("mm", 1e3), "orientation": ("deg", 57.29577951308232), "acceleration": ("m/s2", 1.0),
    "angular_velocity": ("deg/s", 57.29577951308232), "angular_acceleration": ("rad/s2", 1.0),
}  # fmt: skip
