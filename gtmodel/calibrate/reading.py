"""What sensors said, as expressions: values of the model's variables from data, noise, unknown frames and scales."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..lang.source import ModelError
from .closure import Closure
from .measurements import Correction, Measurements, Pose
from .turning import product, rotated, turned
from .unknowns import Parameters


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


def reading(closure: Closure, m: Measurements, starts: dict[str, np.ndarray]) -> Reading:
    """`starts`: of latent variables (k,) or (N, k). Raises ModelError for what is measured but not in the model's
    closure equations, wrong sizes, and corrections that need more than was given."""
    r = _Reader(closure.flat.title, m)
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
        signals[c.signal] = r.corrected(c, signals[c.signal])
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
    def __init__(self, title: str, m: Measurements) -> None:
        self.m = m
        self.d: list[ca.SX] = []
        self.columns: list[np.ndarray] = []
        self.noise: list[ca.SX] = []
        self.places: dict[str, slice] = {}
        self.latent: list[ca.SX] = []
        self.parameters = Parameters(title, [], [], [], [])
        self.unit: list[str] = []

    def symbol(self, name: str, columns: np.ndarray) -> ca.SX:
        s = ca.SX.sym(name, len(columns))
        self.d.append(s)
        self.columns.append(columns)
        return s

    def parameter(self, name: str, start: np.ndarray, unit: str, scalar: bool = False) -> ca.SX:
        names = [name] if scalar else [f"{name}[{k}]" for k in range(len(start))]
        symbols = [ca.SX.sym(n) for n in names]
        p = self.parameters
        p.names.extend(names)
        p.symbols.extend(symbols)
        p.values.extend(float(v) for v in start)
        p.units.extend([unit] * len(names))
        return ca.vertcat(*symbols)

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

    def corrected(self, c: Correction, value: ca.SX) -> ca.SX:
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
            sessions = self.m.session_names
            for session in sessions:
                here = np.array([s == session for s in self.m.sessions or [""] * len(self.m)], float)
                inside = self.symbol(f"in session {session}", here[None])
                ending = f" in {session}" if len(sessions) > 1 else ""
                offset = self.parameter(f"{c.signal}.offset{ending}", np.zeros(n), "")
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
            t, u = self.frame(f"{pose.position}.target", pose.target_start)
            p, e = p + rotated(e, t), product(e, u)
        if pose.device:
            t, u = self.frame(f"{pose.position}.device", pose.device_start)
            p, e = t + rotated(u, p), None if e is None else product(u, e)
        signals[pose.position] = p
        if pose.orientation is not None and e is not None:
            signals[pose.orientation] = e

    def frame(self, name: str, start: tuple[ArrayLike, ArrayLike]) -> tuple[ca.SX, ca.SX]:
        t = self.parameter(f"{name}.t", np.asarray(start[0], float), "m")
        u = self.parameter(f"{name}.u", np.asarray(start[1], float), "1")
        self.unit.append(f"{name}.u")
        return t, u

    def hidden(self, name: str, start: np.ndarray, quaternion: bool) -> ca.SX:
        rows = np.broadcast_to(np.atleast_2d(start), (len(self.m), np.shape(start)[-1]))
        value = self.symbol(f"start of {name}", rows.T)
        size = 3 if quaternion else rows.shape[1]
        move = ca.SX.sym(f"move of {name}", size)
        self.latent.append(move)
        return turned(value, move) if quaternion else value + move
