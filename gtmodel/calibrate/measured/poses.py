"""Measured poses with information about their file, split into fitted and held-out ones."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...compiler.causal import flat_of
from ...lang import Model, ModelError
from ...measurements.inspection.data_tests import Data, tested
from ...measurements.signal_table import Columns
from ...results import ArgumentError
from ...results.suspicion import Inspection
from ..closure import left_open
from ..measurements import CONDITIONS, Measurements, Pose, SignalName
from ..reading import variables_of
from .options import Refit


@dataclass(frozen=True, eq=False)
class MeasuredPoses:
    """N measured poses for a study, and their source; the fields other than `measurements` have defaults.

    measurements: in SI units. actuators: the variable that the drives measure.
    lines: (N,) of their files; numbered from 1 if left out. held_out: (N,) poses that no fit uses; None leaves the
        choice to the study. columns: signal -> names and units in the file.
    known: parameters of the measurement with given values, such as "T.sag", which no fit changes.
    left_out: lines of the file that were not read, as `Measured.leave_out` says.
    synthetic: seed and noise of a synthetic file. truth: the robot with known errors. files: further synthetic files.
    """

    measurements: Measurements
    actuators: str = "q"
    lines: np.ndarray | None = None
    held_out: np.ndarray | None = None
    columns: Mapping[str, Columns] = field(default_factory=dict)
    known: Sequence[str] = ()
    synthetic: str | None = None
    truth: Model | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    left_out: Sequence[int] = ()


@dataclass(frozen=True, eq=False)
class SplitPoses:
    """All poses, with those held out and information for the report.

    `all`: with exactly one `pose`; `lines` (N,): of their files; `repeated`: groups of poses at the same actuators;
    `columns`: of every signal. `refitting`: poses of a held-out recording used for the refit, and for nothing else.
    """

    all: Measurements
    actuators: str
    lines: np.ndarray
    held_out: np.ndarray
    columns: Mapping[str, Columns]
    repeated: tuple[np.ndarray, ...]
    source: MeasuredPoses
    refitting: Measurements | None = None

    @property
    def pose(self) -> Pose:
        return self.all.poses[0]

    @property
    def position(self) -> str:
        """The signal by which the robot is evaluated: the measured position, or else the first of `judged`."""
        return self.pose.position if self.whole else self.judged[0]

    @property
    def whole(self) -> bool:
        """Whether the position was measured, one pose per row."""
        return self.pose.position in self.all.values and not any("@" in n for n in self.all.values)

    @property
    def judged(self) -> list[str]:
        """Measured signals other than actuators, rates and loads."""
        return [n for n in self.all.values
                if not n.startswith(CONDITIONS) and n.partition("@")[0] != self.actuators]  # fmt: skip

    @property
    def name(self) -> str:
        return self.all.name

    @property
    def q(self) -> np.ndarray:
        """The actuators (N, k) in SI units."""
        return np.asarray(self.all.values[self.actuators])

    @property
    def T(self) -> np.ndarray:
        """The measured positions (N, k) [m], or the other signal by which the robot is evaluated."""
        return np.asarray(self.all.values[self.position])

    @property
    def synthetic(self) -> str | None:
        return self.source.synthetic

    @cached_property
    def fitted(self) -> Measurements:
        return self.all.part(~self.held_out)

    @cached_property
    def kept(self) -> Measurements | None:
        """The held-out poses; None if there are none."""
        return self.all.part(self.held_out) if self.held_out.any() else None

    def refitted_by(self, refit: Refit) -> SplitPoses:
        """Move the first of every few held-out poses to `refitting`. Raises ArgumentError if no pose is held out."""
        held = np.flatnonzero(self.held_out)
        if not len(held):
            raise ArgumentError("there are no held-out poses to refit on", "refit")
        refitting = held[:: refit.every]
        rest = np.setdiff1d(np.arange(len(self.lines)), refitting)
        return replace(
            self, all=self.all.part(rest), lines=self.lines[rest], held_out=self.held_out[rest],
            repeated=_repeated(self.q[rest]), refitting=self.all.part(refitting),
        )  # fmt: skip

    def with_device(self, frames: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> SplitPoses:
        """The poses with other start values of the device frame, by session, or "" for all."""
        first = next(iter(frames.values()))
        starts = {s: frame for s, frame in frames.items() if s}
        poses = tuple(replace(p, device_start=first, device_starts=starts) if p.device else p for p in self.all.poses)
        return replace(self, all=replace(self.all, poses=poses))


def split_all(
    poses: MeasuredPoses | Measurements | Sequence[MeasuredPoses | Measurements],
    model: Model,
    every: int,
    refit: Refit | None = None,
    inspection: Inspection | None = None,
) -> list[SplitPoses]:
    """Split each of the measurements. Raises ArgumentError as split(), and for names that occur twice."""
    several = [poses] if isinstance(poses, MeasuredPoses | Measurements) else list(poses)
    if not several:
        raise ArgumentError("there are no measurements; give poses", "poses")
    recorded = [isinstance(entry, MeasuredPoses) and entry.held_out is not None for entry in several]
    data = []
    for k, entry in enumerate(several, 1):
        whole = MeasuredPoses(entry) if isinstance(entry, Measurements) else entry
        if not whole.measurements.name:
            name = f"measurements {k}" if len(several) > 1 else "measurements"
            whole = replace(whole, measurements=replace(whole.measurements, name=name))
        try:
            # of several, refit those whose held-out poses are a separate recording, if there are any
            refit_poses = refit if recorded[k - 1] or not any(recorded) else None
            data.append(split(whole, model, every, refit_poses, inspection))
        except ArgumentError as error:
            argument = error.argument
            if len(several) > 1 and argument.startswith("poses"):
                argument = f"poses[{k - 1}]{argument.removeprefix('poses')}"
            raise ArgumentError(error.message, argument) from error
    names = [d.name for d in data]
    for name in names:
        if names.count(name) > 1:
            raise ArgumentError(
                f"{names.count(name)} measurements are named '{name}'; give each a different name", "poses"
            )
    if len({d.actuators for d in data}) > 1:
        raise ArgumentError("all measurements must have the same actuators", "poses")
    return data


def split(
    poses: MeasuredPoses | Measurements,
    model: Model,
    every: int,
    refit: Refit | None = None,
    inspection: Inspection | None = None,
) -> SplitPoses:
    """Mark held-out poses: those of the file, or every k-th (Dressler 2012, eq. (5.5)); none for 0.

    Raises ArgumentError if the poses do not fit the model or each other.
    """
    if isinstance(poses, Measurements):
        poses = MeasuredPoses(poses)
    m = poses.measurements
    partly = bool(m.points or m.distances or any(n.partition("@")[0].endswith("]") for n in m.values))
    if not m.poses:
        if "T" not in m.values and not partly:
            raise ArgumentError(f"name the measured variable with a Pose; found {', '.join(m.values)}", "poses")
        m = replace(m, poses=(Pose("T", "e" if "e" in m.values else None),))
    if len(m.poses) > 1:
        raise ArgumentError(f"a study judges one position, but {len(m.poses)} poses name one each; give one", "poses")
    if every < 0 or every == 1:
        raise ArgumentError(f"{every} leaves no poses to fit; give 2 or more, or 0 to hold out none", "held_out")
    lines = np.arange(1, len(m) + 1) if poses.lines is None else poses.lines
    columns = _fit_the_model(m, poses, model, partly)
    m = _with_latent(m, model)
    place = "line" if len(np.unique(lines)) == len(lines) else "line (of either file)"
    for suspicion in tested(Data(m.values, list(m.values), "pose", place, lines)):
        (inspection or Inspection()).refuse(suspicion, "poses.file")
    repeated = _repeated(np.asarray(m.values[poses.actuators]))
    mask = np.zeros(len(lines), bool)
    if poses.held_out is not None:
        mask = np.asarray(poses.held_out, bool)
    elif every > 0:
        mask = _alternate(repeated, len(lines), every)
    if refit is None:
        _refuse_unknown_sessions(m, mask)
    data = SplitPoses(m, poses.actuators, lines, mask, columns, repeated, poses)
    return data if refit is None else data.refitted_by(refit)


def _with_latent(m: Measurements, model: Model) -> Measurements:
    """Declare unmeasured variables latent if the equations do not close without them.

    Raises ArgumentError for signals that do not depend on the pose."""
    flat = flat_of(model)
    try:
        stances = variables_of(flat, m)
        missing = [n for known, latent in stances for n in left_open(flat, [*known, *latent])]
    except ModelError as error:
        raise ArgumentError(str(error), "poses") from error
    return replace(m, latent=tuple(dict.fromkeys([*m.latent, *missing]))) if missing else m


def _fit_the_model(m: Measurements, poses: MeasuredPoses, model: Model, partly: bool) -> dict[str, Columns]:
    """Columns of all signals. Raises ArgumentError for signals that are not variables of the model, and for a wrong
    number of columns."""
    flat = flat_of(model)
    tables: dict[str, Columns] = {}
    for name in (poses.actuators, *(n for p in m.poses for n in (p.position, p.orientation) if n)):
        if name not in m.values and (name == poses.actuators or not partly):
            raise ArgumentError(f"'{name}' is not among the measured {', '.join(m.values)}", "poses")
    for name, rows in m.values.items():
        if name.startswith(CONDITIONS[1:]):
            continue
        stem = re.sub(r"@\d+", "", name)
        if name in m.distances or SignalName.of(stem, [*flat.groups, *m.points]).base in m.points:
            k = np.asarray(rows).shape[1]
            names = tuple(f"{name}[{j}]" for j in range(k)) if k > 1 else (name,)
            tables[name] = poses.columns.get(name) or Columns(names, ("m",) * k)
            continue
        try:
            shape, indices, _ = flat.lookup(stem)
        except ModelError as error:
            raise ArgumentError(str(error), f"poses.values.{name}") from error
        columns, size = np.asarray(rows).shape[1], int(np.prod(shape))
        if columns != size:
            argument = f"poses.values.{name}" + (".column" if name in poses.columns else "")
            raise ArgumentError(f"has {columns} columns; '{name}' of the robot has {size}", argument)
        names = tuple(f"{name}[{k}]" for k in range(size)) if size > 1 else (name,)
        units = tuple(flat.variables[i].unit or "1" for i in indices)
        tables[name] = poses.columns.get(name) or Columns(names, units)
    return tables


def _refuse_unknown_sessions(m: Measurements, held: np.ndarray) -> None:
    """Raise ArgumentError for sessions whose poses are all held out, if their offsets or frames are unknown."""
    offsets = [c.signal for c in m.corrections if c.offset]
    frames = any(p.device_per_session or p.target_per_session for p in m.poses)
    if m.sessions is None or not (offsets or frames):
        return
    what = f"the offsets of {', '.join(offsets)}" if offsets else "the frame"
    known = {s for s, h in zip(m.sessions, held, strict=True) if not h}
    lost = [s for s in m.session_names if s not in known]
    if lost:
        raise ArgumentError(
            f"all poses of session '{lost[0]}' are held out, so that {what} cannot be determined; "
            f"let some of them be fitted{', or give the offset as a number' if offsets else ''}",
            "held_out",
        )


def _repeated(q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Groups of two or more poses at the same actuators, ordered by their first pose."""
    _, which = np.unique(q, axis=0, return_inverse=True)
    which = which.reshape(-1)
    groups = [np.flatnonzero(which == w) for w in dict.fromkeys(which.tolist())]
    return tuple(g for g in groups if len(g) > 1)


def _alternate(repeated: Sequence[np.ndarray], n: int, every: int) -> np.ndarray:
    """Every k-th pose (Dressler 2012, eq. (5.5)); poses at the same actuators stay together."""
    first = np.arange(n)
    for group in repeated:
        first[group] = group[0]
    order = {p: k for k, p in enumerate(dict.fromkeys(first.tolist()))}
    return np.array([order[p] % every == every - 1 for p in first.tolist()])
