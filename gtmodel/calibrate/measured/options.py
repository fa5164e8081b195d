"""Options for poses in a CSV file: columns and units, frames and points of device and robot, points of guideways."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np

from ...lang.units import UnitError, parse_unit
from ...measurements.joining import ClockColumn, RowJoin
from ...results.options import Long, Options, Unit, Within
from ...results.refusal import ArgumentError, renamed

Free = Literal["estimate"]
ESTIMATE: Free = "estimate"
DeviceDrift = Literal["none", "linear", "temperature"]


@dataclass(frozen=True)
class MeasuredSignal(Options):
    """Columns of a measured variable, as for signals of a log, see `gtmodel.measurements.Conversion`:
    quantity = coupling (scale / gear_ratio (column + delay rate)) - offset.

    >>> gt.calibrate.MeasuredSignal("T", "mm", deviation=0.01).noise_in_si  # T[0], T[1], ... of the file
    1e-05
    >>> gt.calibrate.MeasuredSignal(["q1", "q2", "q3"], "mm", offset="estimate").offset
    'estimate'
    """

    column: Annotated[str | list[str], 'names in the file; "q" also means "q[0]", "q[1]", ...']
    unit: Annotated[str | list[str], "unit of the columns, or one each"]
    deviation: Annotated[
        float | list[float] | list[list[float]] | None,
        "standard deviation in the unit of the column: one, one each, or a covariance in its square; in rad for a "
        "quaternion or matrix; if left out, estimated from the residuals",
    ] = None
    noise: Annotated[
        float | list[float] | list[list[float]] | None,
        "old name of deviation, in SI; accepted if the unit is SI",
    ] = None
    scale: Annotated[
        float | list[float] | Free, "quantity per column, both in SI, one or one each; -1 reverses a sign"
    ] = 1.0
    offset: Annotated[
        float | list[float] | Free,
        "reading at which the quantity is zero, in its SI unit, one or one each; if estimated, one per session",
    ] = 0.0
    delay: Annotated[float | Free, Unit("s"), "delay of the column; needs its rate"] = 0.0
    gear_ratio: Annotated[
        float | list[float] | None, "turns of the motor per turn of the joint, one or one each; columns are divided"
    ] = None
    coupling: Annotated[
        list[list[float]] | None,
        "square matrix from the columns, after scale and gear ratio, to the quantity, such as for a wrist whose joint "
        "6 moves with joint 5",
    ] = None
    rate: Annotated[str | list[str] | None, "columns of the rate, for a delay"] = None
    rate_unit: Annotated[str, "unit of the rate's columns"] = "m/s"
    between: Annotated[
        list[str] | None, Long(2),
        'the signal is the distance between two positions or points, such as ["T", "T@2"]',
    ] = None  # fmt: skip
    representation: Annotated[
        str | None,
        "representation of an orientation: quaternion w x y z (default), quaternion x y z w, rotation vector, "
        "matrix, KUKA A B C, "
        "intrinsic zyx or extrinsic xyz with any axes; of a position: matrix, the last column of a pose's 12 or 16",
    ] = None  # fmt: skip
    file: Annotated[
        str | None, "file of this signal, if not that of the poses, such as of the tracker; path from its folder"
    ] = None  # fmt: skip
    join: Annotated[
        str | RowJoin | None,
        "column in both files that names the pose of a row, or a table such as { match = \"at_rest\" }; if left out, "
        "row n of both files is pose n",
    ] = None  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.join is not None and self.file is None:
            raise ArgumentError("joins the rows of two files; name the file of this signal too", "join")
        for name in ("deviation", "noise"):
            value = getattr(self, name)
            if value is None:
                continue
            sizes = np.diagonal(value) if np.ndim(value) == 2 else np.atleast_1d(value)
            if not (np.all(sizes > 0) and np.all(np.isfinite(sizes))):
                raise ArgumentError(
                    f"found {value}; expected more than 0, as no reading is exact: give a standard deviation, or leave "
                    "it out to estimate it from the residuals",
                    name,
                )
        if self.noise is None:
            return
        if self.deviation is not None:
            raise ArgumentError("is the old name of deviation, which is also given; leave one of the two out", "noise")
        renamed("noise of a signal", "deviation")
        try:
            si = all(parse_unit(u).is_si for u in self._units)
        except UnitError:  # reported when the columns are read
            return
        if not si:
            was, units = self._scaled(self.noise, -1), ", ".join(dict.fromkeys(self._units))
            units = f"({units})^2" if np.ndim(self.noise) == 2 else units
            raise ArgumentError(
                f"is accepted only if columns are in SI, and these are in {units}: {self.noise} in SI is {was} "
                f"{units}: write deviation = {was}, or deviation = {self.noise} if that is in {units}",
                "noise",
            )

    @property
    def noise_in_si(self) -> float | list[float] | list[list[float]] | None:
        """Standard deviation or covariance of the quantity in SI; None if not stated. Raises ArgumentError."""
        return self.noise if self.deviation is None else self._scaled(self.deviation, 1)

    @property
    def _units(self) -> list[str]:
        return [self.unit] if isinstance(self.unit, str) else self.unit

    def _scaled(self, value: float | list[float] | list[list[float]], power: int) -> Any:
        """Convert from the columns' unit to the quantity in SI, or back, rounded to 12 digits."""
        if self.coupling is not None:
            raise ArgumentError("is not known after a coupling; leave it out, to estimate it", "deviation")
        scale, gear = np.asarray(1.0 if isinstance(self.scale, str) else self.scale), np.asarray(self.gear_ratio or 1.0)
        factors = np.abs(scale / gear) * np.array([parse_unit(u).scale for u in self._units])
        factor = (factors if len(set(factors.tolist())) > 1 else factors[0]) ** power
        if np.ndim(factor) and np.shape(value) not in ((), factor.shape, 2 * factor.shape):
            sentence = f"has the shape {np.shape(value)} for {len(factor)} columns in several units; give one each"
            raise ArgumentError(sentence, "deviation")
        scaled = np.asarray(value) * (np.multiply.outer(factor, factor) if np.ndim(value) == 2 else factor)
        return np.vectorize(lambda x: float(f"{x:.12g}"), otypes=[float])(scaled).tolist()


@dataclass(frozen=True)
class MeasuredPoint(Options):
    """A measured point, or the end of a measured distance: on the end-effector, or fixed in the robot's frame.

    >>> ball = gt.calibrate.MeasuredPoint([0.1, 0.0, -0.05], position="T", orientation="e")
    >>> gt.calibrate.MeasuredPoint([1.0, 0.5, 0.2], estimate=True).position is None  # the fixed end of a ball-bar
    True
    """

    at: Annotated[list[float], Unit("m"), Long(3), "in the frame of the end-effector, or the robot's"]
    position: Annotated[str | None, "position variable of the model that it is attached to; fixed if left out"] = None
    orientation: Annotated[str | None, "quaternion with which it turns"] = None
    estimate: Annotated[bool, "whether to estimate its coordinates, starting from `at`"] = False


@dataclass(frozen=True)
class FrameStart(Options):
    """Start values of an unknown frame.

    >>> gt.calibrate.FrameStart(t=[2.0, -1.0, 0.5], quaternion=[0.0, 0.0, 1.0])
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: quaternion: expected 4 numbers; found 3
    """

    t: Annotated[list[float], Unit("m"), Long(3), "its origin"] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    quaternion: Annotated[list[float], Long(4), "its orientation, scalar first"] = field(
        default_factory=lambda: [1.0, 0.0, 0.0, 0.0]
    )


@dataclass(frozen=True)
class Sag(Options):
    """Displacement of the tool under a payload: k times its weight, along it.

    >>> gt.calibrate.Sag(payload="m", compliance=2e-7).payload  # the column "m" of the file, in kg
    'm'
    """

    payload: Annotated[
        float | str, Unit("kg"), Within(least=0), "mass at the tool: a number, or the column with that of each pose"
    ]  # fmt: skip
    compliance: Annotated[
        float | Free, Unit("m/N", key="compliance_m_per_N"), Within(least=0),
        "k; if estimated (T.sag), poses with at least two payloads are needed",
    ] = ESTIMATE  # fmt: skip
    down: Annotated[list[float], Long(3), "direction of the weight, in the robot's frame"] = field(
        default_factory=lambda: [0.0, 0.0, -1.0]
    )


@dataclass(frozen=True)
class Measured(Options):
    """Measured poses in a CSV file: its columns, and the frames and points between device and robot.

    >>> from gtmodel.calibrate import Measured, MeasuredSignal
    >>> measured = Measured({"q": MeasuredSignal("q", "mm"), "T": MeasuredSignal("T", "mm")}, frame="device")
    >>> measured.actuators, measured.position
    ('q', 'T')
    """

    signals: Annotated[
        dict[str, MeasuredSignal],
        "by the model's variables: q, T, e; components: T[2]; points; distances; of a row's second pose: q@2",
    ]  # fmt: skip
    session: Annotated[str | None, "column that names the recording of a row"] = None
    time: Annotated[ClockColumn | None, "time column of the poses, for a join in time and for a drift"] = None
    temperature: Annotated[str | None, "column with the temperature in K or its changes, for a drift"] = None
    drift: Annotated[
        DeviceDrift | list[DeviceDrift],
        "drift of the measured position to estimate, one or several: linear in time, or with temperature",
    ] = "none"  # fmt: skip
    actuators: Annotated[str, "variable that the drives measure"] = "q"
    position: Annotated[str, "variable that the device measures"] = "T"
    orientation: Annotated[str | None, "its quaternion, scalar first, if measured"] = None
    frame: Annotated[
        Literal["robot", "device"],
        "frame of the coordinates in the file: the robot's, or that of a device at an unknown place",
    ] = "robot"
    target: Annotated[bool, "whether the place of the target on the end-effector is unknown"] = False
    device_start: Annotated[
        FrameStart | None, "frame of the device in the robot's frame; by default from alignment with the model"
    ] = None
    device_per_session: Annotated[
        bool, "whether the device moved between sessions; its frames are found by alignment"
    ] = False  # fmt: skip
    target_per_session: Annotated[bool, "whether the target moved on the end-effector between sessions"] = False
    sag: Annotated[Sag | None, "sag of the tool under a payload; none if left out"] = None
    target_start: Annotated[FrameStart, "start value of the robot's tool frame in the target's"] = field(
        default_factory=FrameStart
    )
    points: Annotated[dict[str, MeasuredPoint], "measured points by the names of their signals"] = field(
        default_factory=dict
    )
    latent: Annotated[
        list[str], "unmeasured variables, estimated pose by pose; those that signals need are added automatically"
    ] = field(default_factory=list)  # fmt: skip
    name: Annotated[str, "name of these measurements among others; by default their file's"] = ""
    leave_out: Annotated[
        list[int], "lines of the file whose poses are not read, such as outliers; the result counts them"
    ] = field(default_factory=list)  # fmt: skip


@dataclass(frozen=True)
class Refit(Options):
    """Parameters specific to a held-out recording: fitted on some of its poses, validated on the others.

    >>> gt.calibrate.Refit(["offset", "device"], every=4).every  # the first of every four poses refits them
    4
    """

    what: Annotated[
        list[Literal["offset", "scale", "device", "target"]],
        "offset and scale of the actuators, as after a new homing; frame of the device; place of the target",
    ]
    every: Annotated[
        int, Within(least=2), "the first of every n held-out poses is for the refit, the rest for validation"
    ] = 2


@dataclass(frozen=True, eq=False)
class CartPoints(Options):
    """Points of each cart along its guideway, measured in another set-up of the device (Dressler 2012, eq. (5.7)).

    at: (n,) increasing coordinates of the carts [m]. points: arm from 1 -> (n, 3) [m]; all other arms stay straight.

    >>> at = np.linspace(0.0, 2.0, 5)
    >>> carts = gt.calibrate.CartPoints(at, {1: np.column_stack([at, 1e-4 * at**2, 0 * at])})  # arm 1 bends
    >>> carts.points[1].shape, carts.quaternion
    ((5, 3), [1.0, 0.0, 0.0, 0.0])
    """

    at: np.ndarray
    points: Mapping[int, np.ndarray]
    quaternion: Annotated[
        list[float], Long(4), "orientation of that set-up in the frame of the poses, from common reference points"
    ] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])  # fmt: skip
    turn_std: Annotated[
        float | None, Unit("rad"), Within(above=0.0),
        "its standard deviation; if left out, only the poses determine it, and badly about the guideway",
    ] = field(default=None, kw_only=True)  # fmt: skip
