"""The loop in Python, cycle for cycle as gt_loop.c: fed with the same datagrams it writes the same log."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

from ..results.status import Status
from .exchange import AXES, Command, Exchange, RobotFeedback
from .laws import LoopLaw
from .record import COLUMNS
from .sequence import Sequence, near
from .wire import DATAGRAM_MAX

WAITING, RUNNING, HOLDING, RAMPING, STOPPED, BRAKING = range(6)
RAMP_MOST = 100_000  # cycles


@dataclass
class LoopLimits:
    """What a command must keep: carts [m], their change in a cycle [m], a path correction [m]."""

    lowest_m: list[float] = field(default_factory=lambda: [-10.0] * AXES)
    highest_m: list[float] = field(default_factory=lambda: [10.0] * AXES)
    step_m: float = 0.02
    path_m: float = 0.01


@dataclass
class Settings:
    """How the loop runs, and how it stops.

    dry: commands are logged, not sent. Without a command the last speed is held for hold_cycles; then it is ramped to
    zero, the fastest cart at deceleration_m_s2 [m/s2] or, where that is 0, over ramp_cycles, and the loop stays
    stopped. A command outside the limits, and a robot that runs no more, start the ramp at once.
    """

    dry: bool = True
    hold_cycles: int = 5
    ramp_cycles: int = 50
    deceleration_m_s2: float = 0.0
    limits: LoopLimits = field(default_factory=LoopLimits)


class PythonLoop:
    """gt_loop in Python. `exchange` takes the datagrams of a cycle and returns the answers, one or none."""

    def __init__(self, settings: Settings, peer: Exchange, law: LoopLaw) -> None:
        self.settings, self.peer, self.law = settings, peer, law
        peer.reads_wrenches = law.reads_wrenches
        self.sequence = Sequence()
        self.state, self.status = WAITING, Status.STALE_INPUT
        self.fresh: RobotFeedback | None = None
        self.feedback: RobotFeedback | None = None
        self.first_ms = self.command_ms = self.cycles = self.late = self.garbage = self.datagrams = self.misses = (
            self.ramp_left
        ) = self.ramp_cycles = 0
        self.ramp_from = [0.0] * AXES
        self.coasting_m, self.coasted_m = [0.0] * AXES, 0.0
        self.command = Command()
        self.log = bytearray()

    def exchange(self, datagrams: list[bytes]) -> list[bytes]:
        """One cycle: its datagrams in, its answers out."""
        for data in datagrams:
            self.datagram(data)
        answer = self.cycle()
        return [answer] if answer else []

    def datagram(self, data: bytes) -> None:
        """Take one datagram of this cycle; any bytes are allowed."""
        self.datagrams += 1
        feedback = self.peer.read(data) if len(data) <= DATAGRAM_MAX else None
        if feedback is None:
            self.garbage += 1
        elif self._is_newer(feedback):
            self.feedback = self.fresh = feedback

    def stop(self) -> None:
        """No more commands of the law: the cycles that follow ramp to a stop."""
        if self.state == WAITING:
            self.state = STOPPED
        if self.state in (RUNNING, HOLDING):
            self._begin_ramp()

    def _is_newer(self, feedback: RobotFeedback) -> bool:
        """True if it is newer than all before; number and time of EGM, of 32 bits, go on where they run over."""
        if self.peer.protocol != "egm":
            return self.sequence.take(feedback.sequence)
        if self.feedback is not None:
            feedback.time_ms = max(0, near(self.feedback.time_ms, feedback.time_ms))
        number = self.sequence.take_32(feedback.sequence)
        feedback.sequence = feedback.sequence if number is None else number
        return number is not None

    def cycle(self) -> bytes:
        """End the cycle: the answer to the newest datagram, empty for none, and a record in the log."""
        fresh = self.fresh
        self.cycles += 1
        if fresh is not None and self.state == WAITING:
            self._wait(fresh)
        if self.state in (RUNNING, HOLDING, BRAKING):
            if self.state != BRAKING:
                self.status = Status.STALE_INPUT  # else it says already why the motion ends
            if fresh is None or not self._law(fresh):
                self._miss()
        if self.state == RAMPING:
            self._ramp()
        self.late += fresh is None and self.feedback is not None
        answer = self._answer(fresh is not None)
        self._record(answer)
        self.fresh, self.datagrams = None, 0
        return answer

    def _wait(self, first: RobotFeedback) -> None:
        self.peer.begin(first)
        self.command.position_m = list(self.peer.start_m)
        if first.running:
            self.first_ms = self.command_ms = first.time_ms
            self.status = self.law.init(first)
            self.state = RUNNING if self.status is Status.OK else STOPPED

    def _law(self, feedback: RobotFeedback) -> bool:
        """True if the law gave a command that counts."""
        command = self.command.copy()
        command.braking = False
        if not feedback.running:
            self.misses = self.settings.hold_cycles
            self.status = Status.STALE_INPUT
            return False
        if feedback.time_ms < self.command_ms:
            self.status = Status.STALE_INPUT
            return False
        self.status = self.law.step(feedback, feedback.time_ms - self.first_ms, command)
        given = self.status is Status.OK or command.braking
        if given and not self._allowed(command, self._passed(feedback)):
            self.status, self.misses = Status.OUT_OF_RANGE, self.settings.hold_cycles
            return False
        if given:
            self._take(command, feedback)
        return given

    def _take(self, command: Command, feedback: RobotFeedback) -> None:
        """Running, or on the way to the stop that the law makes; without its next command the ramp begins at once."""
        self.command, self.command_ms = command, feedback.time_ms
        self.coasting_m = [0.0] * AXES
        self.misses, self.state = 0, RUNNING
        if command.braking:
            moves = any(abs(x) > 0.0 for x in command.speed_m_s[: self.peer.axes])
            self.misses, self.state = self.settings.hold_cycles, BRAKING if moves else STOPPED

    def _passed(self, feedback: RobotFeedback) -> int:
        """Cycles of the robot's clock since the last command; no more than may be held, whatever the clock says."""
        cycles = (feedback.time_ms - self.command_ms) // self.peer.cycle_ms
        return max(1, min(cycles, self.settings.hold_cycles + 1))

    def _allowed(self, command: Command, cycles: int) -> bool:
        limits = self.settings.limits
        if command.along_path:
            return all(abs(x) <= limits.path_m for x in command.path_m)
        return all(
            limits.lowest_m[n] <= command.position_m[n] <= limits.highest_m[n]
            and abs(command.position_m[n] - self.command.position_m[n]) <= limits.step_m * cycles
            and math.isfinite(command.speed_m_s[n])
            for n in range(self.peer.axes)
        )

    def _coast(self, speed: list[float], share: float) -> None:
        limits, seconds = self.settings.limits, self.peer.cycle_ms / 1000.0
        for n in range(self.peer.axes):
            now = speed[n] * share
            moved = self.command.position_m[n] + now * seconds
            lowest, highest = limits.lowest_m[n], limits.highest_m[n]
            self.command.position_m[n] = lowest if moved < lowest else min(moved, highest)
            self.command.speed_m_s[n] = now
            self.coasting_m[n] += abs(now * seconds)
            self.coasted_m = max(self.coasted_m, self.coasting_m[n])

    def _miss(self) -> None:
        self.misses += 1
        if self.misses <= self.settings.hold_cycles:
            self.state = HOLDING
            self._coast(self.command.speed_m_s, 1.0)
        else:
            self._begin_ramp()

    def _begin_ramp(self) -> None:
        self.state = RAMPING
        self.ramp_cycles = self.ramp_left = self._ramp_length()
        self.ramp_from = list(self.command.speed_m_s)

    def _ramp_length(self) -> int:
        """Cycles of a ramp to zero: the fastest cart at the declared deceleration, and never fewer than that takes."""
        lost = self.settings.deceleration_m_s2 * (self.peer.cycle_ms / 1000.0)
        if not lost > 0.0:
            return self.settings.ramp_cycles
        cycles = max(abs(x) for x in self.command.speed_m_s[: self.peer.axes]) / lost
        return math.ceil(cycles) if cycles < RAMP_MOST else RAMP_MOST

    def _ramp(self) -> None:
        if self.ramp_left > 0:
            self.ramp_left -= 1
            self._coast(self.ramp_from, self.ramp_left / self.ramp_cycles)
        if self.ramp_left == 0:
            self._coast(self.ramp_from, 0.0)
            self.state = STOPPED

    def _answer(self, fresh: bool) -> bytes:
        if self.feedback is None or (not fresh and self.peer.protocol == "rsi"):
            return b""
        command = self.command
        if self.settings.dry:
            if self.peer.protocol == "egm":
                return b""
            command = Command(position_m=list(self.peer.start_m))
        return self.peer.write(self.feedback, command)

    def _record(self, answer: bytes) -> None:
        f, s = self.feedback or RobotFeedback(0, 0, [0.0] * AXES, [], False, False), self.sequence
        numbers = [
            *(self.cycles, f.sequence, f.time_ms, self.state, int(self.status), self.datagrams),
            *(self.late, s.lost, s.repeated, s.reordered, s.stale, self.garbage),
            *(f.delay, len(answer), _hash(answer)),
            *f.position_m,
            *self.command.position_m,
            *self.command.speed_m_s,
            *self.command.path_m,
            self.settings.dry,
        ]
        self.log += struct.pack(f"<{len(COLUMNS)}d", *numbers)


def _hash(data: bytes) -> int:
    """FNV-1a of 32 bits."""
    value = 2166136261
    for byte in data:
        value = (value ^ byte) * 16777619 & 0xFFFFFFFF
    return value
