"""A robot as plants of its axes: from a model of the language, from a log of all axes, or from printed numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmodel import lang as gt

from ..._lazy import hint
from ..._pickling import Portable
from ...linear.state_space import continuous_poles, frequency_and_damping, held
from ...results import ArgumentError
from ...results.refusal import naming
from .axis import AxisPlant, delayed
from .identified import COLUMNS, EXPLAINED, LEAST, TAPS, identified_axis, identified_tool, pulses
from .options import AXES
from .plants import SAMPLE_TIME, SampledSystem, delayed_lag, stable

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

LIGHT = 0.5  # damping ratio below which a pair of poles is an uncertain mode
SLOW = 0.4  # of half the sampling rate: above it Q passes little, and poles belong to delays and noise
DEAD = 1e-3  # modulus below which a pole belongs to a delay
EXCITED, HELD = 4000, 10  # samples of the identification of a plant's tool, and samples per level


@dataclass(frozen=True, eq=False)
class ModelledRobot(Portable):
    """The law's model of the robot, with a plant for each of one to three axes.

    plants: stable `AxisPlant`s with a common sampling period, for example from `identified_axis`. tools: for each axis
    the model from the motor side to the tool, see `identified_tool`; by default identified from the plant.

    The tool's modes, lightly damped pairs of poles, may differ from the model; `plant` moves them without changing the
    static gain. Raises ArgumentError if the plants do not fit together.

    >>> learning = gt.control.learning
    >>> robot = learning.ModelledRobot([learning.flexible_axis(7.4, 0.2), learning.flexible_axis(11.5, 0.05)])
    >>> robot.axes, [round(x, 3) for x in robot.mode(1)]
    (('x', 'y'), [11.5, 0.05])
    """

    plants: Sequence[AxisPlant]
    tools: Sequence[SampledSystem | StateSpace] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.plants) <= len(AXES) or len(self.tools) not in (0, len(self.plants)):
            raise ArgumentError(
                f"expected one plant (and one tool or none) for each of one to three axes; found {len(self.plants)} "
                f"plants and {len(self.tools)} tools", "plants",
            )  # fmt: skip
        if len({p.sample_time for p in self.plants}) > 1:
            raise ArgumentError("the plants have different sampling periods; use a common one", "plants")
        for k, plant in enumerate(self.plants):
            if "motor" not in plant.signals:
                raise ArgumentError("has no signal 'motor', which is required", f"plants[{k}]")
            for system in plant.signals.values():
                stable(system)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return AXES[: len(self.plants)]

    @property
    def along(self) -> tuple[int, ...]:
        """Direction of the square that each axis follows, 0 for x and 1 for y."""
        return (0, 1, 0)[: len(self.plants)]

    @property
    def sample_time(self) -> float:
        """Sampling period [s]."""
        return self.plants[0].sample_time

    def mode(self, axis: int) -> tuple[float, float] | None:
        """Return frequency [Hz] and damping ratio of an axis' least damped mode; None if it has none."""
        signals = self.plants[axis].signals
        if "tool" not in signals:
            return None
        modes = [
            frequency_and_damping(continuous_poles(pole, self.sample_time))
            for pole in _light(stable(signals["tool"]), self.sample_time)
        ]
        if not modes:
            return None
        frequency, damping = min(modes, key=lambda m: m[0] * m[1])
        return float(frequency), float(damping)

    def tool(self, axis: int) -> SampledSystem | StateSpace:
        """Return the model from the motor side to the tool."""
        if self.tools:
            return self.tools[axis]
        levels = np.random.default_rng(0).normal(size=EXCITED // HELD)
        maps = self.plants[axis].maps(EXCITED)
        u = np.repeat(levels, HELD)
        return identified_tool(maps["motor"](u), maps["tool"](u), self.sample_time)

    def plant(self, axis: int, frequency: float = 1.0, damping: float = 1.0) -> AxisPlant:
        """Return the axis, with frequencies and dampings of its modes multiplied by these factors."""
        nominal = self.plants[axis]
        if frequency == 1.0 and damping == 1.0:
            return nominal
        signals = {name: stable(s) for name, s in nominal.signals.items()}
        for name in ("tool", "acceleration"):  # the tool does not react on the motors
            if name in signals:
                signals[name] = _moved(signals[name], nominal.sample_time, frequency, damping)
        return AxisPlant(signals, nominal.sample_time)


def lag_robot(b: Sequence[float], a: Sequence[float], delay: int, sample_time: float) -> ModelledRobot:
    """Return a robot of controlled actuators b q^-delay / (1 - a q^-1), one per axis, without a tool: Dressler 2012,
    (6.11).

    Raises ArgumentError if a and b differ in length, and as `ModelledRobot`.

    >>> gt.control.learning.lag_robot([0.2], [0.8], delay=3, sample_time=0.004).axes
    ('x',)
    """
    if len(a) != len(b):
        raise ArgumentError(f"must have as many numbers as b, {len(b)}; found {len(a)}", "a")
    return ModelledRobot(
        [AxisPlant({"motor": delayed_lag(*pair, delay, sample_time)}, sample_time) for pair in zip(b, a, strict=True)]
    )


def linear_axis(
    model: gt.Model, reference: str, signals: Mapping[str, str], sample_time: float = SAMPLE_TIME, delay: int = 0
) -> AxisPlant:  # fmt: skip
    """Linearise a model of the language about its start values, with the reference held between samples.

    Args:
        reference: name of the input. signals: the model's variables for "motor" and, if the robot learns from them,
            "tool" and "acceleration". delay: of the reference, in samples.

    Raises ModelError as `gtmodel.linearize`, and ArgumentError if the delay is negative.

    >>> class Loop(gt.Model):
    ...     lag = gt.parameter(0.02, unit="s")
    ...     q = gt.variable(unit="m")
    ...     wanted = gt.input(unit="m")
    ...     def equations(self):
    ...         yield self.lag * gt.der(self.q) == self.wanted - self.q
    >>> axis = gt.control.learning.linear_axis(Loop(), "wanted", {"motor": "q"}, delay=5)
    >>> gt.control.learning.pulse_response(axis.signals["motor"], 7).round(3).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.181]
    """
    from ...simulation.linearize import Linearization

    if delay < 0:
        raise ArgumentError(f"must not be negative; found {delay} samples", "delay")
    A, B, C, D = Linearization(model, reference, list(signals.values())).at(None, None).matrices
    if C.shape[0] != len(signals) or B.shape[1] != 1:
        raise ArgumentError("expected one input and scalar signals; name components of vectors", "signals")
    return AxisPlant(
        {
            name: delayed(SampledSystem(*held(A, B, sample_time), C[k : k + 1], D[k : k + 1], sample_time), delay)
            for k, name in enumerate(signals)
        },
        sample_time,
    )


def _light(system: SampledSystem | StateSpace, sample_time: float) -> list[complex]:
    """Poles of lightly damped modes in the upper half plane."""
    poles = []
    for pole in np.linalg.eigvals(np.asarray(system.A, float)):
        if pole.imag > 0 and abs(pole) > DEAD:
            frequency, damping = frequency_and_damping(continuous_poles(pole, sample_time))
            if damping < LIGHT and frequency < SLOW * 0.5 / sample_time:
                poles.append(complex(pole))
    return poles


def _moved(system: SampledSystem | StateSpace, sample_time: float, frequency: float, damping: float) -> Any:
    """The system in series with a filter of unit static gain that moves its lightly damped modes."""
    from ..._control import control

    moved: Any = system.to_control() if isinstance(system, SampledSystem) else system
    for pole in _light(system, sample_time):
        f, z = frequency_and_damping(continuous_poles(pole, sample_time))
        z = min(z * damping, 1 - 1e-9)
        new = np.exp(2 * np.pi * f * frequency * complex(-z, np.sqrt(1 - z**2)) * sample_time)
        before, after = (np.array([1.0, -2 * p.real, abs(p) ** 2]) for p in (pole, new))
        move = control.ss(control.TransferFunction(before / before.sum() * after.sum(), after, sample_time))
        moved = stable(control.series(moved, move))
    return moved


def identified_robot(
    reference: Any, signals: Mapping[str, Any], sample_time: float = SAMPLE_TIME, order: int | None = None,
    delay: int | None = None,
) -> ModelledRobot:  # fmt: skip
    """Identify a robot from one log, each axis from its own columns; see `identified_axis`.

    Args:
        reference: (N, axes) [m], including the learned input. signals: "motor" and, if measured, "tool" [m] and
            "acceleration" [m/s2], each (N, axes). order, delay: of every axis, as in `identified_axis`.

    Raises ArgumentError if a column follows the reference of another axis instead of its own, if columns do not match,
    and as `identified_axis`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=(200, 2)), 10, axis=0)
    >>> maps = [learning.flexible_axis(f, z).maps(2000)["motor"] for f, z in ((7.4, 0.2), (11.5, 0.05))]
    >>> motor = np.column_stack([T(r[:, k]) for k, T in enumerate(maps)])
    >>> learning.identified_robot(r, {"motor": motor}).axes
    ('x', 'y')
    >>> learning.identified_robot(r, {"motor": motor[:, ::-1]})
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: signals: 'motor' of x follows the reference of y, which explains 100 % of ...
    """
    u = np.asarray(reference, float)
    rows = {name: np.asarray(values, float) for name, values in signals.items()}
    if u.ndim != 2 or not 1 <= u.shape[1] <= len(AXES):
        raise ArgumentError(f"expected (N, axes) with one to three axes; found {u.shape}", "reference")
    for name, values in rows.items():
        if values.shape != u.shape:
            raise ArgumentError(f"'{name}' is {values.shape}; expected {u.shape}, like the reference", "signals")
        _own_reference(u, values, name)
    axes = []
    for k in range(u.shape[1]):
        columns = {name: values[:, k] for name, values in rows.items()}
        with naming({}, before=f"axis {AXES[k]}: "):
            axes.append(identified_axis(u[:, k], columns, sample_time, order, delay))
    return ModelledRobot(axes)


def _own_reference(u: np.ndarray, values: np.ndarray, name: str) -> None:
    """Raise ArgumentError if a column follows the reference of another axis instead of its own."""
    if u.shape[1] < 2 or len(u) < LEAST * TAPS or not (np.all(np.isfinite(u)) and np.all(np.isfinite(values))):
        return
    share = np.array([[pulses(r, y)[2] for r in u.T] for y in values.T])
    for k, row in enumerate(share):
        j = int(np.argmax(row))
        if row[k] < EXPLAINED <= row[j]:
            raise ArgumentError(
                f"'{name}' of {AXES[k]} follows the reference of {AXES[j]}, which explains {100 * row[j]:.0f} % of its "
                f"variance; the reference of {AXES[k]} explains {100 * row[k]:.0f} %: swap the columns, or {COLUMNS}",
                "signals",
            )
