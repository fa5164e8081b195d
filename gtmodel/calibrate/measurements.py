"""Measured poses: values of the model's variables, their noise, and the frames and corrections of the sensors."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..lang.source import ModelError
from ..measurements.drift import DriftKind

CONDITIONS = ("der(", "load(", "time(", "temperature(")  # names of values that are no signals of the model begin so
_COMPONENT = re.compile(r"(?P<base>.+)\[(?P<k>\d+)\]$")


class SignalName(NamedTuple):
    """A parsed signal name: "T@2" is T at the second pose of a row, "T[2]" the third component of T."""

    base: str
    component: int | None = None
    pose: int = 1

    @classmethod
    def of(cls, name: str, whole: Sequence[str] = ()) -> SignalName:
        """Parse a name; `whole`: names that end with an index but are not components.

        Raises ModelError if the pose is not a number from 1."""
        stem, _, pose = name.partition("@")
        if pose and not (pose.isdecimal() and int(pose) >= 1):
            raise ModelError(f"'{name}' does not name a pose of its row; write {stem}@2 for the second")
        match = None if stem in whole else _COMPONENT.match(stem)
        number = int(pose or 1)
        return cls(stem, None, number) if match is None else cls(match["base"], int(match["k"]), number)

    def at(self, name: str) -> str:
        """The name of another variable at the same pose of the row."""
        return name if self.pose == 1 else f"{name}@{self.pose}"


@dataclass(frozen=True)
class FixedPoint:
    """A point whose position, or distance from another point, is measured: on the end-effector, or fixed in the robot's
    frame if `position` is None.

    `at` (3,) [m]: in the frame of the end-effector, whose `position` and `orientation` (quaternion, scalar first) are
    variables of the model, or in the robot's frame. `free`: estimate it from there, parameters "NAME.at[0]"...

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
        coordinates = np.asarray(self.at, float)
        if coordinates.shape not in ((2,), (3,)) or not np.all(np.isfinite(coordinates)):
            raise ModelError(f"a point has 3 coordinates, or 2 in the plane; found {self.at}")
        if self.orientation is not None and self.position is None:
            raise ModelError("a point with an orientation is on the end-effector: give its position variable too")


@dataclass(frozen=True)
class Pose:
    """A pose measured by a device, possibly at an unknown place, on a target, possibly at an unknown place of the tool.

    `position` and `orientation` (quaternion, scalar first) name variables of the model; leave out `orientation` if the
    device sees only a point and the plate does not turn. `device`: the frame of the device in that of the robot is
    unknown, p_robot = t + R(u) p_device, with parameters "T.device.t" and "T.device.u" if T is the position's name.
    `target`: the model's frame in that of the target, "T.target.t" and "T.target.u". Start values are (t (3,), u (4,))
    in `device_start` and `target_start`; the default is the identity, and in a study a device aligned with the model.

    `device_per_session`, `target_per_session`: one such frame per session, "T.device.t in s[0]" if there are several;
    `device_starts` by session override `device_start`. `sag`: the end-effector is displaced by k times the load, a
    force [N] in the robot's frame, values "load(T)" (N, 3) or (N, 1) downwards; parameter "T.sag" = k [m/N], starting
    from `sag_start`. T of the model is the measured position less k load.

    `drift`: the readings of the position move in the robot's frame; "linear", from values "time(T)" (N,) [s], with the
    rate "T.drift[0]"... [m/s], and "temperature", from "temperature(T)" (N,) [K], with "T.thermal[0]"... [m/K]. Both
    values are relative to the time and temperature at which the frame of the device is that of the parameters.
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
    drift: tuple[DriftKind, ...] = ()


@dataclass(frozen=True)
class Correction:
    """Delay [s], and scale and offset per session, of a signal: quantity = scale column(t + delay) - offset.

    Convention of `gtmodel.measurements.Signal`, with column(t + delay) = column + delay rate. True estimates a value;
    `delay` needs the signal's rate among the values, as "der(q)". Parameters "q.scale[i]", "q.offset[i]" (with several
    sessions "q.offset in s[i]"), "q.delay".
    """

    signal: str
    offset: bool = False
    scale: bool = False
    delay: bool = False


@dataclass(frozen=True, eq=False)
class Measurements:
    """N poses: `values` by variable name, (N,) or (N, k) in SI units, in the frames in which they were measured.

    `noise` by name: a standard deviation, one per component (k,), a covariance (k, k), or one per pose (N, k, k); for a
    quaternion in rad, about the measured axes. `sessions` (N,): names of recordings. `poses` and `corrections` describe
    frames and errors of the sensors. Raises ModelError for inconsistent shapes and invalid values.

    A pose may be measured partially: by components, "T[2]"; by `points`, under the names given here; and by
    `distances`, name -> the two positions or points. Signals of the second pose of a row end with "@2": "q@2", a
    distance from "T" to "T@2". `latent` names unmeasured variables; those that components, points and distances need
    are added automatically. `name`: of these measurements among others. `places` (N,): where each pose was read, such
    as "poses.csv, line 7".

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
        for name, rows in self.values.items():
            a = np.asarray(rows, float)
            if a.ndim == 0:
                raise ModelError(f"'{name}' is one number; expected an array with one row per pose")
            arrays[name] = a.reshape(len(a), -1)
        if not arrays:
            raise ModelError("there are no measurements; give values such as q=..., T=...")
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
                    f"the noise of '{name}' must be positive, as no reading is exact; found {s}: give a standard "
                    "deviation above 0, or leave it out to estimate it from the residuals"
                )
        if self.sessions is not None and len(self.sessions) != len(arrays[first]):
            raise ModelError(f"found {len(self.sessions)} sessions for {len(arrays[first])} poses; give one per pose")
        object.__setattr__(self, "values", arrays)

    def __len__(self) -> int:
        return len(np.asarray(next(iter(self.values.values()))))

    @property
    def session_names(self) -> tuple[str, ...]:
        """Names of the sessions, ordered by their first pose; one empty name if there are none."""
        return tuple(dict.fromkeys(self.sessions)) if self.sessions is not None else ("",)

    def part(self, rows: ArrayLike) -> Measurements:
        """Return some of the poses, by index or mask."""
        index = np.arange(len(self))[np.asarray(rows)]
        noise = {n: (np.asarray(s)[index] if np.ndim(s) == 3 else s) for n, s in self.noise.items()}
        sessions = None if self.sessions is None else [self.sessions[int(k)] for k in index]
        values = {n: np.asarray(a)[index] for n, a in self.values.items()}
        places = None if self.places is None else [self.places[int(k)] for k in index]
        return replace(self, values=values, noise=noise, sessions=sessions, places=places)

    def unclosed(self, rows: Sequence[int] | np.ndarray) -> str:
        """Return a sentence on poses (from 0) that do not close."""
        which = self.where(int(rows[0]))
        others = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
        return (
            f"{which}{others} cannot be closed with the start values: check its line, the units, and the "
            "robot's parameters and start values"
        )

    def where(self, row: int) -> str:
        """Return words for a pose (from 0), with its file and line if known."""
        if self.places is not None:
            return f"the pose of {self.places[row]}"
        return f"pose {row + 1}" + (f" of {self.name}" if self.name else "")

    def covariance(self, name: str, size: int) -> np.ndarray:
        """Return the covariance (N or 1, size, size) of a signal; size 3 for a quaternion [rad^2]."""
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
