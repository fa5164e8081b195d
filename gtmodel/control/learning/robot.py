"""A robot known by plants of its axes: from a model of the language, from one log of all its axes, or written down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmodel import lang as gt

from ..._lazy import hint
from ...linear.state_space import continuous_poles, frequency_and_damping
from ...results import ArgumentError
from ...results.refusal import naming
from .axis import AxisPlant, delayed
from .identified import COLUMNS, EXPLAINED, LEAST, TAPS, identified_axis, identified_tool, pulses
from .options import AXES
from .plants import SAMPLE_TIME, delayed_lag, stable

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

LIGHT = 0.5  # damping below which a pair of poles is a mode that may differ
SLOW = 0.4  # of half the sampling rate: above, no Q lets much through, and poles are those of delays and noise
DEAD = 1e-3  # modulus below which a pole is a delay
EXCITED, HELD = 4000, 10  # samples, and those of one level, by which a plant's own tool is identified


@dataclass(frozen=True, eq=False)
class ModelledRobot:
    """What the law knows of the robot, by a plant for each of one to three axes.

    plants: `AxisPlant` each, such as `identified_axis` gives, all at one sampling time and stable. tools: of each axis
    the model from the motor side to the tool, see `identified_tool`; identified from the plant itself if left out.

    Modes of the tool, pairs of poles of light damping, may differ from the model; so `plant` moves them, with what
    passes at rest unchanged. Raises ArgumentError for plants that do not fit together.

    >>> learning = gt.control.learning
    >>> robot = learning.ModelledRobot([learning.flexible_axis(7.4, 0.2), learning.flexible_axis(11.5, 0.05)])
    >>> robot.axes, [round(x, 3) for x in robot.mode(1)]
    (('x', 'y'), [11.5, 0.05])
    """

    plants: Sequence[AxisPlant]
    tools: Sequence[StateSpace] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.plants) <= len(AXES) or len(self.tools) not in (0, len(self.plants)):
            raise ArgumentError(
                f"expected one for each of one to three axes; found {len(self.plants)} plants and {len(self.tools)} "
                "tools", "plants",
            )  # fmt: skip
        if len({p.sample_time for p in self.plants}) > 1:
            raise ArgumentError("the plants have sampling times of their own; sample them alike", "plants")
        for k, plant in enumerate(self.plants):
            if "motor" not in plant.signals:
                raise ArgumentError("the plant has no signal 'motor', from which every robot learns", f"plants[{k}]")
            for system in plant.signals.values():
                stable(system)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names."""
        return AXES[: len(self.plants)]

    @property
    def along(self) -> tuple[int, ...]:
        """Which side of the square each axis follows, 0 for x and 1 for y."""
        return (0, 1, 0)[: len(self.plants)]

    @property
    def sample_time(self) -> float:
        """[s]."""
        return self.plants[0].sample_time

    def mode(self, axis: int) -> tuple[float, float] | None:
        """Frequency [Hz] and damping of an axis' lightest mode; None of an axis without one."""
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

    def tool(self, axis: int) -> StateSpace:
        """The model from the motor side to the tool."""
        if self.tools:
            return self.tools[axis]
        levels = np.random.default_rng(0).normal(size=EXCITED // HELD)
        maps = self.plants[axis].maps(EXCITED)
        u = np.repeat(levels, HELD)
        return identified_tool(maps["motor"](u), maps["tool"](u), self.sample_time)

    def plant(self, axis: int, frequency: float = 1.0, damping: float = 1.0) -> AxisPlant:
        """The axis, its modes' frequencies and dampings times these numbers."""
        known = self.plants[axis]
        if frequency == 1.0 and damping == 1.0:
            return known
        made = {name: stable(s) for name, s in known.signals.items()}
        for name in ("tool", "acceleration"):  # the motors do not feel the tool
            if name in made:
                made[name] = _moved(made[name], known.sample_time, frequency, damping)
        return AxisPlant(made, known.sample_time)


def lag_robot(b: Sequence[float], a: Sequence[float], delay: int, sample_time: float) -> ModelledRobot:
    """Controlled actuators b q^-delay / (1 - a q^-1), an axis each, without a tool: Dressler 2012, (6.11).

    Raises ArgumentError where a and b differ in number, and as `ModelledRobot`.

    >>> gt.control.learning.lag_robot([0.2], [0.8], delay=3, sample_time=0.004).axes
    ('x',)
    """
    if len(a) != len(b):
        raise ArgumentError(f"expected as many as b, {len(b)}; found {len(a)}", "a")
    return ModelledRobot(
        [AxisPlant({"motor": delayed_lag(*one, delay, sample_time)}, sample_time) for one in zip(b, a, strict=True)]
    )


def linear_axis(
    model: gt.Model, reference: str, signals: Mapping[str, str], sample_time: float = SAMPLE_TIME, delay: int = 0
) -> AxisPlant:  # fmt: skip
    """An axis of a model of the language, linear about where it starts, its reference held between samples.

    Args:
        reference: name of the input. signals: "motor", and "tool" and "acceleration" where the robot is to learn from
            them, each with the name of a variable of the model. delay: until a reference acts, in samples.

    Raises ModelError as `gtmodel.linearize`, and ArgumentError for a delay that is negative.

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
    import control

    from ...simulation import linearize

    if delay < 0:
        raise ArgumentError(f"a delay is not negative; found {delay} samples", "delay")
    linear = control.c2d(linearize(model, reference, list(signals.values())), sample_time)
    A, B, C, D = (np.asarray(m, float) for m in (linear.A, linear.B, linear.C, linear.D))
    if C.shape[0] != len(signals) or B.shape[1] != 1:
        raise ArgumentError("expected one input, and one number for each signal; name components", "signals")
    return AxisPlant(
        {
            name: delayed(control.StateSpace(A, B, C[k : k + 1], D[k : k + 1], sample_time), delay)
            for k, name in enumerate(signals)
        },
        sample_time,
    )


def _light(system: StateSpace, sample_time: float) -> list[complex]:
    """Poles of the upper half plane of light modes."""
    made = []
    for pole in np.linalg.eigvals(np.asarray(system.A, float)):
        if pole.imag > 0 and abs(pole) > DEAD:
            frequency, damping = frequency_and_damping(continuous_poles(pole, sample_time))
            if damping < LIGHT and frequency < SLOW * 0.5 / sample_time:
                made.append(complex(pole))
    return made


def _moved(system: StateSpace, sample_time: float, frequency: float, damping: float) -> StateSpace:
    """The system behind a filter that takes its light modes away and puts them where they are to be; 1 at rest."""
    import control

    made = system
    for pole in _light(system, sample_time):
        f, z = frequency_and_damping(continuous_poles(pole, sample_time))
        z = min(z * damping, 1 - 1e-9)
        new = np.exp(2 * np.pi * f * frequency * complex(-z, np.sqrt(1 - z**2)) * sample_time)
        before, after = (np.array([1.0, -2 * p.real, abs(p) ** 2]) for p in (pole, new))
        move = control.ss(control.TransferFunction(before / before.sum() * after.sum(), after, sample_time))
        made = stable(control.series(made, move))
    return made


def identified_robot(
    reference: Any, signals: Mapping[str, Any], sample_time: float = SAMPLE_TIME, order: int | None = None,
    delay: int | None = None,
) -> ModelledRobot:  # fmt: skip
    """A robot by plants of its axes, each identified from its own columns of one log, see `identified_axis`.

    Args:
        reference: (N, axes) [m], the learned input included. signals: "motor", and where they were measured "tool" [m]
            and "acceleration" [m/s2], each (N, axes). order, delay: of every axis, as of `identified_axis`.

    Raises ArgumentError where a column follows the reference of another axis and not its own, for columns that do not
    match, and as `identified_axis`.

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
        raise ArgumentError(f"expected (N, axes) of one to three axes; found {u.shape}", "reference")
    for name, values in rows.items():
        if values.shape != u.shape:
            raise ArgumentError(f"'{name}' is {values.shape}; expected {u.shape}, as the reference", "signals")
        _own_reference(u, values, name)
    axes = []
    for k in range(u.shape[1]):
        mine = {name: values[:, k] for name, values in rows.items()}
        with naming({}, before=f"axis {AXES[k]}: "):
            axes.append(identified_axis(u[:, k], mine, sample_time, order, delay))
    return ModelledRobot(axes)


def _own_reference(u: np.ndarray, values: np.ndarray, name: str) -> None:
    """Raises ArgumentError where a column follows the reference of another axis and not its own."""
    if u.shape[1] < 2 or len(u) < LEAST * TAPS or not (np.all(np.isfinite(u)) and np.all(np.isfinite(values))):
        return
    share = np.array([[pulses(r, y)[2] for r in u.T] for y in values.T])
    for k, row in enumerate(share):
        j = int(np.argmax(row))
        if row[k] < EXPLAINED <= row[j]:
            raise ArgumentError(
                f"'{name}' of {AXES[k]} follows the reference of {AXES[j]}, which explains {100 * row[j]:.0f} % of its "
                f"variance; its own explains {100 * row[k]:.0f} %: exchange the columns, or {COLUMNS}",
                "signals",
            )
