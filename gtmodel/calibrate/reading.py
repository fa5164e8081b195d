"""What sensors said, as expressions: values of the model's variables from data, noise, unknown frames and scales."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..lang.source import ModelError
from .closure import Closure
from .measurements import Correction, Measurements, Pose
from .quaternions import product, rotated, turned
from .unknowns import Parameters

IDENTITY = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Reading:
    """`d` (nd,) symbols of a pose's data and `data` (nd, N) their values; `noise` (ny,) symbols of what is added to
    them; `latent` (nz,) symbols of what nobody measured.

    `values`: model symbols -> expressions in these and in `parameters` of the measurement (frames, scales, offsets).
    `places`: signal -> its slice of the noise; `unit`: quaternions among the parameters.
    """

    d: ca.SX
    data: np.ndarray
    noise: ca.SX
    places: dict[str, slice]
    latent: ca.SX
    values: tuple[tuple[ca.SX, ca.SX], ...]
    parameters: Parameters
    unit: tuple[str, ...]


def reading(closure: Closure, m: Measurements, starts: dict[str, np.ndarray], sessions: Sequence[str] = ()) -> Reading:
    """`starts`: of latent variables (k,) or (N, k); `sessions`: all that parameters are for, those of the measurements
    if empty. Raises ModelError for what is measured but not in the model's
    closure equations, wrong sizes, and corrections that need more than was given."""
    r = _Reader(closure.flat.title, m, tuple(sessions) or m.session_names)
    own = any(c.offset for c in m.corrections) or any(p.device_per_session or p.target_per_session for p in m.poses)
    strange = [s for s in m.session_names if own and s not in r.sessions]
    if strange:
        raise ModelError(f"there is no session '{strange[0]}' among those prepared: {', '.join(r.sessions)}")
    signals: dict[str, ca.SX] = {}
    for name in closure.known:
        if name not in m.values:
            raise ModelError(f"'{name}' is known to the closure equations, but no values are given")
        size = closure.symbols[name].numel()
        given = np.asarray(m.values[name])
        if given.shape[1] != size:
            raise ModelError(f"'{name}' has {given.shape[1]} columns; the model's has {size}")
        quaternion = name in closure.unit or any(p.orientation == name for p in m.poses)
        signals[name] = r.read(name, quaternion)
    for c in m.corrections:
        if c.signal not in signals:
            raise ModelError(f"a correction names '{c.signal}', which is not among {', '.join(signals)}")
        first = closure.flat.groups[c.signal][1][0]
        signals[c.signal] = r.corrected(c, signals[c.signal], closure.flat.variables[first].unit or "")
    for pose in m.poses:
        r.placed(pose, signals)
    for name in closure.latent:
        signals[name] = r.hidden(name, starts[name], name in closure.unit)
    values = tuple((closure.symbols[n], signals[n]) for n in (*closure.known, *closure.latent))
    return Reading(
        ca.vertcat(*r.d), np.vstack(r.columns), ca.vertcat(ca.SX(0, 1), *r.noise), r.places,
        ca.vertcat(ca.SX(0, 1), *r.latent), values, r.parameters, tuple(r.unit),
    )  # fmt: skip


class _Reader:
    def __init__(self, title: str, m: Measurements, sessions: tuple[str, ...]) -> None:
        self.m = m
        self.sessions = sessions
        self.d: list[ca.SX] = []
        self.columns: list[np.ndarray] = []
        self.noise: list[ca.SX] = []
        self.places: dict[str, slice] = {}
        self.latent: list[ca.SX] = []
        self.parameters = Parameters(title)
        self.unit: list[str] = []

    def symbol(self, name: str, columns: np.ndarray) -> ca.SX:
        s = ca.SX.sym(name, len(columns))
        self.d.append(s)
        self.columns.append(columns)
        return s

    def parameter(self, name: str, start: np.ndarray, unit: str, scalar: bool = False) -> ca.SX:
        names = [name] if scalar else [f"{name}[{k}]" for k in range(len(start))]
        return ca.vertcat(*[self.parameters.add(n, unit, v) for n, v in zip(names, start, strict=True)])

    def read(self, name: str, quaternion: bool) -> ca.SX:
        given = np.asarray(self.m.values[name])
        if quaternion:
            given = given / np.linalg.norm(given, axis=1, keepdims=True)
        value = self.symbol(name, given.T)
        size = 3 if quaternion else len(given.T)
        at = sum(s.numel() for s in self.noise)
        self.places[name] = slice(at, at + size)
        error = ca.SX.sym(f"noise of {name}", size)
        self.noise.append(error)
        return turned(value, error) if quaternion else value + error

    def corrected(self, c: Correction, value: ca.SX, unit: str) -> ca.SX:
        """A signal in `unit` without its delay, scale and offset."""
        n = value.numel()
        if c.delay:
            rate = f"der({c.signal})"
            if rate not in self.m.values:
                raise ModelError(f"a delay of '{c.signal}' needs its rate among the values, as '{rate}'")
            moved = self.symbol(rate, np.asarray(self.m.values[rate]).T)
            value = value + self.parameter(f"{c.signal}.delay", np.zeros(1), "s", scalar=True) * moved
        if c.scale:
            value = self.parameter(f"{c.signal}.scale", np.ones(n), "1") * value
        if c.offset:
            for session in self.sessions:
                inside = self.inside(session)
                ending = f" in {session}" if len(self.sessions) > 1 else ""
                offset = self.parameter(f"{c.signal}.offset{ending}", np.zeros(n), unit)
                value = value - inside * offset
        return value

    def placed(self, pose: Pose, signals: dict[str, ca.SX]) -> None:
        for name in (pose.position, pose.orientation):
            if name is not None and name not in signals:
                raise ModelError(f"a pose names '{name}', which is not measured; measured are {', '.join(signals)}")
        p = signals[pose.position]
        e = None if pose.orientation is None else signals[pose.orientation]
        if pose.target:
            if e is None:
                raise ModelError(f"the target of '{pose.position}' needs a measured orientation; name it in the pose")
            parts = [
                (inside, p + rotated(e, t), product(e, u))
                for inside, t, u in self.frames(f"{pose.position}.target", pose.target_per_session, pose.target_start)
            ]
            p, e = (_sum(inside * part[k] for inside, *part in parts) for k in range(2))
        if pose.device:
            name, each, starts = f"{pose.position}.device", pose.device_per_session, pose.device_starts
            parts = [
                (inside, t + rotated(u, p), ca.SX(0) if e is None else product(u, e))
                for inside, t, u in self.frames(name, each, pose.device_start or IDENTITY, starts)
            ]
            p, turned_ = (_sum(inside * part[k] for inside, *part in parts) for k in range(2))
            e = None if e is None else turned_
        if pose.sag:
            p = p - self.sagged(pose)
        signals[pose.position] = p
        if pose.orientation is not None and e is not None:
            signals[pose.orientation] = e

    def inside(self, session: str) -> ca.SX:
        """1 at the poses of a session, 0 at others."""
        here = np.array([s == session for s in self.m.sessions or [""] * len(self.m)], float)
        return self.symbol(f"in session {session}", here[None])

    def frames(
        self, name: str, each: bool, start: tuple[ArrayLike, ArrayLike],
        starts: Mapping[str, tuple[ArrayLike, ArrayLike]] = MappingProxyType({}),
    ) -> list[tuple[ca.SX, ca.SX, ca.SX]]:  # fmt: skip
        """Where it counts, t and u: one for all poses, or one for each session."""
        if not each or len(self.sessions) == 1:
            return [(ca.SX(1), *self.frame(name, start))]
        return [(self.inside(s), *self.frame(name, starts.get(s, start), f" in {s}")) for s in self.sessions]

    def sagged(self, pose: Pose) -> ca.SX:
        name = f"load({pose.position})"
        if name not in self.m.values:
            raise ModelError(f"the sag of '{pose.position}' needs the load among the values, as '{name}' in N")
        load = np.asarray(self.m.values[name])
        if load.shape[1] not in (1, 3):
            raise ModelError(f"'{name}' has {load.shape[1]} columns; expected a force of 3, or its size downwards")
        if load.shape[1] == 1:
            load = load * np.array([0.0, 0.0, -1.0])
        k = self.parameter(f"{pose.position}.sag", np.array([pose.sag_start]), "m/N", scalar=True)
        return k * self.symbol(name, load.T)

    def frame(self, name: str, start: tuple[ArrayLike, ArrayLike], ending: str = "") -> tuple[ca.SX, ca.SX]:
        t = self.parameter(f"{name}.t{ending}", np.asarray(start[0], float), "m")
        u = self.parameter(f"{name}.u{ending}", np.asarray(start[1], float), "1")
        self.unit.append(f"{name}.u{ending}")
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
