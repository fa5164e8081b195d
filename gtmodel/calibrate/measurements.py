"""Measured poses: values of the model's variables, their noise, and what lies between sensor and model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..lang.source import ModelError

_COMPONENT = re.compile(r"(?P<base>.+)\[(?P<k>\d+)\]$")


class SignalName(NamedTuple):
    """What a signal's name says: "T@2" is T at the second pose of a row, "T[2]" the third component of T."""

    base: str
    component: int | None = None
    pose: int = 1

    @classmethod
    def of(cls, name: str, whole: Sequence[str] = ()) -> SignalName:
        """`whole`: names that are no components though they end with an index. Raises ModelError for a pose that is no
        number from 1."""
        stem, _, pose = name.partition("@")
        if pose and not (pose.isdecimal() and int(pose) >= 1):
            raise ModelError(f"'{name}' names no pose of its row; write {stem}@2 for the second")
        match = None if stem in whole else _COMPONENT.match(stem)
        number = int(pose or 1)
        return cls(stem, None, number) if match is None else cls(match["base"], int(match["k"]), number)

    def at(self, name: str) -> str:
        """Another variable at the same pose of the row."""
        return name if self.pose == 1 else f"{name}@{self.pose}"


@dataclass(frozen=True)
class FixedPoint:
    """A point whose position is measured, or its distance from another: fixed on the end-effector, or in the robot's
    frame where `position` is None.

    `at` (3,) [m]: in the frame of the end-effector, of which `position` and `orientation` (quaternion, scalar first)
    are the model's variables, or in the robot's. `free`: estimated from there, parameters "NAME.at[0]"...

    >>> ball = gt.calibrate.FixedPoint([0.1, 0.0, -0.05], "T", "e")  # a reflector on the plate
    >>> post = gt.calibrate.FixedPoint([1.0, 0.5, 0.2], free=True)  # the fixed end of a ball-bar
    >>> ball.free, post.position
    (False, None)
    """

    at: ArrayLike
    position: str | None = None
    orientation: str | None = None
    free: bool = False

    def __post_init__(self) -> None:
        at = np.asarray(self.at, float)
        if at.shape not in ((2,), (3,)) or not np.all(np.isfinite(at)):
            raise ModelError(f"a point has 3 coordinates, or 2 in the plane; found {self.at}")
        if self.orientation is not None and self.position is None:
            raise ModelError("a point with an orientation is on the end-effector: name its position too")


@dataclass(frozen=True)
class Pose:
    """A pose measured by a device that stands somewhere, on a target that sits somewhere on the end-effector.

    `position` and `orientation` (quaternion, scalar first) name variables of the model; no `orientation` for devices
    that see a point, on robots whose plate does not turn. `device`: the frame of the device in that of the robot is
    unknown, p_robot = t + R(u) p_device, parameters "T.device.t" and "T.device.u" where T is the position's name.
    `target`: the model's frame in that of the target, "T.target.t" and "T.target.u". Start values are (t (3,), u (4,))
    in `device_start` and `target_start`; left out, the identity, and in a study the device aligned with the model.

    `device_per_session`, `target_per_session`: each session has such a frame of its own, "T.device.t in s[0]" where
    there are several; `device_starts` by session, before `device_start`. `sag`: the end-effector is displaced by k
    times the load, a force [N] in the robot's frame, values "load(T)" (N, 3) or (N, 1) downwards; parameter "T.sag" = k
    [m/N], from `sag_start`: what the model calls T is the measured position less k load.
    """

    position: str
    orientation: str | None = None
    device: bool = False
    target: bool = False
    device_start: tuple[ArrayLike, ArrayLike] | None = None
    target_start: tuple[ArrayLike, ArrayLike] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    device_per_session: bool = False
    target_per_session: bool = False
    device_starts: Mapping[str, tuple[ArrayLike, ArrayLike]] = field(default_factory=dict)
    sag: bool = False
    sag_start: float = 0.0


@dataclass(frozen=True)
class Correction:
    """A signal read through a delay [s], a scale and an offset per session, in the convention of
    `gtmodel.measurements.Signal`: quantity = scale column(t + delay) - offset, column(t + delay) = column + delay rate.

    True estimates it; `delay` needs the signal's rate among the values, as "der(q)". Parameters "q.scale[i]",
    "q.offset[i]" (of several sessions "q.offset in s[i]"), "q.delay".
    """

    signal: str
    offset: bool = False
    scale: bool = False
    delay: bool = False


@dataclass(frozen=True, eq=False)
class Measurements:
    """N poses: `values` by variable name, (N,) or (N, k) in SI units, in the frames in which they were measured.

    `noise` by name: a standard deviation, one per component (k,), a covariance (k, k), or one per pose (N, k, k); of a
    quaternion in rad, about the axes of what was measured. `sessions` (N,): names of recordings. `poses` and
    `corrections` say what lies between sensor and model. Raises ModelError for shapes and values that cannot be.

    A pose may be known in part. Beside whole variables there are components, "T[2]"; `points`, measured by the name
    that they are given here; and `distances`, by name from one position or point to another. What is measured at the
    second pose of a row has "@2" after its name: "q@2", a distance from "T" to "T@2". `latent` names variables that
    nobody measured; those that components, points and distances need are latent by themselves. `name`: of these
    measurements among others; `places` (N,): where each pose was read, such as "poses.csv, line 7".

    >>> poses = gt.calibrate.Measurements({"q": np.zeros((4, 3)), "T": np.ones((4, 3))}, noise={"T": 1e-5})
    >>> len(poses), len(poses.part([0, 2])), poses.covariance("T", 3).shape
    (4, 2, (1, 3, 3))
    >>> gt.calibrate.Measurements({"q": np.zeros((4, 3)), "T": np.ones((3, 3))})
    Traceback (most recent call last):
    gtmodel...ModelError: 'T' has 3 rows and 'q' 4; give one per pose
    >>> heights = gt.calibrate.Measurements({"q": np.zeros((4, 3)), "T[2]": np.full(4, 0.5)}, noise={"T[2]": 1e-5})
    >>> q1, q2, bar = np.zeros((4, 3)), np.ones((4, 3)), np.full(4, 0.3)
    >>> bars = gt.calibrate.Measurements({"q": q1, "q@2": q2, "bar": bar}, distances={"bar": ("T", "T@2")})
    """

    values: Mapping[str, ArrayLike]
    noise: Mapping[str, ArrayLike] = field(default_factory=dict)
    sessions: Sequence[str] | None = None
    poses: Sequence[Pose] = ()
    corrections: Sequence[Correction] = ()
    points: Mapping[str, FixedPoint] = field(default_factory=dict)
    distances: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    latent: Sequence[str] = ()
    name: str = ""
    places: Sequence[str] | None = None

    def __post_init__(self) -> None:
        arrays: dict[str, np.ndarray] = {}
        for name, given in self.values.items():
            a = np.asarray(given, float)
            if a.ndim == 0:
                raise ModelError(f"'{name}' is one number; expected rows, one per pose")
            arrays[name] = a.reshape(len(a), -1)
        if not arrays:
            raise ModelError("there is nothing measured; give values such as q=..., T=...")
        first = next(iter(arrays))
        for name, a in arrays.items():
            if len(a) != len(arrays[first]):
                raise ModelError(f"'{name}' has {len(a)} rows and '{first}' {len(arrays[first])}; give one per pose")
            if not np.all(np.isfinite(a)):
                raise ModelError(f"'{name}' is not finite at pose {int(np.argwhere(~np.isfinite(a))[0, 0])} (from 0)")
        for name, stated in self.noise.items():
            s = np.asarray(stated, float)
            if not np.all((np.diagonal(s, axis1=-2, axis2=-1) if s.ndim > 1 else s) > 0):
                raise ModelError(
                    f"the noise of '{name}' must be positive; found {s}: no reading is exact; give a standard "
                    "deviation above 0, or leave it out and the residuals give it"
                )
        if self.sessions is not None and len(self.sessions) != len(arrays[first]):
            raise ModelError(f"{len(self.sessions)} sessions are named for {len(arrays[first])} poses; give one each")
        object.__setattr__(self, "values", arrays)

    def __len__(self) -> int:
        return len(np.asarray(next(iter(self.values.values()))))

    @property
    def session_names(self) -> tuple[str, ...]:
        """In the order of their first pose; one empty name where none are given."""
        return tuple(dict.fromkeys(self.sessions)) if self.sessions is not None else ("",)

    def part(self, rows: ArrayLike) -> Measurements:
        """Some of the poses, by index or mask."""
        index = np.arange(len(self))[np.asarray(rows)]
        noise = {n: (np.asarray(s)[index] if np.ndim(s) == 3 else s) for n, s in self.noise.items()}
        sessions = None if self.sessions is None else [self.sessions[int(k)] for k in index]
        values = {n: np.asarray(a)[index] for n, a in self.values.items()}
        places = None if self.places is None else [self.places[int(k)] for k in index]
        return replace(self, values=values, noise=noise, sessions=sessions, places=places)

    def unclosed(self, rows: Sequence[int] | np.ndarray) -> str:
        """A sentence on poses, from 0, that no position of the robot closes."""
        which = self.where(int(rows[0]))
        others = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
        return (
            f"{which}{others} cannot be closed with the parameters at the start: check its line, the units, and the "
            "robot's parameters and start values"
        )

    def where(self, row: int) -> str:
        """Words for a pose, from 0: its place in what was read where that is known."""
        if self.places is not None:
            return f"the pose of {self.places[row]}"
        return f"pose {row + 1}" + (f" of {self.name}" if self.name else "")

    def covariance(self, name: str, size: int) -> np.ndarray:
        """Covariance (N or 1, size, size) of a signal; size 3 for a quaternion [rad^2]. Raises ModelError."""
        s = np.asarray(self.noise[name], float)
        if s.ndim < 2:
            if s.shape not in ((), (size,)):
                raise ModelError(f"the noise of '{name}' has the shape {s.shape}; expected one number, or {size}")
            return (np.broadcast_to(s, size) ** 2 * np.eye(size))[None]
        c = s if s.ndim == 3 else s[None]
        if c.shape[1:] != (size, size) or len(c) not in (1, len(self)):
            raise ModelError(
                f"the noise of '{name}' has the shape {s.shape}; expected ({size}, {size}) or one per pose"
            )
        return c
