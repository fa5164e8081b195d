"""What a learning experiment is asked for, the robot, the law and its scatter, and what its study answers."""

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
    from control import StateSpace

    from .axis import AxisPlant
    from .robot import ModelledRobot
else:
    AxisPlant = hint("gtmodel.control.learning.axis", "AxisPlant")
    StateSpace = hint("control", "StateSpace")
    ModelledRobot = hint("gtmodel.control.learning.robot", "ModelledRobot")

Case = Literal["1", "2A", "2B", "3"]
SET = 5  # dampings of the set of models, and frequencies at least
SPACING = 0.5  # of a mode's half width: between two models lies no peak that is 3 % higher
FREQUENCIES = 2001  # of a design at least
PRINTED = ("actuator 1", "actuator 2", "actuator 3")
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class LearningRobot(Options):
    """What the law knows of the robot: a motor loop, and a tool on a spring along each axis behind it.

    >>> gt.control.learning.LearningRobot().axes
    ('x', 'y')
    """

    loop: Annotated[
        Literal["lag", "printed"],
        "a lag behind a delay; or the three printed actuators (6.11), without a tool",
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
                f"expected one for each of one to three axes; found {len(self.frequency)} frequencies and "
                f"{len(self.damping)} dampings", "damping",
            )  # fmt: skip

    @property
    def axes(self) -> tuple[str, ...]:
        """Names."""
        return PRINTED if self.loop == "printed" else AXES[: len(self.frequency)]

    @property
    def along(self) -> tuple[int, ...]:
        """Which side of the square each axis follows, 0 for x and 1 for y: the printed actuators x each."""
        return (0, 0, 0) if self.loop == "printed" else (0, 1, 0)[: len(self.frequency)]

    def mode(self, axis: int) -> tuple[float, float] | None:
        """Frequency [Hz] and damping of an axis' lightest mode; None of an axis without a tool."""
        return None if self.loop == "printed" else (self.frequency[axis], self.damping[axis])

    def tool(self, axis: int) -> StateSpace:
        """The model from the motor side to the tool, which the filter of (7.21) takes."""
        from .axis import tool_model

        return tool_model(self.frequency[axis], self.damping[axis], self.sample_time)

    def plant(self, axis: int, frequency: float = 1.0, damping: float = 1.0) -> AxisPlant:
        """The axis with its tool's frequency and damping times these numbers."""
        from .axis import AxisPlant, flexible_axis  # here: keys of files need no engine
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
    """The law, what it learns from, and for which robots it is to converge.

    >>> gt.control.learning.LearningDesign(case="2B").low_pass
    30.0
    """

    case: Annotated[
        Case, "what is learned from: 1 motors, 2A complementary filter, 2B Kalman filter, 3 the measured tool"
    ] = "1"
    law: Annotated[
        Literal["shift", "inverse", "norm_optimal"], "L = gain q^shift, the model's inverse, or least norm"
    ] = "shift"  # fmt: skip
    gain: Annotated[float, Within(above=0.0, most=2.0), "of L"] = 0.9
    shift: Annotated[
        int | None, Unit("", key="shift_samples"), Within(least=0), "of L; 5 in case 1, else that of the models"
    ] = None
    cutoff: Annotated[
        float | None, Unit("Hz"), Within(above=0.0), "of the low pass in Q; 10 in case 1, else 30"
    ] = None  # fmt: skip
    iterations: Annotated[int, Within(least=1), "after the first run"] = 10
    ramps: Annotated[bool, "the windows Q_w over lead-in and lead-out"] = True
    contraction: Annotated[float, Within(above=0.0, below=1.0), "the bound that Q is designed for"] = CONTRACTION
    lags: Annotated[int, Within(least=1), "of Q on either side, in samples"] = LENGTH
    frequency_share: Annotated[
        float, Within(least=0.0, below=1.0), "by which the tool's frequency may differ either way"
    ] = 0.06
    damping_shares: Annotated[
        tuple[float, float], Within(above=0.0), "between which factors its damping may lie"
    ] = (0.6, 1.6)  # fmt: skip
    slow_cutoff: Annotated[
        tuple[float, ...], Unit("Hz"), Within(above=0.0), "of the complementary filter, per axis; (7.18)"
    ] = (4.5, 2.63, 2.63)
    change: Annotated[float, Within(above=0.0), "weight of the input's change, of the inverse and of least norm"] = 0.1
    effort: Annotated[float, Within(least=0.0), "weight of the input, of least norm"] = 0.001
    largest: Annotated[
        float | None, Unit("m", written="mm"), Within(above=0.0), "modulus of the input, of least norm"
    ] = None  # fmt: skip
    largest_speed: Annotated[
        float | None, Unit("m/s", written="mm/s"), Within(above=0.0), "by which the input changes, of least norm"
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law != "norm_optimal" and (self.largest is not None or self.largest_speed is not None):
            raise ArgumentError("bounds on the input belong to law = norm_optimal", "law")
        if self.damping_shares[0] > self.damping_shares[1]:
            raise ArgumentError("the smaller factor comes first", "damping_shares")

    @property
    def low_pass(self) -> float:
        """The cutoff of Q [Hz]."""
        return self.cutoff if self.cutoff is not None else (10.0 if self.case == "1" else 30.0)

    def models(self, robot: LearningRobot | ModelledRobot, axis: int) -> list[AxisPlant]:
        """The set for which the law is to converge; of motors alone the one model. It is as dense as the light modes
        of the set are narrow."""
        mode = robot.mode(axis)
        if self.case == "1" or mode is None:
            return [robot.plant(axis)]
        made = []
        for b in np.unique(np.geomspace(*self.damping_shares, SET)):
            count = max(SET, int(np.ceil(2 * self.frequency_share / (SPACING * mode[1] * b))) + 1)
            made += [robot.plant(axis, 1 + self.frequency_share * a, b) for a in np.linspace(-1, 1, count)]
        return made

    def grid(self, robot: LearningRobot | ModelledRobot, axis: int) -> int:
        """How many frequencies up to half the sampling rate show the narrowest mode of the set."""
        mode = robot.mode(axis)
        if self.case == "1" or mode is None:
            return FREQUENCIES
        width = mode[0] * mode[1] * (1 - self.frequency_share) * self.damping_shares[0]
        return max(FREQUENCIES, int(np.ceil(0.5 / robot.sample_time / (SPACING * width))) + 1)


@dataclass(frozen=True)
class LearningNoise(Options):
    """How runs differ, and how far the synthetic tool differs from the model; all drawn from the seed.

    >>> gt.control.learning.LearningNoise(seed=3).repeats
    5
    """

    seed: Annotated[int, Within(least=0), "of all that is drawn"] = 1
    motor: Annotated[float, Unit("m", written="um"), Within(least=0.0), "noise of the motor side"] = 1e-6
    gauge: Annotated[float, Unit("m", written="um"), Within(least=0.0), "noise of the measured tool"] = 1e-6
    acceleration: Annotated[float, Unit("m/s2"), Within(above=0.0), "noise of the accelerometer"] = 0.07
    unrepeatable: Annotated[
        float, Unit("m", written="um"), Within(least=0.0), "motion that differs from run to run, below 10 Hz"
    ] = 5e-6
    repeats: Annotated[int, Within(least=3), "identical runs before learning, which show that"] = 5
    frequency_error: Annotated[
        float, Within(least=0.0, below=0.5), "largest share by which the tool's frequency differs from the model"
    ] = 0.03
    damping_error: Annotated[float, Within(least=0.0, below=1.0), "the same of its damping"] = 0.2


@dataclass(frozen=True)
class ElasticTip(Options):
    """A tool on a spring at the plate of a robot that is simulated with its controller, computed torque at samples.

    >>> gt.control.learning.ElasticTip().frequency
    15.0
    """

    start: Annotated[tuple[float, ...], Unit("m"), Long(3), "of the plate"] = (0.5, -0.9, 0.3)
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "of the tool, of which the controller does not know"] = 1.0
    frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "of its spring with the plate held"] = 15.0
    damping: Annotated[float, Within(above=0.0, below=1.0), "damping ratio"] = 0.1
    position_gain: Annotated[float, Unit("1/s2", key="position_gain"), Within(above=0.0), "of the controller, 1/s2"] = (
        900.0
    )
    velocity_gain: Annotated[float, Unit("1/s", key="velocity_gain"), Within(above=0.0), "of the controller, 1/s"] = (
        60.0
    )
    delay: Annotated[float, Unit("s", written="ms"), Within(least=0.0), "until a sample's forces act"] = 0.008


Numbers = Sequence[float]
Courses = Sequence[Sequence[float]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LearningStudy(Study):
    """Runs of a learning law beside what was said of them beforehand, per axis; errors are root mean squares over the
    fully corrected samples. trajectory: reference, input and estimate of the last run."""

    case: Annotated[str, "what is learned from: 1, 2A, 2B, 3"] = ""
    axes: Annotated[Sequence[str], "names, in the order of all that follows"] = ()
    shift: Annotated[Sequence[int], Quantity("", "of L in samples", key="shift_samples")] = ()
    sigma: Annotated[Numbers, "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Numbers, "largest |Q| |1 - L T| over frequency and all models"] = ()
    bound_frequency: Annotated[Numbers, Quantity("Hz", "where that is")] = ()
    first_error: Annotated[Numbers, Quantity("m", "of the estimate, before learning", written="um")] = ()
    floor: Annotated[Numbers, Quantity("m", "predicted before learning", written="um")] = ()
    factor: Annotated[Numbers, "by which the error is to fall, predicted before learning: first error over floor"] = ()
    not_learned: Annotated[Numbers, "share of the first error that Q does not let through, predicted"] = ()
    scatter: Annotated[Numbers, Quantity("m", "part of the floor that does not repeat, predicted", written="um")] = ()
    reached: Annotated[Numbers, Quantity("m", "error of the estimate over the last runs", written="um")] = ()
    error: Annotated[Courses, Quantity("m", "of the estimate, per axis in each run", written="um")] = ()
    predicted: Annotated[Courses, Quantity("m", "the same, predicted before learning", written="um")] = ()
    tool_error: Annotated[
        Courses | None, Quantity("m", "of the true tool, per axis in each run; where it is known", written="um")
    ] = None
    tool_share: Annotated[Numbers | None, "tool's error over the last runs, of that before learning"] = None
    reference_above: Annotated[Numbers, "share of the first error's amplitude above the cutoff of Q"] = ()
    largest_input: Annotated[Numbers, Quantity("m", "modulus of the learned input", written="mm")] = ()
    synthetic: Annotated[str | None, "what made the runs; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f} at "
                            f"{self.bound_frequency[k]:.3g} Hz"))  # fmt: skip
            if not self.floor:  # ended before there was one
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
    """The input for the next run, and what learning will leave; errors are root mean squares of the fully corrected
    samples."""

    axes: Annotated[Sequence[str], "names, in the order of all that follows"] = ()
    case: Annotated[str, "what is learned from: 1, 2A, 2B, 3"] = ""
    error: Annotated[Sequence[float], Quantity("m", "of the estimate in this run", written="um")] = ()
    floor: Annotated[Sequence[float], Quantity("m", "what learning will leave, by the model", written="um")] = ()
    scatter: Annotated[
        Sequence[float] | None, Quantity("m", "between identical runs, learning on; null without them", written="um")
    ] = None
    unexplained: Annotated[
        Sequence[float], "what the model does not make of this run, of the error that it expects before learning"
    ] = ()
    sigma: Annotated[Sequence[float], "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Sequence[float], "largest |Q| |1 - L T| over frequency and all models"] = ()
    learned: Annotated[bool, "whether nothing more can be learned; the input is then that of this run"] = False
    largest_input: Annotated[Sequence[float], Quantity("m", "modulus of the next input", written="mm")] = ()
    synthetic: Annotated[str | None, "what made a synthetic run; null for a measured one"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: error of this run", f"{1e6 * self.error[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: floor", f"{1e6 * self.floor[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f}"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
