"""Reference motions for synthetic experiments: fast and slow sines from rest to rest, or a motion that is given."""

from __future__ import annotations

import numpy as np

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..measurements import Column, read_log
from ..results import ArgumentError, Status, naming
from ..results.trajectory_files import PathLike
from .options import SyntheticLog

Array = np.ndarray

APART = 0.15  # between the frequencies of neighbouring axes, as a share of them
CLOSED = 1e-9  # of the motion's size: how far a motion that repeats may end from where it begins


def multisine(
    time: Array,
    centre: Array,
    half_range: Array,
    frequencies: Array,
    seed: int,
    ramp: float = 1.0,
) -> Array:
    """Sums of sines (n, k) at the instants `time` (n,) [s] about `centre` (k,), which begin and end at rest there.

    Dressler 2012, section 6.2, combines fast and slow motion in one experiment: here all `frequencies` [Hz] have the
    same velocity amplitude, random phases by `seed`, and the sum stays within `half_range` (k,) of the centre. Each
    coordinate has frequencies that differ a little from those of the others. Over the first and last `ramp` seconds the
    motion grows and fades with three continuous derivatives.

    Raises ArgumentError for a ramp that is longer than half of the time, for no frequencies, and for one that is not
    above zero.

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
        raise ArgumentError(f"a motion of {length:g} s cannot grow and fade over {ramp:g} s each; take a shorter ramp")
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, (len(f), len(centre)))
    # slightly other frequencies on each axis, so that no two axes repeat each other's pattern; none below a half
    apart = min(APART, 1 / max(1, len(centre) - 1))
    own = f[:, None] * (1 + apart * (np.arange(len(centre)) - (len(centre) - 1) / 2))
    sines = np.sum(np.sin(2 * np.pi * own * time[:, None, None] + phases) / own, axis=1)
    fade = _rise((time - time[0]) / ramp) * _rise((time[-1] - time) / ramp)
    shape = fade[:, None] * sines
    return np.asarray(centre, dtype=float) + np.asarray(half_range, dtype=float) * shape / np.max(np.abs(shape), axis=0)


def _rise(x: Array) -> Array:
    """From 0 to 1 over [0, 1] with three continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)


def read_motion(path: PathLike, robot: Model, synthetic: SyntheticLog) -> Array:
    """The rows (n, ...) of the reference variable from a CSV or MATLAB file, for the `motion` of `synthetic_study`.

    The file has the variable's columns in SI, as the trajectory.csv of an excitation has; `synthetic` names the
    variable and the sample time. Raises ArgumentError for a variable that the robot has not, a column that the file has
    not, and another sample time.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> time = 0.004 * np.arange(1000)
    >>> T = gt.identify.multisine(time, robot.home, np.full(3, 0.1), np.array([0.5, 1.1]), seed=1)
    >>> gt.Trajectory(time, {"T": T}, {"T": "m"}).to_csv("trajectory.csv")
    >>> gt.identify.read_motion("trajectory.csv", robot, gt.identify.SyntheticLog()).shape
    (1000, 3)
    """
    _, unit = _reference(robot, synthetic)
    columns = {synthetic.reference: Column(synthetic.reference, unit)}
    with naming("motion", ValueError):  # the log's, or that of a unit
        recordings = read_log(path, columns, sample_time=synthetic.sample_time)
    return recordings[0].trajectory[synthetic.reference]


def _reference(robot: Model, synthetic: SyntheticLog) -> tuple[tuple[int, ...], str]:
    """Shape and unit of the reference variable. Raises ArgumentError."""
    flat = flat_of(robot)
    with naming("synthetic.reference", ModelError):
        shape, indices, order = flat.lookup(synthetic.reference)
    return shape, flat.unit_of(indices[0], order)


def reference_motion(known: str, s: SyntheticLog, plant: Model, seed: int, motion: Array | None = None) -> Array:
    """(n, ...) of the known variable at the sample times, along sines of that seed, or along the given rows of the
    reference variable.

    Raises ArgumentError: a variable that there is not, rows of another shape, a motion that leaves the reach.
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
        argument, hint = ("motion", "take it nearer to the home") if motion is not None else (
            "synthetic.half_range", "take a smaller half_range, or another centre")  # fmt: skip
        raise ArgumentError(
            f"the motion leaves the reach of the robot at {bad[0] * s.sample_time:g} s "
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
    apart = float(np.max(np.abs(rows[-1] - rows[0])))
    if apart > CLOSED * max(1.0, float(np.max(np.abs(rows)))):
        raise ArgumentError(
            f"the motion ends {apart:.3g} {unit} from where it begins and cannot run {s.repeats} times on end; take a "
            "closed one, or repeats = 1",
            "synthetic.repeats",
        )
    return np.concatenate([*[rows[:-1]] * s.repeats, rows[-1:]])


def _sines(s: SyntheticLog, shape: tuple[int, ...], plant: Model, seed: int) -> Array:
    count = shape[0] if shape else 1
    home = getattr(plant, "home", None) if s.reference == "T" else None
    centre = s.centre if s.centre is not None else home
    if centre is None or np.size(centre) != count:
        raise ArgumentError(
            f"expected {count} numbers, where the sines of '{s.reference}' have their middle", "synthetic.centre"
        )
    half = np.atleast_1d(np.asarray(s.half_range, dtype=float))
    if half.size not in (1, count):
        raise ArgumentError(f"has {half.size} numbers; expected one, or {count}", "synthetic.half_range")
    if not s.frequencies:
        raise ArgumentError("is empty; expected one frequency or more", "synthetic.frequencies")
    time = s.sample_time * np.arange(round(s.duration / s.sample_time))
    with naming("synthetic.ramp", ValueError):
        rows = multisine(time, np.asarray(centre, dtype=float), np.broadcast_to(half, (count,)),
                         np.array(s.frequencies), seed, s.ramp)  # fmt: skip
    return rows.reshape(len(rows), *shape)
