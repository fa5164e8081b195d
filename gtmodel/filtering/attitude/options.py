"""Options of the attitude study: test on a recording, a synthetic recording; and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from ...results.options import Options, Unit, Within
from ...results.quantity import Quantity, Row
from ...results.study import Study, to_inherit

GyroDrift = Literal["none", "linear", "temperature"]


@dataclass(frozen=True)
class AttitudeJudging(Options):
    """The part of a recording that calibrates a gyro, and the gaps between references that test it on the rest.

    >>> gt.filtering.AttitudeJudging(gaps=(0.2,)).longest_offset
    0.5
    """

    calibrate_until: Annotated[
        float | None, Unit("s"), "end of the calibration, by the reference's clock; half of the references if left out"
    ] = None  # fmt: skip
    gaps: Annotated[tuple[float, ...], Unit("s"), Within(above=0), "lengths of time without a reference"] = (0.5, 1.0)
    sample_period: Annotated[
        float | None, Unit("s"), Within(above=0),
        "sampling period of the gyro by its own clock, if rows are stamped on arrival; compared with the stamps",
    ] = None  # fmt: skip
    longest_offset: Annotated[
        float, Unit("s"), Within(above=0), "largest offset between the two clocks, either way, in the search"
    ] = 0.5  # fmt: skip
    drift: Annotated[
        GyroDrift | list[GyroDrift],
        "drift of the gyro's bias to estimate, one or several: linear in time, or with temperature",
    ] = "none"  # fmt: skip


@dataclass(frozen=True)
class SyntheticAttitude(Options):
    """A synthetic recording of an arm that turns a low-cost inertial unit: rests, and rotations about many axes.

    The gyro is sampled evenly and stamped on arrival, with varying delay; at first a buffer is emptied. The references
    are quaternions, world to body, stamped in steps of `resolution`.

    >>> gt.filtering.SyntheticAttitude(seed=2).reference_period
    0.0725
    """

    duration: Annotated[float, Unit("s"), Within(least=6.0), "of the recording"] = 17.8
    sample_period: Annotated[float, Unit("s"), Within(above=0), "of the gyro"] = 0.009963
    reference_period: Annotated[float, Unit("s"), Within(above=0), "of the references, without pauses"] = 0.0725
    resolution: Annotated[float, Unit("s"), Within(above=0), "resolution of the time stamps of the references"] = 0.01
    offset: Annotated[float, Unit("s"), "of the reference's clock"] = 0.002
    relative: Annotated[float, Within(least=0), "deviation of the gyro's error over the rate; persists for 2 s"] = 0.006
    noise: Annotated[float, Unit("rad/s"), Within(least=0), "noise of one reading of the gyro"] = 7e-4
    drift: Annotated[float, Unit("rad/s2"), "rate of change of the gyro's bias, the same on its three axes"] = 0.0
    lost: Annotated[int, Within(least=0), "missing rows"] = 5
    seed: Annotated[int, Within(least=0), "seed of the motion and of all noise"] = 0


METHODS: Mapping[str, str] = {
    "carried": "gyro from the left reference",
    "corrected": "gyro, corrected at both ends",
    "slerp": "slerp between the two",
    "spline": "cubic rotation spline through all other references",
    "slow_spline": "cubic rotation spline through references one gap apart",
}
SHOWN = 6  # conventions in the table
_DEG = 180 / np.pi
_SHOWN = {
    "mount": (_DEG, "deg"), "scale": (1.0, ""), "misalignment": (_DEG, "deg"), "bias": (_DEG, "deg/s"),
    "offset": (1e3, "ms"), "bias_drift": (3600 * _DEG, "deg/s/h"), "bias_thermal": (_DEG, "deg/s/K"),
}  # fmt: skip


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AttitudeStudy(Study):
    """Calibration of a gyro on the first part of a recording, and attitude errors in gaps of the rest.

    Names for `interval`: "mount[0]", "scale[0]", "misalignment[0]" (axes yz, zx, xy), "bias[0]" and "offset", of the
    first part; with a drift also "bias_drift[0]" [rad/s2] and "bias_thermal[0]" [rad/s/K]. The bias is then that at the
    end of the first part. error[i][j] is the error in gap i with method j.
    """

    convention: Annotated[str, Quantity("", "units and direction found", "read as")] = ""
    conventions: Annotated[Sequence[str], "all candidates, the most likely first"] = ()
    log_likelihood: Annotated[Sequence[float], "of each candidate"] = ()
    clock: Annotated[str, Quantity("", "more likely instants of the gyro, and the gain in likelihood", "clock")] = ""
    gravity: Annotated[str, Quantity("", "reading of the accelerometer at rest", "accelerometer")] = ""
    names: Annotated[Sequence[str], "names of the calibrated numbers, in the order of all fields below"] = ()
    numbers: Annotated[Sequence[float], "calibrated on the first part, in SI"] = ()
    first_interval: Annotated[Sequence[Sequence[float]], "95 % intervals of the first part, in SI"] = ()
    second_interval: Annotated[Sequence[Sequence[float]], "95 % intervals of the second part, in SI"] = ()
    timing: Annotated[Sequence[float], Quantity("s", "deviation of the stamps of the references, both parts")] = ()
    relative: Annotated[Sequence[float], "deviation of the gyro's error relative to its rotations, both parts"] = ()
    persistence: Annotated[Sequence[float], Quantity("s", "correlation time of that error, both parts")] = ()
    gaps: Annotated[Sequence[float], Quantity("s", "lengths of time without a reference")] = ()
    starts: Annotated[Sequence[int], "number of tested gaps of each length"] = ()
    methods: Annotated[Sequence[str], "methods that bridge a gap"] = ()
    error: Annotated[
        Sequence[Sequence[float]], Quantity("rad", "mean error at the hidden references of the second part",
    written="deg")
    ] = ()  # fmt: skip
    exchanged: Annotated[
        Sequence[Sequence[float]],
        Quantity("rad", "the same, calibrated on the second part and tested on the first", written="deg"),
    ] = ()  # fmt: skip
    below_slerp: Annotated[Sequence[Sequence[float]], "error of slerp over the errors of carried and corrected"] = ()
    below_spline: Annotated[Sequence[float], "error of the rotation spline over the error of corrected"] = ()
    covered: Annotated[
        Sequence[Sequence[float]], "share of the errors, carried and corrected, inside their 95 % ellipsoid"
    ] = ()  # fmt: skip
    filtered: Annotated[
        Sequence[float], Quantity("rad", "mean error of a causal filter with one reference per gap", written="deg")
    ] = ()  # fmt: skip
    smoothed: Annotated[
        Sequence[float], Quantity("rad", "mean error of its fixed-interval smoother", written="deg")
    ] = ()  # fmt: skip
    nis: Annotated[Sequence[float], "normalised innovation squared of the filter, mean per number: 1 is expected"] = ()
    left_out: Annotated[Sequence[float], Quantity("s", "stamps of references: spikes, or not of unit length")] = ()
    synthetic: Annotated[str | None, "seed and noise of a synthetic recording; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        rows = [Row("read as", self.convention)]
        for name, logs in list(zip(self.conventions, self.log_likelihood, strict=True))[:SHOWN]:
            rows.append(Row(f"log-likelihood: {name}", f"{logs:.1f}"))
        rows += [Row("clock of the gyro", self.clock), Row("accelerometer", self.gravity)]
        for k, name in enumerate(self.names):
            factor, unit = _SHOWN[name.split("[")[0]]
            value, (a, b), (c, d) = (
                factor * self.numbers[k],
                [factor * v for v in self.first_interval[k]],
                [factor * v for v in self.second_interval[k]],
            )
            rows.append(Row(name, f"{value:.4g}  ({a:.4g} .. {b:.4g}; second part {c:.4g} .. {d:.4g})", unit))
        for part, *sizes in zip(("first", "second"), self.timing, self.relative, self.persistence, strict=False):
            timing, relative, lasts = sizes
            sizes = f"stamps {1e3 * timing:.3g} ms, gyro {100 * relative:.2g} % for {lasts:.2g} s"
            rows.append(Row(f"disagreement, {part} part", sizes))
        for i, gap in enumerate(self.gaps):
            rows += [
                Row(
                    f"gap of {gap:g} s: {METHODS[method]}",
                    f"{np.degrees(self.error[i][j]):.3f}  (parts exchanged {np.degrees(self.exchanged[i][j]):.3f})",
                    "deg",
                )
                for j, method in enumerate(self.methods)
            ]
            run = f"{np.degrees(self.filtered[i]):.3f}, {np.degrees(self.smoothed[i]):.3f}  (NIS {self.nis[i]:.2f})"
            rows.append(Row(f"gap of {gap:g} s: error of the error-state filter, of its smoother", run, "deg"))
            carried, corrected = self.below_slerp[i]
            times = f"carried {carried:.1f} times, corrected {corrected:.1f}; corrected {self.below_spline[i]:.1f}"
            rows.append(Row(f"gap of {gap:g} s: below slerp, below spline", times))
            inside = " and ".join(f"{100 * c:.0f} %" for c in self.covered[i])
            rows.append(Row(f"gap of {gap:g} s: inside the 95 % ellipsoid, carried and corrected", inside))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
