"""Options of the filter study (sensors, start, synthetic readings), and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from .._lazy import hint
from ..results import Quantity, Row, Study
from ..results.options import Options, Unit, Within

if TYPE_CHECKING:
    from .sensors import Sensor
else:
    Sensor = hint("gtmodel.filtering.sensors", "Sensor")

FilterName = Literal["kf", "ekf", "iekf", "ukf", "particle", "steady"]
Numbers = float | tuple[float, ...]


@dataclass(frozen=True)
class MeasuredQuantity(Options):
    """A sensor of a filter: the model variable that it measures, and its noise in the SI unit of that variable.

    >>> gt.filtering.MeasuredQuantity(signal="angle", deviation=0.01).sensor("encoder").quantity
    'angle'
    """

    signal: Annotated[str, "measured variable of the model; the sensor's name if left out"] = ""
    deviation: Annotated[
        Numbers | Literal["estimate"] | None,
        Within(above=0.0),
        'standard deviation of one reading, a number or one per component; or "estimate": from a log at rest if there '
        "is one, else by maximum likelihood",
    ] = None
    density: Annotated[
        Numbers | None,
        Within(above=0.0),
        "instead of deviation: deviation times the square root of the period, as in data sheets",
    ] = None
    period: Annotated[float | None, Unit("s"), Within(above=0.0), "between two readings; needed with a density"] = None
    kind: Annotated[
        Literal["vector", "quaternion", "direction"], "quaternions are scalar first, directions of any length"
    ] = "vector"
    delay: Annotated[float, Unit("s"), "how late a reading arrives"] = 0.0
    gate: Annotated[
        float | None,
        Within(above=0.0, below=1.0),
        "readings beyond this quantile of chi-squared are left out, such as 0.999",
    ] = None
    outliers: Annotated[Literal["huber"] | None, "readings far off count less, with Huber's weights"] = None

    def sensor(self, name: str) -> Sensor:
        """Return the sensor with that name; a deviation to estimate is 1 at first. Raises ArgumentError if its noise is
        stated twice or not at all."""
        from .sensors import Sensor

        deviation = 1.0 if self.deviation == "estimate" else self.deviation
        return Sensor(
            name, self.signal, deviation, self.density, self.period, self.kind, self.delay,
            gate=self.gate, outliers=self.outliers,
        )  # fmt: skip


@dataclass(frozen=True)
class FilterStart(Options):
    """Initial estimate of a filter: mean and standard deviation of each state, in SI.

    >>> gt.filtering.FilterStart(deviation={"angle": 0.1, "rate": 1.0}).mean
    {}
    """

    mean: Annotated[Mapping[str, Numbers], "state -> value; zero for states that are not named"] = field(
        default_factory=dict
    )
    deviation: Annotated[
        Mapping[str, Numbers],
        "state -> standard deviation of its error, for every state; with from_rest, only for those that the rest does "
        "not show",
    ] = field(default_factory=dict)
    from_rest: Annotated[bool, "the states at rest, from the mean readings of a log at rest"] = False


@dataclass(frozen=True)
class DrawnReadings(Options):
    """Synthetic readings instead of a log, of a motion that the process draws from its own noise.

    >>> gt.filtering.DrawnReadings(duration=2.0).seed
    1
    """

    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the motion"]
    step: Annotated[
        float, Unit("s"), Within(above=0.0), "between instants; sensors without a period read at each of them"
    ] = 0.01
    seed: Annotated[int, Within(least=0), "seed of the random start, motion and noise"] = 1


@dataclass(frozen=True, eq=False)
class FilterStudy(Study):
    """Filtered log: estimates with standard deviations, and whether the innovations are consistent with them.

    The trajectory has each state, its "NAME.deviation", and with smoothing "NAME.smoothed". The file innovations.csv
    has each sensor's innovation with its standard deviation, in SI, and the NIS of each instant.
    """

    filter: Annotated[str, "its name", "filter"] = ""
    readings: Annotated[Mapping[str, int], "number of readings of each sensor"] = field(default_factory=dict)
    left_out: Annotated[Mapping[str, int], "readings that a gate left out, by sensor"] = field(default_factory=dict)
    nis: Annotated[float | None, "mean normalised innovation squared per instant"] = None
    nis_band: Annotated[Sequence[float], "99.9 % band of nis for a consistent filter"] = ()
    nis_numbers: Annotated[float | None, "expected nis of a consistent filter"] = None
    verdict: Annotated[str, "whether the innovations agree with the filter"] = ""
    final: Annotated[Mapping[str, Sequence[float]], "each state at the end, SI"] = field(default_factory=dict)
    final_deviation: Annotated[Mapping[str, Sequence[float]], "their deviations"] = field(default_factory=dict)
    rms_error: Annotated[
        Mapping[str, Sequence[float]],
        Quantity("", "rms error of each state, if the truth is known: synthetic readings"),
    ] = field(default_factory=dict)
    rms_deviation: Annotated[
        Mapping[str, Sequence[float]], "rms of the filter's standard deviations of these errors"
    ] = field(default_factory=dict)  # fmt: skip
    smoothed_rms_error: Annotated[Mapping[str, Sequence[float]], "of the smoothed states"] = field(default_factory=dict)
    synthetic: Annotated[str, "origin of synthetic readings"] = ""
    units: Mapping[str, str] = field(default_factory=dict)
    noise: Annotated[
        Mapping[str, Sequence[float]], "estimated noise: NOISE.density and SENSOR.deviation, per component, SI"
    ] = field(default_factory=dict)
    noise_low: Annotated[Mapping[str, Sequence[float]], "lower ends of their 95 % intervals"] = field(
        default_factory=dict
    )
    noise_high: Annotated[Mapping[str, Sequence[float]], "upper ends, infinite if the log does not show them"] = field(
        default_factory=dict
    )
    noise_source: Annotated[Mapping[str, str], "rest or likelihood, by noise"] = field(default_factory=dict)
    noise_undetermined: Annotated[Sequence[str], "noise that the log does not determine, alone or together"] = ()
    start: Annotated[Mapping[str, Sequence[float]], "each state at the start, SI"] = field(default_factory=dict)
    start_deviation: Annotated[Mapping[str, Sequence[float]], "their deviations"] = field(default_factory=dict)
    faults: Annotated[str, "result of the search for faults"] = ""
    fault_sizes: Annotated[
        Mapping[str, Sequence[float]], "change from the declared value that fits the log best, alone; of noise a factor"
    ] = field(default_factory=dict)
    fault_deviations: Annotated[Mapping[str, Sequence[float]], "their standard deviations"] = field(
        default_factory=dict
    )
    fault_p: Annotated[Mapping[str, float], "p-value of each fault; small: the log shows it"] = field(
        default_factory=dict
    )

    @property
    def rows(self) -> list[Row]:
        """Readings, estimates and the verdict."""
        rows = [Row(f"readings of {name}", self._counted(name, n)) for name, n in self.readings.items()]
        rows += [Row(f"estimated {name}", self._estimated(name)) for name in self.noise]
        for name, values in self.final.items():
            pairs = zip(values, self.final_deviation[name], strict=True)
            text = ", ".join(f"{value:.6g} +- {deviation:.2g}" for value, deviation in pairs)
            rows.append(Row(f"{name} at the end", text, self.units.get(name, "")))
        for name, errors in self.rms_error.items():
            pairs = zip(errors, self.rms_deviation[name], strict=True)
            text = ", ".join(f"{error:.3g} (expected {deviation:.3g})" for error, deviation in pairs)
            if name in self.smoothed_rms_error:
                text += f"; smoothed {', '.join(f'{e:.3g}' for e in self.smoothed_rms_error[name])}"
            rows.append(Row(f"rms error of {name}", text, self.units.get(name, "")))
        if self.nis_band:
            low, high = self.nis_band
            text = f"{self.nis:.4g}, expected {self.nis_numbers:.3g}, band {low:.4g} to {high:.4g}"
            rows += [Row("innovations squared (NIS)", text), Row("  verdict", self.verdict)]
        rows += [Row("faults", self.faults)] if self.faults else []
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])

    def _estimated(self, name: str) -> str:
        ends = zip(self.noise[name], self.noise_low[name], self.noise_high[name], strict=True)
        numbers = ", ".join(f"{value:.4g} ({low:.3g} to {high:.3g})" for value, low, high in ends)
        undetermined = "; not determined by this log" if name in self.noise_undetermined else ""
        return f"{numbers}, from {self.noise_source[name]}{undetermined}"

    def _counted(self, name: str, n: int) -> str:
        out = self.left_out.get(name, 0)
        return f"{n}, {out} left out by the gate" if out else str(n)
