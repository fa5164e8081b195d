"""Sensor readings as expressions: variables of the model from data, noise, unknown frames and scales."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..compiler.flat import FlatModel
from ..geometry.expressions import rotated
from ..geometry.quaternions import conjugate, product, turned
from ..lang.source import ModelError
from ..measurements.drift import DriftBasis
from .closure import Closure
from .measurements import CONDITIONS, Correction, Measurements, Pose, SignalName
from .unknowns import Parameters

IDENTITY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Stance:
    """One pose of a row: closure equations, and model symbols -> expressions in the row's data and parameters."""

    closure: Closure
    values: tuple[tuple[ca.SX, ca.SX], ...]


@dataclass(frozen=True, eq=False)
class Reading:
    """`d` (nd,): symbols of a row's data, `data` (nd, N): their values. `noise` (ny,): symbols of the added noise.
    `latent` (nz,): symbols of unmeasured values.

    `stances`: the poses of a row, mostly one. `derived` (k,): equations of measured components, points and distances,
    with `derived_labels`. `parameters` of the measurement (frames, scales, offsets), whose names have the `ending`.
    `places`: signal -> its slice of the noise. `unit`: quaternions among the parameters.
    """

    d: ca.SX
    data: np.ndarray
    noise: ca.SX
    places: dict[str, slice]
    latent: ca.SX
    stances: tuple[Stance, ...]
    derived: ca.SX
    derived_labels: tuple[str, ...]
    parameters: Parameters
    unit: tuple[str, ...]
    ending: str = ""

    def equations(self, squared: bool) -> ca.SX:
        """All residuals of a row; lengths squared or not."""
        rows = []
        for s in self.stances:
            residuals = s.closure.residuals if squared else s.closure.lengths
            known = [ca.vertcat(*[symbol for symbol, _ in s.values])], [ca.vertcat(*[v for _, v in s.values])]
            rows += ca.substitute([residuals], *known)
        return ca.vertcat(*rows, self.derived) if self.derived.numel() or len(rows) > 1 else rows[0]


def variables_of(flat: FlatModel, m: Measurements, latent: Sequence[str] = ()) -> list[tuple[list[str], list[str]]]:
    """Return the known and the latent variables of each pose of a row.

    Latent are those of `latent` and of the measurements, and unmeasured variables that components, points and distances
    need. Raises ModelError for unknown names.
    """
    known: dict[int, list[str]] = {}
    needed: dict[int, list[str]] = {}
    for name in m.values:
        if name.startswith(CONDITIONS):
            continue
        ends = m.distances.get(name, (name,))
        for end in ends:
            s = _signal(flat, m, end)
            if name not in m.distances and s.component is None and s.base not in m.points:
                known.setdefault(s.pose, []).append(s.base)
            elif s.base in m.points:
                point = m.points[s.base]
                needed.setdefault(s.pose, []).extend(n for n in (point.position, point.orientation) if n)
            else:
                needed.setdefault(s.pose, []).append(s.base)
    poses = sorted({*known, *(k for k, names in needed.items() if names)})
    if poses != list(range(1, len(poses) + 1)):
        raise ModelError(f"the poses of a row must be numbered from 1 without gaps; found {', '.join(map(str, poses))}")
    named = list(dict.fromkeys([*latent, *m.latent]))
    return [
        (
            known.get(k, []),
            [n for n in dict.fromkeys([*needed.get(k, []), *named]) if n not in known.get(k, [])],
        )
        for k in poses
    ]


def _signal(flat: FlatModel, m: Measurements, name: str) -> SignalName:
    whole = [*flat.groups, *m.points]
    return SignalName.of(name, whole)


def reading(
    closures: Sequence[Closure], m: Measurements, starts: Sequence[Mapping[str, np.ndarray]],
    sessions: Sequence[str] = (), ending: str = "",
) -> Reading:  # fmt: skip
    """Build the Reading from one closure per pose of a row.

    `starts`: per pose, of latent variables (k,) or (N, k). `sessions`: sessions with parameters, default those of the
    measurements. `ending`: of parameter names. Raises ModelError for measured variables outside the closure equations,
    wrong sizes, and corrections that lack data."""
    first = closures[0]
    r = _Reader(first.flat, m, tuple(sessions) or m.session_names, ending)
    split = any(c.offset for c in m.corrections) or any(p.device_per_session or p.target_per_session for p in m.poses)
    unknown = [s for s in m.session_names if split and s not in r.sessions]
    if unknown:
        raise ModelError(f"session '{unknown[0]}' is unknown; the problem has: {', '.join(r.sessions)}")
    stances, signals_of = [], []
    for k, (closure, start) in enumerate(zip(closures, starts, strict=True), 1):
        at = SignalName("", pose=k).at
        signals: dict[str, ca.SX] = {}
        for name in closure.known:
            if at(name) not in m.values:
                raise ModelError(f"the closure equations need '{at(name)}', but no values are given")
            size = closure.symbols[name].numel()
            values = np.asarray(m.values[at(name)])
            if values.shape[1] != size:
                raise ModelError(f"'{at(name)}' has {values.shape[1]} columns; the model's variable has {size}")
            quaternion = name in closure.unit or any(p.orientation == name for p in m.poses)
            signals[name] = r.read(at(name), quaternion)
        for c in m.corrections:
            name = c.signal.partition("@")[0]
            if c.signal == at(name) and name in signals:
                index = closure.flat.groups[name][1][0]
                signals[name] = r.corrected(c, name, signals[name], closure.flat.variables[index].unit or "")
        for pose in m.poses:
            r.placed(pose, signals, closure.latent)
        for name in closure.latent:
            signals[name] = r.hidden(at(name), start[name], name in closure.unit)
        signals_of.append(signals)
        names = (*closure.known, *closure.latent)
        stances.append(Stance(closure, tuple((closure.symbols[n], signals[n]) for n in names)))
    derived, labels = r.derived(signals_of)
    whole = [SignalName("", pose=k).at(n) for k, s in enumerate(signals_of, 1) for n in s]
    for c in m.corrections:
        if c.signal not in whole and c.signal not in r.places:
            raise ModelError(f"a correction names '{c.signal}', which is not a signal; found {', '.join(r.places)}")
    return Reading(
        ca.vertcat(*r.d), np.vstack(r.columns), ca.vertcat(ca.SX(0, 1), *r.noise), r.places,
        ca.vertcat(ca.SX(0, 1), *r.latent), tuple(stances), derived, labels, r.parameters,
        tuple(dict.fromkeys(r.unit)), ending,
    )  # fmt: skip


class _Reader:
    def __init__(self, flat: FlatModel, m: Measurements, sessions: tuple[str, ...], ending: str) -> None:
        self.flat = flat
        self.m = m
        self.sessions = sessions
        self.ending = ending
        self.d: list[ca.SX] = []
        self.columns: list[np.ndarray] = []
        self.noise: list[ca.SX] = []
        self.places: dict[str, slice] = {}
        self.latent: list[ca.SX] = []
        self.parameters = Parameters(flat.title)
        self.unit: list[str] = []

    def symbol(self, name: str, columns: np.ndarray) -> ca.SX:
        s = ca.SX.sym(name, len(columns))
        self.d.append(s)
        self.columns.append(columns)
        return s

    def parameter(self, name: str, start: np.ndarray, unit: str, scalar: bool = False) -> ca.SX:
        name += self.ending
        names = [name] if scalar else [f"{name}[{k}]" for k in range(len(start))]
        known = self.parameters.names
        return ca.vertcat(
            *[
                self.parameters.symbols[known.index(n)] if n in known else self.parameters.add(n, unit, v)
                for n, v in zip(names, start, strict=True)
            ]
        )

    def read(self, name: str, quaternion: bool) -> ca.SX:
        values = np.asarray(self.m.values[name])
        if quaternion:
            values = values / np.linalg.norm(values, axis=1, keepdims=True)
        value = self.symbol(name, values.T)
        size = 3 if quaternion else len(values.T)
        start = sum(s.numel() for s in self.noise)
        self.places[name] = slice(start, start + size)
        error = ca.SX.sym(f"noise of {name}", size)
        self.noise.append(error)
        return turned(value, error) if quaternion else value + error

    def corrected(self, c: Correction, name: str, value: ca.SX, unit: str) -> ca.SX:
        """Correct a signal in `unit` by delay, scale and offset, which are common to all poses of the row."""
        n = value.numel()
        if c.delay:
            rate = f"der({c.signal})"
            if rate not in self.m.values:
                raise ModelError(f"a delay of '{c.signal}' needs its rate among the values, named '{rate}'")
            speed = self.symbol(rate, np.asarray(self.m.values[rate]).T)
            value = value + self.parameter(f"{name}.delay", np.zeros(1), "s", scalar=True) * speed
        if c.scale:
            value = self.parameter(f"{name}.scale", np.ones(n), "1") * value
        if c.offset:
            for session in self.sessions:
                inside = self.inside(session)
                ending = f" in {session}" if len(self.sessions) > 1 else ""
                offset = self.parameter(f"{name}.offset{ending}", np.zeros(n), unit)
                value = value - inside * offset
        return value

    def placed(self, pose: Pose, signals: dict[str, ca.SX], latent: Sequence[str]) -> None:
        for name in (pose.position, pose.orientation):
            if name is not None and name not in signals and name not in latent:
                raise ModelError(f"a pose names '{name}', which is not measured; found {', '.join(signals)}")
        if pose.position not in signals:  # measured partially: see derived()
            if pose.orientation in signals and (pose.device or pose.target):
                raise ModelError(
                    f"'{pose.orientation}' is measured in the frame of a device, but '{pose.position}' only partially; "
                    "measure the whole position, or leave the orientation out"
                )
            return
        p = signals[pose.position]
        e = None if pose.orientation is None else signals.get(pose.orientation)
        if pose.target:
            if e is None:
                raise ModelError(
                    f"the target of '{pose.position}' needs a measured orientation; name it in the pose, or declare "
                    "the target as a point"
                )
            parts = [
                (inside, p + rotated(e, t), product(e, u))
                for inside, t, u in self.frames(f"{pose.position}.target", pose.target_per_session, pose.target_start)
            ]
            p, e = (_sum(inside * part[k] for inside, *part in parts) for k in range(2))
        if pose.device:
            parts = [
                (inside, t + rotated(u, p), ca.SX(0) if e is None else product(u, e))
                for inside, t, u in self.device(pose)
            ]
            p, turned_ = (_sum(inside * part[k] for inside, *part in parts) for k in range(2))
            e = None if e is None else turned_
        if pose.sag:
            p = p - self.sagged(pose)
        if pose.drift:
            p = p - self.drifted(pose, p.numel())
        signals[pose.position] = p
        if pose.orientation is not None and e is not None:
            signals[pose.orientation] = e

    def derived(self, signals: Sequence[Mapping[str, ca.SX]]) -> tuple[ca.SX, tuple[str, ...]]:
        """Equations of components, points and distances, with labels."""
        rows: list[ca.SX] = []
        labels: list[str] = []
        for name in self.m.values:
            if name.startswith(CONDITIONS):
                continue
            if name in self.m.distances:
                first, second = (self.point(end, signals, False) for end in self.m.distances[name])
                value, unit, base = ca.norm_2(first - second), "m", name
            else:
                s = _signal(self.flat, self.m, name)
                if s.component is None and s.base not in self.m.points:
                    continue
                value, base = self.point(name, signals, True), name.partition("@")[0]
                unit = "m" if s.base in self.m.points else self.flat.variables[self.flat.groups[s.base][1][0]].unit
            read = self.read(name, False)
            if read.numel() != value.numel():
                raise ModelError(f"'{name}' has {read.numel()} columns; expected {value.numel()}")
            for c in self.m.corrections:
                if c.signal == name:
                    read = self.corrected(c, base, read, unit or "")
            rows.append(value - read)
            labels += [name] if value.numel() == 1 else [f"{name}[{k}]" for k in range(value.numel())]
        return ca.vertcat(ca.SX(0, 1), *rows), tuple(labels)

    def point(self, name: str, signals: Sequence[Mapping[str, ca.SX]], by_device: bool) -> ca.SX:
        """A variable, a point, or one of their components, in the robot's frame or as the device measures it."""
        s = _signal(self.flat, self.m, name)
        variables = signals[min(s.pose, len(signals)) - 1]
        pose: Pose | None = None
        if s.base in self.m.points:
            q = self.m.points[s.base]
            coordinates = np.asarray(q.at, float)
            p = self.parameter(f"{s.base}.at", coordinates, "m") if q.free else ca.SX(ca.DM(coordinates))
            if q.position is not None:
                p = variables[q.position] + (p if q.orientation is None else rotated(variables[q.orientation], p))
            pose = next((a for a in self.m.poses if q.position in (None, a.position)), None)
        else:
            p = variables[s.base]
            pose = next((a for a in self.m.poses if a.position == s.base), None)
            if by_device and pose is not None and pose.target:
                raise ModelError(f"'{s.base}' on a target is measured only partially; declare the target as a point")
        if by_device and pose is not None:
            if pose.sag:
                p = p + self.sagged(pose)
            if pose.drift:
                p = p + self.drifted(pose, p.numel())
            if pose.device:
                back = [(inside, rotated(conjugate(u), p - t)) for inside, t, u in self.device(pose)]
                p = _sum(inside * part for inside, part in back)
        return p if s.component is None else p[s.component]

    def device(self, pose: Pose) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
        return self.frames(
            f"{pose.position}.device", pose.device_per_session, pose.device_start or IDENTITY, pose.device_starts
        )

    def inside(self, session: str) -> ca.SX:
        """1 at the poses of a session, 0 at others."""
        mask = np.array([s == session for s in self.m.sessions or [""] * len(self.m)], float)
        return self.symbol(f"in session {session}", mask[None])

    def frames(
        self, name: str, each: bool, start: tuple[ArrayLike, ArrayLike],
        starts: Mapping[str, tuple[ArrayLike, ArrayLike]] = MappingProxyType({}),
    ) -> list[tuple[ca.SX, ca.SX, ca.SX]]:  # fmt: skip
        """Weights (0 or 1 per pose) with t and u: one frame for all poses, or one per session."""
        if not each or len(self.sessions) == 1:
            return [(ca.SX(1), *self.frame(name, start))]
        return [(self.inside(s), *self.frame(name, starts.get(s, start), f" in {s}")) for s in self.sessions]

    def sagged(self, pose: Pose) -> ca.SX:
        name = f"load({pose.position})"
        if name not in self.m.values:
            raise ModelError(f"the sag of '{pose.position}' needs the load in N among the values, named '{name}'")
        load = np.asarray(self.m.values[name])
        if load.shape[1] not in (1, 3):
            raise ModelError(f"'{name}' has {load.shape[1]} columns; expected 3 of a force, or 1 (downwards)")
        if load.shape[1] == 1:
            load = load * np.array([0.0, 0.0, -1.0])
        k = self.parameter(f"{pose.position}.sag", np.array([pose.sag_start]), "m/N", scalar=True)
        return k * self.symbol(name, load.T)

    def drifted(self, pose: Pose, size: int) -> ca.SX:
        """Movement of the readings since the origin of time and temperature."""
        conditions = []
        for kind, of in (("linear", "time"), ("temperature", "temperature")):
            name = f"{of}({pose.position})"
            if kind in pose.drift and name not in self.m.values:
                raise ModelError(f"a drift of '{pose.position}' ({kind}) needs values named '{name}'")
            conditions.append(np.asarray(self.m.values.get(name, np.zeros(len(self.m))), float).reshape(-1))
        time, temperature = conditions
        columns = DriftBasis(pose.drift, time, None, temperature, origin=(0.0, 0.0)).columns()
        return _sum(
            self.parameter(f"{pose.position}.{prefix}", np.zeros(size), f"m{per}")
            * self.symbol(f"{prefix} of {pose.position}", column[None])
            for prefix, per, column in columns
        )

    def frame(self, name: str, start: tuple[ArrayLike, ArrayLike], ending: str = "") -> tuple[ca.SX, ca.SX]:
        t = self.parameter(f"{name}.t{ending}", np.asarray(start[0], float), "m")
        u = self.parameter(f"{name}.u{ending}", np.asarray(start[1], float), "1")
        self.unit.append(f"{name}.u{ending}{self.ending}")
        return t, u

    def hidden(self, name: str, start: np.ndarray, quaternion: bool) -> ca.SX:
        rows = np.broadcast_to(np.atleast_2d(start), (len(self.m), np.shape(start)[-1]))
        value = self.symbol(f"start of {name}", rows.T)
        size = 3 if quaternion else rows.shape[1]
        move = ca.SX.sym(f"move of {name}", size)
        self.latent.append(move)
        return turned(value, move) if quaternion else value + move


def _sum(parts: Iterable[ca.SX]) -> ca.SX:
    first, *rest = parts
    for part in rest:
        first = first + part
    return first
