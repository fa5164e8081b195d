"""Translate between protocols and laws: datagrams to feedback, commands to answers (gt_peer in Python)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from . import egm, rsi
from .egm import WireError
from .wrenches import Wrench, read_egm, read_rsi

AXES = 6
CYCLE_MS = 4
MM = 1000.0
DEGREES = math.degrees(1.0)
Protocol = Literal["egm", "rsi"]


@dataclass
class RobotFeedback:
    """The state that a robot reports in a datagram; the thesis calls it the submit state.

    position_m, planned_m: measured and planned positions of carts [m] or joints [rad]; planned_m is valid if
    `has_planned`. joints_deg: joints [deg]. time_ms: the robot's clock [ms]. sequence: number of the datagram. running:
    whether the robot follows commands. wrenches: of the force sensors at handle and tool, if a law reads them and the
    robot sent both.
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

    position_m, speed_m_s: positions and speeds of carts [m, m/s] or joints [rad, rad/s]. path_m: offset of the tool
    centre point's path [m], used instead if `along_path`. braking: the law is bringing the motion to a stop; its status
    says why.
    """

    position_m: list[float] = field(default_factory=lambda: [0.0] * AXES)
    speed_m_s: list[float] = field(default_factory=lambda: [0.0] * AXES)
    path_m: list[float] = field(default_factory=lambda: [0.0] * 3)
    along_path: bool = False
    braking: bool = False

    def copy(self) -> Command:
        return Command(list(self.position_m), list(self.speed_m_s), list(self.path_m), self.along_path, self.braking)


class Exchange:
    """Reads and answers datagrams of one protocol, "egm" or "rsi", for `axes` carts, or joints.

    joints: the axes are joints of an arm, in degrees outside and in rad inside, in place of carts in mm and m.
    cycle_ms: cycle of the robot. reads_wrenches: set by the loop if its law needs wrenches. `read` returns a
    `RobotFeedback`, or None if the datagram cannot be read.

    >>> gt.loop.Exchange("egm", axes=3).read(b"no datagram") is None
    True
    """

    def __init__(self, protocol: Protocol, axes: int, cycle_ms: int = 4, *, joints: bool = False) -> None:
        self.protocol, self.axes, self.cycle_ms, self.joints = protocol, axes, cycle_ms, joints
        self.unit = DEGREES if joints else MM
        self.start_m = [0.0] * AXES
        self.reads_wrenches = False

    def read(self, data: bytes) -> RobotFeedback | None:
        """Return the feedback, or None for a datagram of another protocol or type (EGM), or without all axes."""
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
        measured, planned = (
            p.joints_deg if self.joints else p.external_mm for p in (robot.feedback, robot.planned)
        )  # fmt: skip
        if len(measured) < self.axes or robot.type not in (egm.TYPE_DATA, egm.TYPE_UNDEFINED):
            return None
        same = len(robot.planned.joints_deg) == len(robot.feedback.joints_deg)
        return RobotFeedback(
            sequence=robot.sequence,
            time_ms=robot.time_ms,
            position_m=self._inside(measured),
            planned_m=self._inside(planned),
            has_planned=len(planned) >= self.axes,
            running=robot.mci_state == egm.MCI_RUNNING and robot.motor_state != egm.MOTORS_OFF,
            joints_deg=robot.planned.joints_deg if same else robot.feedback.joints_deg,
        )

    def _read_rsi(self, data: bytes) -> RobotFeedback | None:
        robot = rsi.decode_robot(data)
        axes = (1 << self.axes) - 1
        measured, planned = ("AIPos", "ASPos") if self.joints else ("EIPos", "ESPos")
        if robot.given.get(measured, 0) & axes != axes:
            return None
        return RobotFeedback(
            sequence=robot.ipoc // self.cycle_ms,
            time_ms=robot.ipoc,
            position_m=self._inside(robot.values[measured]),
            planned_m=self._inside(robot.values.get(planned, [])),
            has_planned=robot.given.get(planned, 0) & axes == axes,
            running=True,
            delay=robot.delay,
            stamp=robot.stamp,
        )

    def _inside(self, values: list[float]) -> list[float]:
        """Return positions [m, rad] from those of the protocol [mm, deg]."""
        axes = [x / self.unit for x in values[: self.axes]]
        return axes + [0.0] * (AXES - len(axes))

    def _write_egm(self, feedback: RobotFeedback, command: Command) -> bytes:
        sensor = egm.EgmSensor(feedback.sequence & 0xFFFFFFFF, feedback.time_ms & 0xFFFFFFFF)
        if command.along_path:
            sensor.path_mm = [x * MM for x in command.path_m]
            return egm.encode_sensor(sensor)
        sensor.joints_deg = list(feedback.joints_deg)
        sensor.joint_speeds_deg_s = [0.0] * len(feedback.joints_deg)
        positions = [x * self.unit for x in command.position_m[: self.axes]]
        speeds = [x * self.unit for x in command.speed_m_s[: self.axes]]
        if self.joints:
            sensor.joints_deg[: self.axes], sensor.joint_speeds_deg_s[: self.axes] = positions, speeds
        else:
            sensor.external_mm, sensor.external_speeds_mm_s = positions, speeds
        return egm.encode_sensor(sensor)

    def _write_rsi(self, feedback: RobotFeedback, command: Command) -> bytes:
        sensor = rsi.RsiSensor(feedback.stamp)
        for n in range(3 if command.along_path else 0):
            sensor.rkorr[n] = command.path_m[n] * MM
        corrections = sensor.ak_deg if self.joints else sensor.ek_mm
        for n in range(0 if command.along_path else self.axes):
            corrections[n] = (command.position_m[n] - self.start_m[n]) * self.unit
        return rsi.encode_sensor(sensor)
