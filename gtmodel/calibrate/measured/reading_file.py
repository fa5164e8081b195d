"""Reads measured poses from CSV files: assembles signals, converts orientations, applies known corrections, checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from ...lang import ModelError
from ...lang.units import parse_unit
from ...measurements import Conversion, LogError, LogForm, signal_table
from ...measurements.drift import DriftKind, drift_basis
from ...measurements.orientations import MATRIX, UNIT_LENGTH, in_angles, quaternions
from ...measurements.signal_table import SignalTable
from ...measurements.streams.form import NoNumberError
from ...results import ArgumentError
from ...results.disk import path_of
from ...results.refusal import naming
from ..measurements import Correction, FixedPoint, Measurements, Pose
from .options import ESTIMATE, DeviceDrift, Measured, MeasuredSignal, Sag
from .other_files import PoseFile, Wanted, file_of, with_other_files
from .poses import MeasuredPoses


def positions(rows: np.ndarray) -> np.ndarray:
    """The last column (N, 3) of pose matrices, written row by row as 12 or 16 numbers."""
    if rows.shape[1] not in (12, 16):
        raise ArgumentError(f"the matrix of a pose has 12 or 16 columns; found {rows.shape[1]}")
    return rows[:, 3:12:4]


GRAVITY = 9.81  # m/s2
IDENTITY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def read_poses(
    path: Path | str,
    measured: Measured,
    held_out: Path | str | None = None,
    form: LogForm = LogForm(),  # noqa: B008
) -> MeasuredPoses:
    r"""Read measured poses from a file, one per row; `held_out`: another file with the same columns, kept out of fits.

    The file may be any that `gt.measurements.open_log` reads; `form` describes its format if the file does not.

    Numbers for scale, offset or delay are applied here; "estimate" leaves them to the calibration. Raises ArgumentError
    with file and line, or with the argument "measured.signals.q.column" if a column is wrong.

    >>> from pathlib import Path
    >>> from gtmodel.calibrate import Measured, MeasuredSignal, read_poses
    >>> _ = Path("poses.csv").write_text("q[0],q[1],q[2],x,y,z\n0,0,0,500,-600,500\n10,0,0,503,-601,502\n")
    >>> signals = {"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal(["x", "y", "z"], "mm")}
    >>> read_poses("poses.csv", Measured(signals)).measurements.values["T"]  # m
    array([[ 0.5 , -0.6 , 0.5 ],
           [ 0.503, -0.601, 0.502]])
    """
    sources = [path_of(path)]
    columns = _columns(measured)
    tables = [_table(sources[0], columns, measured, form, leave_out=measured.leave_out)]
    mask = None
    if held_out is not None:
        sources.append(path_of(held_out, "held_out"))
        tables.append(_table(sources[1], columns, measured, form, "held_out.file"))
        mask = np.repeat([False, True], [len(t.lines) for t in tables])
    left_out = [measured.leave_out, ()]
    files = [
        PoseFile(source, table, partial(signal_table.read, source, form=form, leave_out=lines))
        for source, table, lines in zip(sources, tables, left_out, strict=False)
    ]
    tables = with_other_files(files, columns, measured, form)
    measurements = _measurements(tables, measured, sources)
    lines = np.concatenate([t.lines for t in tables])
    notes = [t.synthetic for t in tables if t.synthetic]
    plain = {n for n, s in measured.signals.items() if s.representation is None}
    columns = {n: c for n, c in tables[0].columns.items() if n in plain}
    has_sag = measured.sag is not None and measured.sag.compliance != ESTIMATE
    known = [f"{measured.position}.sag"] if has_sag else []
    return MeasuredPoses(
        measurements, measured.actuators, lines, mask, columns, known, notes[0] if notes else None,
        left_out=sorted(set(measured.leave_out)),
    )  # fmt: skip


def _columns(measured: Measured) -> Wanted:
    """Return the columns and units of all signals, and of rates and payloads. Raises ArgumentError."""
    columns: Wanted = {}
    if len(measured.signals) < 2:
        names = ", ".join(measured.signals) or "none"
        raise ArgumentError(f"expected at least two signals, such as q and T; found {names}", "measured.signals")
    for name, s in measured.signals.items():
        argument = f"measured.signals.{name}"
        columns[name] = (s.column, s.unit)
        if isinstance(s.scale, str) and s.coupling is not None:
            raise ArgumentError("cannot be estimated with a coupling; give numbers", f"{argument}.scale")
        with naming(f"{argument}.", LogError):
            conversion_of(s)
        if s.delay != 0.0:
            if s.rate is None:
                raise ArgumentError("a delay needs the columns of the signal's rate", f"{argument}.rate")
            columns[f"der({name})"] = (s.rate, s.rate_unit)
    partly = len(_partial_signals(measured)) > 0
    for key_ in ("actuators", "position", "orientation"):
        name = getattr(measured, key_)
        if name is not None and name not in measured.signals and (key_ == "actuators" or not partly):
            choices = ", ".join(measured.signals)
            raise ArgumentError(f"is '{name}', which is not a signal; choose one of: {choices}", f"measured.{key_}")
    if measured.sag is not None and isinstance(measured.sag.payload, str):
        columns[f"load({measured.position})"] = (measured.sag.payload, "kg")
    if measured.time is not None:
        columns[f"time({measured.position})"] = (measured.time.column, measured.time.unit)
    if measured.temperature is not None:
        columns[f"temperature({measured.position})"] = (measured.temperature, "K")
    if measured.session is None and (measured.device_per_session or measured.target_per_session):
        raise ArgumentError("is missing; name the column with the recording of each row", "measured.session")
    return columns


def _table(
    path: Path, columns: Wanted, measured: Measured, form: LogForm, key: str = "measured.file",
    leave_out: Sequence[int] = (),
) -> SignalTable:  # fmt: skip
    """Read the signals that name no file of their own."""
    own = {name: pair for name, pair in columns.items() if file_of(name, measured) is None}
    if not own:
        raise ArgumentError("every signal names a file of its own; leave `file` out of one", "measured.signals")
    try:
        return signal_table.read(path, own, measured.session, form, leave_out=leave_out)
    except ArgumentError as error:
        advice = ""
        if isinstance(error, NoNumberError) and key == "measured.file":
            advice = f"; fill in the cell, or leave the row out: leave_out = {sorted({*leave_out, error.line})}"
        raise ArgumentError(error.message + advice, f"measured.{error.argument}" if error.argument else key) from error


def _partial_signals(measured: Measured) -> list[str]:
    """Signals that give a part of the pose: components, points, distances."""
    return [n for n, s in measured.signals.items() if s.between or n.partition("@")[0].endswith("]")
            or n.partition("@")[0] in measured.points]  # fmt: skip


def _represented(values: dict[str, np.ndarray], tables: Sequence[SignalTable], measured: Measured) -> None:
    """Convert orientations to quaternions, scalar first, and extract positions from matrices."""
    for name, s in measured.signals.items():
        if s.representation is None:
            continue
        argument = f"measured.signals.{name}"
        if ESTIMATE in (s.scale, s.offset, s.delay):
            raise ArgumentError("scale, offset or delay of an orientation cannot be estimated", argument)
        with naming(f"{argument}.representation"):
            if name.partition("@")[0] == measured.position and s.representation == MATRIX:
                values[name] = positions(values[name])
                continue
            units = {parse_unit(u).si_text for u in tables[0].columns[name].units}
            if in_angles(s.representation) and units != {"rad"}:
                raise ArgumentError(f"'{s.representation}' consists of angles: set the unit to deg or rad")
            values[name] = quaternions(values[name], s.representation)


def _measurements(tables: Sequence[SignalTable], measured: Measured, sources: Sequence[Path]) -> Measurements:
    values = {n: np.vstack([t.values[n] for t in tables]) for n in tables[0].values}
    corrections: list[Correction] = []
    for name, s in measured.signals.items():
        _read_through(name, s, values, corrections)
    _represented(values, tables, measured)
    if measured.orientation in values:
        _refuse_long(values[measured.orientation], measured.orientation)
    noise = {}
    for n, s in measured.signals.items():
        with naming(f"measured.signals.{n}.deviation"):
            if (stated := s.noise_in_si) is not None:
                noise[n] = np.asarray(stated) if isinstance(stated, list) else stated
    device, target, sag = measured.device_start, measured.target_start, measured.sag
    pose = Pose(
        measured.position,
        measured.orientation,
        measured.frame == "device",
        measured.target,
        None if device is None else (device.t, device.quaternion),
        (target.t, target.quaternion),
        measured.device_per_session,
        measured.target_per_session,
        sag=sag is not None,
        sag_start=0.0 if sag is None or isinstance(sag.compliance, str) else sag.compliance,
        drift=_drift(values, measured),
    )
    if sag is not None:
        values[f"load({measured.position})"] = _load(sag, values, measured.position)
    sessions = None if measured.session is None else [s for t in tables for s in t.sessions or ()]
    try:
        points = {n: FixedPoint(p.at, p.position, p.orientation, p.estimate) for n, p in measured.points.items()}
        between = {n: (s.between[0], s.between[1]) for n, s in measured.signals.items() if s.between}
        places = [f"{path.name}, line {k}" for path, t in zip(sources, tables, strict=True) for k in t.lines]
        measurements = Measurements(
            values, noise, sessions, (pose,), tuple(corrections), points, between, tuple(measured.latent),
            measured.name or sources[0].stem, places,
        )  # fmt: skip
        for name in noise:
            turns = name.partition("@")[0] == measured.orientation
            size = 3 if turns else np.asarray(measurements.values[name]).shape[1]
            measurements.covariance(name, size)
        return measurements
    except ModelError as error:
        raise ArgumentError(str(error), "measured.signals") from error


def _read_through(name: str, s: MeasuredSignal, values: dict[str, np.ndarray], corrections: list[Correction]) -> None:
    """Apply scale, offset and delay given as numbers; "estimate" becomes a parameter."""
    free = {"scale": s.scale == ESTIMATE, "offset": s.offset == ESTIMATE, "delay": s.delay == ESTIMATE}
    if free["scale"] and not free["offset"] and s.offset != 0.0:
        raise ArgumentError("with an estimated scale, a fixed offset in SI is not known; estimate both, or neither",
                            f"measured.signals.{name}.offset")  # fmt: skip
    rate = values.pop(f"der({name})", None)
    rows = values[name] if rate is None or free["delay"] else values[name] + float(s.delay) * rate
    conversion = conversion_of(s)
    with naming(f"measured.signals.{name}.", LogError):
        values[name] = conversion.apply(rows, _SI)
        if free["delay"] and rate is not None:
            values[f"der({name})"] = replace(conversion, offset=0.0).apply(rate, _SI)
    if any(free.values()):
        corrections.append(Correction(name, **free))


def conversion_of(s: MeasuredSignal) -> Conversion:
    """Return what the numbers of a signal do to its columns in SI. Raises LogError."""

    def fixed(value: float | list[float] | str, free: float) -> float | tuple[float, ...]:
        return free if isinstance(value, str) else tuple(value) if isinstance(value, list) else value

    coupling = None if s.coupling is None else tuple(map(tuple, s.coupling))
    gear = None if s.gear_ratio is None else fixed(s.gear_ratio, 1.0)
    return Conversion(fixed(s.scale, 1.0), fixed(s.offset, 0.0), gear, coupling=coupling)


_SI = ("1",)  # the columns have been converted to SI; their factors need no unit


def _drift(values: dict[str, np.ndarray], measured: Measured) -> tuple[DriftKind, ...]:
    """Return the drifts to estimate; time and temperature become relative to the last row. Raises ArgumentError."""
    rows = len(values[measured.actuators])
    conditions: dict[str, np.ndarray | None] = {}
    for name in ("time", "temperature"):
        key = f"{name}({measured.position})"
        if key in values:
            values[key] = values[key] - values[key][-1]
        conditions[name] = values[key][:, 0] if key in values else None
    order = None if conditions["time"] is None else np.sort(conditions["time"])
    with naming("measured."):
        return drift_basis(
            measured.drift, rows, order, None, conditions["temperature"], kinds=get_args(DeviceDrift)
        ).kinds


def _load(sag: Sag, values: Mapping[str, np.ndarray], position: str) -> np.ndarray:
    """Weights (N, 3) [N] of the payloads. Raises ArgumentError."""
    down = np.array(sag.down, float)
    if not np.linalg.norm(down) > 0:
        raise ArgumentError("is zero and has no direction", "measured.sag.down")
    N = len(values[position])
    mass = values[f"load({position})"] if isinstance(sag.payload, str) else np.full((N, 1), sag.payload)
    if np.any(mass < 0):
        raise ArgumentError(f"contains {mass.min():g} kg; a payload must not be negative", "measured.sag.payload")
    return GRAVITY * mass * down / np.linalg.norm(down)


def _refuse_long(e: np.ndarray, name: str) -> None:
    length = np.linalg.norm(e, axis=1) if e.shape[1] == 4 else np.zeros(len(e))
    k = int(np.argmax(np.abs(length - 1)))
    if abs(length[k] - 1) > UNIT_LENGTH:
        raise ArgumentError(
            f"expected quaternions of four columns and length 1, scalar first; pose {k + 1} has {e.shape[1]} columns "
            f"and length {length[k]:.4g}",
            f"measured.signals.{name}",
        )
