"""What the fusion study returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from ...results import Quantity, Row, Study
from ...results.study import to_inherit

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
