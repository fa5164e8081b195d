"""The control laws in Python, with the same operations in the same order as in C, and tables sampled at a constant
step."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from ..results.status import Status
from .exchange import Command, RobotFeedback

_WORD = b"GTTABLE1"


@dataclass(frozen=True)
class ReferenceTable:
    """A sampled reference: rows (n, columns) at multiples of `step_ms` [ms], with linear interpolation.

    >>> table = gt.loop.ReferenceTable(np.array([[0.0], [0.1]]), step_ms=4)
    >>> table.at(2)
    (<Status.OK: 0>, [0.05])
    """

    rows: np.ndarray
    step_ms: int = 4

    def to_bytes(self) -> bytes:
        """Return the content of the file that the C loop reads."""
        n, columns = self.rows.shape
        head = _WORD + struct.pack("<3Q", n, columns, self.step_ms)
        return head + np.ascontiguousarray(self.rows, dtype="<f8").tobytes()

    def at(self, time_ms: int) -> tuple[Status, list[float]]:
        """Interpolate the row at a time; after the end, return the last row. gt_traj_at in Python."""
        if not len(self.rows):
            return Status.OUT_OF_RANGE, []
        n, rest = divmod(time_ms, self.step_ms)
        last = len(self.rows) - 1
        n, weight = (last, 0.0) if n >= last else (n, rest / self.step_ms)
        below = self.rows[n]
        above = self.rows[n + 1] if weight > 0.0 else below
        if not (np.all(np.isfinite(below)) and np.all(np.isfinite(above))):
            return Status.NOT_FINITE, []
        with np.errstate(over="ignore"):
            between = above - below
        if not np.all(np.isfinite(between)):
            return Status.NOT_FINITE, []
        row = below + weight * between if weight > 0.0 else below
        return Status.OK, row.tolist()


Forward = Callable[[list[float]], tuple[Status, list[float]]]
InverseDynamics = Callable[[list[float], list[float], list[float]], tuple[Status, list[float]]]


def reference_columns(axes: int) -> int:
    """Return the number of columns of a reference: q, der(q), der(q,2) of the axes, then T, der(T), der(T,2)."""
    return 3 * axes + 9


class LoopLaw(Protocol):
    """A control law. Each method returns GT_OK or the reason why it cannot go on. `step` writes the command only if it
    returns GT_OK or the command is braking. reads_wrenches: the law needs the wrenches of two force sensors."""

    reads_wrenches: ClassVar[bool]

    def init(self, first: RobotFeedback) -> Status: ...

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status: ...


@dataclass
class TrajectoryLaw:
    """Law that moves the carts along an optimised motion.

    reference: columns q, der(q), der(q,2) of the carts, then T, der(T), der(T,2). With `feedforward` the law inverts
    the drives b q^-d / (1 - a q^-1) of Dressler 2012, eq. (6.11): a and b for each cart, delay d as `delay_ms`.
    """

    reads_wrenches: ClassVar[bool] = False
    reference: ReferenceTable
    axes: int
    feedforward: bool
    delay_ms: int
    cycle_ms: int
    a: list[float]
    b: list[float]
    start_m: list[float] = field(default_factory=list)

    def init(self, first: RobotFeedback) -> Status:
        if self.reference.rows.shape[1] != reference_columns(self.axes):
            return Status.OUT_OF_RANGE
        if self.feedforward and not all(abs(b) > 0 for b in self.b[: self.axes]):
            return Status.SINGULAR
        status, row = self.reference.at(0)
        self.start_m = row[: self.axes]
        return status

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        ahead = elapsed_ms + self.delay_ms if self.feedforward else elapsed_ms
        status, row = self.reference.at(ahead)
        before: list[float] = []
        if status is Status.OK:
            status, before = self.reference.at(max(0, ahead - self.cycle_ms))
        if status is not Status.OK:
            return status
        command.along_path = False
        for n in range(self.axes):
            command.position_m[n] = row[n]
            if self.feedforward:
                target, previous = row[n] - self.start_m[n], before[n] - self.start_m[n]
                command.position_m[n] = self.start_m[n] + (target - self.a[n] * previous) / self.b[n]
            command.speed_m_s[n] = row[self.axes + n]
        return Status.OK


@dataclass
class DynamicsLaw:
    """Law with inverse-dynamics feedforward for carts under a servo F = kp (u - q) + kd (du - dq).

    reference: as in `TrajectoryLaw`. kp_N_m, kd_N_s_m: the servo's gains for each cart; `sends_speed`: the servo also
    receives du; `lead_ms`: how far ahead the reference is read [ms]. joints: the axes are joints, and
    `inverse_dynamics` takes q, der(q), der(q,2) in place of T and its derivatives. The C version is gt_law_dynamics.h.
    """

    reads_wrenches: ClassVar[bool] = False
    reference: ReferenceTable
    axes: int
    inverse_dynamics: InverseDynamics | None
    feedforward: bool
    sends_speed: bool
    lead_ms: int
    kp_N_m: list[float]
    kd_N_s_m: list[float]
    joints: bool = False

    def init(self, first: RobotFeedback) -> Status:
        if self.inverse_dynamics is None or self.reference.rows.shape[1] != reference_columns(self.axes):
            return Status.OUT_OF_RANGE
        return Status.OK if all(kp > 0 for kp in self.kp_N_m[: self.axes]) else Status.SINGULAR

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        assert self.inverse_dynamics is not None
        status, row = self.reference.at(elapsed_ms + self.lead_ms)
        force: list[float] = []
        if status is Status.OK and self.feedforward:
            given, width = (row, self.axes) if self.joints else (row[3 * self.axes :], 3)
            status, force = self.inverse_dynamics(*(given[n * width : (n + 1) * width] for n in range(3)))
        if status is not Status.OK:
            return status
        command.along_path = False
        for n in range(self.axes):
            speed = row[self.axes + n]
            command.position_m[n] = row[n]
            if self.feedforward:
                damping = 0.0 if self.sends_speed else self.kd_N_s_m[n] * speed
                command.position_m[n] = row[n] + (force[n] + damping) / self.kp_N_m[n]
            command.speed_m_s[n] = speed
        return Status.OK


@dataclass
class ReplayLaw:
    """Law that adds a stored table of corrections, a column per cart [m], to a reference as in `TrajectoryLaw`."""

    reads_wrenches: ClassVar[bool] = False
    reference: ReferenceTable
    corrections: ReferenceTable
    axes: int

    def init(self, first: RobotFeedback) -> Status:
        misfit = self.corrections.rows.shape[1] != self.axes
        misfit = misfit or self.reference.rows.shape[1] != reference_columns(self.axes)
        return Status.OUT_OF_RANGE if misfit else Status.OK

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        status, row = self.reference.at(elapsed_ms)
        correction: list[float] = []
        if status is Status.OK:
            status, correction = self.corrections.at(elapsed_ms)
        if status is not Status.OK:
            return status
        command.along_path = False
        for n in range(self.axes):
            command.position_m[n] = row[n] + correction[n]
            command.speed_m_s[n] = row[self.axes + n]
        return Status.OK


@dataclass
class PathLaw:
    """Law for a robot that runs its own programme: the loop shifts the path by the integrated tool error.

    forward: forward kinematics, carts -> tool centre point [m]. gain_per_s: integral gain [1/s]. limit_m: bound on each
    component of the correction [m].
    """

    reads_wrenches: ClassVar[bool] = False
    axes: int
    forward: Forward | None
    gain_per_s: float
    limit_m: float
    last_ms: int = 0
    correction_m: list[float] = field(default_factory=lambda: [0.0] * 3)

    def init(self, first: RobotFeedback) -> Status:
        self.last_ms, self.correction_m = 0, [0.0] * 3
        usable = self.forward is not None and first.has_planned and self.limit_m >= 0
        return Status.OK if usable else Status.OUT_OF_RANGE

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        assert self.forward is not None
        seconds = (elapsed_ms - self.last_ms) / 1000.0
        status, planned = self.forward(feedback.planned_m[: self.axes])
        position: list[float] = []
        if status is Status.OK:
            status, position = self.forward(feedback.position_m[: self.axes])
        if status is not Status.OK:
            return status
        command.along_path = True
        self.last_ms = elapsed_ms
        for k in range(3):
            step = (self.gain_per_s * seconds) * (planned[k] - position[k])
            self.correction_m[k] = float(np.clip(self.correction_m[k] + step, -self.limit_m, self.limit_m))
            command.path_m[k] = self.correction_m[k]
        return Status.OK
