"""Logs of a robot that was never measured: motion, quantised positions and noisy efforts, marked as synthetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from gtmodel.compiler.causal import compile_causal
from gtmodel.lang import Model, ModelError
from gtmodel.lang.units import rate_unit
from gtmodel.measurements import smooth_motion
from gtmodel.results import ArgumentError, Status, Trajectory

from .tracking import Tracking

Array = np.ndarray


@dataclass(frozen=True)
class Sensors:
    """What comes between a motion and its log.

    `position_step` is the quantisation of the known variable [its unit], `effort_step` that of the targets, 0 for none.
    `effort_noise` is the standard deviation of the noise of each target, one number or one each; `effort_colour` the
    correlation of neighbouring samples of that noise, a first-order autoregression (0: white, the same standard
    deviation). Raises ArgumentError for negative sizes and a colour outside [0, 1).

    >>> gt.identify.Sensors(effort_noise=30.0, effort_colour=0.8).note
    'effort noise 30 (AR(1) 0.8), position step 1e-06, effort step 0, SI units'
    """

    position_step: float = 1e-6
    effort_noise: float | tuple[float, ...] = 0.0
    effort_colour: float = 0.0
    effort_step: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.position_step, self.effort_step, *np.atleast_1d(self.effort_noise))
        if min(sizes) < 0 or not 0 <= self.effort_colour < 1:
            raise ArgumentError(
                f"steps and noise must not be negative, and the colour must lie in [0, 1); found {self}"
            )

    @property
    def note(self) -> str:
        """One line on quantisation and noise."""
        colour = f"AR(1) {self.effort_colour:g}" if self.effort_colour else "white"
        noise = ", ".join(f"{x:g}" for x in np.atleast_1d(self.effort_noise))
        steps = f"position step {self.position_step:g}, effort step {self.effort_step:g}"
        return f"effort noise {noise} ({colour}), {steps}, SI units"


class LogSimulator:
    """Logs of one motion of a plant, drawn by seed: the motion and the efforts are computed once.

    Args:
        model: the plant, with its true parameters.
        reference: (n, *shape) of the known variable at multiples of sample_time.
        sample_time: of the log [s].
        known, targets: the measured position and the measured efforts, by name.
        tracking: how the axes follow the reference; None: exactly.
        branches: as for `Model.causal`.

    `truth` is a Trajectory with the exact position, its two derivatives and the efforts; it can be pickled and so can
    this object. Raises ModelError where the motion leaves the reach of the robot, with the time, and ArgumentError for
    a tracking of another sample time.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> q = 0.1 * np.sin(2 * np.pi * np.arange(0.0, 2.0, 0.004))
    >>> simulator = gt.identify.LogSimulator(Axis(), q)
    >>> simulator.draw(1, gt.identify.Sensors(effort_noise=0.5)).synthetic
    'seed 1, effort noise 0.5 (white), position step 1e-06, effort step 0, SI units'
    """

    def __init__(
        self,
        model: Model,
        reference: Array,
        sample_time: float = 0.004,
        known: str = "q",
        targets: str = "tau",
        tracking: Tracking | None = None,
        branches: Any = None,
    ) -> None:
        reference = np.asarray(reference, dtype=float)
        rows = reference.reshape(len(reference), -1)
        if tracking is not None and not np.isclose(tracking.sample_time, sample_time, rtol=1e-9, atol=0):
            raise ArgumentError(
                f"the tracking was identified at {tracking.sample_time:g} s, the log is to have {sample_time:g} s; "
                "take the same sample time"
            )
        time = sample_time * np.arange(len(rows), dtype=float)
        motion = smooth_motion(time, rows if tracking is None else tracking.follow(rows))
        q, rate, acceleration = (x.reshape(reference.shape) for x in motion)
        given = {known: q, f"der({known})": rate, f"der({known},2)": acceleration}
        f = compile_causal(model, known, targets, branches=branches)
        efforts, status = f(*[given[s.name] for s in f.inputs])
        bad = np.flatnonzero(status != Status.OK)
        if bad.size:
            raise ModelError(
                f"at {time[bad[0]]:g} s of the motion {Status(int(status[bad[0]])).message}; take a smaller range"
            )
        signal = {s.name: s for s in f.inputs}[known]
        unit, effort = ("1" if u == "?" else u for u in (signal.unit, f.outputs[0].unit))  # joints of both kinds
        units = {known: unit, targets: effort}
        units |= {name: rate_unit(unit, k) for k, name in ((1, f"der({known})"), (2, f"der({known},2)"))}
        self.known, self.targets, self.sample_time = known, targets, sample_time
        self.truth = Trajectory(time, {**given, targets: efforts}, units, synthetic="exact motion, no noise")

    def draw(self, seed: int | np.random.Generator, sensors: Sensors) -> Trajectory:
        """A log: quantised position and noisy efforts, marked as synthetic with seed and noise. Same seed, same log."""
        rng = np.random.default_rng(seed)
        position, efforts = self.truth[self.known], self.truth[self.targets]
        noise = _noise(rng, efforts.reshape(len(efforts), -1).shape, sensors).reshape(efforts.shape)
        log = {
            self.known: _quantised(position, sensors.position_step),
            self.targets: _quantised(efforts + noise, sensors.effort_step),
        }
        label = f"seed {seed}" if isinstance(seed, (int, np.integer)) else "seed of a Monte Carlo"
        units = {name: self.truth.unit(name) for name in log}
        return Trajectory(self.truth.time, log, units, synthetic=f"{label}, {sensors.note}")


def _quantised(values: Array, step: float) -> Array:
    return np.round(values / step) * step if step > 0 else values


def _noise(rng: np.random.Generator, shape: Sequence[int], sensors: Sensors) -> Array:
    size = np.broadcast_to(np.asarray(sensors.effort_noise, dtype=float), (shape[1],))
    white, c = rng.normal(size=tuple(shape)), sensors.effort_colour
    if not c:
        return size * white
    white[1:] *= np.sqrt(1 - c**2)  # the first row is drawn from the stationary distribution
    return size * np.asarray(scipy.signal.lfilter([1.0], [1.0, -c], white, axis=0))
