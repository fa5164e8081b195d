"""Measured or made-up poses of a calibration: read, put together, split in fitted and held-out ones."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtmodel.calibrate import Correction, Measurements, Pose
from gtmodel.compiler.causal import flat_of
from gtmodel.lang import Model, ModelError
from gtmodel.measurements import copies

from . import calibration_synthetic, calibration_table
from .base import Context, InputError
from .calibration_keys import Measured, MeasuredSignal, Sag, Schema
from .calibration_synthetic_keys import Synthetic
from .calibration_table import PoseTable
from .robots import file_of

UNIT_LENGTH = 1e-3  # of a measured quaternion: printed digits leave less
KEY = "measurements"
GRAVITY = 9.81  # m/s2
FILE = "measurements.csv"
CARTS = "carts.csv"


@dataclass(frozen=True, eq=False)
class PoseData:
    """All poses, which are held out, and where they stand in the files.

    `lines` (N,): of their files; `text`, `carts`, `truth`: of synthetic files, None for measured ones; `repeated`:
    groups of poses at the same actuators.
    """

    keys: Measured
    all: Measurements
    lines: np.ndarray
    held_out: np.ndarray
    synthetic: str | None
    text: str | None
    truth: Model | None
    carts: str | None
    repeated: tuple[np.ndarray, ...]

    @property
    def fitted(self) -> Measurements:
        return self.all.part(~self.held_out)

    @property
    def kept(self) -> Measurements | None:
        """The poses held out; None for none."""
        return self.all.part(self.held_out) if self.held_out.any() else None


def data_of(problem: Schema, model: Model, context: Context) -> PoseData:
    """Raises InputError with the key of what is wrong."""
    if (problem.measurements is None) == (problem.synthetic is None):
        found = "both" if problem.measurements else "none of them"
        raise InputError(f"expected one of [measurements] and [synthetic]; found {found}", KEY)
    text, truth, carts = None, None, None
    if problem.synthetic is not None:
        made = calibration_synthetic.make(model, problem.synthetic)
        text, truth, carts = made.text, made.robot, made.carts
        keys = _synthetic_keys(made, problem.synthetic)
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / FILE
            path.write_text(text, encoding="utf-8")
            table = _table(path, keys)
    else:
        assert problem.measurements is not None
        keys = problem.measurements
        table = _table(_found(keys.file, f"{KEY}.file", context), keys)
    held = np.zeros(len(table.lines), bool)
    tables = [table]
    if problem.held_out.file is not None:
        other = _table(_found(problem.held_out.file, "held_out.file", context), keys)
        tables.append(other)
        held = np.concatenate([held, np.ones(len(other.lines), bool)])
    _fit_the_model(tables[0], model)
    everything = _measurements(tables, keys)
    lines = np.concatenate([t.lines for t in tables])
    _refuse_copies(everything, lines, [len(t.lines) for t in tables])
    repeated = _repeated(np.asarray(everything.values[keys.actuators]))
    if problem.held_out.file is None and problem.held_out.every > 0:
        held = _alternate(repeated, len(lines), problem.held_out.every)
    _refuse_unknown_sessions(everything, held)
    notes = [t.synthetic for t in tables if t.synthetic]
    return PoseData(keys, everything, lines, held, notes[0] if notes else None, text, truth, carts, repeated)


def with_device(data: PoseData, placed: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> PoseData:
    """The same with other starts for the frame of the device, by session, or "" for all."""
    first = next(iter(placed.values()))
    starts = {s: frame for s, frame in placed.items() if s}
    poses = tuple(
        replace(p, device_start=first, device_starts=starts) if p.device else p  # type: ignore[arg-type]
        for p in data.all.poses
    )
    m = data.all
    return replace(data, all=Measurements(m.values, m.noise, m.sessions, poses, m.corrections))


def _found(name: str, key: str, context: Context) -> Path:
    path = file_of(name, context)
    if path is None:
        raise InputError(f"there is no file '{name}' in {context.folder} or here", key)
    context.take(key, path)
    return path


def _synthetic_keys(made: calibration_synthetic.Made, s: Synthetic) -> Measured:
    drives: list[str] = ["mm"] * 3 + (["deg"] * 3 if made.rotary else [])
    signals = {
        "q": MeasuredSignal(column="q", unit=drives),
        "T": MeasuredSignal(column="T", unit="mm"),
    } | ({"e": MeasuredSignal(column="e", unit="1")} if made.turns else {})
    if s.state_noise:
        stated = calibration_synthetic.stated_noise(s, made.rotary)
        signals = {n: k.model_copy(update={"noise": stated[n]}) for n, k in signals.items()}
    frame = "device" if any([*s.device_t_m, *s.device_zyz_deg]) else "robot"
    return Measured(file=FILE, signals=signals, orientation="e" if made.turns else None, frame=frame)


def _table(path: Path, keys: Measured) -> PoseTable:
    wanted: dict[str, tuple[str | Sequence[str], str | Sequence[str]]] = {}
    for name, s in keys.signals.items():
        wanted[name] = (s.column, s.unit)
        if s.delay_s != 0.0:
            if s.rate is None:
                raise InputError("a delay needs the columns of the signal's rate", f"{KEY}.signals.{name}.rate")
            wanted[f"der({name})"] = (s.rate, s.rate_unit)
    for key in ("actuators", "position", "orientation"):
        name = getattr(keys, key)
        if name is not None and name not in keys.signals:
            raise InputError(f"names '{name}', which is no signal; these are {', '.join(keys.signals)}", f"{KEY}.{key}")
    if keys.sag is not None and isinstance(keys.sag.payload_kg, str):
        wanted[f"load({keys.position})"] = (keys.sag.payload_kg, "kg")
    if keys.session is None and (keys.device_per_session or keys.target_per_session):
        raise InputError("is missing; name the column that tells the recording of a row", f"{KEY}.session")
    try:
        return calibration_table.read(path, wanted, keys.session)
    except InputError as error:
        at = f"{KEY}.{error.key}" if error.key else f"{KEY}.file"
        raise InputError(error.sentence, at) from error


def _measurements(tables: Sequence[PoseTable], keys: Measured) -> Measurements:
    values = {n: np.vstack([t.values[n] for t in tables]) for n in tables[0].values}
    corrections: list[Correction] = []
    for name, s in keys.signals.items():
        _read_through(name, s, values, corrections)
    if keys.orientation is not None:
        _refuse_long(values[keys.orientation], keys)
    noise = {
        n: np.asarray(s.noise) if isinstance(s.noise, list) else s.noise for n, s in keys.signals.items() if s.noise
    }
    device, target = keys.device_start, keys.target_start
    pose = Pose(
        keys.position,
        keys.orientation,
        keys.frame == "device",
        keys.target,
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)) if device is None else (device.t_m, device.quaternion),
        (target.t_m, target.quaternion),
        keys.device_per_session,
        keys.target_per_session,
        sag=keys.sag is not None,
        sag_start=0.0 if keys.sag is None or keys.sag.compliance_m_per_N == "estimate" else keys.sag.compliance_m_per_N,
    )
    if keys.sag is not None:
        values[f"load({keys.position})"] = _load(keys.sag, values, keys.position)
    sessions = None
    if keys.session is not None:
        sessions = [s for t in tables for s in t.sessions or ()]
    try:
        found = Measurements(values, noise, sessions, (pose,), tuple(corrections))  # type: ignore[arg-type]
        for name in noise:
            size = 3 if name == keys.orientation else np.asarray(found.values[name]).shape[1]
            found.covariance(name, size)
        return found
    except ModelError as error:
        raise InputError(str(error), f"{KEY}.signals") from error


def _fit_the_model(table: PoseTable, model: Model) -> None:
    """Raises InputError for signals that are no variables of the model, and for another number of columns."""
    flat = flat_of(model)
    for name, rows in table.values.items():
        if name.startswith("load("):
            continue
        try:
            shape, _, _ = flat.lookup(name)
        except ModelError as error:
            raise InputError(str(error), f"{KEY}.signals.{name}") from error
        size = int(np.prod(shape))
        if rows.shape[1] != size:
            raise InputError(
                f"has {rows.shape[1]} columns; '{name}' of the robot has {size}", f"{KEY}.signals.{name}.column"
            )


def _read_through(name: str, s: MeasuredSignal, values: dict[str, np.ndarray], corrections: list[Correction]) -> None:
    """Numbers are applied to the values here, "estimate" becomes a parameter."""
    free = {"scale": s.scale == "estimate", "offset": s.offset == "estimate", "delay": s.delay_s == "estimate"}
    if free["scale"] and not free["offset"] and s.offset != 0.0:
        raise InputError("a fixed offset beside an estimated scale is not known in SI; estimate both, or none",
                         f"{KEY}.signals.{name}.offset")  # fmt: skip
    rate = values.pop(f"der({name})", None)
    rows = values[name] if rate is None or free["delay"] else values[name] + float(s.delay_s) * rate
    scale = 1.0 if free["scale"] else float(s.scale)
    values[name] = scale * rows - (0.0 if free["offset"] else float(s.offset))
    if free["delay"] and rate is not None:
        values[f"der({name})"] = scale * rate
    if any(free.values()):
        corrections.append(Correction(name, **free))


def _load(sag: Sag, values: Mapping[str, np.ndarray], position: str) -> np.ndarray:
    """Weights (N, 3) [N] of the payloads. Raises InputError."""
    down = np.array(sag.down, float)
    if not np.linalg.norm(down) > 0:
        raise InputError("is zero and points nowhere", f"{KEY}.sag.down")
    N = len(values[position])
    mass = values[f"load({position})"] if isinstance(sag.payload_kg, str) else np.full((N, 1), sag.payload_kg)
    if np.any(mass < 0):
        raise InputError(f"holds {mass.min():g} kg; a payload is not negative", f"{KEY}.sag.payload_kg")
    return GRAVITY * mass * down / np.linalg.norm(down)


def _refuse_unknown_sessions(m: Measurements, held: np.ndarray) -> None:
    """Raises InputError for sessions that only held-out poses have, and whose offsets no fitted pose tells."""
    offsets = [c.signal for c in m.corrections if c.offset]
    frames = any(p.device_per_session or p.target_per_session for p in m.poses)
    if m.sessions is None or not (offsets or frames):
        return
    what = f"the offsets of {', '.join(offsets)}" if offsets else "the frame"
    known = {s for s, h in zip(m.sessions, held, strict=True) if not h}
    lost = [s for s in m.session_names if s not in known]
    if lost:
        raise InputError(
            f"{what} in session '{lost[0]}' cannot be known, all its poses are held out; "
            f"let some of them be fitted{', or give the offset as a number' if offsets else ''}",
            "held_out",
        )


def _refuse_long(e: np.ndarray, keys: Measured) -> None:
    length = np.linalg.norm(e, axis=1) if e.shape[1] == 4 else np.zeros(len(e))
    k = int(np.argmax(np.abs(length - 1)))
    if abs(length[k] - 1) > UNIT_LENGTH:
        raise InputError(
            f"expected quaternions of four columns and length 1, scalar first; pose {k + 1} has {e.shape[1]} columns "
            f"and length {length[k]:.4g}",
            f"{KEY}.signals.{keys.orientation}",
        )


def _refuse_copies(m: Measurements, lines: np.ndarray, counts: Sequence[int]) -> None:
    """Raises InputError for rows that are the same in all digits: copies, which no device measures."""
    everything = np.column_stack([np.asarray(a) for a in m.values.values()])
    pairs = copies(everything)
    if len(pairs):
        again, original = lines[pairs[0]]
        place = "line" if len(counts) == 1 else "line (of either file)"
        raise InputError(
            f"{len(pairs)} of {len(everything)} poses are copies of others in every digit, the first {place} {again} "
            f"of line {original}; a copy counts twice and would be fitted and held out, take it out",
            f"{KEY}.file",
        )


def _repeated(q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Groups of two and more poses at the same actuators, in the order of their first."""
    _, which = np.unique(q, axis=0, return_inverse=True)
    which = which.reshape(-1)
    groups = [np.flatnonzero(which == w) for w in dict.fromkeys(which.tolist())]
    return tuple(g for g in groups if len(g) > 1)


def _alternate(repeated: Sequence[np.ndarray], n: int, every: int) -> np.ndarray:
    """Every k-th pose (Dressler 2012, eq. (5.5)); those at the same actuators stay together."""
    first = np.arange(n)
    for group in repeated:
        first[group] = group[0]
    order = {p: k for k, p in enumerate(dict.fromkeys(first.tolist()))}
    return np.array([order[p] % every == every - 1 for p in first.tolist()])
