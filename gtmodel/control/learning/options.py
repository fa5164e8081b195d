"""Options of learning experiments (robot, law, noise, simulated tool) and results of the studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from ..._lazy import hint
from ...results import ArgumentError, Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from .references import ACTUATOR_DELAY, ACTUATORS, CONTRACTION, LENGTH, SAMPLE_TIME

if TYPE_CHECKING:
    from .axis import AxisPlant
    from .plants import SampledSystem
    from .robot import ModelledRobot
else:
    AxisPlant = hint("gtmodel.control.learning.axis", "AxisPlant")
    SampledSystem = hint("gtmodel.control.learning.plants", "SampledSystem")
    ModelledRobot = hint("gtmodel.control.learning.robot", "ModelledRobot")

Case = Literal["1", "2A", "2B", "3"]
SET = 5  # dampings of the set of models, and least number of frequencies
SPACING = 0.5  # of a mode's half width: no peak between two models is more than 3 % higher
FREQUENCIES = 2001  # least number for a design
PRINTED = ("actuator 1", "actuator 2", "actuator 3")
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class LearningRobot(Options):
    """The law's model of the robot: along each axis a motor loop that carries a tool on a spring.

    >>> gt.control.learning.LearningRobot().axes
    ('x', 'y')
    """

    loop: Annotated[
        Literal["lag", "printed"],
        "lag: delay and lag with a tool; printed: the three printed actuators (6.11), without a tool",
    ] = "lag"  # fmt: skip
    lag: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "of the motor loop"] = 0.02
    delay: Annotated[int, Unit("", key="delay_samples"), Within(least=0), "of the motor loop"] = ACTUATOR_DELAY
    frequency: Annotated[tuple[float, ...], Unit("Hz"), Within(above=0.0), "of the tool along each axis"] = (7.4, 11.5)
    damping: Annotated[tuple[float, ...], Within(above=0.0), "of the tool along each axis"] = (0.2, 0.05)
    sample_time: Annotated[float, Unit("s", written="ms"), Within(above=0.0), "of the controller"] = SAMPLE_TIME

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.frequency) <= len(AXES) or len(self.damping) != len(self.frequency):
            raise ArgumentError(
                f"expected one frequency and one damping for each of one to three axes; found {len(self.frequency)} "
                f"and {len(self.damping)}", "damping",
            )  # fmt: skip

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return PRINTED if self.loop == "printed" else AXES[: len(self.frequency)]

    @property
    def along(self) -> tuple[int, ...]:
        """Direction of the square that each axis follows, 0 for x and 1 for y; 0 for all printed actuators."""
        return (0, 0, 0) if self.loop == "printed" else (0, 1, 0)[: len(self.frequency)]

    def mode(self, axis: int) -> tuple[float, float] | None:
        """Return frequency [Hz] and damping ratio of an axis' least damped mode; None without a tool."""
        return None if self.loop == "printed" else (self.frequency[axis], self.damping[axis])

    def tool(self, axis: int) -> SampledSystem:
        """Return the model from the motor side to the tool, for the filter of (7.21)."""
        from .axis import tool_model

        return tool_model(self.frequency[axis], self.damping[axis], self.sample_time)

    def plant(self, axis: int, frequency: float = 1.0, damping: float = 1.0) -> AxisPlant:
        """Return the axis, with frequency and damping of its tool multiplied by these factors."""
        from .axis import AxisPlant, flexible_axis  # slow to import, not needed for the keys of files
        from .plants import delayed_lag

        if self.loop == "printed":
            b, a = ACTUATORS[axis]
            return AxisPlant({"motor": delayed_lag(b, a, ACTUATOR_DELAY, self.sample_time)}, self.sample_time)
        return flexible_axis(
            self.frequency[axis] * frequency, self.damping[axis] * damping, lag=self.lag, delay=self.delay,
            sample_time=self.sample_time,
        )  # fmt: skip


@dataclass(frozen=True)
class LearningDesign(Options):
    """The law, the signals it learns from, and the set of robots for which it must converge.

    >>> gt.control.learning.LearningDesign(case="2B").low_pass
    30.0
    """

    case: Annotated[Case, "signals: 1 motors, 2A complementary filter, 2B Kalman filter, 3 measured tool"] = "1"
    law: Annotated[
        Literal["shift", "inverse", "norm_optimal"], "L = gain q^shift, inverse of the model, or norm-optimal law"
    ] = "shift"  # fmt: skip
    gain: Annotated[float, Within(above=0.0, most=2.0), "of L"] = 0.9
    shift: Annotated[
        int | None, Unit("", key="shift_samples"), Within(least=0), "of L; default: 5 in case 1, else from the models"
    ] = None
    cutoff: Annotated[
        float | None, Unit("Hz"), Within(above=0.0), "of the low pass in Q; default: 10 in case 1, else 30"
    ] = None  # fmt: skip
    iterations: Annotated[int, Within(least=1), "after the first run"] = 10
    ramps: Annotated[bool, "use the windows Q_w over lead-in and lead-out"] = True
    contraction: Annotated[float, Within(above=0.0, below=1.0), "bound for the design of Q"] = CONTRACTION
    lags: Annotated[int, Within(least=1), "of Q on either side, in samples"] = LENGTH
    frequency_share: Annotated[
        float, Within(least=0.0, below=1.0), "largest deviation of the tool's frequency, as a share"
    ] = 0.06
    damping_shares: Annotated[
        tuple[float, float], Within(above=0.0), "range of factors on the tool's damping"
    ] = (0.6, 1.6)  # fmt: skip
    slow_cutoff: Annotated[
        tuple[float, ...], Unit("Hz"), Within(above=0.0), "of the complementary filter, per axis; (7.18)"
    ] = (4.5, 2.63, 2.63)
    change: Annotated[float, Within(above=0.0), "weight of the input's change, with inverse and norm_optimal"] = 0.1
    effort: Annotated[float, Within(least=0.0), "weight of the input, with norm_optimal"] = 0.001
    largest: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0.0), "bound on the absolute input, with norm_optimal"
    ] = None  # fmt: skip
    largest_speed: Annotated[
        float | None, Unit("m/s", written="mm/s"), Within(above=0.0), "bound on the input's rate, with norm_optimal"
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law != "norm_optimal" and (self.largest is not None or self.largest_speed is not None):
            raise ArgumentError("bounds on the input need law = norm_optimal", "law")
        if self.damping_shares[0] > self.damping_shares[1]:
            raise ArgumentError("the smaller factor must come first", "damping_shares")

    @property
    def low_pass(self) -> float:
        """The cutoff of Q [Hz]."""
        return self.cutoff if self.cutoff is not None else (10.0 if self.case == "1" else 30.0)

    def models(self, robot: LearningRobot | ModelledRobot, axis: int) -> list[AxisPlant]:
        """Return the set of models for which the law must converge, spaced according to the width of the mode; only the
        nominal model in case 1."""
        mode = robot.mode(axis)
        if self.case == "1" or mode is None:
            return [robot.plant(axis)]
        models = []
        for b in np.unique(np.geomspace(*self.damping_shares, SET)):
            count = max(SET, int(np.ceil(2 * self.frequency_share / (SPACING * mode[1] * b))) + 1)
            models += [robot.plant(axis, 1 + self.frequency_share * a, b) for a in np.linspace(-1, 1, count)]
        return models

    def grid(self, robot: LearningRobot | ModelledRobot, axis: int) -> int:
        """Return the number of frequencies up to half the sampling rate that resolves the narrowest mode of the set."""
        mode = robot.mode(axis)
        if self.case == "1" or mode is None:
            return FREQUENCIES
        width = mode[0] * mode[1] * (1 - self.frequency_share) * self.damping_shares[0]
        return max(FREQUENCIES, int(np.ceil(0.5 / robot.sample_time / (SPACING * width))) + 1)


@dataclass(frozen=True)
class LearningNoise(Options):
    """Differences between runs, and between synthetic tool and model; all drawn from the seed.

    >>> gt.control.learning.LearningNoise(seed=3).repeats
    5
    """

    seed: Annotated[int, Within(least=0), "of all random numbers"] = 1
    motor: Annotated[float, Unit("m", written="um"), Within(least=0.0), "noise of the motor side"] = 1e-6
    gauge: Annotated[float, Unit("m", written="um"), Within(least=0.0), "noise of the measured tool"] = 1e-6
    acceleration: Annotated[float, Unit("m/s2"), Within(above=0.0), "noise of the accelerometer"] = 0.07
    unrepeatable: Annotated[
        float, Unit("m", written="um"), Within(least=0.0), "motion that differs from run to run, below 10 Hz"
    ] = 5e-6
    repeats: Annotated[int, Within(least=3), "identical runs before learning, for the scatter"] = 5
    frequency_error: Annotated[
        float, Within(least=0.0, below=0.5), "largest deviation of the tool's frequency from the model, as a share"
    ] = 0.03
    damping_error: Annotated[
        float, Within(least=0.0, below=1.0), "largest deviation of the tool's damping, as a share"
    ] = 0.2


@dataclass(frozen=True)
class ElasticTip(Options):
    """A tool on a spring at the plate of a simulated robot under sampled computed torque.

    >>> gt.control.learning.ElasticTip().frequency
    15.0
    """

    start: Annotated[tuple[float, ...], Unit("m"), Long(3), "of the plate"] = (0.5, -0.9, 0.3)
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "of the tool, unknown to the controller"] = 1.0
    frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "of the tool on its spring with the plate fixed"] = 15.0
    damping: Annotated[float, Within(above=0.0, below=1.0), "damping ratio"] = 0.1
    position_gain: Annotated[float, Unit("1/s2", key="position_gain"), Within(above=0.0), "of the controller, 1/s2"] = (
        900.0
    )
    velocity_gain: Annotated[float, Unit("1/s", key="velocity_gain"), Within(above=0.0), "of the controller, 1/s"] = (
        60.0
    )
    delay: Annotated[float, Unit("s", written="ms"), Within(least=0.0), "from a sample until its forces act"] = 0.008


Numbers = Sequence[float]
Courses = Sequence[Sequence[float]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LearningStudy(Study):
    """Runs of a learning law and their prediction, per axis; errors are root mean squares over the fully corrected
    samples. trajectory: reference, input and estimate of the last run."""

    case: Annotated[str, "signals: 1, 2A, 2B, 3"] = ""
    axes: Annotated[Sequence[str], "names, in the order of all other values"] = ()
    shift: Annotated[Sequence[int], Quantity("", "of L in samples", key="shift_samples")] = ()
    sigma: Annotated[Numbers, "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Numbers, "largest |Q| |1 - L T| over frequency and all models"] = ()
    bound_frequency: Annotated[Numbers, Quantity("Hz", "of the bound")] = ()
    first_error: Annotated[Numbers, Quantity("m", "of the estimate, before learning", written="um")] = ()
    floor: Annotated[Numbers, Quantity("m", "predicted before learning", written="um")] = ()
    factor: Annotated[Numbers, "predicted reduction of the error: first error over floor"] = ()
    not_learned: Annotated[Numbers, "share of the first error that Q does not pass, predicted"] = ()
    scatter: Annotated[Numbers, Quantity("m", "part of the floor that does not repeat, predicted", written="um")] = ()
    reached: Annotated[Numbers, Quantity("m", "error of the estimate over the last runs", written="um")] = ()
    error: Annotated[Courses, Quantity("m", "of the estimate, per axis in each run", written="um")] = ()
    predicted: Annotated[Courses, Quantity("m", "error predicted before learning", written="um")] = ()
    tool_error: Annotated[
        Courses | None, Quantity("m", "of the true tool, per axis in each run; null if unknown", written="um")
    ] = None
    tool_share: Annotated[Numbers | None, "tool's error over the last runs, as a share of that before learning"] = None
    reference_above: Annotated[Numbers, "share of the first error's amplitude above the cutoff of Q"] = ()
    largest_input: Annotated[Numbers, Quantity("m", "largest absolute value of the learned input", written="mm")] = ()
    synthetic: Annotated[str | None, "origin of synthetic runs; null for measured runs"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f} at "
                            f"{self.bound_frequency[k]:.3g} Hz"))  # fmt: skip
            if not self.floor:  # interrupted before the prediction
                continue
            rows.append(Row(f"{axis}: error before learning", f"{1e6 * self.first_error[k]:.4g}", "um"))
            falls = f" (falls to 1/{self.factor[k]:.3g})" if self.factor and np.isfinite(self.factor[k]) else ""
            rows.append(Row(f"{axis}: floor predicted", f"{1e6 * self.floor[k]:.4g}{falls}", "um"))
            if self.reached:
                rows.append(Row(f"{axis}: reached", f"{1e6 * self.reached[k]:.4g}", "um"))
            if self.tool_share is not None:
                rows.append(Row(f"{axis}: tool's error left", f"{100 * self.tool_share[k]:.3g}", "%"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])


WORDS = {
    "1": "the motors (case 1)", "2A": "a complementary filter (case 2A)", "2B": "a Kalman filter (case 2B)",
    "3": "the measured tool (case 3)",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class NextInputStudy(Study):
    """The input for the next run and the predicted remaining error; errors are root mean squares over the fully
    corrected samples."""

    axes: Annotated[Sequence[str], "names, in the order of all other values"] = ()
    case: Annotated[str, "signals: 1, 2A, 2B, 3"] = ""
    error: Annotated[Sequence[float], Quantity("m", "of the estimate in this run", written="um")] = ()
    floor: Annotated[Sequence[float], Quantity("m", "remaining error predicted by the model", written="um")] = ()
    scatter: Annotated[
        Sequence[float] | None,
        Quantity("m", "part of the floor from differences between identical runs; null without repeats", written="um"),
    ] = None
    unexplained: Annotated[
        Sequence[float], "deviation of this run from the model, as a share of the error predicted before learning"
    ] = ()
    sigma: Annotated[Sequence[float], "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Sequence[float], "largest |Q| |1 - L T| over frequency and all models"] = ()
    learned: Annotated[bool, "whether nothing more can be learned; the input is then that of this run"] = False
    largest_input: Annotated[
        Sequence[float], Quantity("m", "largest absolute value of the next input", written="mm")
    ] = ()
    synthetic: Annotated[str | None, "origin of a synthetic run; null for a measured run"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: error of this run", f"{1e6 * self.error[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: floor", f"{1e6 * self.floor[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f}"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
