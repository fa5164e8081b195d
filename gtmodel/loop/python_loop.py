"""The loop in Python, cycle for cycle as gt_loop.c: fed with the same datagrams it writes the same log."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

from ..results.status import Status
from .exchange import AXES, Command, Exchange, RobotFeedback
from .laws import LoopLaw
from .pace import Arrival, LoopPace
from .record import COLUMNS
from .sequence import Sequence, near
from .wire import DATAGRAM_MAX

WAITING, RUNNING, HOLDING, RAMPING, STOPPED, BRAKING = range(6)
RAMP_MOST = 100_000  # cycles


@dataclass
class LoopLimits:
    """What a command must keep: carts [m], their change from cycle to cycle [m], a path correction [m].

    following_m: as far a cart may be from the last command that was answered [m].
    """

    lowest_m: list[float] = field(default_factory=lambda: [-10.0] * AXES)
    highest_m: list[float] = field(default_factory=lambda: [10.0] * AXES)
    step_m: float = 0.02
    path_m: float = 0.01
    following_m: float = 0.25


@dataclass
class Settings:
    """How the loop runs, and how it stops.

    dry: commands are logged, not sent. Without a command the last speed is held for hold_cycles; then it is ramped to
    zero, the fastest cart at deceleration_m_s2 [m/s2] or, where that is 0, over ramp_cycles, and the loop stays
    stopped. A command outside the limits, a robot that runs no more, a clock that disagrees with the numbers, and carts
    that do not follow start the ramp at once.
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
        self.pace = LoopPace()
        self.cycles = self.late = self.garbage = self.apart = self.datagrams = self.misses = 0
        self.ramp_left = self.ramp_cycles = 0
        self.ramp_from = [0.0] * AXES
        self.coasting_m, self.coasted_m = [0.0] * AXES, 0.0
        self.command = Command()
        self.sent_m, self.going_m_s = [0.0] * AXES, [0.0] * AXES  # of the last answer; without a law
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
            if self.feedback is not None:
                self.pace.note(self.feedback, feedback, self.peer.cycle_ms)
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
        if self.state == STOPPED:
            self.command.speed_m_s = [0.0] * AXES
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
        if fresh is not None or self.peer.protocol == "egm":
            self.sent_m = list(self.command.position_m)  # in a dry run as well
        self._record(answer)
        self.fresh, self.datagrams = None, 0
        return answer

    def _wait(self, first: RobotFeedback) -> None:
        self.peer.begin(first)
        self.command.position_m, self.sent_m = list(self.peer.start_m), list(self.peer.start_m)
        if first.running and self._is_apart(first):
            self.apart += 1
            self.state, self.status = STOPPED, Status.OUT_OF_RANGE
        elif first.running:
            self.pace.begin(first)
            self.status = self.law.init(first)
            self.state = RUNNING if self.status is Status.OK else STOPPED

    def _asks(self, feedback: RobotFeedback) -> Status:
        """OK if the law may be asked; else why not, and whether the ramp begins at once."""
        hold = self.settings.hold_cycles
        answered = self.peer.protocol == "egm"
        pace = self.pace.verdict(feedback, self.peer.cycle_ms, hold, answered=answered)
        if self._is_apart(feedback):
            self.apart += 1
            self.misses = hold
            return Status.OUT_OF_RANGE
        if not feedback.running or pace is Arrival.FALSE:
            self.misses = hold
            return Status.STALE_INPUT
        return Status.STALE_INPUT if pace is Arrival.MISS else Status.OK

    def _law(self, feedback: RobotFeedback) -> bool:
        """True if the law gave a command that counts."""
        self.status = self._asks(feedback)
        if self.status is not Status.OK:
            return False
        command = self.command.copy()
        command.braking = False
        elapsed_ms = self.pace.elapsed_ms + self.pace.cycles * self.peer.cycle_ms
        self.status = self.law.step(feedback, elapsed_ms, command)
        given = self.status is Status.OK or command.braking
        if given and not self._allowed(command):
            self.status, self.misses = Status.OUT_OF_RANGE, self.settings.hold_cycles
            return False
        if given:
            self._take(command, feedback)
        return given

    def _take(self, command: Command, feedback: RobotFeedback) -> None:
        """Running, or on the way to the stop that the law makes; without its next command the ramp begins at once."""
        moves = any(abs(x) > 0.0 for x in command.speed_m_s[: self.peer.axes])
        self._follow(command)
        self.pace.take(feedback, self.peer.cycle_ms)
        self.misses, self.state = 0, RUNNING
        if command.braking:
            self.misses, self.state = self.settings.hold_cycles, BRAKING if moves else STOPPED

    def _follow(self, command: Command) -> None:
        """The law's command counts; its speeds are the way there over the robot's time for it."""
        before, seconds = self.command.position_m, float(self.pace.moved) * self._cycle_s
        # behind cycles without the law that way is a correction too, at which nothing may go on
        plain = self.pace.held == 0 and self.pace.cycles <= 1
        self.command = command
        for n in range(self.peer.axes):
            stated = command.speed_m_s[n]
            command.speed_m_s[n] = (command.position_m[n] - before[n]) / seconds
            self.going_m_s[n] = command.speed_m_s[n] if plain else stated
            self.coasting_m[n] = 0.0

    @property
    def _cycle_s(self) -> float:
        return self.peer.cycle_ms / 1000.0

    def _is_apart(self, feedback: RobotFeedback) -> bool:
        """True if a cart is not where it was sent, unless the robot runs its own programme."""
        sent = zip(feedback.position_m[: self.peer.axes], self.sent_m, strict=False)
        return not self.command.along_path and not all(abs(x - u) <= self.settings.limits.following_m for x, u in sent)

    def _allowed(self, command: Command) -> bool:
        limits = self.settings.limits
        if command.along_path:
            return all(abs(x) <= limits.path_m for x in command.path_m)
        return all(
            limits.lowest_m[n] <= command.position_m[n] <= limits.highest_m[n]
            and abs(command.position_m[n] - self.command.position_m[n]) <= limits.step_m
            and abs(command.position_m[n] - self.sent_m[n]) <= limits.step_m
            and abs(command.speed_m_s[n] * self._cycle_s) <= limits.step_m
            for n in range(self.peer.axes)
        )

    def _coast(self, speed: list[float], share: float) -> None:
        """The carts go on, within the limits, and no further than a step from what was answered last.

        A robot may stand outside of the limits: from there it goes no further out, and never jumps to them.
        """
        limits, seconds = self.settings.limits, self._cycle_s
        for n in range(self.peer.axes):
            before, now = self.command.position_m[n], speed[n] * share
            wanted = before + now * seconds
            near = _clamped(wanted, self.sent_m[n] - limits.step_m, self.sent_m[n] + limits.step_m)
            moved = _clamped(near, min(before, limits.lowest_m[n]), max(before, limits.highest_m[n]))
            self.command.position_m[n] = moved
            self.command.speed_m_s[n] = (moved - before) / seconds if moved != wanted else now
            self.coasting_m[n] += abs(self.command.speed_m_s[n] * seconds)
            self.coasted_m = max(self.coasted_m, self.coasting_m[n])

    def _miss(self) -> None:
        self.misses += 1
        self.pace.held += 1
        if self.misses <= self.settings.hold_cycles:
            self.state = HOLDING
            self._coast(self.going_m_s, 1.0)
        else:
            self._begin_ramp()

    def _begin_ramp(self) -> None:
        self.state = RAMPING
        self.ramp_cycles = self.ramp_left = self._ramp_length()
        self.ramp_from = list(self.going_m_s)

    def _ramp_length(self) -> int:
        """Cycles of a ramp to zero: the fastest cart at the declared deceleration, and never fewer than that takes."""
        lost = self.settings.deceleration_m_s2 * self._cycle_s
        if not lost > 0.0:
            return self.settings.ramp_cycles
        cycles = max(abs(x) for x in self.going_m_s[: self.peer.axes]) / lost
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
            *(self.settings.dry, self.pace.faults, self.apart),
        ]
        self.log += struct.pack(f"<{len(COLUMNS)}d", *numbers)


def _clamped(value: float, lowest: float, highest: float) -> float:
    return lowest if value < lowest else min(value, highest)


def _hash(data: bytes) -> int:
    """FNV-1a of 32 bits."""
    value = 2166136261
    for byte in data:
        value = (value ^ byte) * 16777619 & 0xFFFFFFFF
    return value
