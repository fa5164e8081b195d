"""The reference motion of a synthetic identification: sines, or as a file has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtmodel.compiler.causal import flat_of
from gtmodel.identify import multisine
from gtmodel.lang import Model, ModelError
from gtmodel.lang.units import UnitError
from gtmodel.measurements import Column, read_log
from gtmodel.results import Status, TrajectoryError

from .base import Context, InputError
from .identification_keys import Synthetic
from .robots import file_of

CLOSED = 1e-9  # of the motion's size: how far a motion that repeats may end from where it begins


def reference_motion(known: str, s: Synthetic, plant: Model, seed: int | None, context: Context) -> np.ndarray:
    """(n, ...) of the known variable at the sample times, along sines of that seed, or along the file's for None.

    Raises InputError with the key: a variable, a file or a column that there is not, a wrong sample time, a motion that
    leaves the reach of the robot.
    """
    flat = flat_of(plant)
    try:
        shape, indices, order = flat.lookup(s.reference)
    except ModelError as error:
        raise InputError(str(error), "synthetic.reference") from error
    if seed is None:
        rows = _of_file(s, shape, flat.unit_of(indices[0], order), context)
    else:
        rows = _sines(s, shape, plant, seed)
    if s.reference == known:
        return rows
    try:
        function = plant.causal(known=s.reference, targets=known)
        found, status = function(rows)
    except (ModelError, TypeError) as error:
        raise InputError(str(error), "synthetic.reference") from error
    bad = np.flatnonzero(status != Status.OK)
    if bad.size:
        hint = ("synthetic.reference_file", "take it nearer to the home") if seed is None else (
            "synthetic.half_range", "take a smaller half_range, or another centre")  # fmt: skip
        raise InputError(
            f"the motion leaves the reach of the robot at {bad[0] * s.sample_time_s:g} s "
            f"({Status(int(status[bad[0]])).sentence}); {hint[1]}",
            hint[0],
        )
    return found


def _of_file(s: Synthetic, shape: tuple[int, ...], unit: str, context: Context) -> np.ndarray:
    key, name = "synthetic.reference_file", str(s.reference_file)
    path = file_of(name, context)
    if path is None:
        raise InputError(f"there is no file '{name}' in {context.folder} or here", key)
    context.take(key, Path(path))
    try:
        recordings = read_log(path, {s.reference: Column(s.reference, unit)}, sample_time=s.sample_time_s)
    except (TrajectoryError, UnitError) as error:
        raise InputError(str(error), key) from error
    rows = recordings[0].trajectory[s.reference]
    if rows.shape[1:] != shape:
        wide = rows.shape[1] if rows.ndim > 1 else 1
        raise InputError(f"has {wide} columns of '{s.reference}'; expected {shape[0] if shape else 1}", key)
    if s.repeats == 1:
        return rows
    apart = float(np.max(np.abs(rows[-1] - rows[0])))
    if apart > CLOSED * max(1.0, float(np.max(np.abs(rows)))):
        raise InputError(
            f"the motion of '{name}' ends {apart:.3g} {unit} from where it begins and cannot run {s.repeats} times on "
            "end; take a closed one, or repeats = 1",
            "synthetic.repeats",
        )
    return np.concatenate([*[rows[:-1]] * s.repeats, rows[-1:]])


def _sines(s: Synthetic, shape: tuple[int, ...], plant: Model, seed: int) -> np.ndarray:
    count = shape[0] if shape else 1
    home = getattr(plant, "home", None) if s.reference == "T" else None
    centre = s.centre if s.centre is not None else home
    if centre is None or np.size(centre) != count:
        raise InputError(f"expected {count} numbers, where the sines of '{s.reference}' have their middle",
                         "synthetic.centre")  # fmt: skip
    half = np.atleast_1d(np.asarray(s.half_range, dtype=float))
    if half.size not in (1, count):
        raise InputError(f"has {half.size} numbers; expected one, or {count}", "synthetic.half_range")
    time = s.sample_time_s * np.arange(round(s.duration_s / s.sample_time_s))
    try:
        rows = multisine(time, np.asarray(centre, dtype=float), np.broadcast_to(half, (count,)),
                         np.array(s.frequencies_Hz), seed, s.ramp_s)  # fmt: skip
    except ValueError as error:
        raise InputError(str(error), "synthetic.ramp_s") from error
    return rows.reshape(len(rows), *shape)
