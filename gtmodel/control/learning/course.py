"""Runs of a learning law, the rate and remaining error predicted by a model, and a synthetic robot for the runs."""

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

REPEATS = 3  # fewest runs for an estimate of the scatter
STAYS = 1e-9  # distance of an eigenvalue's modulus from 1 below which it counts as 1
SETTLED = 60  # runs after which the contribution of one run has decayed, 0.93^60 = 0.013
RISES = (
    "without the ramps Q_w the rows of L that repeat the last sample have full weight, but inputs there hardly reach "
    "the output of the run; with input_window sigma equals the frequency bound"
)
UNEVEN = "lower the cutoff of Q for monotone convergence"


class Rate(NamedTuple):
    """sigma of (7.16), rho of (7.15) (or sigma as its bound if that is below 1), and a sentence about them."""

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
    """Compute the rate of convergence of a law on a plant from the input to the estimate, before any iteration.

    Raises ArgumentError if the law would diverge, (7.15).

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
            "an eigenvalue of Q (I - L T) is 1: a part of the input neither grows nor decays, for example the last "
            "samples, whose effect comes after the run; use a Q below 1, in a norm-optimal law with a weight of the "
            "effort",
            "law",
        )
    if rho >= 1:
        raise ArgumentError(
            f"the law diverges on this plant: an eigenvalue of Q (I - L T) has the modulus {rho:.4g}; lower the cutoff "
            "of Q or the gain, or set the shift to the delay of the controlled plant",
            "law",
        )
    ends = law.Q(np.ones(step.size))[[0, -1]]
    why = UNEVEN if not ends.any() else RISES
    return Rate(sigma, rho, f"converges with {rho:.3f} in the end, but not in every run: sigma is {sigma:.3g}; {why}")


class Floor(NamedTuple):
    """Remaining error after learning, root mean square [m] over the fully corrected samples.

    repeating: part of the first error that Q does not pass. scatter: differences between runs, including the effect of
    learning from them. total: both. course: (runs + 1,) total after each run. before: error of the first run. rest:
    (N,) repeating error [m]. clipped: whether the final input is at its bounds.
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
        """Share of the first error that cannot be learned."""
        return self.repeating / self.before if self.before else 0.0


def floor(
    law: LearningLaw, seen: Lifted, first_error: Any, corrected: slice, runs: int, repeats: Any = None, *,
    update: Callable[[Array, Array], Array] | None = None, end: Array | None = None, clipped: bool = False,
) -> Floor:  # fmt: skip
    """Predict the remaining error of a law from the error (N,) of the first run, or the mean over several runs.

    Args:
        seen: model from the input to the estimate. corrected: the samples to evaluate, (7.25).
        runs: number of iterations. repeats: (m, N) estimates of m identical runs, m at least 3; optional.
        update, end: for a law with bounds, the next input from input and error, and the final input (N,); clipped:
            whether the final input is at the bounds.

    The repeating part is the error at the fixed point. The scatter is independent from run to run: what is learned from
    one run adds to the error of the following runs, by |Q L|^2 / (1 - |Q (1 - L T)|^2) over frequency, passed through
    T. Bounds do not increase the scatter. Raises ArgumentError if there are fewer repeats or no fixed point.

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
    """Scatter (runs + 2,) of the error in each run and in the limit [m], from identical runs."""
    if repeats is None:
        return np.zeros(runs + 2)
    rows = np.asarray(repeats, float)
    if rows.ndim != 2 or len(rows) < REPEATS:
        raise ArgumentError(f"the scatter needs {REPEATS} or more identical runs; found {rows.shape}", "repeats")
    apart = (rows - rows.mean(axis=0)) * np.sqrt(len(rows) / (len(rows) - 1))
    # u(k+1) = Q (I - L T) u(k) - Q L n(k), with independent n of the same distribution: their contributions to
    # the squared error add up
    step = law.map(seen)
    direct = float(np.mean([_rms(n[corrected]) ** 2 for n in apart]))
    learned = -law.Q(law.L(apart.T))
    squares, total = [direct], 0.0
    for _ in range(SETTLED):
        total += float(np.mean(seen(learned)[corrected] ** 2))
        squares.append(direct + total)
        learned = step(learned)
    rms = np.sqrt(np.array(squares))
    return np.append(rms[: runs + 1] if runs < SETTLED else np.pad(rms, (0, runs + 1 - len(rms)), "edge"), rms[-1])


@dataclass(frozen=True, eq=False)
class Course:
    """Runs of a robot: inputs (runs + 1, N), controlled errors (runs + 1, N), and the reason of an early stop."""

    inputs: Array
    errors: Array
    words: str = ""


def learn(law: LearningLaw, first_error: Any, seen: Lifted, runs: int, noise: Sequence[Any] = ()) -> Course:
    """Simulate a law on a linear plant: e(k) = first_error - seen u(k) - noise(k), u(0) = 0.

    Args:
        first_error: (N,) of the run without input. noise: (runs + 1, N), or empty.

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
    """Return the share of a signal's (N,) amplitude above a frequency [Hz], the square root of the share of energy.

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


SLOW = 25  # samples of the moving average of the unrepeatable motion: below 10 Hz at 4 ms


class RepeatedMotion(Protocol):
    """Interface of a robot that repeats a motion with different inputs. names: of its axes; sample_time: [s];
    reference: (N, axes) [m]; corrected: the samples to evaluate; synthetic: origin of synthetic runs."""

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
        """Return the signals (N, axes) by name of a run with an input (N, axes) added to the reference."""
        ...


class SyntheticExperiment:
    """Linear axes along a square, with white sensor noise and slow motion that differs from run to run.

    robot: the model known to the law; the true tool differs from it according to `noise`. All runs draw from the same
    generator.

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
        self.reference = path.samples(robot.sample_time)[:, list(robot.along)]
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
            f"linear axes, seed {n.seed}; noise: motors {1e6 * n.motor:g} um, accelerometer {n.acceleration:g} m/s2, "
            f"gauges {1e6 * n.gauge:g} um; unrepeatable motion {1e6 * n.unrepeatable:g} um"
        )

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Return the signals (N, axes) by name of a run with an input (N, axes); "true tool" is without noise."""
        draw, size = self.generator, len(self.reference)
        signals: dict[str, list[np.ndarray]] = {}
        for k, maps in enumerate(self.maps):
            slow = np.convolve(draw.normal(size=size + SLOW - 1), np.ones(SLOW) / np.sqrt(SLOW), "valid")
            command = self.reference[:, k] + inputs[:, k] + self.noise.unrepeatable * slow
            for name, T in maps.items():
                clean = T(command)
                signals.setdefault(name, []).append(clean + self.deviations[name] * draw.normal(size=size))
                if name == "tool":
                    signals.setdefault("true tool", []).append(clean)
        return {name: np.column_stack(columns) for name, columns in signals.items()}
