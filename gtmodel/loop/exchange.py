"""Translate between protocols and laws: datagrams to feedback, commands to answers (gt_peer in Python)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from . import egm, rsi
from .egm import WireError
from .wrenches import Wrench, read_egm, read_rsi

AXES = 6
CYCLE_MS = 4
MM = 1000.0
Protocol = Literal["egm", "rsi"]


@dataclass
class RobotFeedback:
    """The state that a robot reports in a datagram; the thesis calls it the submit state.

    position_m, planned_m: measured and planned cart positions [m]; planned_m is valid if `has_planned`. joints_deg:
    joints [deg]. time_ms: the robot's clock [ms]. sequence: number of the datagram. running: whether the robot follows
    commands. wrenches: of the force sensors at handle and tool, if a law reads them and the robot sent both.
    """

    sequence: int
    time_ms: int
    position_m: list[float]
    planned_m: list[float]
    has_planned: bool
    running: bool
    delay: int = 0
    joints_deg: list[float] = field(default_factory=list)
    stamp: bytes = b""
    wrenches: tuple[Wrench, Wrench] | None = None


@dataclass
class Command:
    """The loop's command to the robot; the thesis calls it the obtain state.

    position_m, speed_m_s: cart positions [m] and speeds [m/s]. path_m: offset of the tool centre point's path [m], used
    instead if `along_path`. braking: the law is bringing the motion to a stop; its status says why.
    """

    position_m: list[float] = field(default_factory=lambda: [0.0] * AXES)
    speed_m_s: list[float] = field(default_factory=lambda: [0.0] * AXES)
    path_m: list[float] = field(default_factory=lambda: [0.0] * 3)
    along_path: bool = False
    braking: bool = False

    def copy(self) -> Command:
        return Command(list(self.position_m), list(self.speed_m_s), list(self.path_m), self.along_path, self.braking)


class Exchange:
    """Reads and answers datagrams of one protocol, "egm" or "rsi", for `axes` carts.

    cycle_ms: cycle of the robot. reads_wrenches: set by the loop if its law needs wrenches. `read` returns a
    `RobotFeedback`, or None if the datagram cannot be read.

    >>> gt.loop.Exchange("egm", axes=3).read(b"no datagram") is None
    True
    """

    def __init__(self, protocol: Protocol, axes: int, cycle_ms: int = 4) -> None:
        self.protocol, self.axes, self.cycle_ms = protocol, axes, cycle_ms
        self.start_m = [0.0] * AXES
        self.reads_wrenches = False

    def read(self, data: bytes) -> RobotFeedback | None:
        """Return the feedback, or None if the datagram is of another protocol or type (EGM) or lacks a cart."""
        try:
            feedback = self._read_egm(data) if self.protocol == "egm" else self._read_rsi(data)
        except (WireError, rsi.TelegramError):
            return None
        if feedback is not None and self.reads_wrenches:
            feedback.wrenches = (read_egm if self.protocol == "egm" else read_rsi)(data)
        return feedback

    def begin(self, first: RobotFeedback) -> None:
        """Take this feedback as the zero of corrections."""
        self.start_m = list(first.planned_m if first.has_planned else first.position_m)

    def write(self, feedback: RobotFeedback, command: Command) -> bytes:
        """Return the answer; empty if it cannot be written."""
        if self.protocol == "egm":
            return self._write_egm(feedback, command)
        try:
            return self._write_rsi(feedback, command)
        except ValueError:
            return b""

    def _read_egm(self, data: bytes) -> RobotFeedback | None:
        robot = egm.decode_robot(data)
        if len(robot.feedback.external_mm) < self.axes or robot.type not in (egm.TYPE_DATA, egm.TYPE_UNDEFINED):
            return None
        planned = len(robot.planned.external_mm) >= self.axes
        same = len(robot.planned.joints_deg) == len(robot.feedback.joints_deg)
        return RobotFeedback(
            sequence=robot.sequence,
            time_ms=robot.time_ms,
            position_m=self._metres(robot.feedback.external_mm),
            planned_m=self._metres(robot.planned.external_mm),
            has_planned=planned,
            running=robot.mci_state == egm.MCI_RUNNING and robot.motor_state != egm.MOTORS_OFF,
            joints_deg=robot.planned.joints_deg if same else robot.feedback.joints_deg,
        )

    def _read_rsi(self, data: bytes) -> RobotFeedback | None:
        robot = rsi.decode_robot(data)
        carts = (1 << self.axes) - 1
        if robot.given.get("EIPos", 0) & carts != carts:
            return None
        return RobotFeedback(
            sequence=robot.ipoc // self.cycle_ms,
            time_ms=robot.ipoc,
            position_m=self._metres(robot.values["EIPos"]),
            planned_m=self._metres(robot.values.get("ESPos", [])),
            has_planned=robot.given.get("ESPos", 0) & carts == carts,
            running=True,
            delay=robot.delay,
            stamp=robot.stamp,
        )

    def _metres(self, values_mm: list[float]) -> list[float]:
        carts = [x / MM for x in values_mm[: self.axes]]
        return carts + [0.0] * (AXES - len(carts))

    def _write_egm(self, feedback: RobotFeedback, command: Command) -> bytes:
        sensor = egm.EgmSensor(feedback.sequence & 0xFFFFFFFF, feedback.time_ms & 0xFFFFFFFF)
        if command.along_path:
            sensor.path_mm = [x * MM for x in command.path_m]
            return egm.encode_sensor(sensor)
        sensor.joints_deg = list(feedback.joints_deg)
        sensor.joint_speeds_deg_s = [0.0] * len(feedback.joints_deg)
        sensor.external_mm = [x * MM for x in command.position_m[: self.axes]]
        sensor.external_speeds_mm_s = [x * MM for x in command.speed_m_s[: self.axes]]
        return egm.encode_sensor(sensor)

    def _write_rsi(self, feedback: RobotFeedback, command: Command) -> bytes:
        sensor = rsi.RsiSensor(feedback.stamp)
        for n in range(3 if command.along_path else 0):
            sensor.rkorr[n] = command.path_m[n] * MM
        for n in range(0 if command.along_path else self.axes):
            sensor.ek_mm[n] = (command.position_m[n] - self.start_m[n]) * MM
        return rsi.encode_sensor(sensor)
