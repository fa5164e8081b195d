"""A law run after run on a robot, what a model says of it beforehand, where it ends, and a synthetic robot that
repeats its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ...results import ArgumentError
from .axis import AxisPlant
from .law import LearningLaw, largest_gain, spectral_radius
from .lifted import Array, Lifted
from .options import LearningNoise, LearningRobot
from .references import SquarePath
from .robot import ModelledRobot

REPEATS = 3  # runs without which the scatter is a guess
STAYS = 1e-9  # of the modulus of an eigenvalue from 1
SETTLED = 60  # runs after which what one of them taught has gone, 0.93^60 = 0.013
RISES = (
    "without the ramps Q_w the rows of L that repeat the last sample count in full, and inputs there hardly reach the "
    "output of the run; with input_window sigma is that of the frequency bound"
)
UNEVEN = "a lower cutoff of Q makes it so"


class Rate(NamedTuple):
    """sigma of (7.16), rho of (7.15) or sigma where that bounds it below 1, and in words what they say."""

    sigma: float
    rho: float
    words: str

    @property
    def converges(self) -> bool:
        """Stable, (7.15)."""
        return self.rho < 1

    @property
    def monotone(self) -> bool:
        """The input approaches its limit in every run, (7.16)."""
        return self.sigma < 1


def rate(law: LearningLaw, seen: Lifted) -> Rate:
    """How fast a law converges on a plant, from the input to the estimate; said before the first iteration.

    Raises ArgumentError where it would diverge, (7.15).

    >>> learning = gt.control.learning
    >>> b, a = learning.ACTUATORS[0]
    >>> law = learning.simple_law(825, gain=0.9, shift=5, cutoff=10.0)
    >>> learning.rate(law, learning.lifted(learning.delayed_lag(b, a, 5), 825)).words
    'converges in every run, by a factor of 0.904 or better'
    """
    step = law.map(seen)
    sigma = largest_gain(step)
    if sigma < 1:
        return Rate(sigma, sigma, f"converges in every run, by a factor of {sigma:.3f} or better")
    rho = spectral_radius(step)
    if abs(rho - 1) < STAYS:
        raise ArgumentError(
            "an eigenvalue of Q (I - L T) is 1: a part of the input neither grows nor fades, such as the last samples, "
            "whose effect comes after the run; give the law a Q below 1, in a law of least norm by a weight of the "
            "effort",
            "law",
        )
    if rho >= 1:
        raise ArgumentError(
            f"the law diverges on this plant: an eigenvalue of Q (I - L T) has the modulus {rho:.4g}; lower the cutoff "
            "of Q or the gain, or let the shift be the delay of what is controlled",
            "law",
        )
    ends = law.Q(np.ones(step.size))[[0, -1]]
    why = UNEVEN if not ends.any() else RISES
    return Rate(sigma, rho, f"converges in the end by {rho:.3f}, but not in every run: sigma is {sigma:.3g}; {why}")


class Floor(NamedTuple):
    """What learning leaves of the controlled error, root mean square [m] over the fully corrected samples.

    repeating: the part of the first error that Q does not let through. scatter: of a run against another, with what of
    it is learned. total: both. course: (runs + 1,) total after each run. before: of the first run. rest: (N,) error of
    the repeating part [m]. clipped: whether bounds on the input hold where it ends.
    """

    repeating: float
    scatter: float
    total: float
    course: Array
    before: float
    rest: Array
    clipped: bool = False

    @property
    def share(self) -> float:
        """The part of the first error that cannot be learned."""
        return self.repeating / self.before if self.before else 0.0


def floor(
    law: LearningLaw, seen: Lifted, first_error: Any, corrected: slice, runs: int, repeats: Any = None, *,
    update: Callable[[Array, Array], Array] | None = None, end: Array | None = None, clipped: bool = False,
) -> Floor:  # fmt: skip
    """What a law will leave, from the error (N,) of the first run, or its mean over several.

    Args:
        seen: from the input to the estimate, by the model. corrected: the samples that count, (7.25).
        runs: how many iterations. repeats: (m, N) estimates of m identical runs, m at least 3; none if left out.
        update, end: of a law within bounds, the next input from input and error, and the input (N,) where it ends;
            clipped: whether it lies at the bounds there.

    The repeating part is that of the fixed point. The scatter of a run is independent of that of others: learned from
    one run it adds to the next ones' error, |Q L|^2 / (1 - |Q (1 - L T)|^2) times over frequency, with what T passes.
    Bounds make the scatter no larger. Raises ArgumentError for fewer repeats, and where the law has no fixed point.

    >>> learning = gt.control.learning
    >>> law = learning.simple_law(300, 0.9, 5, 10.0)
    >>> T = learning.lifted(learning.delayed_lag(*learning.ACTUATORS[0], 5), 300)
    >>> left = learning.floor(law, T, np.ones(300), slice(100, 200), runs=5)
    >>> left.total < left.before, len(left.course)
    (True, 6)
    """
    e0 = np.asarray(first_error, float)
    rest = e0 - seen(law.fixed_point(seen, e0) if end is None else end)
    repeating = _rms(rest[corrected])
    u, systematic, noise = np.zeros_like(e0), [], _amplified(law, seen, repeats, corrected, runs)
    for _ in range(runs + 1):
        e = e0 - seen(u)
        systematic.append(_rms(e[corrected]))
        u = (update or law.update)(u, e)
    scatter, last = noise[:-1], float(noise[-1])
    course = np.hypot(systematic, scatter)
    return Floor(repeating, last, float(np.hypot(repeating, last)), course, _rms(e0[corrected]), rest, clipped)


def _amplified(law: LearningLaw, seen: Lifted, repeats: Any, corrected: slice, runs: int) -> Array:
    """Scatter (runs + 2,) of the error in each run, and in the limit [m], from runs that were identical."""
    if repeats is None:
        return np.zeros(runs + 2)
    rows = np.asarray(repeats, float)
    if rows.ndim != 2 or len(rows) < REPEATS:
        raise ArgumentError(f"the scatter wants {REPEATS} identical runs or more; found {rows.shape}", "repeats")
    apart = (rows - rows.mean(axis=0)) * np.sqrt(len(rows) / (len(rows) - 1))
    # each repeat's own scatter as if it were learned from: u(k+1) = Q (I - L T) u(k) - Q L n(k), all n alike
    # and independent; so the squares of what each one leaves add up
    step = law.map(seen)
    own = float(np.mean([_rms(n[corrected]) ** 2 for n in apart]))
    learned = -law.Q(law.L(apart.T))
    squares, total = [own], 0.0
    for _ in range(SETTLED):
        total += float(np.mean(seen(learned)[corrected] ** 2))
        squares.append(own + total)
        learned = step(learned)
    made = np.sqrt(np.array(squares))
    return np.append(made[: runs + 1] if runs < SETTLED else np.pad(made, (0, runs + 1 - len(made)), "edge"), made[-1])


@dataclass(frozen=True, eq=False)
class Course:
    """Runs of a robot: inputs (runs + 1, N), the controlled errors (runs + 1, N), and where it stopped early, why."""

    inputs: Array
    errors: Array
    words: str = ""


def learn(law: LearningLaw, first_error: Any, seen: Lifted, runs: int, noise: Sequence[Any] = ()) -> Course:
    """Run a law on a linear plant: e(k) = first_error - seen u(k) - noise(k), u(0) = 0.

    Args:
        first_error: (N,) of the run without input. noise: (runs + 1, N), or none.

    >>> learning = gt.control.learning
    >>> law = learning.simple_law(300, 0.9, 5, 10.0)
    >>> T = learning.lifted(learning.delayed_lag(*learning.ACTUATORS[0], 5), 300)
    >>> run = learning.learn(law, np.ones(300), T, runs=3)
    >>> run.errors.shape
    (4, 300)
    """
    e0 = np.asarray(first_error, float)
    u, inputs, errors = np.zeros_like(e0), [], []
    for k in range(runs + 1):
        e = e0 - seen(u) - (np.asarray(noise[k], float) if len(noise) else 0.0)
        inputs.append(u)
        errors.append(e)
        u = law.update(u, e)
    return Course(np.array(inputs), np.array(errors))


def above_cutoff(signal: Any, cutoff: float, sample_time: float) -> float:
    """Share of the amplitude of a signal (N,) above a frequency [Hz], root of the share of its energy.

    >>> t = 0.004 * np.arange(1000)
    >>> float(round(gt.control.learning.above_cutoff(np.sin(2 * np.pi * 5 * t), 10.0, 0.004), 6))
    0.0
    """
    x = np.asarray(signal, float)
    energy = np.abs(np.fft.rfft(x)) ** 2
    f = np.fft.rfftfreq(len(x), sample_time)
    total = float(energy[1:].sum())
    return float(np.sqrt(energy[f > cutoff].sum() / total)) if total > 0 else 0.0


def _rms(x: Any) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


SLOW = 25  # samples over which the unrepeatable motion is averaged: below 10 Hz at 4 ms


class RepeatedMotion(Protocol):
    """A robot that repeats a motion with another input. names: of its axes; sample_time: [s]; reference: (N, axes) [m];
    corrected: the samples that count; synthetic: what made its runs."""

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def sample_time(self) -> float: ...
    @property
    def reference(self) -> np.ndarray: ...
    @property
    def corrected(self) -> slice: ...
    @property
    def synthetic(self) -> str: ...

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) of the next run, with an input (N, axes) added to the reference."""
        ...


class SyntheticExperiment:
    """Linear axes along a square, with white noise of the sensors and slow motion that differs from run to run.

    robot: as the law knows it; the true tool differs from it as noise says. Each run draws from one generator.

    >>> learning = gt.control.learning
    >>> experiment = learning.SyntheticExperiment(learning.LearningRobot(), learning.SquarePath())
    >>> run = experiment.run(np.zeros((825, 2)))
    >>> run["tool"].shape
    (825, 2)
    """

    def __init__(
        self, robot: LearningRobot | ModelledRobot, path: SquarePath, noise: LearningNoise | None = None
    ) -> None:
        self.noise = noise or LearningNoise()
        self.names, self.sample_time = robot.axes, robot.sample_time
        both = path.samples(robot.sample_time)
        self.reference = both[:, list(robot.along)]
        self.corrected = slice(path.ramp, path.ramp + path.corrected)
        self.generator = np.random.default_rng(self.noise.seed)
        off = self.generator.uniform(-1, 1, (len(self.names), 2))
        self.plants: list[AxisPlant] = [
            robot.plant(k, 1 + self.noise.frequency_error * f, 1 + self.noise.damping_error * z)
            for k, (f, z) in enumerate(off)
        ]
        self.maps = [plant.maps(path.size) for plant in self.plants]
        n = self.noise
        self.deviations = {"motor": n.motor, "tool": n.gauge, "acceleration": n.acceleration}
        self.synthetic = (
            f"linear axes, seed {n.seed}; noise {1e6 * n.motor:g} um of the motors, {n.acceleration:g} m/s2 of the "
            f"accelerometer, {1e6 * n.gauge:g} um of the gauges, {1e6 * n.unrepeatable:g} um unrepeatable"
        )

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) with an input (N, axes) added to the reference; "true tool" without noise."""
        draw, size = self.generator, len(self.reference)
        made: dict[str, list[np.ndarray]] = {}
        for k, maps in enumerate(self.maps):
            slow = np.convolve(draw.normal(size=size + SLOW - 1), np.ones(SLOW) / np.sqrt(SLOW), "valid")
            at = self.reference[:, k] + inputs[:, k] + self.noise.unrepeatable * slow
            for name, T in maps.items():
                clean = T(at)
                made.setdefault(name, []).append(clean + self.deviations[name] * draw.normal(size=size))
                if name == "tool":
                    made.setdefault("true tool", []).append(clean)
        return {name: np.column_stack(columns) for name, columns in made.items()}
