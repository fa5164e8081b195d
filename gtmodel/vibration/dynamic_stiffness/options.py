"""Options of a study of dynamic stiffness and of synthetic experiments, and the result of the study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from ..._lazy import hint
from ...results import ArgumentError, Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within

if TYPE_CHECKING:
    from .experiments import Experiment
    from .modal_fit import ModalFit
    from .oscillator_field import OscillatorField

    Fits = Sequence[ModalFit | None]
else:
    Experiment = hint("gtmodel.vibration.dynamic_stiffness.experiments", "Experiment")
    Fits = Sequence[hint("gtmodel.vibration.dynamic_stiffness.modal_fit", "ModalFit") | None]
    OscillatorField = hint("gtmodel.vibration.dynamic_stiffness.oscillator_field", "OscillatorField")

NEW_POSES = 200  # poses at which a fitted field is compared with a synthetic true one


@dataclass(frozen=True)
class ModalFitting(Options):
    """How modes are fitted to a frequency response."""

    search: Annotated[list[float], Unit("Hz"), Long(2), "range of the search for the most compliant mode"] = field(
        default_factory=lambda: [3.0, 200.0]
    )
    band: Annotated[
        list[float] | None, Unit("Hz"), Long(2), "range of the fit; default: 0.7 to 1.3 times the peak"
    ] = None  # fmt: skip
    modes: Annotated[int | None, Within(above=0), "number of modes; default: selected by information criterion"] = None
    most: Annotated[int, Within(least=1, most=5), "largest number of modes to try"] = 3
    relative_noise: Annotated[
        float | None,
        Within(above=0.0),
        "relative noise of a receptance; default: from repeated hits, else from the residuals",
    ] = None
    estimator: Annotated[Literal["H1", "H2"], "H1 for noise on the response, H2 on the force"] = "H1"
    force_window: Annotated[
        float | None, Unit("s"), Within(above=0.0), "the force is set to zero this long after a hit"
    ] = None  # fmt: skip
    decay: Annotated[
        float, Unit("1/s"), Within(least=0.0), "exponential window for records that end before the response has decayed"
    ] = 0.0  # fmt: skip


@dataclass(frozen=True)
class Process(Options):
    """The Gaussian processes of log m, log c and log k over the pose."""

    covariance: Annotated[
        Literal["squared_exponential", "matern_5_2"], "smooth, or twice differentiable"
    ] = "squared_exponential"  # fmt: skip
    scale: Annotated[list[float], Unit("m"), Within(above=0.0), Long(3), "typical lengths of x, y, z"] = field(
        default_factory=lambda: [0.5] * 3
    )
    angle_scale: Annotated[
        float, Unit("rad", written="deg", key="scale_deg"), Within(above=0.0), "typical change of A"
    ] = math.pi / 3  # fmt: skip
    periodic: Annotated[bool, "whether A has a period of 360 degrees"] = True
    shared: Annotated[bool, "whether m, c and k of a direction share their lengths"] = True
    starts: Annotated[int, Within(above=0), "of the search for hyperparameters"] = 4
    seed: Annotated[int, "seed of these starts and of the held-out folds"] = 0


@dataclass(frozen=True)
class FrequencyMap(Options):
    """The plot of the lowest frequency over two coordinates of the pose."""

    over: Annotated[list[Literal["x", "y", "z", "A"]], Long(2), "abscissa and ordinate"] = field(
        default_factory=lambda: ["y", "A"]
    )
    at: Annotated[
        list[float] | None, Unit("m"), Long(3), "values of the other coordinates; default: the middle of the poses"
    ] = None  # fmt: skip
    at_angle: Annotated[float | None, Unit("rad", written="deg", key="at_deg"), "A; default: the middle"] = None
    points: Annotated[int, Within(least=5, most=201), "along each side"] = 41


@dataclass(frozen=True)
class SyntheticArm(Options):
    """Synthetic experiments on a smooth field near printed oscillators."""

    seed: Annotated[int, "of field, poses and noise"]
    lengths: Annotated[
        list[float], Within(above=0.0), Long(4),
        "lengths of its changes in x, y, z and A, relative to the scales of the process; our choice",
    ] = field(default_factory=lambda: [2.0, 0.8, 2.0, 0.8])  # fmt: skip
    poses: Annotated[int, Within(least=8, most=1000), "Latin hypercube in the box"] = 60
    box: Annotated[list[list[float]], Unit("m"), Long(2), "of x, y, z"] = field(
        default_factory=lambda: [[-0.3, 0.9], [-3.1, -2.1], [0.2, 0.4]]
    )
    box_angle: Annotated[list[float], Unit("rad", written="deg", key="box_deg"), Long(2), "of A"] = field(
        default_factory=lambda: [0.0, math.radians(120.0)]
    )
    records: Annotated[Literal["hits", "receptance"], "measured quantity"] = "hits"
    hits: Annotated[int, Within(least=2), "of each experiment"] = 5
    noise: Annotated[
        float, Unit("m/s2"), Within(above=0.0), "noise of the acceleration in records of hits"
    ] = 0.05  # fmt: skip
    relative_noise: Annotated[float, Within(above=0.0), "of receptances"] = 0.05
    sample_rate: Annotated[float, Unit("Hz"), Within(above=0.0), "of records of hits"] = 1024.0
    duration: Annotated[
        float, Unit("s"), Within(above=0.0), "duration of each record; its inverse is the frequency step of receptances"
    ] = 4.0  # fmt: skip


Array = np.ndarray
QUANTITIES = ("mass", "damping", "stiffness", "frequency", "damping_ratio")  # as NAMES of the fits
NAMES = ("m", "c", "k", "fn", "zeta")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DynamicStiffnessStudy(Study):
    """Oscillators by experiment and over the pose. field: m, c and k at any pose; experiments, fits: each of them."""

    poses: Annotated[
        Array, "x, y, z in m and A in rad of each experiment, in the order of its table"
    ]  # fmt: skip
    direction: Annotated[Sequence[str], "x, y or z of each experiment"]
    mass: Annotated[
        Array, Quantity("kg", "mass of the most compliant mode, by experiment; null if no mode was found")
    ]  # fmt: skip
    damping: Annotated[Array, Quantity("N.s/m", "of this mode, by experiment", key="damping_N_s_m")]
    stiffness: Annotated[Array, Quantity("N/m", "of this mode, by experiment")]
    frequency: Annotated[Array, Quantity("Hz", "undamped natural frequency of this mode, by experiment")]
    damping_ratio: Annotated[Array, "of this mode, by experiment"]
    relative_std: Annotated[
        Sequence[Sequence[float] | None],
        "relative standard deviation of m, c, k, fn and zeta by experiment, from the noise of its own records",
    ]
    modes: Annotated[Sequence[int], "number of fitted modes, by experiment"]
    next_mode: Annotated[
        Sequence[float | None], Quantity("Hz", "distance to the nearest other mode; null if there is only one")
    ]
    scatter: Annotated[
        float,
        "standard deviation of a logarithm between experiments at one pose, from the repeatability",
    ]
    measured_repeatability: Annotated[
        float | None,
        "mean change of m, c and k between experiments at one pose; null without repetitions",
    ] = None
    noise_of_process: Annotated[
        Sequence[float] | None,
        "standard deviation of a logarithm, fitted by the processes; m, c, k of x, y, z in order",
    ] = None
    lengths: Annotated[
        Sequence[Any] | None,
        "lengths of the Gaussian processes relative to their scales; x, y, z, A for m, c, k of each direction in order",
    ] = None  # fmt: skip
    inflation: Annotated[
        Sequence[float] | None,
        "factor on standard deviations, from held-out poses; m, c, k of x, y, z in order",
    ] = None
    leave_one_out_rms: Annotated[
        Sequence[float] | None,
        "leave-one-out errors of logarithms; m, c, k of x, y, z in order",
    ] = None
    coverage_leave_one_out: Annotated[
        float | None, "share of left-out values inside the 95 % intervals before inflation"
    ] = None
    coverage_held_out: Annotated[
        Sequence[float] | None, "share of held-out values inside the intervals, before and after inflation"
    ] = None
    coverage_of_truth: Annotated[
        Sequence[float] | None,
        "share of the true field inside the intervals at new poses, before and after inflation; null for measured data",
    ] = None
    lowest: Annotated[
        Sequence[float] | None,
        Quantity("Hz", "lowest and highest frequency of the softest direction over the poses"),
    ] = None
    printed: Annotated[
        str | None, "note on the printed oscillators; null if none are used"
    ] = None  # fmt: skip
    synthetic: Annotated[
        str | None, "seed and noise of synthetic records; null for measured ones"
    ] = None  # fmt: skip
    field: OscillatorField | None = None
    experiments: Sequence[Experiment] = ()
    fits: Fits = ()

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "mass[0]", "damping[0]", "stiffness[0]", "frequency[0]" or "damping_ratio[0]" for the
        experiment with this index, from the noise of its own records. Raises ArgumentError."""
        stem, _, place = str(name).partition("[")
        names = dict(zip(QUANTITIES, NAMES, strict=True))
        index = place[:-1] if place.endswith("]") else ""
        fit = dict(enumerate(self.fits)).get(int(index)) if index.isdecimal() else None
        if stem not in names or fit is None:
            raise ArgumentError(f"unknown name '{name}'; expected one of {', '.join(names)} with an index", "name")
        return fit.interval(f"{names[stem]}[0]", level)

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        rows = _experiment_rows(self.experiments, self.fits)
        if self.field is not None:
            rows += self._field_rows()
        if self.synthetic is not None:
            rows += [Row("printed oscillators", self.printed), Row("SYNTHETIC", self.synthetic)]
        return rows

    def _field_rows(self) -> list[Row]:
        low, high = self.lowest or (np.nan, np.nan)
        held, truth = self.coverage_held_out or (np.nan, np.nan), self.coverage_of_truth
        rows = [
            Row("lowest frequency over the poses", f"{low:.3g} to {high:.3g}", "Hz"),
            Row("scatter between experiments: as set", f"{self.scatter:.3g} of each logarithm"),
            Row("scatter between experiments: fitted", _list(self.noise_of_process)),
            Row("leave-one-out error, m, c, k of x, y, z", _list(self.leave_one_out_rms)),
            Row("left-out values inside their 95 % intervals", f"{self.coverage_leave_one_out:.1%}"),
            Row("held-out values inside their 95 % intervals", f"{held[0]:.1%}, after inflation {held[1]:.1%}"),
            Row("inflation of the intervals", _list(self.inflation)),
        ]
        if self.measured_repeatability is not None:
            rows.append(Row("measured repeatability", f"{self.measured_repeatability:.1%}"))
        if truth is not None:
            shares = f"{truth[0]:.1%}, after inflation {truth[1]:.1%}"
            rows.append(Row(f"true field at {NEW_POSES} new poses inside the intervals", shares))
        return rows


def _experiment_rows(experiments: Sequence[Experiment], fits: Fits) -> list[Row]:
    """A row for each of few experiments; ranges by direction for many."""
    if len(experiments) <= 12:
        return [
            Row(f"{e.source} ({'xyz'[e.direction]})", f"fn {f.fn[0]:.4g} Hz, zeta {f.zeta[0]:.3g}, m {f.m[0]:.4g} kg, "
                f"c {f.c[0]:.4g} N.s/m, k {f.k[0]:.4g} N/m")
            for e, f in zip(experiments, fits, strict=True) if f is not None
        ]  # fmt: skip
    rows = []
    for d, name in enumerate("xyz"):
        part = [f for e, f in zip(experiments, fits, strict=True) if f is not None and e.direction == d]
        spans = [
            f"{q} {min(getattr(f, q)[0] for f in part):.3g}..{max(getattr(f, q)[0] for f in part):.3g}" for q in NAMES
        ]
        rows.append(Row(f"{len(part)} experiments in {name}", ", ".join(spans)))
        error = max(f.log_std("k") for f in part)
        rows.append(Row(f"  largest standard deviation of k from noise, {name}", f"{error:.2%}"))
    rows.append(Row("all experiments with intervals", "poses.csv"))
    return rows


def _list(numbers: Sequence[float] | None) -> str:
    return ", ".join(f"{x:.3g}" for x in numbers or ())
