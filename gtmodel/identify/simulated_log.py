"""Synthetic logs of a robot: reference motions, carts that follow them, quantised positions and noisy efforts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from gtmodel.compiler.causal import compile_causal
from gtmodel.lang.units import rate_unit
from gtmodel.measurements import smooth_motion
from gtmodel.results import Trajectory

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..linear.response import late_lag
from ..measurements import Column, read_log
from ..results import ArgumentError, Status, naming
from ..results.trajectory_files import PathLike
from .options import SyntheticLog

Array = np.ndarray


@dataclass(frozen=True)
class Tracking:
    """How axes follow their references: q_m = b z^-delay / (1 - a z^-1) q_r (Dressler 2012, eqs. (6.10) and (6.11)).

    `b` and `a` have one number per axis; `delay` is in samples of `sample_time` [s]. The filter acts on the deviation
    from the first reference, so that a robot at rest stays at rest: the printed gains b / (1 - a) are 0.999, 0.996 and
    1.010. Raises ArgumentError for an unstable filter, unequal numbers of a and b, and a negative delay.

    >>> tracking = gt.identify.Tracking(b=(0.5,), a=(0.5,), delay=1)
    >>> tracking.follow(np.array([[1.0], [2.0], [2.0], [2.0]]))[:, 0]
    array([1.  , 1.  , 1.5 , 1.75])
    """

    b: tuple[float, ...]
    a: tuple[float, ...]
    delay: int
    sample_time: float = 0.004

    def __post_init__(self) -> None:
        if len(self.a) != len(self.b) or self.delay < 0 or not all(abs(a) < 1 for a in self.a):
            raise ArgumentError(
                f"tracking takes one a, below 1 in size, for each b, and a delay of 0 or more samples; found "
                f"a = {self.a}, b = {self.b}, delay = {self.delay}"
            )

    def follow(self, reference: Array) -> Array:
        """Positions (n, axes) of the axes for references (n, axes), at rest before the first row."""
        reference = np.asarray(reference, dtype=float)
        if reference.ndim != 2 or reference.shape[1] != len(self.a):
            raise ArgumentError(
                f"tracking of {len(self.a)} axes takes references (n, {len(self.a)}); found {reference.shape}"
            )
        moved = reference - reference[0]
        columns = [late_lag(u, a, b, self.delay) for u, a, b in zip(moved.T, self.a, self.b, strict=True)]
        return np.stack(columns, axis=1) + reference[0]


APART = 0.15  # relative difference between the frequencies of neighbouring axes
CLOSED = 1e-9  # relative to the motion: allowed gap between the ends of a repeated motion


def multisine(
    time: Array,
    centre: Array,
    half_range: Array,
    frequencies: Array,
    seed: int,
    ramp: float = 1.0,
) -> Array:
    """Return sums of sines (n, k) about `centre` (k,) at the instants `time` (n,) [s], at rest there at both ends.

    Dressler 2012, section 6.2, combines fast and slow motion in one experiment. Here all `frequencies` [Hz] have the
    same velocity amplitude, and random phases drawn with `seed`; the sum stays within `half_range` (k,) of the centre.
    The frequencies differ slightly between the coordinates. The motion grows and fades over the first and last `ramp`
    seconds with three continuous derivatives.

    Raises ArgumentError if the ramp is longer than half of the time, if there are no frequencies, and if one is not
    positive.

    >>> time = np.arange(0.0, 8.0, 0.004)
    >>> q = gt.identify.multisine(time, np.array([1.0, 2.0]), np.array([0.4, 0.1]), np.array([0.5, 1.1]), seed=1)
    >>> q.shape, q[0], np.abs(q - q[0]).max(axis=0).round(3)
    ((2000, 2), array([1., 2.]), array([0.4, 0.1]))
    """
    time, f = np.asarray(time, dtype=float), np.asarray(frequencies, dtype=float)
    if f.ndim != 1 or not f.size or not np.all((f > 0) & np.isfinite(f)):
        raise ArgumentError(f"expected one or more [Hz], above 0; found {f.tolist()}", "frequencies")
    length = float(time[-1] - time[0])
    if not 0 < 2 * ramp <= length:
        raise ArgumentError(f"a motion of {length:g} s is too short for two ramps of {ramp:g} s; take a shorter ramp")
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, (len(f), len(centre)))
    # slightly different frequencies on each axis, so that no two axes have the same pattern; none below a half
    spread = min(APART, 1 / max(1, len(centre) - 1))
    by_axis = f[:, None] * (1 + spread * (np.arange(len(centre)) - (len(centre) - 1) / 2))
    sines = np.sum(np.sin(2 * np.pi * by_axis * time[:, None, None] + phases) / by_axis, axis=1)
    fade = _rise((time - time[0]) / ramp) * _rise((time[-1] - time) / ramp)
    shape = fade[:, None] * sines
    return np.asarray(centre, dtype=float) + np.asarray(half_range, dtype=float) * shape / np.max(np.abs(shape), axis=0)


def _rise(x: Array) -> Array:
    """From 0 to 1 over [0, 1] with three continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)


def read_motion(path: PathLike, robot: Model, synthetic: SyntheticLog) -> Array:
    """Read the rows (n, ...) of the reference variable from a CSV or MATLAB file, as `motion` of `synthetic_study`.

    The file has the columns of the variable in SI, like the trajectory.csv of an excitation; `synthetic` names the
    variable and the sample time. Raises ArgumentError if the robot lacks the variable, the file lacks a column, or the
    sample times differ.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> time = 0.004 * np.arange(1000)
    >>> T = gt.identify.multisine(time, robot.home, np.full(3, 0.1), np.array([0.5, 1.1]), seed=1)
    >>> gt.Trajectory(time, {"T": T}, {"T": "m"}).to_csv("trajectory.csv")
    >>> gt.identify.read_motion("trajectory.csv", robot, gt.identify.SyntheticLog()).shape
    (1000, 3)
    """
    _, unit = _reference(robot, synthetic)
    columns = {synthetic.reference: Column(synthetic.reference, unit)}
    with naming("motion", ValueError):  # errors of the log or of a unit
        recordings = read_log(path, columns, sample_time=synthetic.sample_time)
    return recordings[0].trajectory[synthetic.reference]


def _reference(robot: Model, synthetic: SyntheticLog) -> tuple[tuple[int, ...], str]:
    """Shape and unit of the reference variable. Raises ArgumentError."""
    flat = flat_of(robot)
    with naming("synthetic.reference", ModelError):
        shape, indices, order = flat.lookup(synthetic.reference)
    return shape, flat.unit_of(indices[0], order)


def reference_motion(known: str, s: SyntheticLog, plant: Model, seed: int, motion: Array | None = None) -> Array:
    """(n, ...) of the known variable at the sample times, from sines of that seed or from rows of the reference.

    Raises ArgumentError for an unknown variable, rows of another shape, and a motion outside the workspace.
    """
    shape, unit = _reference(plant, s)
    rows = _sines(s, shape, plant, seed) if motion is None else _repeated(s, np.asarray(motion, float), shape, unit)
    if s.reference == known:
        return rows
    with naming("synthetic.reference", ModelError, TypeError):
        function = plant.causal(known=s.reference, targets=known)
        outputs, status = function(rows)
    bad = np.flatnonzero(status != Status.OK)
    if bad.size:
        argument, hint = ("motion", "move it closer to the home pose") if motion is not None else (
            "synthetic.half_range", "take a smaller half_range, or another centre")  # fmt: skip
        raise ArgumentError(
            f"the motion leaves the workspace of the robot at {bad[0] * s.sample_time:g} s "
            f"({Status(int(status[bad[0]])).message}); {hint}",
            argument,
        )
    return outputs


def _repeated(s: SyntheticLog, rows: Array, shape: tuple[int, ...], unit: str) -> Array:
    if rows.shape[1:] != shape:
        wide = rows.shape[1] if rows.ndim > 1 else 1
        raise ArgumentError(f"has {wide} columns of '{s.reference}'; expected {shape[0] if shape else 1}", "motion")
    if s.repeats == 1:
        return rows
    gap = float(np.max(np.abs(rows[-1] - rows[0])))
    if gap > CLOSED * max(1.0, float(np.max(np.abs(rows)))):
        raise ArgumentError(
            f"the motion ends {gap:.3g} {unit} from its beginning and cannot be repeated {s.repeats} times; use a "
            "closed motion, or repeats = 1",
            "synthetic.repeats",
        )
    return np.concatenate([*[rows[:-1]] * s.repeats, rows[-1:]])


def _sines(s: SyntheticLog, shape: tuple[int, ...], plant: Model, seed: int) -> Array:
    count = shape[0] if shape else 1
    home = getattr(plant, "home", None) if s.reference == "T" else None
    centre = s.centre if s.centre is not None else home
    if centre is None or np.size(centre) != count:
        raise ArgumentError(f"expected {count} numbers, the centre of the sines of '{s.reference}'", "synthetic.centre")
    half = np.atleast_1d(np.asarray(s.half_range, dtype=float))
    if half.size not in (1, count):
        raise ArgumentError(f"has {half.size} numbers; expected one, or {count}", "synthetic.half_range")
    if not s.frequencies:
        raise ArgumentError("is empty; expected at least one frequency", "synthetic.frequencies")
    time = s.sample_time * np.arange(round(s.duration / s.sample_time))
    with naming("synthetic.ramp", ValueError):
        rows = multisine(time, np.asarray(centre, dtype=float), np.broadcast_to(half, (count,)),
                         np.array(s.frequencies), seed, s.ramp)  # fmt: skip
    return rows.reshape(len(rows), *shape)


@dataclass(frozen=True)
class Sensors:
    """Quantisation and noise between a motion and its log.

    `position_step` is the quantisation of the known variable [its unit], `effort_step` that of the targets; 0 for none.
    `effort_noise` is the standard deviation of the noise, one number for all targets or one each. `effort_colour` is
    the correlation of neighbouring noise samples, a first-order autoregression with the same standard deviation (0:
    white). Raises ArgumentError for negative sizes and a colour outside [0, 1).

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
        """Quantisation and noise in one line."""
        colour = f"AR(1) {self.effort_colour:g}" if self.effort_colour else "white"
        noise = ", ".join(f"{x:g}" for x in np.atleast_1d(self.effort_noise))
        steps = f"position step {self.position_step:g}, effort step {self.effort_step:g}"
        return f"effort noise {noise} ({colour}), {steps}, SI units"


class LogSimulator:
    """Logs of one motion of a plant, drawn by seed; the motion and the efforts are computed once.

    Args:
        model: the plant, with its true parameters.
        reference: (n, *shape) of the known variable at multiples of sample_time.
        sample_time: of the log [s].
        known, targets: names of the measured position and the measured efforts.
        tracking: how the axes follow the reference; None for exactly.
        branches: as for `Model.causal`.

    `truth` is a Trajectory with the exact position, its two derivatives and the efforts. It can be pickled, and so can
    the simulator. Raises ModelError if the motion leaves the workspace (naming the time), and ArgumentError if
    `tracking` has another sample time.

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
                f"the tracking was identified at {tracking.sample_time:g} s, but the log has {sample_time:g} s; "
                "use the same sample time"
            )
        time = sample_time * np.arange(len(rows), dtype=float)
        motion = smooth_motion(time, rows if tracking is None else tracking.follow(rows))
        q, rate, acceleration = (x.reshape(reference.shape) for x in motion)
        signals = {known: q, f"der({known})": rate, f"der({known},2)": acceleration}
        f = compile_causal(model, known, targets, branches=branches)
        efforts, status = f(*[signals[s.name] for s in f.inputs])
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
        self.truth = Trajectory(time, {**signals, targets: efforts}, units, synthetic="exact motion, no noise")

    def draw(self, seed: int | np.random.Generator, sensors: Sensors) -> Trajectory:
        """Return a log: quantised position and noisy efforts, marked as synthetic. The same seed gives the same log."""
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
    white[1:] *= np.sqrt(1 - c**2)  # the first row has the stationary distribution
    return size * np.asarray(scipy.signal.lfilter([1.0], [1.0, -c], white, axis=0))
